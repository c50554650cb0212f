"""One thread for linear algebra.

Products of small arrays, as the optimisers of fits make them by the thousand, are the slower the more threads share
them: the threads wait for each other, and L-BFGS-B takes ten times as much CPU time with two threads as with one. With
one thread a sum also has the same order of additions, and so the same last digits, on every machine.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

Function = TypeVar("Function", bound=Callable[..., Any])


def with_one_blas_thread(function: Function) -> Function:
    """Return a function that does what ``function`` does, with one thread for linear algebra in this process."""
    limited: Function = threadpool_limits.wrap(limits=1, user_api="blas")(function)
    return limited
