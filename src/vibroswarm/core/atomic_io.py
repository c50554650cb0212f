"""Files and folders written whole or not at all, temporary names, and folder locks.

Temporary files are named ``.NAME.vsHOST-PID-TOKEN.SUFFIX``, so that the files of a killed process can be recognised
and removed. HOST identifies the machine and its process-number space: two containers, or two machines that share a
disk, never mistake each other's processes for dead. A folder that is replaced is first moved aside, to
``.NAME.old.vsHOST-PID-TOKEN``.

A folder lock lets one process at a time work in a folder. The lock is released when that process ends, even if it is
killed.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import secrets
import shutil
import socket
import stat
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError, RunError, check_flags, path_of, shown_name

TEMPORARY_NAME: Final = re.compile(
    r"(?:\.(?P<name>.+?)\.(?P<old>old\.)?|vibroswarm-)vs(?P<host>[0-9a-f]{8})-(?P<pid>\d+)-[0-9a-f]{12}(?:\..*)?"
)
"""Names of temporary files and folders. Those with a dot are explained in the module's docstring; ``old`` matches for
a folder that was moved aside. ``vibroswarm-vsHOST-PID-TOKEN`` is a folder in the system's folder of temporary files."""
OLD_MARK: Final = "old."
"""Precedes the tag of a folder that was moved aside while another takes its place."""


@cache
def _host() -> str:
    """Return 8 hexadecimal digits that identify this machine and its process-number space."""
    # Containers on one machine may share its name, but each counts its processes in a number space of its own.
    space = ""
    with suppress(OSError):  # systems other than Linux have no such entry
        # The link's text, such as "pid:[4026531836]", names the space.
        space = os.readlink("/proc/self/ns/pid")  # noqa: PTH115 - the text is not a path
    return hashlib.sha256(f"{socket.gethostname()} {space}".encode()).hexdigest()[:8]


def tag() -> str:
    """Return a new unique tag for a temporary file of this process."""
    return f"vs{_host()}-{os.getpid()}-{secrets.token_hex(6)}"


def is_alive(pid: int) -> bool:
    """Return whether process ``pid`` runs on this machine; True if that cannot be determined."""
    if os.name != "posix":  # Windows, where os.kill terminates
        return True
    try:
        os.kill(pid, 0)  # signal 0 only checks that the process exists
    except ProcessLookupError:
        return False
    except (
        PermissionError,
        OverflowError,
    ):  # it belongs to another user; it is too large a number for this system
        pass
    return True


def remove_leftovers(folder: Path) -> int:
    """Remove the temporary files and folders that killed processes of this machine left in a folder.

    If a process was killed after it had moved a folder aside and before it had put the new one in its place, the old
    folder is moved back. Files of other users, of other machines and of running processes stay.

    Returns:
        The number of files and folders that were removed or moved back, or would have been if the system allowed it.
    """
    removed = 0
    try:
        # Temporary names contain "vs": a cheap test before the pattern is tried.
        names = [entry.name for entry in os.scandir(folder) if "vs" in entry.name]
    except (
        OSError,
        ValueError,
    ):  # the folder does not exist or cannot be read; ValueError: a NUL in its name
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
                _remove_at_once(path)
            else:
                path.unlink()
    return removed


_cleaned_folders: set[tuple[int, str]] = set()
"""Folders for which ``remove_leftovers`` was called, each with the number of the process that called it."""


def remove_leftovers_once(folder: Path) -> None:
    """Call ``remove_leftovers`` for a folder, unless this process has done so already.

    A folder may hold many files and be written to often, so that searching it at each write would take long.
    """
    # A forked process inherits the set. With the process number in the key, it still searches the folder itself.
    key = os.getpid(), str(folder.absolute())
    if key not in _cleaned_folders:
        _cleaned_folders.add(key)
        remove_leftovers(folder)


def _remove_at_once(folder: Path) -> None:
    """Rename a folder, then remove it: no process sees it half removed under its own name."""
    # The new name has no ``OLD_MARK``, so ``remove_leftovers`` does not move the folder back.
    doomed = folder.with_name(f".removed.{tag()}")
    folder.replace(doomed)
    shutil.rmtree(doomed)


fcntl: Any
"""Module of file locks; None on Windows."""
msvcrt: Any
"""Module of file locks on Windows; None on other systems."""
try:
    import fcntl
except ImportError:  # Windows
    fcntl = None
try:
    import msvcrt
except ImportError:
    msvcrt = None

LOCK_FILE: Final = ".lock"
"""Name of the file in a folder by which the folder is locked."""
LOCK_OFFSET: Final = 2**30
"""Locked byte on Windows: far from the part that others may read."""


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of an existing folder during a ``with`` block.

    A folder that cannot be written to is not locked, as no process can change anything in it. The lock file names the
    process that holds it, for the error message of other processes.

    Raises:
        InputError: another process holds the lock or has removed the folder, or the lock file is a link, a folder or a
            pipe.
    """
    path = folder / LOCK_FILE
    stream = _acquire(path)
    if stream is None:  # the folder cannot be written to
        yield
        return
    try:
        os.ftruncate(stream, 0)
        os.write(stream, _me().encode())
        yield
    finally:
        try:
            if msvcrt is None:
                # Remove the file before the lock is released: after that, another process might hold a lock on it.
                path.unlink(missing_ok=True)
        finally:
            os.close(stream)  # releases the lock
        if msvcrt is not None:  # Windows cannot remove an open file
            with suppress(OSError):  # fails if another process has opened the file in the meantime
                path.unlink()


def _acquire(path: Path) -> int | None:
    """Create or open a lock file and lock it; return its descriptor, or None if the file cannot be written.

    Raises:
        InputError: another process holds the lock or has removed the folder, or it is no plain file: what a link leads
            to would be overwritten.
    """
    while True:
        with suppress(OSError):  # there is none
            if not stat.S_ISREG(path.lstat().st_mode):
                raise InputError("is in the place of a file: move it away", field=str(path))
        try:
            stream = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except FileNotFoundError:
            raise InputError(
                "was removed by another process; run the command again", field=str(path.parent)
            ) from None
        except OSError:
            return None
        try:
            if not _lock(stream, path):
                raise InputError(
                    f"is in use by {_holder(path)}; wait until it ends, or choose another folder",
                    field=str(path.parent),
                )
            # Windows cannot remove an open file, so the file is still there.
            if os.name != "posix" or _is_still_there(stream, path):
                return stream
        except BaseException:
            os.close(stream)
            raise
        # The previous holder removed the file after it had been opened here and before it was locked. A lock on a
        # removed file keeps no other process out, so try again with a new file.
        os.close(stream)


def _lock(stream: int, path: Path) -> bool:
    """Lock an open file without waiting; return False if another process holds the lock.

    On a file system without locks, the process that the file names holds the lock while it is alive. A process on
    another machine cannot be checked, and counts as ended. A file that names no process, or this process, is free.
    """
    try:
        if fcntl is not None:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif msvcrt is not None:
            os.lseek(stream, LOCK_OFFSET, os.SEEK_SET)  # ``locking`` locks the byte at the current position
            msvcrt.locking(stream, msvcrt.LK_NBLCK, 1)  # 1 byte
            os.lseek(stream, 0, os.SEEK_SET)  # where ``folder_lock`` writes
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a file system without locks
        pid, host = _named(path)
        return host != socket.gethostname() or pid == os.getpid() or not is_alive(pid)
    return True


def _is_still_there(stream: int, path: Path) -> bool:
    """Return whether ``path`` still names the open file ``stream``: it may have been removed or replaced since."""
    try:
        return os.path.samestat(os.fstat(stream), path.stat())
    except FileNotFoundError:
        return False


def _me() -> str:
    return f"{os.getpid()} {socket.gethostname()}\n"


def _named(path: Path) -> tuple[int, str]:
    """Return the number of the process and the machine that a lock file names; (0, "") if it names none."""
    try:
        pid, _, host = path.read_text(encoding="utf-8").strip().partition(" ")
        return int(pid), host
    except (OSError, ValueError):
        return 0, ""


def _holder(path: Path) -> str:
    pid, host = _named(path)
    return f"process {pid} on {host}" if pid else "another process"


MANIFEST: Final = "vibroswarm.json"
"""The file that says of which kind a folder is (``core.folders``)."""
OURS: Final = (MANIFEST, "scenario.toml", "study.toml", "search.toml", "printed.json")
"""Files that mark a folder as written by one of our commands: each such folder has at least one of them, except those
of ``export``, which have markers of their own. Folders of older formats, and those that were just begun, may have no
manifest."""
MAX_TRIES = 20
"""Attempts to check or to replace a folder that other processes replace at the same time."""
MAX_FILE_NAME_BYTES: Final = 255
"""Greatest length of a name on common file systems."""
MAX_BYTES_IN_NAME: Final = 100
"""Number of bytes of a name that are used in its temporary name, since file systems limit the length of names."""


def temporary_stem(name: str) -> str:
    """Return how the temporary names of a file or folder begin: with a point and the beginning of its name.

    A name that ends in ``.old`` gets a hyphen, so that its temporary name is not that of a folder that was moved aside.
    """
    # In ASCII, which every file system and every locale can encode; other bytes are written as %xx.
    letters = [chr(byte) if 32 <= byte < 127 else f"%{byte:02x}" for byte in os.fsencode(name)]
    beginning = "".join(letters)[:MAX_BYTES_IN_NAME]
    return f".{beginning}{'-' if beginning.endswith('.old') else ''}."


def check_free(path: Path) -> None:
    """Raise ``InputError`` if there is a file or folder at ``path``, which the user did not allow to be replaced."""
    if path.exists():
        raise InputError(
            f"'{path}' exists already; choose another name, or add --force (in Python: replace=True)",
            field="--out",
        )


def _short_suffix(path: Path) -> str:
    """Return the suffix of a file, by which writers choose its format; "" if it is too long to be one."""
    return path.suffix if len(os.fsencode(path.suffix)) <= MAX_BYTES_IN_NAME else ""


def write_text(path: str | Path, text: str, *, replace: bool) -> None:
    """Write a text file whole or not at all, as ``whole_file`` does, with the same line ends on all systems."""
    with whole_file(path, replace=replace) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def whole_file(path: str | Path, *, replace: bool = True) -> Iterator[Path]:
    """Yield the path of a new empty file beside ``path``; after the ``with`` block, rename the file to ``path``.

    The new file has the suffix of ``path``, by which some libraries choose the format. If the block raises an error,
    the new file is removed and ``path`` stays as it was.

    Args:
        replace: whether an existing file at ``path`` may be replaced; checked before the block only.
    Raises:
        InputError: ``path`` is a folder, a device or a pipe, or exists and ``replace`` is false, or its folder cannot
            be written to.
        RunError: the disk is full or failed: the block or the renaming raised an ``OSError``.
    """
    path = path_of(path)
    check_flags(replace=replace)
    if "\0" in str(path):
        raise _no_such_name(path)
    if path.is_dir():
        raise InputError(f"'{path}' is a folder; give the name of a file", field="--out")
    if not replace:
        check_free(path)
    if path.exists() and not path.is_file():  # renamed to, a device would be lost for the whole machine
        raise InputError(f"'{path}' is a device or a pipe; give the name of a file", field="--out")
    # The name is chosen before the file is created, so that the file is removed below even if Ctrl-C interrupts its
    # creation.
    part = path.parent / f"{temporary_stem(path.name)}{tag()}{_short_suffix(path)}"
    remove_leftovers_once(path.parent)
    try:
        try:
            _make_empty(part)
        except OSError as error:
            raise InputError(f"cannot write '{path}': {error.strerror}", field="--out") from None
        yield part
        part.replace(path)
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:  # the temporary name was shorter
            raise InputError(f"cannot write '{path}': {error.strerror}", field="--out") from None
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        if os.path.isfile(part):  # noqa: PTH113 - Path.is_file raises an error if the folder cannot be read
            part.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all; raises the errors of ``whole_file``."""
    with whole_file(path) as part:
        part.write_bytes(content if isinstance(content, bytes) else content.encode())


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write files into a folder, in the order of ``contents``, each whole or not at all; make the folder if needed.

    Args:
        contents: file name to text (written as UTF-8) or bytes.
    Raises:
        InputError: a file cannot be created, as ``whole_file`` has it.
        RunError: the folder cannot be created, or the disk is full or failed.
    """
    try:
        _make_folders(folder)
    except OSError as error:
        raise RunError(f"could not write '{folder}': {error.strerror or error}") from error
    for name, content in contents.items():
        write_file(folder / name, content)


def _no_such_name(path: Path) -> InputError:
    return InputError("cannot be made: there is no such name", field=shown_name(repr(str(path))))


def _make_folders(folder: Path) -> None:
    """Make a folder, and those in which it lies.

    Raises:
        InputError: there can be no such folder. OSError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (ValueError, RecursionError):  # a NUL in the name, or thousands of folders in each other
        raise _no_such_name(folder) from None


def make_folder(folder: Path) -> None:
    """Make a folder, and those in which it lies, unless it exists.

    Raises:
        InputError: it cannot be made there. RunError: the disk is full or failed.
    """
    try:
        _make_folders(folder)
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EIO):
            raise RunError(f"could not write '{folder}': {error.strerror}") from error
        raise InputError(f"cannot be made: {error.strerror or error}", field=str(folder)) from None


def _make_empty(part: Path) -> None:
    """Create a file with permissions by the umask; ``tempfile`` would let only this user read it."""
    os.close(os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666))


@contextmanager
def whole_folder(path: Path, *, replace: bool = False, marker: str = MANIFEST) -> Iterator[Path]:
    """Yield a new empty folder beside ``path``; after the ``with`` block, rename the folder to ``path``.

    If the block raises an error, the new folder is removed and ``path`` stays as it was. The new folder has the
    permissions of the one that it replaces. An existing empty folder is always replaced. Any other existing folder is
    replaced only if ``replace`` is true and the folder holds the file ``marker`` or one of the files ``OURS``, so that
    a folder that is not a result of ours is never removed.

    Raises:
        InputError: ``path`` exists and may not be replaced, or it cannot be written.
        RunError: the disk is full or failed: the block or the renaming raised an ``OSError``.
    """
    path = Path(path)
    # At every call, not once as for files: a folder that a killed process left moved aside must be back when ``path``
    # is checked.
    remove_leftovers(path.parent)
    check_folder(path, replace=replace, marker=marker)
    part = path.parent / f"{temporary_stem(path.name)}{tag()}"
    try:
        _make_folders(path.parent)
        part.mkdir()
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}", field="--out") from None
    with suppress(OSError):  # nothing there, or a file system without permissions
        shutil.copymode(path, part)  # a private folder stays private
    try:
        yield part
        # A check or a move fails if another process replaces the folder at the same time. Then try again: the folder of
        # the process that comes last stays.
        for tries_left in reversed(range(MAX_TRIES)):  # tries after this one
            try:
                check_folder(path, replace=replace, marker=marker)
                _swap_in(part, path)
                break
            except OSError:
                if not (tries_left and replace):
                    raise
                # Wait 0.5 ms longer after each try, times a factor (1 to 7) that differs between processes: if all
                # processes waited equally long, the same one might lose every time.
                time.sleep(0.0005 * (MAX_TRIES - tries_left) * (1 + os.getpid() % 7))
    except RunError as error:
        if str(part) not in str(error):
            raise
        # a file of the new folder could not be written; the user knows only the name of ``path``
        raise RunError(str(error).replace(str(part), str(path))) from error
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def remove_folder(path: Path) -> None:
    """Remove a folder and its content, unless another process works in it.

    Raises:
        InputError: another process holds the folder's lock, or as of ``refuse_unremovable``.
        RunError: the folder cannot be removed.
    """
    refuse_unremovable(path)
    # The lock only shows that no other process works in the folder. Its file lies in the folder, and Windows renames no
    # folder with an open file, so it is released first; a process that takes it in between loses its work.
    with folder_lock(path):
        pass
    try:
        _remove_at_once(path)
    except OSError as error:
        raise RunError(f"could not remove '{path}': {error.strerror or error}") from error


def refuse_working_folder(path: Path) -> None:
    """Refuse a folder that is to be removed or replaced but is the working folder, or holds it.

    Raises:
        InputError: it is.
    """
    try:
        holds_it = Path.cwd().is_relative_to(path.resolve())
    except (OSError, ValueError):  # the working folder was removed; the name is impossible
        return
    if holds_it:
        raise InputError(
            f"'{path}' is the working folder or holds it, so it is not replaced; work in another folder, or "
            "give the name of another",
            field="--out",
        )


def refuse_unremovable(path: Path) -> None:
    """Refuse a folder that is to be removed or replaced but cannot be, before it is renamed and half of it is gone.

    Raises:
        InputError: it is the working folder or holds it, or the user may not write to a folder within.
    """
    refuse_working_folder(path)
    if not path.is_dir():  # there is none, or its name is impossible
        return
    for place, folders, _ in os.walk(path):
        for part in (Path(place, name) for name in folders):
            if part.is_symlink() or not part.exists():  # another process may remove it meanwhile
                continue
            if not os.access(part, os.R_OK | os.W_OK | os.X_OK):
                raise InputError(f"'{path}' cannot be removed: '{part}' may not be written to", field="--out")


def refuse_unwritable(path: Path) -> None:
    """Refuse a folder that cannot be made or written to: a file is in its way, or the user may not write there.

    Raises:
        InputError: it cannot.
    """
    # None if the working folder was removed, of which later errors tell
    nearest = next((place for place in (path, *path.parents) if os.path.lexists(place)), None)
    if nearest is None:
        return
    if not nearest.is_dir():
        raise InputError(f"'{path}' cannot be made: '{nearest}' is not a folder", field="--out")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"cannot write '{path}': '{nearest}' may not be written to", field="--out")


def _aside(path: Path) -> Path:
    """Return a new name for a folder that is moved aside until another one is in its place.

    ``remove_leftovers`` moves the folder back to the name in it: the folder's own, or its beginning if the file system
    would not allow a name of that length.
    """
    whole = f".{path.name}.{OLD_MARK}{tag()}"
    if len(os.fsencode(whole)) > MAX_FILE_NAME_BYTES:
        whole = f"{temporary_stem(path.name)}{OLD_MARK}{tag()}"
    return path.parent / whole


def _swap_in(part: Path, path: Path) -> None:
    """Rename the folder ``part`` to ``path`` and remove the old folder at ``path``, if there was one.

    If the renaming fails, the old folder is moved back, unless another process has put a folder at ``path`` since.

    Raises:
        OSError: one of the folders could not be renamed.
    """
    old: Path | None = None  # where the old folder was moved to
    try:
        if path.exists():
            old = _aside(path)
            path.replace(old)
        part.replace(path)
    except OSError:
        if old is not None and old.exists() and not path.exists():
            old.replace(path)
        raise
    finally:
        if old is not None and old.exists():  # it does not exist if the folder was moved back
            with suppress(OSError):
                _remove_at_once(old)


def check_folder(path: Path, *, replace: bool = False, marker: str = MANIFEST) -> None:
    """Refuse a result folder if it exists and may not be replaced, if a file has its name, or if it cannot be written.

    Args:
        path: the folder to be written. An existing empty folder is accepted.
        replace: whether an existing folder may be replaced, if it holds ``marker`` or a file of ``OURS``.
    Raises:
        InputError: the folder is refused.
    """
    for tries_left in reversed(range(MAX_TRIES)):  # tries after this one
        before = identity(path)
        try:
            _check_folder(path, replace, marker)
            return
        except (InputError, FileNotFoundError):
            # Check again if another process has replaced the folder in the middle of this check.
            if not tries_left or identity(path) == before:
                raise


def identity(path: Path) -> tuple[int, int, int] | None:
    """Return a value that identifies the file or folder at ``path`` and its content; None if there is none.

    Device and inode number are not enough: a new folder may get the inode number of a folder that was just removed. So
    the time of the last change is part of the value.
    """
    try:
        status = path.lstat()
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino, status.st_ctime_ns


def _check_folder(path: Path, replace: bool, marker: str) -> None:
    """Check a result folder once, where ``check_folder`` (which has the same arguments) may check it several times.

    A symbolic link is always refused, even one to an empty folder: only folders themselves are replaced.

    Raises:
        InputError: the folder is refused.
        FileNotFoundError: another process removed the folder during the check.
    """
    try:
        path.lstat()  # fails for names that the file system does not allow
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # a name that is too long, or contains a NUL character
        cause = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(path)[:200]!r} is not a valid folder name: {cause}", field="--out") from None
    refuse_working_folder(path)
    if path.is_symlink():
        raise InputError(f"'{path}' is a symbolic link; give the name of a folder", field="--out")
    if path.exists() and not path.is_dir():
        raise InputError(f"'{path}' is a file; give the name of a folder", field="--out")
    refuse_unwritable(path)
    if path.exists():
        if not any(path.iterdir()):
            return
        if not replace:
            raise InputError(
                f"'{path}' exists already; choose another name, or add --force (in Python: replace=True)",
                field="--out",
            )
        if not any((path / name).exists() for name in (marker, *OURS)):
            raise InputError(
                f"'{path}' is not a vibroswarm result (no {marker} in it), so --force does not replace it",
                field="--out",
            )
        refuse_unremovable(path)
