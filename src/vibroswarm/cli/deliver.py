"""Where a document goes: to the terminal, to stdout as JSON, and into the folder of ``--out``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli import terminal
from vibroswarm.cli.out_folder import Printed, write_printed
from vibroswarm.cli.output import print_json, print_line, print_saved

if TYPE_CHECKING:
    from vibroswarm.show.document import Document

REPORT: Final = "report.html"
"""Name of the page in a folder of results."""
PICTURES: Final = "pictures"
"""Name of the folder of pictures in a folder of results."""


def deliver(document: Document, arguments: Any, command: str, saved: str, work: str = "") -> None:
    """Save a document in the folder of ``--out``, if it is given; then print it, and say where it is.

    Args:
        arguments: those of the command, with ``out``. With ``open``, the page is opened.
        command: the words of the command, such as "league". saved: what else is in the folder, in words.
        work: hash of the command's settings, by which ``out_folder.refuse_other`` knows the folder again.
    """
    if arguments.out is not None:
        save(document, arguments.out, command, work)
    print_result(document, arguments)
    if not getattr(arguments, "json", False):
        print_line()
    print_saved(arguments, saved, REPORT)


def save(
    document: Document, folder: Path, command: str, work: str = "", *, page: str | None = REPORT
) -> None:
    """Write the page of a document into a folder, and the document itself, so that ``show`` can print it again."""
    from vibroswarm.show.page import write_page

    if page is not None:
        write_page(folder / page, document)
    write_printed(folder, Printed(command, work, document))


def save_pictures(
    document: Document, folder: Path, style: str, progress: Callable[[float], None] = lambda share: None
) -> None:
    """Write the pictures of a document as files into a folder in the folder of results."""
    from vibroswarm.show.figures import write_figures

    write_figures(folder / PICTURES, document, style, progress)


def save_requested_pictures(
    document: Document,
    arguments: Any,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Write the pictures of a document as files, if the options of ``add_pictures`` ask for them.

    Pictures that an earlier command has written are written again, or removed with ``--no-pictures``, since what they
    show may be outdated.

    Args:
        arguments: with ``out``, where earlier pictures are. folder: the folder of results, or its replacement.
    """
    from vibroswarm.cli.options import wants_picture_files
    from vibroswarm.core.atomic_io import remove_folder
    from vibroswarm.show.figures import CAPTIONS

    if wants_picture_files(arguments, f"{PICTURES}/{CAPTIONS}"):
        save_pictures(document, folder, getattr(arguments, "style", "column"), progress)
    elif (folder / PICTURES / CAPTIONS).is_file():
        remove_folder(folder / PICTURES)


def print_result(document: Document, arguments: Any) -> None:
    """Print a document, or with ``--json`` its answer and tables as one JSON document."""
    print_document(document, as_json=getattr(arguments, "json", False))


def print_document(document: Document, *, as_json: bool = False) -> None:
    """Print a document as wide as the terminal, all of it with ``--wide``; or its answer and tables as JSON."""
    if as_json:
        from vibroswarm.show.data import document_data

        print_json(document_data(document))
        return
    from vibroswarm.show.terminal import print_document as print_in

    print_in(document, sys.stdout, terminal.width(), wide=terminal.printing.wide)


def print_in_terminal(document: Document) -> None:
    """Print a document as text."""
    print_document(document)
