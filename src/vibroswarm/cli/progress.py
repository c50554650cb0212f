"""Progress on stderr: a bar that says what is being done, if it is a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from vibroswarm.cli import terminal
from vibroswarm.core.stages import Stages

if TYPE_CHECKING:
    from vibroswarm.study.run import StudyProgress


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[..., None]]:
    """Show a bar; yield a function of how much is done, of how much in all (default 1), and of what is being done."""
    if terminal.printing.quiet or not sys.stderr.isatty():
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
                terminal.report(f"resumed: {now.kept:,} of {now.of:,} runs kept")
            update(now.done, now.wanted, f"{what}: {now.done:,} of {now.wanted:,} runs")

        yield show


STAGES: Final = Stages(runs=counting_runs, share=progress_bar)
"""Stages of work, each with a bar."""


def say_compiling(*sources: str) -> None:
    """Unless an engine is cached, report on stderr that kernels are compiled."""
    from vibroswarm.core.jit import is_cached

    if not is_cached(*sources):
        terminal.report("compiling the engine, once (about 25 s) ...")
