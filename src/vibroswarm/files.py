"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vibroswarm.errors import InputError, RunError
from vibroswarm.leftovers import OLD, remove_leftovers, remove_leftovers_once, tag

MARKER = "scenario.toml"
"""The file by which a folder is known to be a result."""
TRIES = 20
LONGEST = 100
"""Of a name, as much goes into the temporary one, which must not be too long for a file system either."""


@contextmanager
def whole_file(path: Path, *, replace: bool = True) -> Iterator[Path]:
    """Give a temporary name beside ``path``; on leaving without an error, rename it to ``path``.

    Raises:
        InputError: ``path`` exists and ``replace`` is false, or its folder cannot be written.
        RunError: the disk is full or failed.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"'{path}' is a folder; give the name of a file", field="--out")
    if path.exists() and not replace:
        raise InputError(f"'{path}' exists already; choose another name or say --force", field="--out")
    # Named before it is there, so that whatever ends this, even Ctrl-C just as it is made, leaves none behind.
    part = path.parent / f".{path.name[:LONGEST]}.{tag()}{path.suffix[:LONGEST]}"
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


def _make_empty(part: Path) -> None:
    os.close(os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666))


@contextmanager
def whole_folder(path: Path, *, replace: bool = False, marker: str = MARKER) -> Iterator[Path]:
    """Give an empty folder beside ``path``; on leaving without an error, rename it to ``path``.

    An existing ``path`` is refused, or swapped for the new one when ``replace`` is true and it looks like
    a result of ours (or is empty): a folder of something else is never removed.

    Raises:
        InputError: ``path`` exists, or cannot be written.
        RunError: the disk is full or failed.
    """
    path = Path(path)
    remove_leftovers(path.parent)
    check_folder(path, replace=replace, marker=marker)
    part = path.parent / f".{path.name[:LONGEST]}.{tag()}"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.mkdir()
    except OSError as error:
        raise InputError(f"cannot write '{path}': {error.strerror}", field="--out") from None
    try:
        yield part
        for left in reversed(
            range(TRIES)
        ):  # another process may put its own there just now; the last one stays
            try:
                check_folder(path, replace=replace, marker=marker)
                _put(part, path)
                break
            except OSError:
                if not (left and replace):
                    raise
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _put(part: Path, path: Path) -> None:
    """Put a folder in the place of what is there, if anything is; where that fails, it stays."""
    old: Path | None = None
    try:
        if path.exists():
            old = path.parent / f".{path.name}.{OLD}{tag()}"
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
    """Refuse a result folder that exists (unless it may be replaced) or that a file stands in the way of."""
    for left in reversed(range(TRIES)):
        before = _identity(path)
        try:
            _check_folder(path, replace, marker)
            return
        except (InputError, FileNotFoundError):
            # Another process may have moved the folder away between two looks at it, to put its own there.
            if not left or _identity(path) == before:
                raise


def _identity(path: Path) -> tuple[int, int] | None:
    """Equal as long as one and the same folder is there; None: there is none."""
    try:
        about = path.lstat()
    except (OSError, ValueError):
        return None
    return about.st_dev, about.st_ino


def _check_folder(path: Path, replace: bool, marker: str) -> None:
    try:
        path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # too long a name, or one with a NUL
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(path)[:200]!r} is no name for a folder: {why}", field="--out") from None
    if path.is_symlink() or path.exists():
        if not path.is_dir():
            raise InputError(f"'{path}' is a file; give the name of a folder", field="--out")
        empty = not any(path.iterdir())
        if empty and not path.is_symlink():
            return
        if not replace:
            raise InputError(f"'{path}' exists already; choose another name or say --force", field="--out")
        if path.is_symlink() or not (path / marker).is_file():
            raise InputError(
                f"'{path}' is not a vibroswarm result (no {marker} in it), so --force does not replace it",
                field="--out",
            )
