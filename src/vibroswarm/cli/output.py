"""Print JSON, paragraphs and lines, and where results are saved."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from vibroswarm.cli import terminal
from vibroswarm.errors import InputError


def print_json(document: Any) -> None:
    """Print one JSON document.

    JSON has no NaN and no infinity: callers replace them, usually by None.

    Raises:
        ValueError: the document holds such a number.
    """
    print(json.dumps(document, indent=2, allow_nan=False))


def print_paragraph(text: str) -> None:
    """Print text, broken into lines that fit the terminal."""
    from vibroswarm.show.terminal import paragraph

    print("\n".join(paragraph(text, terminal.text_width())))


def print_line(text: str = "") -> None:
    """Print a line as it is, such as a path or an empty line."""
    print(text)


def add_open(parser: Any, help: str = "open the report in the browser") -> None:
    """Add the option that opens the page or report."""
    parser.add_argument("--open", action="store_true", help=help)


def check_open(arguments: Any) -> None:
    """Refuse ``--open`` without ``--out`` before the work begins, because only a saved page can be opened.

    Raises:
        InputError: ``--open`` is given without ``--out``.
    """
    if getattr(arguments, "open", False) and arguments.out is None:
        raise InputError("needs --out DIR, where the page is saved", field="--open")


def print_saved(arguments: Any, what: str, page: str | None = None) -> None:
    """Print where results are saved, or without ``--out`` that they are not; with ``--open``, open their page.

    With ``--json`` nothing is printed on stdout, which holds the JSON document only. A command without the option
    ``--json`` or ``--open`` counts as called without it.

    Args:
        what: what is saved, or what would be saved with ``--out``, in words.
        page: file name of the page or report in the folder ``--out``; None if no page was written.
    """
    as_json = getattr(arguments, "json", False)
    if not as_json:
        if arguments.out is None:
            print_paragraph(f"Not saved; add --out DIR to save {what}")
        else:
            print_line(f"Saved in {arguments.out}: {what}")
            if page is not None:
                kind = "Report" if page == "report.html" else "Page"
                print_line(f"{kind}: open {(arguments.out / page).resolve()} in a browser")
    sys.stdout.flush()  # so that the results are seen before the browser opens
    if getattr(arguments, "open", False) and arguments.out is not None:
        if page is None:
            print("vibroswarm: nothing to open: no page was written", file=sys.stderr)
        else:
            open_page(arguments.out / page)


def open_page(path: Path) -> bool:
    """Open a file in the browser and return True; if that fails, print on stderr what to do, and return False."""
    import webbrowser

    path = path.resolve()
    opened = False
    if has_display():
        try:
            opened = webbrowser.open(path.as_uri())
        except webbrowser.Error:
            opened = False
    if not opened:
        print(
            f"vibroswarm: no browser can be opened here; open {path} on a machine that has one",
            file=sys.stderr,
            flush=True,
        )
    return opened


def has_display() -> bool:
    """Return whether a browser can be opened: a display exists, or the environment variable BROWSER names a browser."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
