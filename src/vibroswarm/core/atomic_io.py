"""Files and folders written whole or not at all, and folder locks.

What is being written has a hidden temporary name beside its place, and is renamed when it is complete.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError, RunError

fcntl: Any
"""Module of file locks; None on Windows, where folders are not locked."""
try:
    import fcntl
except ImportError:
    fcntl = None

MANIFEST: Final = "vibroswarm.json"
"""The file that says of which kind a folder is (``core.folders``)."""
OURS: Final = (MANIFEST, "scenario.toml", "study.toml", "search.toml", "printed.json")
"""Files that mark a folder as written by one of our commands; one that was just begun may have no manifest."""
LETTERS_IN_NAME: Final = 50
"""Letters of a name that are used in its temporary name, since file systems limit the length of names."""


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name[:LETTERS_IN_NAME]}.{secrets.token_hex(6)}{path.suffix}")


@contextmanager
def folder_lock(folder: Path) -> Iterator[None]:
    """Hold the lock of an existing folder during a ``with`` block; it ends with the process, however that ends.

    Where the system or the file system has no locks, nothing happens.

    Raises:
        InputError: another process holds the lock.
    """
    if fcntl is None:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError("is in use by another process", field=str(folder)) from None
        except OSError:  # a file system without locks
            pass
        yield
    finally:
        os.close(descriptor)


def check_free(path: Path) -> None:
    """Raise ``InputError`` if there is a file or folder at ``path``, which may not be replaced."""
    if path.exists():
        raise InputError("exists already; choose another name, or replace it", field=str(path))


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
        InputError: ``path`` is no file, or exists and ``replace`` is false, or its folder cannot be written to.
        RunError: the disk is full or failed: the block or the renaming raised an ``OSError``.
    """
    path = Path(path)
    if not replace:
        check_free(path)
    if path.exists() and not path.is_file():  # renamed to, a device would be lost for the whole machine
        raise InputError("is not a file", field=str(path))
    part = _beside(path)
    try:
        part.touch()
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror}", field=str(path)) from None
    try:
        yield part
        part.replace(path)
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
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
        InputError: the folder or a file cannot be created. RunError: the disk is full or failed.
    """
    make_folder(folder)
    for name, content in contents.items():
        write_file(folder / name, content)


def make_folder(folder: Path) -> None:
    """Make a folder, and those in which it lies, unless it exists.

    Raises:
        InputError: it cannot be made there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", field=str(folder)) from None


@contextmanager
def whole_folder(path: Path, *, replace: bool = False, marker: str = MANIFEST) -> Iterator[Path]:
    """Yield a new empty folder beside ``path``; after the ``with`` block, rename the folder to ``path``.

    If the block raises an error, the new folder is removed and ``path`` stays as it was.

    Args:
        replace, marker: as of ``check_folder``.
    Raises:
        InputError: ``path`` exists and may not be replaced, or it cannot be written.
        RunError: the disk is full or failed: the block or the renaming raised an ``OSError``.
    """
    check_folder(path, replace=replace, marker=marker)
    part = _beside(path)
    make_folder(part)
    try:
        yield part
        if path.exists():
            _remove(path)
        part.replace(path)
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _remove(folder: Path) -> None:
    """Rename a folder, then remove it: no process sees it half removed under its own name."""
    doomed = _beside(folder)
    folder.replace(doomed)
    shutil.rmtree(doomed)


def remove_folder(path: Path) -> None:
    """Remove a folder and its content, unless another process works in it.

    Raises:
        InputError: another process holds the folder's lock. RunError: the folder cannot be removed.
    """
    with folder_lock(path):
        pass
    try:
        _remove(path)
    except OSError as error:
        raise RunError(f"could not remove '{path}': {error.strerror or error}") from error


def check_folder(path: Path, *, replace: bool = False, marker: str = MANIFEST) -> None:
    """Refuse a folder that is to be written if it exists and may not be replaced, or cannot be written.

    Args:
        path: the folder. An existing empty folder is accepted.
        replace: whether an existing folder may be replaced, if it holds ``marker`` or a file of ``OURS``.
    Raises:
        InputError: the folder is refused.
    """
    check_writable(path)
    if path.is_symlink():
        raise InputError("is a symbolic link; give the name of a folder", field=str(path))
    if not path.exists() or not any(path.iterdir()):
        return
    if not replace:
        check_free(path)
    is_ours = any((path / name).exists() for name in (marker, *OURS))
    if not is_ours or Path.cwd().is_relative_to(path.resolve()):
        raise InputError("is no result of vibroswarm, or the working folder: not replaced", field=str(path))


def check_writable(path: Path) -> None:
    """Refuse a folder that cannot be made or written to: a file is in its way, or the user may not write there.

    Raises:
        InputError: it cannot.
    """
    nearest = next((place for place in (path, *path.parents) if place.exists()), Path())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            f"cannot be made: '{nearest}' is not a folder that you may write to", field=str(path)
        )
