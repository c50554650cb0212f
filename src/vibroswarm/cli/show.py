"""``vibroswarm show``: the state and the results of whatever a command has written."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.options import Json, run_plain
from vibroswarm.cli.output import open_page
from vibroswarm.cli.terminal import printing
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.documents.saved import Printed
    from vibroswarm.study.store import Store


PAGES = ("report.html", "run.html", "run-1.html")
"""Pages that commands write, in the order in which ``--open`` looks for them."""


def show(
    path: Annotated[Path, Option("folder or file that a command has written", "PATH")],
    /,
    *,
    json: Json = False,
    open: Annotated[bool, Option("open its page or report in the browser")] = False,
) -> None:
    """Show what a command has written: runs, studies, searches, leagues, recordings, scenarios, floors, tables.

    Prints the results again, how much is done, and what is damaged or failed.

    examples:
      vibroswarm show first            a run: its verdict
      vibroswarm show out/study        a study: how much is done, and its tables; --wide for all columns
      vibroswarm show out/league --open
      vibroswarm show mine.toml        a scenario: what differs from preset paper
    """
    if _is_result(path):
        if printing.own_process and not _needs_kernels(path):
            run_plain()
        _show_result(path, json)
    elif path.is_dir():
        _show_folder(path, json)
    else:
        from vibroswarm.cli.deliver import print_document
        from vibroswarm.cli.floors import in_terminal
        from vibroswarm.documents.shown_file import file_document

        print_document(file_document(path, in_terminal), as_json=json)
    if open:
        pages = [path / name for name in PAGES if (path / name).is_file()]
        if not pages:
            raise InputError("has no page to open", field=str(path))
        open_page(pages[0])


MOST_CHARACTERS: Final = 1_000_000
"""Most characters of a scenario that are searched."""


def _is_result(folder: Path) -> bool:
    """Return whether a folder holds a result and nothing else that this command shows."""
    from vibroswarm.core.folders import kind_of
    from vibroswarm.documents.saved import PRINTED

    return kind_of(folder) in ("result", "recording") and not os.path.lexists(folder / PRINTED)


def _needs_kernels(folder: Path) -> bool:
    """Return whether showing a result computes so much that kernels must be loaded, which takes half a second.

    Only the readings near edges of tiles do, and only scenarios that name the fields of edges have such readings.
    """
    try:
        with (folder / "scenario.toml").open(encoding="utf-8") as scenario:
            return "edge" in scenario.read(MOST_CHARACTERS)
    except (OSError, UnicodeError):  # reported when the result is read
        return True


def _show_folder(folder: Path, json: bool) -> None:
    """Print what a folder holds: the state of a study or search, and the results.

    Results are printed as the command printed them, from the file ``printed.json``. If there is none, or it is damaged,
    a study is summarised again, and ``_show_result`` describes runs, recordings and tables.

    Raises:
        InputError: the folder holds a damaged search, or nothing that a command writes.
    """
    from vibroswarm.cli.deliver import print_document
    from vibroswarm.cli.output import print_json, print_line, print_paragraph
    from vibroswarm.core.folders import kind_of
    from vibroswarm.show.data import document_data

    state: dict[str, Any] = {}
    lines: list[str] = []
    store = None
    kind, printed = kind_of(folder), _printed(folder)
    if kind == "search":
        from vibroswarm.documents.search import search_sentences
        from vibroswarm.optimize.steps import held

        state = held(folder)
        lines = search_sentences(state, is_validated=printed is not None)
    elif kind == "study":
        from vibroswarm.documents.study_results import results_or_need
        from vibroswarm.documents.study_state import state_sentences, study_state
        from vibroswarm.study.store import Store

        store = Store.open(folder)
        state = study_state(store)
        lines = state_sentences(state)
    if printed is None and not state:  # neither saved output nor a study or search
        _show_result(folder, json)
        return
    if json:
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
        print_document(printed.document)
    elif store is not None:
        print_results(store)


def _printed(folder: Path) -> Printed | None:
    """Return what the command printed; None if the folder does not say, or the file is damaged, which is reported."""
    from vibroswarm.documents.saved import read_printed

    try:
        return read_printed(folder)
    except InputError as error:
        print(f"damaged, not used: {error}", file=sys.stderr)
        return None


def _show_result(folder: Path, json: bool) -> None:
    """Print the document of a result; for any other folder, print the names of its tables and pictures."""
    from vibroswarm.cli.deliver import print_document
    from vibroswarm.core.folders import kind_of

    if kind_of(folder) in ("result", "recording"):
        from vibroswarm.documents.run import result_document
        from vibroswarm.recordings.recording import read_result

        document = result_document(read_result(folder))
    else:
        from vibroswarm.documents.shown_file import tables_document

        document = tables_document(folder)
    print_document(document, as_json=json)


def print_results(store: Store) -> None:
    """Print what a study says, or which code of the user it needs; print nothing if no run is finished."""
    from vibroswarm.cli.deliver import print_document
    from vibroswarm.cli.output import print_line, print_paragraph
    from vibroswarm.documents.study_results import results_or_need

    document, needed = results_or_need(store)
    if needed:
        print_paragraph(
            f"Results need code that is not loaded ({needed}). Run the command that made them again to print them."
        )
    if document is not None:
        print_line()
        print_document(document)
