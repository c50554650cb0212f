"""Work that goes on beside the main thread, and what it may tell: one bar for all."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Final

SWITCH_S: Final = 5e-4
"""After so long at most Python's lock goes to another thread that waits for it. Kernels take some ms without it; were
each to wait 5 ms for it afterwards, as is Python's way, processors would idle."""
Check = Callable[[], None]
"""To be called now and then, on either side: raises what ends this side's work."""


class Stopped(Exception):  # noqa: N818  (nothing went wrong here)
    """The main thread ended early, so that work beside it ends too."""


@contextmanager
def beside(work: Callable[[Check], None] | None) -> Iterator[Check]:
    """Have ``work`` done in a thread while the body of this runs; leaving it waits for what is left to do.

    What is raised in one of the two ends the other, where that one next calls the check that it is given.

    Args:
        work: without, nothing is done.
    """
    if work is None:
        yield lambda: None
        return
    stop, raised = threading.Event(), list[BaseException]()

    def check_there() -> None:
        if stop.is_set():
            raise Stopped

    def there() -> None:
        try:
            work(check_there)
        except Stopped:
            pass
        except BaseException as error:  # it is raised in the main thread
            raised.append(error)

    def check_here() -> None:
        if raised:
            raise raised[0]

    # A daemon: a second Ctrl-C, while this waits for it, leaves at once.
    thread = threading.Thread(target=there, name="vibroswarm-beside", daemon=True)
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    thread.start()
    try:
        yield check_here
        thread.join()
    finally:
        stop.set()
        thread.join()
        sys.setswitchinterval(before_s)
    check_here()


class Bar:
    """The share done of all, told from several threads.

    Args:
        tell: called with what is being done and the share done. weights: of what there is to do, by name.
    """

    def __init__(self, tell: Callable[[str, float], None], weights: Mapping[str, float]) -> None:
        self._tell, self._weights, self._lock = tell, dict(weights), threading.Lock()
        self._done = dict.fromkeys(weights, 0.0)
        self.shown: str | None = None
        """What is named; what tells, if None."""

    def told(self, what: str, share: float) -> None:
        """So much of this is done."""
        with self._lock:
            self._done[what] = max(share, self._done[what])
            whole = sum(self._weights.values())
            total = sum(self._weights[name] * done for name, done in self._done.items()) / whole
            self._tell(self.shown or what, min(total, 1.0))
