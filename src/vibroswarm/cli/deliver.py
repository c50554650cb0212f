"""Where a result goes as its document: to the terminal, to stdout as JSON, into the folder of ``--out``; and print it.

A result has its document by its class (``documents.document_of``); a document is its own.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.cli import terminal
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
        result: object,
        tables: Mapping[str, DataFrame] | None = None,
        also: Callable[[Path], object] | None = None,
    ) -> None:
        """Save the document of a result and tables, as ``deliver`` does, and print it."""
        deliver(result, self.output, self.command, tables, self.work, also)


def deliver(
    result: object,
    output: Any,
    command: str,
    tables: Mapping[str, DataFrame] | None = None,
    work: str = "",
    also: Callable[[Path], object] | None = None,
) -> None:
    """Save tables and the document of a result in the folder of ``--out``, if it is given; print it, and where it is.

    If they cannot be saved, the document is printed before the error is raised, so that no result is lost.

    With ``--pictures`` its pictures are files too, with ``--no-pictures`` its page has none.

    Args:
        output: options such as ``Paged`` or ``Drawn``. command: the words of the command, such as "league".
        tables: by name; they become CSV and Parquet. work: hash of the command's settings (``Destination``).
        also: writes further files into the folder.
    """
    from vibroswarm.core.folders import REPORT
    from vibroswarm.documents.saved import begin

    document = document_of(result)
    if output.out is not None:
        try:
            make_folder(output.out)
            # first, so that the command can be given again if a table cannot be written
            begin(output.out, command, work)
            files = _write_tables(tables, output.out) if tables else {}
            if also is not None:
                also(output.out)
            save_with_pictures(document, output, output.out, command, work, files)
        except (InputError, RunError):
            print_document(document, as_json=output.json)
            raise
    print_with_place(document, output, REPORT)


def _write_tables(tables: Mapping[str, DataFrame], folder: Path) -> dict[str, Any]:
    """Write tables by name; return what a manifest says of their files."""
    from vibroswarm.study.summary import write_table

    files: dict[str, Any] = {}
    for name, table in tables.items():
        files |= write_table(table, folder / name)
    return files


def document_of(result: object) -> Document:
    """Return the document of a result, which has one."""
    from vibroswarm import documents

    return documents.document_of(result)


def print_with_place(result: object, output: Any, page: str | None) -> None:
    """Print the document of a result, and where it is saved, with which page."""
    print_document(result, as_json=output.json)
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


def print_document(result: object, *, as_json: bool = False) -> None:
    """Print the document of a result as wide as the terminal, with ``--wide`` all of it; or its data as JSON."""
    document = document_of(result)
    if as_json:
        from vibroswarm.show.data import document_data

        print_json(document_data(document))
        return
    from vibroswarm.show.terminal import print_document as print_in

    print_in(document, terminal.results(), terminal.width(), wide=terminal.printing.wide)


def print_text(text: str) -> None:
    """Print text as it is, which ends with a line break."""
    print(text, end="", file=terminal.results(), flush=True)


def print_json(document: Any) -> None:
    """Print one JSON document.

    JSON has no NaN and no infinity: callers replace them, usually by None.

    Raises:
        ValueError: the document holds such a number.
    """
    print_text(json.dumps(document, indent=2, allow_nan=False) + "\n")


def print_paragraph(text: str) -> None:
    """Print text, broken into lines that fit the terminal."""
    from vibroswarm.show.terminal import TEXT_WIDTH, paragraph

    for line in paragraph(text, min(TEXT_WIDTH, terminal.width())):
        print_text(f"{line}\n")


def print_line(text: str = "") -> None:
    """Print a line that is not broken, such as a path or an empty line."""
    print_text(f"{terminal.plain(text)}\n")


def print_saved(output: Any, page: str | None = None) -> None:
    """Print where results are saved and what is in the folder, or without ``--out`` that they are not saved.

    With ``--open``, their page is opened. With ``--json`` nothing is printed on stdout, which holds the JSON only.

    Args:
        output: the options ``out``, and perhaps ``json`` and ``open``.
        page: file name of the page or report in the folder ``--out``; None if no page was written.
    """
    out: Path | None = output.out
    if not getattr(output, "json", False):
        if out is None:
            print_paragraph("Not saved; add --out DIR to save tables, the data behind them, and a page")
        else:
            print_line(f"Saved in {out}: {', '.join(_names_in(out))}")
            if page is not None:
                print_line(f"Page: open {(out / page).resolve()} in a browser")
    terminal.results().flush()  # so that the results are seen before the browser opens
    if getattr(output, "open", False) and out is not None:
        if page is None:
            terminal.say("vibroswarm: nothing to open: no page was written")
        else:
            open_page((out / page).resolve())


def print_saved_file(path: Path | None, note: str = "", *, as_json: bool = False) -> None:
    """Print where a file was written, if it was, unless stdout holds JSON."""
    if path is not None and not as_json:
        print_line(f"Saved: {path}{f' ({note})' if note else ''}")


TABLES: Final = {".csv": "CSV", ".parquet": "Parquet"}
"""Suffixes of tables, which are not listed one by one."""


def _names_in(folder: Path) -> list[str]:
    """Return what a folder holds: pages, other files, tables by their kind, folders; not what only programs read."""
    paths = [path for path in folder.iterdir() if path.name[0] != "." and path.suffix != ".json"]
    kinds = sorted({TABLES[path.suffix] for path in paths if path.suffix in TABLES})
    files = [path.name for path in paths if path.is_file() and path.suffix not in TABLES]
    files.sort(key=lambda name: (not name.endswith(".html"), name))
    folders = sorted(f"{path.name}/" for path in paths if path.is_dir())
    return [*files, *([f"tables ({', '.join(kinds)})"] if kinds else []), *folders]


def open_page(page: Path) -> bool:
    """Open a page in the browser and return True; if that fails, print on stderr what to do, and return False."""
    import webbrowser

    with suppress(webbrowser.Error):
        if has_display() and webbrowser.open(page.as_uri()):
            return True
    terminal.say(f"vibroswarm: no browser can be opened here; open {page} on a machine that has one")
    return False


def has_display() -> bool:
    """Return whether a browser can be opened: a display exists, or the environment variable BROWSER names a browser."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
