"""Progress on stderr: a bar on a terminal, otherwise a line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from vibroswarm.cli.terminal import printing, report

if TYPE_CHECKING:
    from vibroswarm.optimize.methods import SearchProgress
    from vibroswarm.study.runner import StudyProgress

LINE_EVERY_S = 10.0


class _Lines:
    """Prints a line on stderr, unless it printed one less than ten seconds ago."""

    def __init__(self) -> None:
        self.latest_s = time.monotonic()

    def __call__(self, text: str) -> None:
        now_s = time.monotonic()
        if now_s - self.latest_s >= LINE_EVERY_S:
            self.latest_s = now_s
            report(text)


@contextmanager
def _bar(what: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Show a bar; yields the function that updates its description, total, completed and note.

    Args:
        total: 1 to show per cent, None to count runs up to a total that is set later.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    count = ("{task.percentage:3.0f} %",) if total else (MofNCompleteColumn(), "runs")
    columns = ("{task.description}", BarColumn(), *count, TimeRemainingColumn(), "{task.fields[note]}")
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=printing.quiet) as bars:
        task = bars.add_task(what, total=total, note="")
        yield lambda **values: bars.update(task, **values)


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """Yield a function that takes the share done, 0 to 1; reports first if kernels must be compiled."""
    with labelled_progress_bar(what) as progress:
        yield lambda share: progress(what, share)


@contextmanager
def labelled_progress_bar(what: str) -> Iterator[Callable[[str, float], None]]:
    """Yield a function that takes what is being done now, and the share done of all."""
    say_compiling()
    if not sys.stderr.isatty():
        lines = _Lines()
        yield lambda now, share: lines(f"{what}: {100 * share:.0f} %")
        return
    with _bar(what, total=1.0) as update:
        yield lambda now, share: update(description=now, completed=share)


@contextmanager
def study_progress(what: str) -> Iterator[Callable[[StudyProgress], None]]:
    """Yield a function that shows how far a study is, at what rate, and how much failed."""
    from vibroswarm.study.runner import StudyProgress

    began_s = time.monotonic()
    latest = [StudyProgress(0, 0, 0)]

    def values(now: StudyProgress) -> tuple[float, str]:
        passed_s = time.monotonic() - began_s
        return now.done / max(passed_s, 1e-9), f"{now.failed} batches failed" if now.failed else ""

    if not sys.stderr.isatty():
        lines = _Lines()

        def line(now: StudyProgress) -> None:
            latest[0] = now
            rate, failed = values(now)
            share = 100 * now.done / max(now.wanted, 1)
            left = f"{(now.wanted - now.done) / rate:.0f} s left" if rate else ""
            text = f"{what}: {now.done:,} of {now.wanted:,} runs ({share:.0f} %)"
            lines(", ".join(part for part in (text, f"{rate:,.0f} per second", left, failed) if part))

        def line_while_compiling() -> None:
            done = f"; {latest[0].done:,} of {latest[0].wanted:,} runs done" if latest[0].wanted else ""
            lines(f"{what}: compiling{done}")

        with _while_compiling(line_while_compiling):
            yield line
        return
    with _bar(what) as update:

        def show(now: StudyProgress) -> None:
            rate, failed = values(now)
            note = f"{rate:,.0f} per second{f', {failed}' if failed else ''}"
            update(description=what, total=now.wanted, completed=now.done, note=note)

        with _while_compiling(lambda: update(description=f"{what}: compiling")):
            yield show


_compiling: list[Callable[[], None]] = []
"""What is called when a kernel is about to be compiled, the last of them."""
_listens: list[bool] = []


@contextmanager
def _while_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` when a kernel is about to be compiled: no run ends meanwhile, so the display would seem stuck."""
    from vibroswarm.core.jit import add_compile_listener

    if not _listens:
        _listens.append(True)
        add_compile_listener(lambda module: _compiling[-1]() if _compiling else None)
    _compiling.append(tell)
    try:
        yield
    finally:
        _compiling.remove(tell)


@contextmanager
def search_progress() -> Iterator[Callable[[SearchProgress], None]]:
    """Yield a function that shows the progress of a search and its best score."""

    def best(now: SearchProgress) -> str:
        return f"best so far {now.best:.4g}{f', {now.failed} failed' if now.failed else ''}"

    if not sys.stderr.isatty():
        lines = _Lines()
        yield lambda now: lines(
            f"{now.method}: iteration {now.iteration} of {now.iterations}, {now.runs:,} of {now.wanted:,} runs, "
            f"{best(now)}"
        )
        return
    with _bar("searching") as update:
        yield lambda now: update(
            total=now.wanted,
            completed=now.runs,
            note=best(now),
            description=f"{now.method} {now.iteration}/{now.iterations}",
        )


def say_compiling(*sources: str) -> None:
    """Report on stderr if kernels must be compiled first, and start a process that helps.

    Args:
        sources: names of the motion sources whose kernels are needed; without names, cached kernels of any suffice.
    """
    from vibroswarm.cli.background_compile import begin
    from vibroswarm.core.jit import cache_folder, is_cached

    if not is_cached(*sources):
        begin()
        duration = "once (about 15 s; cached for later runs)" if cache_folder() is not None else "about 15 s"
        report(f"compiling the engine, {duration} ...")
