"""Files and folders written whole or not at all, temporary names, and folder locks.

Temporary files are named ``.NAME.HOST-PID-TOKEN.SUFFIX``, so that those of a killed process can be removed. HOST
stands for the machine and its process-number space: two containers, or two machines that share a disk, never
mistake each other's processes for dead.

A folder lock lets one process at a time work in a folder; it is released when that process ends, however it ends.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError, RunError

TEMPORARY_NAME: Final = re.compile(
    r"(?:\.(?P<name>.+?)\.(?P<old>old\.)?|vibroswarm-)vs(?P<host>[0-9a-f]{8})-(?P<pid>\d+)-[0-9a-f]{12}(?:\..*)?"
)
OLD_MARK: Final = "old."
"""Precedes the tag of a folder that was moved aside while another takes its place."""


@cache
def _host() -> str:
    """Return 8 digits for this machine and its process-number space."""
    space = ""
    with suppress(OSError):
        space = os.readlink("/proc/self/ns/pid")  # noqa: PTH115 - a name, not a path
    return hashlib.sha256(f"{socket.gethostname()} {space}".encode()).hexdigest()[:8]


def tag() -> str:
    """Return a new unique tag for a temporary file of this process."""
    return f"vs{_host()}-{os.getpid()}-{secrets.token_hex(6)}"


def is_alive(pid: int) -> bool:
    """Return whether process ``pid`` runs on this machine; True if that cannot be determined."""
    if os.name != "posix":  # Windows, where os.kill terminates
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def remove_leftovers(folder: Path) -> int:
    """Remove what killed processes of this machine left in a folder; return the number of files and folders.

    A folder that was moved aside by a process killed at that moment is moved back. Files of other users and of
    running processes stay.
    """
    removed = 0
    try:
        names = [entry.name for entry in os.scandir(folder) if "vs" in entry.name]
    except OSError:
        return 0
    for name in names:
        match = TEMPORARY_NAME.fullmatch(name)
        if match is None or match["host"] != _host() or is_alive(int(match["pid"])):
            continue
        path = folder / name
        with suppress(OSError):
            if hasattr(os, "getuid") and path.lstat().st_uid != os.getuid():
                continue
            removed += 1
            if match["old"] and not (folder / match["name"]).exists():
                path.replace(folder / match["name"])
            elif path.is_dir() and not path.is_symlink():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink()
    return removed


_cleaned_folders: set[tuple[int, str]] = set()


def remove_leftovers_once(folder: Path) -> None:
    """Call ``remove_leftovers`` once per process and folder, as a folder may hold many files and be written to
    often."""
    key = os.getpid(), str(folder.absolute())
    if key not in _cleaned_folders:
        _cleaned_folders.add(key)
        remove_leftovers(folder)


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

LOCK_FILE: Final = ".lock"
LOCK_OFFSET: Final = 2**30
"""Locked byte on Windows: far from the part that others may read."""


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of an existing folder.

    A folder that cannot be written is not locked: nothing in it needs protection.

    Raises:
        InputError: another process holds it.
    """
    path = folder / LOCK_FILE
    stream = _acquire(path)
    if stream is None:
        yield
        return
    try:
        os.ftruncate(stream, 0)
        os.write(stream, _me().encode())
        yield
    finally:
        if msvcrt is None:  # while locked, so that only our own file is removed
            path.unlink(missing_ok=True)
        os.close(stream)
        if msvcrt is not None:
            with suppress(OSError):  # another process has opened it since
                path.unlink()


def _acquire(path: Path) -> int | None:
    """Open and lock a lock file; return its descriptor, or None if it cannot be written.

    Raises:
        InputError: another process holds the lock.
    """
    while True:
        try:
            stream = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError:
            return None
        try:
            if not _lock(stream, path):
                raise InputError(
                    f"is in use by {_holder(path)}; wait until it ends, or choose another folder",
                    field=str(path.parent),
                )
            if os.name != "posix" or _is_still_there(stream, path):
                return stream
        except BaseException:
            os.close(stream)
            raise
        os.close(stream)  # released and removed between opening and locking


def _lock(stream: int, path: Path) -> bool:
    """Lock an open file without waiting; return False if another process holds the lock."""
    try:
        if fcntl is not None:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif msvcrt is not None:
            os.lseek(stream, LOCK_OFFSET, os.SEEK_SET)
            msvcrt.locking(stream, msvcrt.LK_NBLCK, 1)
            os.lseek(stream, 0, os.SEEK_SET)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a file system without locks: the process named in the file, if it is alive
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
    """Return process and machine named in the lock file, or (0, "")."""
    try:
        pid, _, host = path.read_text(encoding="utf-8").strip().partition(" ")
        return int(pid), host
    except (OSError, ValueError):
        return 0, ""


def _holder(path: Path) -> str:
    pid, host = _named(path)
    return f"process {pid} on {host}" if pid else "another process"


MARKER = "scenario.toml"
"""The file that marks a folder as a result."""
OURS: Final = (MARKER, "study.toml", "search.toml", "tradeoff.csv", "printed.json", "recording.json", "items")
"""Files of which a folder that a command writes has at least one."""
MAX_TRIES = 20
MAX_NAME_LENGTH = 100
"""Characters of a name that go into the temporary one, which file systems limit too."""


@contextmanager
def whole_file(path: Path, *, replace: bool = True) -> Iterator[Path]:
    """Yield a temporary name beside ``path``; on success, rename it to ``path``.

    Raises:
        InputError: ``path`` exists and ``replace`` is false, or its folder cannot be written.
        RunError: the disk is full or failed.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"'{path}' is a folder; give the name of a file", field="--out")
    if path.exists() and not replace:
        raise InputError(
            f"'{path}' exists already; choose another name, or add --force (in Python: replace=True)",
            field="--out",
        )
    # Named before it is created, so that no interruption, not even Ctrl-C during creation, leaves a file behind.
    part = path.parent / f".{path.name[:MAX_NAME_LENGTH]}.{tag()}{path.suffix[:MAX_NAME_LENGTH]}"
    remove_leftovers_once(path.parent)
    try:
        try:
            _make_empty(part)
        except OSError as error:
            raise InputError(f"cannot write '{path}': {error.strerror}", field="--out") from None
        yield part
        part.replace(path)
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        if os.path.isfile(part):  # noqa: PTH113 - Path's raises where the folder cannot even be read
            part.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all; raises as ``whole_file`` does."""
    with whole_file(path) as part:
        part.write_bytes(content if isinstance(content, bytes) else content.encode())


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write files by name into a folder, in order, each whole or not at all; make the folder if needed.

    Raises:
        RunError: the folder or a file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"could not write '{folder}': {error.strerror or error}") from error
    for name, content in contents.items():
        write_file(folder / name, content)


def _make_empty(part: Path) -> None:
    os.close(os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666))


@contextmanager
def whole_folder(path: Path, *, replace: bool = False, marker: str = MARKER) -> Iterator[Path]:
    """Yield an empty folder beside ``path``; on success, rename it to ``path``.

    An existing ``path`` is refused, or replaced if ``replace`` is true and it is empty or holds ``marker`` or a file
    of ``OURS``: any other folder is never removed.

    Raises:
        InputError: ``path`` exists, or cannot be written.
        RunError: the disk is full or failed.
    """
    path = Path(path)
    remove_leftovers(path.parent)
    check_folder(path, replace=replace, marker=marker)
    part = path.parent / f".{path.name[:MAX_NAME_LENGTH]}.{tag()}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.mkdir()
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}", field="--out") from None
    try:
        yield part
        # Another process may write there at the same time; the last one wins.
        for left in reversed(range(MAX_TRIES)):
            try:
                check_folder(path, replace=replace, marker=marker)
                _swap_in(part, path)
                break
            except OSError:
                if not (left and replace):
                    raise
                # Longer at each try, and not as long as others: without, a process may lose every time.
                time.sleep(0.0005 * (MAX_TRIES - left) * (1 + os.getpid() % 7))
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def remove_folder(path: Path) -> None:
    """Remove a folder that no other process works in.

    Raises:
        InputError: another process works in it. RunError: it cannot be removed.
    """
    with folder_lock(path):
        pass
    old = path.parent / f".{path.name[:MAX_NAME_LENGTH]}.{OLD_MARK}{tag()}"
    try:
        path.replace(old)  # at once: nobody sees half of it
        shutil.rmtree(old)
    except OSError as error:
        raise RunError(f"could not remove '{path}': {error.strerror or error}") from error


def _swap_in(part: Path, path: Path) -> None:
    """Move a folder to ``path``, replacing what is there; on failure, restore it."""
    old: Path | None = None
    try:
        if path.exists():
            old = path.parent / f".{path.name}.{OLD_MARK}{tag()}"
            path.replace(old)
        part.replace(path)
    except OSError:
        if old is not None and old.exists() and not path.exists():
            old.replace(path)
        raise
    finally:
        if old is not None:
            shutil.rmtree(old, ignore_errors=True)


def check_folder(path: Path, *, replace: bool = False, marker: str = MARKER) -> None:
    """Refuse a result folder that exists (unless it may be replaced) or whose name is taken by a file.

    Raises:
        InputError: the folder is refused.
    """
    for left in reversed(range(MAX_TRIES)):
        before = _identity(path)
        try:
            _check_folder(path, replace, marker)
            return
        except (InputError, FileNotFoundError):
            # Another process may have replaced the folder between two checks.
            if not left or _identity(path) == before:
                raise


def _identity(path: Path) -> tuple[int, int, int] | None:
    """Return a value that identifies the folder at ``path``; None if there is none.

    A folder may have the number of one that was just removed, but hardly its time of change too.
    """
    try:
        status = path.lstat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino, status.st_ctime_ns


def _check_folder(path: Path, replace: bool, marker: str) -> None:
    """Refuse a folder that must not be replaced."""
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # a name that is too long, or holds a NUL
        cause = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(path)[:200]!r} is not a valid folder name: {cause}", field="--out") from None
    if path.is_symlink() or path.exists():
        if not path.is_dir():
            raise InputError(f"'{path}' is a file; give the name of a folder", field="--out")
        empty = not any(path.iterdir())
        if empty and not path.is_symlink():
            return
        if not replace:
            raise InputError(
                f"'{path}' exists already; choose another name, or add --force (in Python: replace=True)",
                field="--out",
            )
        if path.is_symlink() or not any((path / name).exists() for name in (marker, *OURS)):
            raise InputError(
                f"'{path}' is not a vibroswarm result (no {marker} in it), so --force does not replace it",
                field="--out",
            )
