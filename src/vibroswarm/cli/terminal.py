"""How a command prints: the terminal's width, the options ``--wide``, ``--quiet`` and ``--verbose``, and what the last
reports on stderr: versions, kernels as they are loaded or compiled, and times.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final

from vibroswarm.cli import user_settings

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


def plain(text: str) -> str:
    """Return text as one printable line: it may quote a file, with characters that a terminal would act on."""
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


def report(text: str) -> None:
    """Print a line on stderr about what is being done, unless ``--quiet``."""
    if not printing.quiet:
        print(text, file=sys.stderr, flush=True)


_since_s = [0.0]
_listens: list[bool] = []


def _line(text: str) -> None:
    if printing.verbose:
        print(f"[{time.monotonic() - _since_s[0]:7.2f} s] {text}", file=sys.stderr, flush=True)


@contextmanager
def verbose() -> Iterator[None]:
    """Report on the command that runs inside."""
    from vibroswarm.core.jit import add_compile_listener, cache_folder, compiles
    from vibroswarm.simulation import versions

    _since_s[0] = time.monotonic()
    _line(", ".join(f"{name} {value}" for name, value in versions().items()))
    if (settings := user_settings.read()) and (path := user_settings.location()):
        _line(f"settings of {path}: {', '.join(f'{name} {value}' for name, value in settings.items())}")
    if compiles():
        _line(f"cache of compiled kernels: {cache_folder() or 'none can be used'}")
    if not _listens:
        _listens.append(True)
        add_compile_listener(lambda module: _line(f"loads or compiles a kernel of {module}"))
    try:
        yield
    finally:
        _line("end")
