"""The last lines of a command: where its results are, and the page or report that ``--open`` opens."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from vibroswarm.cli.output import print_line, print_paragraph
from vibroswarm.errors import InputError


def add_open(parser: Any, help: str = "open the report in the browser") -> None:
    """Add the option that opens the page or report."""
    parser.add_argument("--open", action="store_true", help=help)


def check_open(arguments: argparse.Namespace) -> None:
    """Refuse ``--open`` where nothing is saved; called before the work.

    Raises:
        InputError: ``--open`` is given without ``--out``.
    """
    if getattr(arguments, "open", False) and arguments.out is None:
        raise InputError("needs --out DIR, where the page is saved", field="--open")


def print_saved(arguments: argparse.Namespace, what: str, page: str | None = None) -> None:
    """Print where results are saved, and open the page if ``--open``.

    Args:
        what: what is saved, or would be. page: its file in the folder, if there is one.
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
    sys.stdout.flush()
    if getattr(arguments, "open", False) and arguments.out is not None:
        if page is None:
            print("vibroswarm: nothing to open: no page was written", file=sys.stderr)
        else:
            open_page(arguments.out / page)


def open_page(path: Path) -> bool:
    """Open a file in the browser; without one, say so on stderr and return False."""
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
    """Return whether a browser could show a window; BROWSER names one where there is no display."""
    if sys.platform in ("win32", "darwin") or os.environ.get("BROWSER"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
