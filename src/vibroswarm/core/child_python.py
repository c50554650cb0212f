"""Python processes that import no file of the working folder, and how many processors there are for them.

``python -c`` and ``python -m`` put the working folder first on the search path, so that a file ``signal.py`` in a
folder of somebody else's data would be executed. Every process that this package starts leaves it out.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

VARIABLE: Final = "PYTHONSAFEPATH"
"""Environment variable that makes Python leave the working folder out, as option -P does."""
MOST_WORKERS: Final = 4096
"""Largest number of workers, threads or processes, that is accepted."""
_lock: Final = threading.Lock()
"""Held while ``VARIABLE`` is set, so that threads which start processes at once do not reset it for each other."""


def processors() -> int:
    """Return the number of processors that this process may use; a batch system may grant fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def command(*arguments: str) -> list[str]:
    """Return the command that runs this Python without the working folder on its search path.

    Args:
        arguments: such as ``-m`` and the name of a module.
    """
    return [sys.executable, "-P", *arguments]


def environment() -> dict[str, str]:
    """Return the environment variables for ``command``: those of this process, with its search path."""
    # An empty entry would be the working folder.
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


@contextmanager
def safe_start() -> Iterator[None]:
    """Context manager: processes that ``multiprocessing`` starts inside leave the working folder out.

    ``multiprocessing`` runs them, and its own helper, by ``python -c``, and passes on option -P only if this process
    has it. They get this process's search path later, when modules of the standard library have been imported.
    """
    with _lock:
        before = os.environ.get(VARIABLE)
        os.environ[VARIABLE] = "1"
        try:
            yield
        finally:
            if before is None:
                del os.environ[VARIABLE]
            else:
                os.environ[VARIABLE] = before
