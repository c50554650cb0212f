"""How a command prints: the terminal's width, and the options ``--wide``, ``--quiet`` and ``--verbose``.

With ``--verbose``, versions, the loading and compiling of kernels, and times are reported on stderr.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import TYPE_CHECKING, Final, TextIO

if TYPE_CHECKING:
    from vibroswarm.cli.options import Printing

UNLIMITED: Final = 100_000
"""Width of output that goes to a file or another program: one line for each row, for ``grep`` and ``awk``."""
LEAST: Final = 40
"""A narrower terminal is treated as if it had this width."""


class _Chosen:
    """How much the command in progress prints, as its options say, and where it runs."""

    wide = quiet = verbose = False
    own_process = False
    """Whether nothing else runs in this process, as in a call from a shell."""
    results: TextIO | None = None
    """The stdout of the command in progress, see ``own_stdout``."""


printing = _Chosen()
"""The options of the command in progress, which ``use`` sets."""


def use(options: Printing, *, own_process: bool) -> None:
    """Set how much is printed from the options of a new command."""
    printing.wide, printing.quiet, printing.verbose = options.wide, options.quiet, options.verbose
    printing.own_process = own_process


@contextmanager
def own_stdout() -> Iterator[None]:
    """Reserve stdout for what the command prints: what users' code prints goes to stderr, so that JSON stays JSON."""
    printing.results = sys.stdout
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        printing.results = None


def results() -> TextIO:
    """Return the stream that a command prints its results on."""
    return printing.results or sys.stdout


def is_terminal() -> bool:
    """Return whether stdout is a terminal."""
    with suppress(AttributeError, ValueError):  # stdout is replaced by an object without isatty, or closed
        return results().isatty()
    return False


def width() -> int:
    """Return the width to print in, characters.

    It is the value of the environment variable COLUMNS if that is a number above 0, else the width of the terminal, but
    in both cases at least ``LEAST``. Without either, as when stdout is a file, it is ``UNLIMITED``.
    """
    with suppress(ValueError):  # COLUMNS is missing or is not a number
        if (given := int(os.environ.get("COLUMNS", ""))) > 0:
            return max(given, LEAST)
    if is_terminal():
        with suppress(OSError, ValueError):  # the system does not know the width
            return max(os.get_terminal_size(results().fileno()).columns, LEAST)
    return UNLIMITED


def plain(text: str) -> str:
    """Return text as one printable line: white space becomes spaces, other unprintable characters become ``?``.

    The text may quote a file, whose control characters a terminal would act on.
    """
    return "".join(c if c.isprintable() else " " if c.isspace() else "?" for c in text)


def say(text: str) -> None:
    """Print a line on stderr, such as a warning; if it cannot be written, it is lost, and the work goes on."""
    with suppress(OSError):  # written at once: the end of a line would come after that of another thread
        print(f"{plain(text)}\n", end="", file=sys.stderr, flush=True)


def report(text: str) -> None:
    """Print a line on stderr about what is being done, unless ``--quiet``."""
    if not printing.quiet:
        say(text)


_since_s = [0.0]
"""Time at which the command began, by ``time.monotonic``; the only entry is replaced by each command."""
_listens: list[bool] = []
"""Empty until a compile listener is registered. The listener cannot be removed, so it serves all later commands too."""


def _verbose_line(text: str) -> None:
    if printing.verbose:
        say(f"[{time.monotonic() - _since_s[0]:7.2f} s] {text}")


@contextmanager
def verbose() -> Iterator[None]:
    """Inside the context of a command, report on stderr its versions, loaded kernels and end, with times.

    Nothing is reported unless ``--verbose`` is set (``_verbose_line``).
    """
    from vibroswarm.core.jit import before_compiling, cache_folder, compiles
    from vibroswarm.simulation import versions

    _since_s[0] = time.monotonic()
    _verbose_line(", ".join(f"{name} {value}" for name, value in versions().items()))
    if compiles():
        _verbose_line(f"cache of compiled kernels: {cache_folder() or 'none can be used'}")
    if not _listens:
        _listens.append(True)
        before_compiling.append(lambda module: _verbose_line(f"loads or compiles a kernel of {module}"))
    try:
        yield
    finally:
        _verbose_line("end")
