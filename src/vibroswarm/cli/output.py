"""Print JSON, paragraphs and lines, and where results are saved."""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from vibroswarm.cli import terminal


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


def open_page(address: Path | str) -> bool:
    """Open a page in the browser and return True; if that fails, print on stderr what to do, and return False."""
    import webbrowser

    with suppress(webbrowser.Error):
        if has_display() and webbrowser.open(address.as_uri() if isinstance(address, Path) else address):
            return True
    terminal.say(f"vibroswarm: no browser can be opened here; open {address} on a machine that has one")
    return False


def has_display() -> bool:
    """Return whether a browser can be opened: a display exists, or the environment variable BROWSER names a browser."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
