"""``vibroswarm show``: the state and the results of whatever a command has written."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli.options import add_json
from vibroswarm.cli.saved import add_open, open_page
from vibroswarm.errors import InputError

if TYPE_CHECKING:
    from vibroswarm.result import Result

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
    """Add the command."""
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
    """Print what is there."""
    path: Path = arguments.folder
    if path.is_dir():
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


def _show_folder(folder: Path, arguments: argparse.Namespace) -> None:
    """Print the state of a study or search, then results."""
    from vibroswarm.cli import printed, show_study
    from vibroswarm.cli.output import print_json, print_line, print_paragraph
    from vibroswarm.optimize.journal import HEAD as SEARCH_HEAD
    from vibroswarm.optimize.journal import SEARCH, held, is_search
    from vibroswarm.study.store import HEAD, Store

    document: dict[str, Any] = {}
    lines: list[str] = []
    store = None
    there = printed.read(folder)
    if is_search(folder) or any(os.path.lexists(folder / name) for name in (SEARCH_HEAD, SEARCH)):
        if not is_search(folder):
            raise InputError(
                f"is a damaged search: {SEARCH_HEAD} or {SEARCH} is missing or no plain file",
                field=str(folder),
            )
        document = held(folder)
        lines = show_study.search_lines(document, with_result=there is None)
    elif (folder / HEAD).exists():
        store = Store.open(folder)
        document = show_study.state_of(store)
        lines = show_study.study_lines(document)
    if there is None and store is None and not document:
        _show_result(folder, arguments)
        return
    if arguments.json:
        results = None
        if store is not None and there is None:
            results, needed = show_study.results_or_need(store)
            document |= {"results_need": needed} if needed else {}
        if there is not None:
            document |= {"command": there.command, "printed": there.blocks}
        print_json(document | ({} if results is None else {"results": results.as_dict()}))
        return
    for line in lines:
        (print_line if line.startswith("To resume") else print_paragraph)(line)  # a command stays on one line
    if there is not None:
        if lines:
            print_line()
        printed.play(there.blocks)
    elif store is not None:
        show_study.print_results(store)


def _show_result(folder: Path, arguments: argparse.Namespace) -> None:
    """Print the verdict of a run or a recording, or what tables a folder holds."""
    from vibroswarm.cli.options import read_result
    from vibroswarm.cli.output import print_json, print_line, print_table

    if not (folder / "result.json").exists():
        from vibroswarm.cli.show_file import show_tables

        show_tables(folder, arguments)
        return
    from vibroswarm.analysis.verdict import verdict
    from vibroswarm.cli.verdict_text import verdict_text

    result = read_result(folder)
    runs = result.runs["run"].to_list()
    verdicts = [verdict(result, run=run) for run in runs]
    if arguments.json:
        print_json({"seed": result.seed, "verdicts": [one.as_dict() for one in verdicts]})
        return
    if len(runs) == 1:
        print_line(verdict_text(result, verdicts[0]).rstrip())
        return
    print_line(f"{len(runs)} runs, {_origin(result)}")
    print_table(
        ["run", "consensus", "at, s", "robots right", "wrong", "undecided"],
        [
            [
                run,
                one.consensus or "not logged",
                "-" if one.consensus_time_s is None else f"{one.consensus_time_s:.1f}",
                one.right,
                one.wrong,
                one.undecided,
            ]
            for run, one in zip(runs, verdicts, strict=True)
        ],
        texts=2,
    )


def _origin(result: Result) -> str:
    robots = result.scenario.swarm.robots
    floor, strategy = result.floor().name, result.scenario.strategy.name
    seed = "as recorded" if result.seed is None else f"seed {result.seed}"
    return f"{robots} robots, strategy {strategy}, on '{floor}', {seed}"
