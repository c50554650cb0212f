"""Progress on stderr: a bar on a terminal, otherwise a line every ten seconds."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from vibroswarm.cli.terminal import printing, report
from vibroswarm.core.numbers import count, count_of, duration, number, percent, whole
from vibroswarm.core.stages import Stages

if TYPE_CHECKING:
    from vibroswarm.search.methods import SearchProgress
    from vibroswarm.study.run import StudyProgress

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
def _shown(what: str, total: float | None = None) -> Iterator[Callable[..., None]]:
    """Show progress of shares (total 1) or runs; yield a function that updates it, unless ``--quiet``.

    The function takes the text of a line, and as keywords values of the bar: description, total, completed, note. On a
    terminal the bar is shown; otherwise lines are printed.
    """
    if not sys.stderr.isatty():
        lines = _Lines()
        yield lambda text, **values: lines(text)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    amount = ("{task.percentage:3.0f} %",) if total else (MofNCompleteColumn(), "runs")
    columns = ("{task.description}", BarColumn(), *amount, TimeRemainingColumn(), "{task.fields[note]}")
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=printing.quiet) as bars:
        task = bars.add_task(what, total=total, note="")
        yield lambda text, **values: bars.update(task, **values)


@contextmanager
def progress_bar(what: str, *, simulates: bool = True) -> Iterator[Callable[[float], None]]:
    """Show a progress bar; yield a function that takes the share done, 0 to 1. See ``labelled_progress_bar``."""
    with labelled_progress_bar(what, simulates=simulates) as progress:
        yield lambda share: progress(what, share)


@contextmanager
def labelled_progress_bar(what: str, *, simulates: bool = True) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar; yield a function that takes a description of the present step and the share done, 0 to 1.

    If kernels must be compiled, that is reported first (``say_compiling``). If stderr is not a terminal, lines with the
    share done are printed instead of a bar; they name the whole work, not the step.

    Args:
        what: description of the whole work. simulates: whether it needs an engine.
    """
    if simulates:
        say_compiling()
    with _shown(what, total=1.0) as show:
        yield lambda now, share: show(f"{what}: {percent(share, 0)}", description=now, completed=share)


@contextmanager
def study_progress(what: str) -> Iterator[Callable[[StudyProgress], None]]:
    """Yield a function that takes the progress of a study and shows runs done, rate and failures.

    No run ends while a kernel is compiled, so "compiling" is shown until progress is reported again, and rate and time
    left are those of the runs after it. If stderr is not a terminal, lines are printed instead of a bar.

    Args:
        what: description of the work.
    """
    began_s: float | None = time.monotonic()  # the rate is that of the runs since then; None: while compiling
    before, latest = 0, 0  # runs done by then, and at the last report
    done = ""  # for lines that are printed during compilation

    with _shown(what) as show:

        def update(now: StudyProgress) -> None:
            nonlocal began_s, before, latest, done
            now_s = time.monotonic()
            if began_s is None and now.done > latest:
                began_s, before = now_s, now.done
            latest = now.done
            # Other batches that waited for the kernel end at once, and say nothing of the rate.
            least_s = FIRST_LINE_S if before else 1e-9  # the clock may not have advanced yet
            passed_s = 0.0 if began_s is None else now_s - began_s
            rate = (latest - before) / passed_s if passed_s >= least_s else 0.0
            left = f"{duration((now.wanted - now.done) / rate)} left" if rate else ""
            speed = f"{number(rate, digits=2)} per second" if rate else ""
            done = f"; {whole(now.done)} of {count(now.wanted, 'run')} done"
            show(
                ", ".join(filter(None, (f"{what}: {count_of(now.done, now.wanted, 'run')}", speed, left))),
                # set each time, because it may be "compiling"
                description=what,
                total=now.wanted,
                completed=now.done,
                note=speed,
            )

        def compiling() -> None:
            nonlocal began_s
            began_s = None
            show(f"{what}: compiling{done}", description=f"{what}: compiling")

        with _while_compiling(compiling):
            yield update


_compiling: list[Callable[[], None]] = []
"""Functions of the ``_while_compiling`` contexts that are open; only the last one is called."""
_listens: list[bool] = []
"""Empty until this module has registered its listener, which cannot be removed and so serves all later contexts."""


@contextmanager
def _while_compiling(show: Callable[[], None]) -> Iterator[None]:
    """Inside the context, call ``show`` each time a kernel is about to be loaded or compiled.

    No run ends while a kernel is compiled, so without this the display of progress would seem stuck.
    """
    from vibroswarm.core.jit import before_compiling

    if not _listens:
        _listens.append(True)
        before_compiling.append(lambda module: _compiling[-1]() if _compiling else None)
    _compiling.append(show)
    try:
        yield
    finally:
        _compiling.remove(show)


@contextmanager
def search_progress() -> Iterator[Callable[[SearchProgress], None]]:
    """Yield a function that takes the progress of a search and shows its iteration, runs and best score."""

    with _shown("searching") as show:

        def update(now: SearchProgress) -> None:
            failed = f", {whole(now.failed)} failed" if now.failed else ""
            best = f"best so far {number(now.best, digits=4)}{failed}"
            runs = f"{whole(now.runs)} of {count(now.wanted, 'run')}"
            show(
                f"{now.method}: iteration {now.iteration} of {now.iterations}, {runs}, {best}",
                description=f"{now.method} {now.iteration}/{now.iterations}",
                total=now.wanted,
                completed=now.runs,
                note=best,
            )

        yield update


STAGES: Final = Stages(runs=study_progress, share=progress_bar)
"""Stages of work, each shown on stderr."""

_reported: set[tuple[str, ...]] = set()
"""Motion sources whose compilation was reported."""


def say_compiling(*sources: str) -> None:
    """Unless an engine is cached, report on stderr that kernels are compiled.

    Args:
        sources: names of the motion sources (engines) of which at least one must be cached; without names, any engine.
    """
    from vibroswarm.core.jit import cache_folder, is_cached

    if sources not in _reported and not is_cached(*sources):
        _reported.add(sources)  # once: without a folder for the cache, kernels never are cached
        duration = "once (about 25 s; cached for later runs)" if cache_folder() is not None else "about 25 s"
        report(f"compiling the engine, {duration} ...")
