"""How a command prints: the terminal's width, and the options ``--wide``, ``--quiet`` and ``--verbose``."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

TEXT_WIDTH: Final = 100
"""Most characters in a line of a paragraph."""
UNLIMITED: Final = 100_000
"""Width of output that goes to a file or another program: one line for each row, for ``grep`` and ``awk``."""
LEAST: Final = 40


@dataclass
class Printing:
    """What the options of the command in progress ask for."""

    wide: bool = False
    quiet: bool = False
    verbose: bool = False


printing = Printing()


def use(arguments: argparse.Namespace) -> None:
    """Print as these options ask for; a new command starts."""
    for name in ("wide", "quiet", "verbose"):
        setattr(printing, name, bool(getattr(arguments, name, False)))


def is_terminal() -> bool:
    """Return whether stdout is a terminal."""
    with suppress(AttributeError, ValueError):  # replaced, or closed
        return sys.stdout.isatty()
    return False


def width() -> int:
    """Return the width to print in: the environment variable COLUMNS, else the terminal's, else unlimited."""
    with suppress(ValueError):
        if (given := int(os.environ.get("COLUMNS", ""))) > 0:
            return max(given, LEAST)
    if is_terminal():
        with suppress(OSError, ValueError):
            return max(os.get_terminal_size(sys.stdout.fileno()).columns, LEAST)
    return UNLIMITED


def text_width() -> int:
    """Return the width of paragraphs."""
    return min(TEXT_WIDTH, width())


def report(text: str) -> None:
    """Print a line on stderr about what is being done, unless ``--quiet``."""
    if not printing.quiet:
        print(text, file=sys.stderr, flush=True)
