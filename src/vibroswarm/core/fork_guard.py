"""Refusal of forked processes in which polars would wait forever for threads that the fork did not copy.

Before Python 3.14, ``multiprocessing`` on Linux starts processes by ``fork``. If polars had started its threads
by then, its queries never return in the new process. Code that needs them calls ``check_threads`` first; a
process forked before polars started any threads is fine.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

from vibroswarm.errors import RunError

TASKS: Final = Path("/proc/self/task")
HOW: Final = (
    "this process was forked after polars had started its threads, which a fork does not copy: it would wait forever; "
    "start processes by spawn, such as ProcessPoolExecutor(8, mp_context=multiprocessing.get_context('spawn'))"
)


class _State:
    used = False
    """Whether tables were used in this process or in its parents."""
    begun = False
    """Whether polars had started threads when this process was about to fork."""
    lost = False
    """Whether those threads are missing in this process."""


def check_threads() -> None:
    """Raise an error instead of waiting forever.

    Raises:
        RunError: this process was forked after polars had started its threads.
    """
    if _State.lost:
        raise RunError(HOW)
    _State.used = True


def _threads_begun() -> bool:
    """Return whether polars has started its threads; if they cannot be listed, whether it was used."""
    if "polars" not in sys.modules:
        return False
    try:
        names = [(task / "comm").read_text() for task in TASKS.iterdir()]
    except OSError:
        return _State.used
    return any(name.startswith("polars-") and name[7:].strip().isdigit() for name in names)


def _before() -> None:
    """Note, before a fork, whether polars has threads that the new process will lack."""
    _State.begun = _threads_begun()


def _in_child() -> None:
    """Note in the forked process that these threads are missing, here or since an earlier fork."""
    _State.lost = _State.lost or _State.begun


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_child=_in_child)
