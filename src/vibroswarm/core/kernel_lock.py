"""Locks among processes that compile kernels into one cache folder.

While one process compiles a kernel, others that need it wait, and then load it from the cache. Without the locks each
of them would compile it too: with an empty cache, two processes that start together would do everything twice.

A lock is on one byte of the file ``locks`` in the folder, at a place that the kernel's name gives, so one empty file
serves all kernels. The system releases the locks of a process that ends, however it ends. Where there are no such
locks (Windows, some network drives) nobody waits, and a kernel may be compiled twice.
"""

from __future__ import annotations

import errno
import hashlib
import os
import sys
from pathlib import Path
from time import monotonic, sleep
from typing import Final

if sys.platform != "win32":
    import fcntl

WAIT_S: Final = 60.0
"""Longest wait for another process, s; after it, the kernel is compiled here. A process may have been suspended."""
POLL_S: Final = 0.02
"""Time between two looks whether the lock is free, s."""
BY_ANOTHER: Final = (errno.EACCES, errno.EAGAIN)
"""Error numbers of a lock that another process holds."""

_files: dict[Path, int] = {}
"""Descriptors of the files of locks. They stay open: closing one would release all of this process's locks there."""


class KernelLock:
    """The lock of one kernel among processes. Threads need none: Numba compiles one kernel at a time in a process."""

    def __init__(self, folder: Path, kernel: str) -> None:
        """Declare the lock; nothing is opened.

        Args:
            folder: the cache folder. kernel: a name that no other kernel in the folder has.
        """
        self._path = folder / "locks"
        # A signed 64-bit offset that need not exist in the file.
        self._offset = int.from_bytes(hashlib.sha256(kernel.encode()).digest()[:7])
        self._is_held = False

    def acquire(self) -> None:
        """Wait until no other process holds the lock, and take it; do nothing where there are no locks."""
        if sys.platform == "win32" or self._is_held:
            return
        try:
            file = self._file()
        except OSError:  # the folder or the file cannot be written to
            return
        until_s = monotonic() + WAIT_S
        while monotonic() < until_s:
            try:
                fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, self._offset)
            except OSError as error:
                if error.errno not in BY_ANOTHER:
                    return  # the folder has no locks
                sleep(POLL_S)
            else:
                self._is_held = True
                return

    def release(self) -> None:
        """Release the lock if this process holds it."""
        if sys.platform != "win32" and self._is_held:
            self._is_held = False
            fcntl.lockf(self._file(), fcntl.LOCK_UN, 1, self._offset)

    def _file(self) -> int:
        """Return the descriptor of the file of locks, which is created if needed."""
        if self._path not in _files:
            _files[self._path] = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
        return _files[self._path]
