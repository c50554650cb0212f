"""How a command prints: the terminal's width, and the options ``--quiet`` and ``--verbose``."""

from __future__ import annotations

import shutil
import sys
from typing import TYPE_CHECKING, Final

from vibroswarm.cli.options import Common

if TYPE_CHECKING:
    from rich.console import Console

LEAST: Final = 40
"""A narrower terminal is treated as if it had this width."""
ELSEWHERE: Final = 140
"""Width of output that goes to a file or another program."""
printing = Common()
"""The options of the command in progress."""


def width() -> int:
    """Return the width to print in: that of the variable COLUMNS or of the terminal."""
    return max(shutil.get_terminal_size((ELSEWHERE, 24)).columns, LEAST)


def console() -> Console:
    """Return stdout as rich prints to it."""
    from rich.console import Console

    return Console(width=width(), highlight=False)


def plain(text: str) -> str:
    """Return text as one printable line; it may quote a file, whose control characters a terminal would act on."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


def say(text: str) -> None:
    """Print a line on stderr, such as a warning."""
    print(f"{plain(text)}\n", end="", file=sys.stderr, flush=True)


def report(text: str) -> None:
    """Print a line on stderr about what is being done, unless ``--quiet``."""
    if not printing.quiet:
        say(text)
