"""One process at a time in a folder: a lock that ends with its process, however that ends."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError
from vibroswarm.leftovers import is_alive

fcntl: Any
msvcrt: Any
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None
try:
    import msvcrt
except ImportError:
    msvcrt = None

FILE: Final = ".lock"
FAR: Final = 2**30
"""Where a byte is locked on Windows: far from what others shall be able to read."""


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder that is there.

    Where the folder cannot be written there is nothing to be guarded, and no lock.

    Raises:
        InputError: another process holds it.
    """
    path = folder / FILE
    stream = _taken(path)
    if stream is None:
        yield
        return
    try:
        os.ftruncate(stream, 0)
        os.write(stream, _me().encode())
        yield
    finally:
        if msvcrt is None:  # while it is held, so that nobody else's is removed
            path.unlink(missing_ok=True)
        os.close(stream)
        if msvcrt is not None:
            with suppress(OSError):  # another one has it open by now
                path.unlink()


def _taken(path: Path) -> int | None:
    while True:
        try:
            stream = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError:
            return None
        try:
            if not _lock(stream, path):
                raise InputError(
                    f"is in use by {_holder(path)}; wait until it ends, or take another folder",
                    field=str(path.parent),
                )
            if os.name != "posix" or _is_still_there(stream, path):
                return stream
        except BaseException:
            os.close(stream)
            raise
        os.close(stream)  # it was released and removed between the two steps


def _lock(stream: int, path: Path) -> bool:
    """Take the lock of an open file without waiting; false: another has it."""
    try:
        if fcntl is not None:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif msvcrt is not None:
            os.lseek(stream, FAR, os.SEEK_SET)
            msvcrt.locking(stream, msvcrt.LK_NBLCK, 1)
            os.lseek(stream, 0, os.SEEK_SET)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a file system without locks: whoever is named in it, if he lives
        pid, host = _named(path)
        return host != socket.gethostname() or pid == os.getpid() or not is_alive(pid)
    return True


def _is_still_there(stream: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(stream), path.stat())
    except FileNotFoundError:
        return False


def _me() -> str:
    return f"{os.getpid()} {socket.gethostname()}\n"


def _named(path: Path) -> tuple[int, str]:
    """Process and machine that wrote the lock, or (0, "")."""
    try:
        pid, _, host = path.read_text(encoding="utf-8").strip().partition(" ")
        return int(pid), host
    except (OSError, ValueError):
        return 0, ""


def _holder(path: Path) -> str:
    pid, host = _named(path)
    return f"process {pid} on {host}" if pid else "another process"
