"""``vibroswarm show``: the state and the results of whatever a command has written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Final

from vibroswarm.cli.command_line import Option
from vibroswarm.cli.deliver import open_page, print_document, print_json, print_line
from vibroswarm.cli.option_values import refuse
from vibroswarm.cli.options import Json, run_plain
from vibroswarm.cli.terminal import printing
from vibroswarm.core.folders import kind_of
from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError

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

    if printing.own_process and path.is_dir() and not _needs_kernels(path):
        run_plain()
    if path.is_dir():
        _show_folder(path, json)
    else:
        from vibroswarm.cli.floors import in_terminal
        from vibroswarm.documents.shown_file import file_document

        print_document(file_document(path, in_terminal), as_json=json)
    if open:
        pages = [path / name for name in PAGES if (path / name).is_file()]
        refuse(not pages, str(path), "has no page to open")
        open_page(pages[0])


SETTINGS: Final = {"result": "scenario.toml", "recording": "scenario.toml", "study": "study.toml"}
"""The file with all fields of the scenario, in folders whose results are computed when they are shown."""


LAWFUL: Final = ("gamma", "confusion", "energies")
"""Sensors whose error rates follow from a formula."""


def _needs_kernels(folder: Path) -> bool:
    """Return whether showing a folder computes so much that kernels must be loaded, which takes half a second.

    Error rates do so where they do not follow from a formula: near edges of tiles, which only scenarios that name the
    fields of edges have, and of sensors that measure at a place. Documents that a command has saved are shown as they
    are.
    """
    from vibroswarm.documents.saved import PRINTED

    settings = SETTINGS.get(kind_of(folder) or "")
    if settings is None or os.path.lexists(folder / PRINTED):
        return False
    try:
        text = read_text(folder / settings, "a scenario")
    except InputError:  # reported when the result is read
        return True
    has_law = any(f'model = "{name}"' in text for name in LAWFUL)
    return not has_law or "edge" in text or "sensor.model" in text  # the last: a study of several sensors


def _show_folder(folder: Path, json: bool) -> None:
    """Print what a folder holds: the state of a study or search, and the results."""
    from vibroswarm.documents.shown_file import shown_folder
    from vibroswarm.show.data import document_data

    shown = shown_folder(folder)
    if json:
        results = shown.documents[1:] if shown.state else shown.documents
        data = [document_data(document) for document in results]
        print_json(
            dict(shown.state)
            | ({"command": shown.command} if shown.command else {})
            | (data[0] if data else {})
        )
        return
    for place, document in enumerate(shown.documents):
        if place:
            print_line()
        print_document(document)
