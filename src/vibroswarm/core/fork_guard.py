"""Refusal of forked processes in which polars would wait forever for threads that the fork did not copy.

Before Python 3.14, ``multiprocessing`` on Linux starts processes by ``fork``. If polars had started its threads
by then, its queries never return in the new process. ``simulate`` therefore calls ``check_threads`` first. A
process that was forked before polars started its threads is fine: polars starts them there when needed.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

from vibroswarm.errors import RunError

TASKS: Final = Path("/proc/self/task")
"""Folder in which Linux lists the threads of this process."""
HOW: Final = (
    "this process was forked after polars had started its threads, which a fork does not copy: it would wait forever; "
    "start processes by spawn, such as ProcessPoolExecutor(8, mp_context=multiprocessing.get_context('spawn'))"
)


class _State:
    used = False
    """Whether ``check_threads`` was called in this process, or in a parent before the fork."""
    begun = False
    """Whether polars had started threads when this process was about to fork."""
    lost = False
    """Whether this process was forked without the threads that polars had started."""


def check_threads() -> None:
    """Refuse to use polars where its queries would wait forever; otherwise note that polars is used from now on.

    What is known is kept in ``_State``: ``lost`` (set when the process was forked) and ``used`` (set here).

    Raises:
        RunError: this process was forked after polars had started its threads.
    """
    if _State.lost:
        raise RunError(HOW)
    _State.used = True


def _threads_begun() -> bool:
    """Return whether polars has started its threads.

    Where the threads of a process cannot be listed (Linux lists them in /proc), they count as started once
    ``check_threads`` has been called.
    """
    if "polars" not in sys.modules:
        return False
    try:
        names = [(task / "comm").read_text() for task in TASKS.iterdir()]
    except OSError:
        return _State.used
    # The threads of polars are named polars-0, polars-1, ...
    return any(
        name.startswith("polars-") and name.removeprefix("polars-").strip().isdigit() for name in names
    )


def _before() -> None:
    """Note, before a fork, whether polars has threads that the new process will lack."""
    _State.begun = _threads_begun()


def _in_child() -> None:
    """Note, in the forked process, whether it lacks the threads of polars, since this fork or an earlier one."""
    _State.lost = _State.lost or _State.begun


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_child=_in_child)
