"""``vibroswarm show``: what a command has written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import open_page, print_report
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Json

PAGES: Final = ("run.html", "report.html", "run-1.html")
"""Pages that commands write, in the order in which ``--open`` looks for them."""


def show(
    path: Annotated[Path, Option("folder or file that a command has written", "PATH")],
    /,
    *,
    json: Json = False,
    open: Annotated[bool, Option("open its page in the browser")] = False,
) -> None:
    """Show what a command has written: runs, studies, searches, leagues, recordings, scenarios, floors, tables.

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
