"""``vibroswarm show``: the state and the results of whatever a command has written."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli.options import add_json, run_plain
from vibroswarm.cli.output import add_open, open_page
from vibroswarm.cli.terminal import printing
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.show.document import Document
    from vibroswarm.study.store import Store


EPILOG = """\
examples:
  vibroswarm show first            a run: its verdict
  vibroswarm show out/study        a study: how much is done, and its tables; --wide for all columns
  vibroswarm show out/league --open
  vibroswarm show mine.toml        a scenario: what differs from preset paper
"""
PAGES = ("report.html", "run.html", "run-1.html")
"""Pages that commands write, in the order in which ``--open`` looks for them."""


def add_parser(commands: Any) -> None:
    """Add the command ``show`` and its options to the program's commands."""
    parser = commands.add_parser(
        "show",
        help="show the state and the results of a folder or file that a command has written",
        description="Show what a command has written: runs, studies, searches, leagues, reproductions, recordings, "
        "scenarios, floors, tables. Prints the results again, how much is done, and what is damaged or failed.",
        epilog=EPILOG,
    )
    parser.add_argument("folder", metavar="PATH", type=Path, help="folder or file that a command has written")
    add_json(parser)
    add_open(parser, "open its page or report in the browser")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print what a folder or file holds, and with ``--open`` open its page; return the exit code.

    Raises:
        InputError: the path cannot be shown; or ``--open`` is given for a file, or for a folder without a page.
    """
    path: Path = arguments.folder
    if _is_result(path):
        if printing.own_process and not _needs_kernels(path):
            run_plain()
        _show_result(path, arguments)
    elif path.is_dir():
        _show_folder(path, arguments)
    else:
        from vibroswarm.cli.show_file import show_file

        show_file(path, arguments)
    if arguments.open:
        pages = [path / name for name in PAGES if (path / name).is_file()]
        if not pages:
            raise InputError("has no page to open", field=str(path))
        open_page(pages[0])
    return 0


OTHERS: Final = ("printed.json", "study.json", "search.json", "search.toml")
"""Files of folders that hold more than a result. Their names are repeated here, since importing them takes longer than
showing a run; a test compares them."""
MOST_CHARACTERS: Final = 1_000_000
"""Most characters of a scenario that are searched."""


def _is_result(folder: Path) -> bool:
    """Return whether a folder holds a result and nothing else that this command shows."""
    return (folder / "result.json").is_file() and not any(os.path.lexists(folder / name) for name in OTHERS)


def _needs_kernels(folder: Path) -> bool:
    """Return whether showing a result computes so much that kernels must be loaded, which takes half a second.

    Only the readings near edges of tiles do, and only scenarios that name the fields of edges have such readings.
    """
    try:
        with (folder / "scenario.toml").open(encoding="utf-8") as scenario:
            return "edge" in scenario.read(MOST_CHARACTERS)
    except (OSError, UnicodeError):  # reported when the result is read
        return True


def _show_folder(folder: Path, arguments: argparse.Namespace) -> None:
    """Print what a folder holds: the state of a study or search, and the results.

    Results are printed as the command printed them, from the file ``printed.json``. If the folder has no such file, a
    study is summarised again, and ``_show_result`` describes runs, recordings and tables.

    Raises:
        InputError: the folder holds a damaged search, or nothing that a command writes.
    """
    from vibroswarm.cli.deliver import print_in_terminal
    from vibroswarm.cli.out_folder import read_printed
    from vibroswarm.cli.output import print_json, print_line, print_paragraph
    from vibroswarm.optimize.journal import HEAD as SEARCH_HEAD
    from vibroswarm.optimize.journal import SEARCH, held, is_search
    from vibroswarm.show.data import document_data
    from vibroswarm.study.store import HEAD, Store

    state: dict[str, Any] = {}
    lines: list[str] = []
    store = None
    printed = read_printed(folder)
    # A search has two files. A folder that has at least one of their names, but not both as regular files, is a damaged
    # search.
    if is_search(folder) or any(os.path.lexists(folder / name) for name in (SEARCH_HEAD, SEARCH)):
        if not is_search(folder):
            raise InputError(
                f"is a damaged search: {SEARCH_HEAD} or {SEARCH} is missing or no plain file",
                field=str(folder),
            )
        state = held(folder)
        lines = search_lines(state, is_validated=printed is not None)
    elif (folder / HEAD).exists():
        from vibroswarm.documents.study_state import state_sentences, study_state

        store = Store.open(folder)
        state = study_state(store)
        lines = state_sentences(state)
    if printed is None and not state:  # neither saved output nor a study or search
        _show_result(folder, arguments)
        return
    if arguments.json:
        document = dict(state)
        if printed is not None:
            document |= {"command": printed.command} | document_data(printed.document)
        elif store is not None:
            results, needed = results_or_need(store)
            document |= {"results_need": needed} if needed else {}
            document |= {} if results is None else document_data(results)
        print_json(document)
        return
    for line in lines:
        # A command is not broken into lines, so that it can be copied.
        print_text = print_line if line.startswith("To resume") else print_paragraph
        print_text(line)
    if printed is not None:
        if lines:
            print_line()
        print_in_terminal(printed.document)
    elif store is not None:
        print_results(store)


def _show_result(folder: Path, arguments: argparse.Namespace) -> None:
    """Print the document of a result; for any other folder, print the names of its tables and pictures."""
    from vibroswarm.cli.options import read_result

    if not (folder / "result.json").exists():
        from vibroswarm.cli.show_file import show_tables

        show_tables(folder, arguments)
        return
    from vibroswarm.cli.deliver import print_result
    from vibroswarm.documents.run import result_document

    print_result(result_document(read_result(folder)), arguments)


OF_CODE: Final = ("strategy.name", "network.name", "task.name")
"""Fields of a scenario that may name the user's own code."""


def search_lines(about: dict[str, Any], *, is_validated: bool) -> list[str]:
    """Describe the state of a search's folder in sentences.

    Args:
        about: the content of the folder, as ``journal.held`` returns it. is_validated: whether the folder has results.
    """
    done, requested = about["runs_there"], about["runs_wanted"]
    lines = [
        f"Search in {about['folder']}: {about['method']}, {' and '.join(about['objectives'])}, seed {about['seed']}.",
        f"Done: {done:,} of {requested:,} runs ({100 * done / max(requested, 1):.4g} %), in {about['steps']} steps; "
        f"{about['runs_failed']:,} failed.",
        f"Fields: {', '.join(about['fields'])}.",
    ]
    if not is_validated:
        lines.append("Not validated on fresh runs yet; run the same optimize command to resume.")
    return lines


def results_of(store: Store) -> Document | None:
    """Return what the finished runs of a study say; None if no run is finished.

    If the folder holds a repetition of the study on other seeds (``SECOND``), the document states which comparisons are
    confirmed by it.
    """
    from vibroswarm.documents.study import study_document
    from vibroswarm.study.cell_comparison import SECOND
    from vibroswarm.study.store import HEAD
    from vibroswarm.study.study_result import StudyResult
    from vibroswarm.study.summary import outcome_of

    every_cell = tuple(cell.number for cell in store.study.cells)
    result = StudyResult(store.study, store, selected=every_cell)
    if not result.cells["there"].sum():
        return None
    second = store.folder / SECOND
    repetition = StudyResult.open(second) if (second / HEAD).exists() else None
    # The table is there if strategies were compared at equal error when the study was run.
    equal_error = (store.folder / "equal_error.csv").is_file()
    return study_document(outcome_of(result, repetition, equal_error=equal_error))


def results_or_need(store: Store) -> tuple[Document | None, str]:
    """Return the results of a study (``results_of``) and an empty text; or None and the user's code that they need.

    Results may need a strategy, network or task of the user. Without ``--trust``, ``show`` does not run such code; then
    the results are None, and the text states which code is needed. If no run of the study is finished, the results are
    None and the text is empty.
    """
    try:
        return results_of(store), ""
    except InputError as error:
        if error.field not in OF_CODE:
            raise
        return None, str(error)


def print_results(store: Store) -> None:
    """Print what a study says, or which code of the user it needs; print nothing if no run is finished."""
    from vibroswarm.cli.deliver import print_in_terminal
    from vibroswarm.cli.output import print_line, print_paragraph

    document, needed = results_or_need(store)
    if needed:
        print_paragraph(
            f"Results need code that is not loaded ({needed}). Run the command that made them again to print them."
        )
    if document is not None:
        print_line()
        print_in_terminal(document)
