"""Progress on stderr: a bar where it is a terminal, plain lines now and then where it is not."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vibroswarm.optimize.method import Told as SearchTold
    from vibroswarm.study.runner import Told

LINE_EVERY_S = 10.0


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """Give a function to be told the share done, in [0, 1]; says so first if kernels must be compiled."""
    say_compiling()
    if sys.stderr.isatty():
        with _bar(what) as tell:
            yield tell
    else:
        yield _Lines(what)


@contextmanager
def _bar(what: str) -> Iterator[Callable[[float], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"))
    console = Console(stderr=True)
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as bars:
        task = bars.add_task(what, total=1.0)
        yield lambda share: bars.update(task, completed=share)


class _Lines:
    def __init__(self, what: str) -> None:
        self.what, self.latest_s = what, time.monotonic()

    def __call__(self, share: float) -> None:
        now_s = time.monotonic()
        if now_s - self.latest_s >= LINE_EVERY_S:
            self.latest_s = now_s
            print(f"{self.what}: {100 * share:.0f} %", file=sys.stderr, flush=True)


def say_compiling(*modules: str) -> None:
    """Say so if kernels must be compiled first, and have another process help.

    Args:
        modules: last names of those that hold the engine; without, any will do.
    """
    from vibroswarm.cli.beside import begin
    from vibroswarm.compiled import cache_folder, is_cached

    if not is_cached(*modules):
        begin()
        how = "once (about 15 s; kept for later runs)" if cache_folder() is not None else "about 15 s"
        print(f"compiling the engine, {how} ...", file=sys.stderr, flush=True)


@contextmanager
def study_progress(what: str, workers: int | None = None) -> Iterator[Callable[[Told], None]]:
    """Give a function to be told how far a study is: a bar with rate and time left, or lines now and then."""
    if not sys.stderr.isatty():
        yield _StudyLines(what)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("runs, {task.fields[rate]}"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[failed]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(what, total=None, rate="", failed="")
        began_s = time.monotonic()

        def tell(told: Told) -> None:
            passed_s = time.monotonic() - began_s
            rate = f"{told.done / passed_s:,.0f} a second" if told.done and passed_s > 0 else ""
            failed = f"{told.failed} batches failed" if told.failed else ""
            bars.update(task, total=told.wanted, completed=told.done, rate=rate, failed=failed)

        yield tell


class _StudyLines:
    """Plain lines, for the logs of a batch system."""

    def __init__(self, what: str) -> None:
        self.what, self.began_s = what, time.monotonic()
        self.latest_s = self.began_s

    def __call__(self, told: Told) -> None:
        now_s = time.monotonic()
        if now_s - self.latest_s < LINE_EVERY_S:
            return
        self.latest_s, passed_s = now_s, now_s - self.began_s
        rate = told.done / passed_s
        left = f", {(told.wanted - told.done) / rate:.0f} s left" if rate else ""
        share = 100 * told.done / max(told.wanted, 1)
        failed = f", {told.failed} batches failed" if told.failed else ""
        print(
            f"{self.what}: {told.done:,} of {told.wanted:,} runs ({share:.0f} %), {rate:,.0f} a second{left}{failed}",
            file=sys.stderr,
            flush=True,
        )


@contextmanager
def reproduce_progress(items: int) -> Iterator[Callable[[str, float], None]]:
    """Give a function to be told what of the paper is being done, and the share done of all."""
    say_compiling()
    if not sys.stderr.isatty():
        lines = _Lines(f"reproducing {items} items")
        yield lambda what, share: lines(share)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description:<20}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("reproducing", total=1.0)
        yield lambda what, share: bars.update(task, description=what, completed=share)


class SearchLines:
    """Plain lines on how far a search is."""

    def __init__(self) -> None:
        self.latest_s = time.monotonic()

    def __call__(self, told: SearchTold) -> None:
        """Say so, if some time has passed since the last line."""
        now_s = time.monotonic()
        if now_s - self.latest_s < LINE_EVERY_S:
            return
        self.latest_s = now_s
        failed = f", {told.failed} failed" if told.failed else ""
        print(
            f"{told.method}: iteration {told.iteration} of {told.iterations}, {told.runs:,} of {told.wanted:,} runs, "
            f"best so far {told.best:.4g}{failed}",
            file=sys.stderr,
            flush=True,
        )
