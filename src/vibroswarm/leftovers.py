"""Temporary files and folders are named by their process, so that those of a killed one can be removed.

The name is ``.NAME.HOST-PID-TOKEN.SUFFIX``, where HOST stands for the machine and its space of process numbers: two
containers, or two machines that share a disk, never take each other's processes for dead.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import socket
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Final

NAMED: Final = re.compile(
    r"(?:\.(?P<name>.+?)\.(?P<old>old\.)?|vibroswarm-)vs(?P<host>[0-9a-f]{8})-(?P<pid>\d+)-[0-9a-f]{12}(?:\..*)?"
)
OLD: Final = "old."
"""Before the tag of a folder that was moved out of the way while another takes its place."""


@cache
def _host() -> str:
    """8 digits for this machine and its space of process numbers."""
    space = ""
    with suppress(OSError):
        space = os.readlink("/proc/self/ns/pid")  # noqa: PTH115 - a name, not a path
    return hashlib.sha256(f"{socket.gethostname()} {space}".encode()).hexdigest()[:8]


def tag() -> str:
    """What names a temporary file of this process, another each time."""
    return f"vs{_host()}-{os.getpid()}-{secrets.token_hex(6)}"


def is_alive(pid: int) -> bool:
    """Whether there is a process of this number on this machine; where it cannot be asked, yes."""
    if os.name != "posix":  # where signal 0 is no question
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def remove_leftovers(folder: Path) -> int:
    """Remove what killed processes of this machine left in a folder; gives how many files and folders.

    A folder that was moved out of the way by a process killed just then goes back to its place. What belongs to
    another user, or to a process that lives, stays.
    """
    removed = 0
    try:
        names = [entry.name for entry in os.scandir(folder) if "vs" in entry.name]
    except OSError:
        return 0
    for name in names:
        found = NAMED.fullmatch(name)
        if found is None or found["host"] != _host() or is_alive(int(found["pid"])):
            continue
        path = folder / name
        with suppress(OSError):
            if hasattr(os, "getuid") and path.lstat().st_uid != os.getuid():
                continue
            removed += 1
            if found["old"] and not (folder / found["name"]).exists():
                path.replace(folder / found["name"])
            elif path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()
    return removed


_looked_at: set[tuple[int, str]] = set()


def remove_leftovers_once(folder: Path) -> None:
    """As ``remove_leftovers``, once a process and folder: a folder may hold many files, and be written to often."""
    key = os.getpid(), str(folder.absolute())
    if key not in _looked_at:
        _looked_at.add(key)
        remove_leftovers(folder)
