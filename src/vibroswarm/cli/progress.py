"""Progress on stderr: a bar where it is a terminal, plain lines now and then where it is not."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LINE_EVERY_S = 10.0


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """Give a function to be told the share done, in [0, 1]; says so first if kernels must be compiled."""
    from vibroswarm.compiled import is_cached

    if not is_cached():
        print("compiling the engine, once (about 20 s; kept for later runs) ...", file=sys.stderr, flush=True)
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
