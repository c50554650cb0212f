"""How a command prints: the terminal's width, ``--quiet`` and ``--verbose``, and progress on stderr."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from vibroswarm.cli.options import Common

if TYPE_CHECKING:
    from rich.console import Console

    from vibroswarm.study.run import StudyProgress

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


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[..., None]]:
    """Show a bar; yield a function of how much is done, of how much in all (default 1), and of what is being done."""
    if printing.quiet or not sys.stderr.isatty():
        yield lambda done, total=1.0, what=what: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TimeRemainingColumn

    columns = ("{task.description}", BarColumn(), "{task.percentage:3.0f} %", TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(what, total=None)

        def update(done: float, total: float = 1.0, what: str = what) -> None:
            bars.update(task, completed=done, total=total, description=what)

        yield update


@contextmanager
def counting_runs(what: str) -> Iterator[Callable[[StudyProgress], None]]:
    """Show a bar; yield a function of the progress of a study."""
    with progress_bar(what) as update:

        def show(now: StudyProgress) -> None:
            if now.kept:
                report(f"resumed: {now.kept:,} of {now.of:,} runs kept")
            update(now.done, now.wanted, f"{what}: {now.done:,} of {now.wanted:,} runs")

        yield show


def say_compiling(*sources: str) -> None:
    """Unless an engine is cached, report on stderr that kernels are compiled."""
    from vibroswarm.core.jit import is_cached

    if not is_cached(*sources):
        report("compiling the engine, once (about 25 s) ...")
