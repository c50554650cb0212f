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
    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.study.runner import StudyProgress

LINE_EVERY_S = 10.0
"""Shortest time between lines of progress."""
FIRST_LINE_S = 2.0
"""Time after which the first line says what takes so long."""


class _Lines:
    """Report lines on stderr: the first after ``FIRST_LINE_S``, further ones at least ``LINE_EVERY_S`` apart."""

    def __init__(self) -> None:
        self.latest_s = time.monotonic() + FIRST_LINE_S - LINE_EVERY_S

    def __call__(self, text: str) -> None:
        """Report ``text`` on stderr, unless the last line or the start was a moment ago."""
        now_s = time.monotonic()
        if now_s - self.latest_s >= LINE_EVERY_S:
            self.latest_s = now_s
            report(text)


@contextmanager
def _bar(what: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Show a bar of shares (total 1) or runs, unless ``--quiet``; yield what updates it (total, completed, note)."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    count = ("{task.percentage:3.0f} %",) if total else (MofNCompleteColumn(), "runs")
    columns = ("{task.description}", BarColumn(), *count, TimeRemainingColumn(), "{task.fields[note]}")
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=printing.quiet) as bars:
        task = bars.add_task(what, total=total, note="")
        yield lambda **values: bars.update(task, **values)


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar; yield a function that takes the share done, 0 to 1. See ``labelled_progress_bar``."""
    with labelled_progress_bar(what) as progress:
        yield lambda share: progress(what, share)


@contextmanager
def labelled_progress_bar(what: str) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar; yield a function that takes a description of the present step and the share done, 0 to 1.

    If kernels must be compiled, that is reported first (``say_compiling``). If stderr is not a terminal, lines with the
    share done are printed instead of a bar; they name the whole work, not the step.

    Args:
        what: description of the whole work.
    """
    say_compiling()
    if not sys.stderr.isatty():
        lines = _Lines()
        yield lambda now, share: lines(f"{what}: {100 * share:.0f} %")
        return
    with _bar(what, total=1.0) as update:
        yield lambda now, share: update(description=now, completed=share)


@contextmanager
def study_progress(what: str) -> Iterator[Callable[[StudyProgress], None]]:
    """Yield a function that takes the progress of a study and shows runs done, rate and failures.

    No run ends while a kernel is compiled, so "compiling" is shown until progress is reported again. If stderr is not a
    terminal, lines are printed instead of a bar.

    Args:
        what: description of the work.
    """
    from vibroswarm.study.runner import StudyProgress

    began_s = time.monotonic()
    latest = StudyProgress(done=0, wanted=0, failed=0)  # for lines that are printed during compilation

    def rate_and_failures(now: StudyProgress) -> tuple[float, str]:
        """Return the number of runs per second so far, and in words how many batches failed (empty if none)."""
        passed_s = time.monotonic() - began_s
        rate = now.done / max(passed_s, 1e-9)  # 1e-9: the clock may not have advanced yet
        return rate, f"{now.failed} batches failed" if now.failed else ""

    if not sys.stderr.isatty():
        lines = _Lines()

        def line(now: StudyProgress) -> None:
            nonlocal latest
            latest = now
            rate, failed = rate_and_failures(now)
            share = 100 * now.done / max(now.wanted, 1)  # at least 1, so that nothing is divided by 0
            left = f"{(now.wanted - now.done) / rate:.0f} s left" if rate else ""
            text = f"{what}: {now.done:,} of {now.wanted:,} runs ({share:.0f} %)"
            lines(", ".join(part for part in (text, f"{rate:,.0f} per second", left, failed) if part))

        def line_while_compiling() -> None:
            done = f"; {latest.done:,} of {latest.wanted:,} runs done" if latest.wanted else ""
            lines(f"{what}: compiling{done}")

        with _while_compiling(line_while_compiling):
            yield line
        return
    with _bar(what) as update:

        def show(now: StudyProgress) -> None:
            rate, failed = rate_and_failures(now)
            note = f"{rate:,.0f} per second{f', {failed}' if failed else ''}"
            # `description` is set each time, because it may be "compiling"
            update(description=what, total=now.wanted, completed=now.done, note=note)

        with _while_compiling(lambda: update(description=f"{what}: compiling")):
            yield show


_compiling: list[Callable[[], None]] = []
"""Functions of the ``_while_compiling`` contexts that are open; only the last one is called."""
_listens: list[bool] = []
"""Empty until this module has registered its listener, which cannot be removed and so serves all later contexts."""


@contextmanager
def _while_compiling(show: Callable[[], None]) -> Iterator[None]:
    """Inside the context, call ``show`` each time a kernel is about to be loaded or compiled.

    No run ends while a kernel is compiled, so without this the display of progress would seem stuck.
    """
    from vibroswarm.core.jit import add_compile_listener

    if not _listens:
        _listens.append(True)
        add_compile_listener(lambda module: _compiling[-1]() if _compiling else None)
    _compiling.append(show)
    try:
        yield
    finally:
        _compiling.remove(show)


@contextmanager
def search_progress() -> Iterator[Callable[[SearchProgress], None]]:
    """Yield a function that takes the progress of a search and shows its iteration, runs and best score."""

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


_reported: set[tuple[str, ...]] = set()
"""Motion sources whose compilation was reported."""


def say_compiling(*sources: str, scenario: Scenario | None = None) -> None:
    """Unless an engine is cached, report on stderr that kernels are compiled, and start a second process for some.

    The second process compiles the kernels of observation and inference (``background_compile``), while this process
    compiles those of the engine, which simulate motion.

    Args:
        sources: names of the motion sources (engines) of which at least one must be cached; without names, any engine.
        scenario: whose kernels of inference are compiled; if it is not given, those of a strategy without feedback.
    """
    from vibroswarm.cli.background_compile import begin
    from vibroswarm.core.jit import cache_folder, is_cached

    if sources not in _reported and not is_cached(*sources):
        _reported.add(sources)  # once: without a folder for the cache, kernels never are cached
        begin(scenario)  # if no second process can be started, this process compiles all kernels itself
        duration = "once (about 15 s; cached for later runs)" if cache_folder() is not None else "about 15 s"
        report(f"compiling the engine, {duration} ...")
