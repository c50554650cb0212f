"""Python processes that import no file of the working folder, their processors, and threads of linear algebra.

``python -c`` and ``python -m`` put the working folder first on the search path, so that a file ``signal.py`` in a
folder of somebody else's data would be executed. Every process that this package starts leaves it out.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])
MOST_WORKERS: Final = 4096
"""Largest number of workers, threads or processes, that is accepted."""
_lock: Final = threading.Lock()
"""Held while the variable is set, so that threads which start processes at once do not reset it for each other."""


def processors() -> int:
    """Return the number of processors that this process may use; a batch system may grant fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def safe_start() -> Iterator[None]:
    """Context manager: processes that ``multiprocessing`` starts inside (by ``python -c``) leave the working folder
    out.
    """
    with _lock:
        before = os.environ.copy()
        os.environ["PYTHONSAFEPATH"] = "1"  # leaves the working folder out, as option -P does
        try:
            yield
        finally:
            os.environ.pop("PYTHONSAFEPATH")
            os.environ.update(before)


def with_one_blas_thread(function: Function) -> Function:
    """Return a function that does what ``function`` does, with one thread for linear algebra in this process.

    Products of small arrays, of which optimisers of fits make thousands, are slower with more threads, which wait for
    each other. With one thread a sum also has the same order of additions, and the same last digits, everywhere.
    """
    from threadpoolctl import threadpool_limits  # commands without a fit need none

    limited: Function = threadpool_limits.wrap(limits=1, user_api="blas")(function)
    return limited
