"""Processes begun by a bare fork, in which polars would wait for ever for threads that the fork did not copy.

``fork`` is how Linux starts the processes of ``multiprocessing`` before Python 3.14. Where polars had begun its threads
by then, its queries never return in the new process. What needs them calls ``check_threads`` first; a process forked
before polars began any is as good as any other, and is not refused.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

from vibroswarm.errors import RunError

TASKS: Final = Path("/proc/self/task")
HOW: Final = (
    "this process was forked after polars had begun its threads, which a fork does not copy: it would wait for ever; "
    "start processes by spawn, such as ProcessPoolExecutor(8, mp_context=multiprocessing.get_context('spawn'))"
)


class _State:
    used = False
    """Whether tables were asked for in this process, or in those that it was forked from."""
    begun = False
    """Whether polars had begun threads when this process was about to fork."""
    lost = False
    """Whether they did not come along into this process."""


def check_threads() -> None:
    """Say what to do instead of waiting for ever.

    Raises:
        RunError: this process was forked from one in which polars had begun its threads.
    """
    if _State.lost:
        raise RunError(HOW)
    _State.used = True


def _threads_begun() -> bool:
    """Whether polars has begun its threads; where they cannot be seen, whether it was used."""
    if "polars" not in sys.modules:
        return False
    try:
        names = [(task / "comm").read_text() for task in TASKS.iterdir()]
    except OSError:
        return _State.used
    return any(name.startswith("polars-") and name[7:].strip().isdigit() for name in names)


def _before() -> None:
    _State.begun = _threads_begun()


def _in_child() -> None:
    _State.lost = _State.lost or _State.begun


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_child=_in_child)
