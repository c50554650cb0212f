"""Where a document goes: to the terminal, to stdout as JSON, and into the folder of ``--out``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibroswarm.cli import terminal
from vibroswarm.cli.output import print_json, print_line, print_saved
from vibroswarm.core.atomic_io import make_folder
from vibroswarm.errors import InputError, RunError

if TYPE_CHECKING:
    from polars import DataFrame

    from vibroswarm.show.document import Document


class Destination:
    """The folder of ``--out`` of a command whose results are known again by its settings, and the terminal.

    Args:
        output: options such as ``Paged`` or ``Drawn``. command: the words of the command, such as "lab import".
        settings: all that results depend on, for a hash (``saved.hash_of``); none if they are known otherwise.
        at_once: False for a command that writes a new folder, which replaces an older one when it is complete.
    Raises:
        InputError: the folder holds something else (``out_folder.claim``).
    """

    def __init__(self, output: Any, command: str, *settings: object, at_once: bool = True) -> None:
        from vibroswarm.cli.out_folder import claim
        from vibroswarm.documents.saved import hash_of, refuse_other

        self.output, self.command = output, command
        self.work = hash_of(*settings) if settings else ""
        claim(output, lambda folder: refuse_other(folder, command, self.work), at_once=at_once)

    def deliver(
        self,
        document: Document,
        tables: Mapping[str, DataFrame] | None = None,
        also: Callable[[Path], object] | None = None,
    ) -> None:
        """Save a document and tables, as ``deliver`` does, and print it."""
        deliver(document, self.output, self.command, tables, self.work, also)


def deliver(
    document: Document,
    output: Any,
    command: str,
    tables: Mapping[str, DataFrame] | None = None,
    work: str = "",
    also: Callable[[Path], object] | None = None,
) -> None:
    """Save tables and a document in the folder of ``--out``, if it is given; print the document, and where it is.

    If they cannot be saved, the document is printed before the error is raised, so that no result is lost.

    With ``--pictures`` its pictures are files too, with ``--no-pictures`` its page has none.

    Args:
        output: options such as ``Paged`` or ``Drawn``. command: the words of the command, such as "league".
        tables: by name; they become CSV and Parquet. work: hash of the command's settings (``Destination``).
        also: writes further files into the folder.
    """
    from vibroswarm.core.folders import REPORT

    if output.out is not None:
        try:
            _save(document, output, command, tables or {}, work, also)
        except (InputError, RunError):
            print_document(document, as_json=output.json)
            raise
    print_with_place(document, output, REPORT)


def _save(
    document: Document,
    output: Any,
    command: str,
    tables: Mapping[str, DataFrame],
    work: str,
    also: Callable[[Path], object] | None,
) -> None:
    """Save a document, tables and further files; the arguments are those of ``deliver``."""
    from vibroswarm.documents.saved import begin

    make_folder(output.out)
    # first, so that the command can be given again if a table cannot be written
    begin(output.out, command, work)
    files: dict[str, Any] = {}
    if tables:
        from vibroswarm.study.summary import write_table

        for name, table in tables.items():
            files |= write_table(table, output.out / name)
    if also is not None:
        also(output.out)
    save_with_pictures(document, output, output.out, command, work, files)


def print_with_place(document: Document, output: Any, page: str | None) -> None:
    """Print a document, and where it is saved, with which page."""
    print_document(document, as_json=output.json)
    if not output.json:
        print_line()
    print_saved(output, page)


def save_with_pictures(
    document: Document,
    output: Any,
    folder: Path,
    command: str,
    work: str = "",
    files: Mapping[str, Any] | None = None,
) -> None:
    """Write the page of a document, the document, and its pictures as the options say, into a folder.

    Args:
        command, work, files: as of ``saved.save``.
    """
    from vibroswarm.documents.saved import save
    from vibroswarm.show.document import without_pictures

    no_pictures = getattr(output, "no_pictures", False)
    save(without_pictures(document) if no_pictures else document, folder, command, work, files=files)
    if hasattr(output, "pictures"):
        save_requested_pictures(document, output, folder)


def wants_pictures(arguments: Any) -> bool:
    """Return whether pictures are written as files: the options ask for them, or an earlier command has written some.

    Args:
        arguments: with ``out``, where earlier pictures are.
    """
    from vibroswarm.core.folders import PICTURES
    from vibroswarm.show.figures import CAPTIONS

    earlier = (arguments.out / PICTURES / CAPTIONS).is_file()
    return bool(arguments.pictures or (earlier and not arguments.no_pictures))


def save_requested_pictures(
    document: Document,
    arguments: Any,
    folder: Path,
    progress: Callable[[float], None] = lambda share: None,
) -> None:
    """Write the pictures of a document as files, if the options ask for them.

    Pictures that an earlier command has written are written again, or removed with ``--no-pictures``, since what they
    show may be outdated.

    Args:
        arguments: with ``out``, where earlier pictures are. folder: the folder of results, or its replacement.
    """
    from vibroswarm.cli.options import STYLES
    from vibroswarm.core.folders import PICTURES
    from vibroswarm.show.figures import remove_figures, write_figures

    if wants_pictures(arguments):
        write_figures(folder / PICTURES, document, arguments.style or STYLES[0], progress)
    else:
        remove_figures(folder / PICTURES)


def print_document(document: Document, *, as_json: bool = False) -> None:
    """Print a document as wide as the terminal, all of it with ``--wide``; or its answer and tables as JSON."""
    if as_json:
        from vibroswarm.show.data import document_data

        print_json(document_data(document))
        return
    from vibroswarm.show.terminal import print_document as print_in

    print_in(document, terminal.results(), terminal.width(), wide=terminal.printing.wide)
