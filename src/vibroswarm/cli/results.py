"""``vibroswarm show`` and ``verify``: what a command has written, and whether its runs come out the same again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from vibroswarm.cli.command_line import Option, refuse
from vibroswarm.cli.deliver import open_page, print_report
from vibroswarm.cli.options import Json
from vibroswarm.cli.terminal import progress_bar

PAGES: Final = ("run.html", "report.html", "run-1.html")
"""Pages that commands write, in the order in which ``--open`` looks for them."""


def show(
    path: Annotated[Path, Option("folder of a command, or file of a scenario or table", "PATH")],
    /,
    *,
    json: Json = False,
    open: Annotated[bool, Option("open its page in the browser")] = False,
) -> None:
    """Show what a command has written (runs, studies, searches, leagues, recordings), a scenario, or a table.

    examples:
      vibroswarm show first            a run: its verdict
      vibroswarm show out/league --open
      vibroswarm show mine.toml        a scenario: what differs from preset paper
    """
    from vibroswarm.report.file import of_path

    print_report(of_path(path), as_json=json)
    if open:
        pages = [path / name for name in PAGES if (path / name).is_file()]
        refuse(not pages, str(path), "has no page to open")
        open_page(pages[0])


def verify(
    folder: Annotated[Path, Option("folder of a study, league or reproduction", "DIR")],
    /,
    *,
    runs: Annotated[int, Option("runs to simulate again, drawn from all", low=1)] = 20,
    seed: Annotated[int, Option("of the draw", "S", low=0)] = 1,
    json: Json = False,
) -> int:
    """Simulate a sample of saved runs again from their seed, and compare them bit by bit.

    A run that differs was made by other code or other versions of libraries, on another kind of processor, or its files
    were changed. Runs of folders within, such as the tests of a league, are drawn too. The exit code is 1 if a run
    differs, or a file with runs is damaged.

    examples:
      vibroswarm verify out/study
      vibroswarm verify out/league --runs 200
      vibroswarm verify out/paper                a reproduction: runs of its studies
    """
    from vibroswarm.study.store import verify as simulate_again

    with progress_bar("simulating again") as progress:
        verified = simulate_again(folder, runs, seed, progress)
    print_report(verified, as_json=json)
    return 0 if verified.holds else 1
