"""Files and folders written whole or not at all.

What is being written has a hidden temporary name beside its place, and is renamed when it is complete.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from vibroswarm.errors import InputError, RunError

MANIFEST: Final = "vibroswarm.json"
"""The file that says of which kind a folder is (``core.folders``)."""
OURS: Final = (MANIFEST, "scenario.toml", "study.toml", "search.toml", "printed.json")
"""Files that mark a folder as written by one of our commands; one that was just begun may have no manifest."""


def _beside(path: Path) -> Path:
    """Return a new name beside a path, of a length that file systems take."""
    return path.with_name(f".{path.name[:50]}.{secrets.token_hex(6)}{path.suffix}")


@contextmanager
def _renamed(part: Path, path: Path) -> Iterator[Path]:
    """Yield ``part``; after the ``with`` block, rename it to ``path``, or remove it if the block raised an error."""
    try:
        yield part
        if path.is_dir():
            shutil.rmtree(path)
        part.replace(path)
    except OSError as error:
        raise RunError(f"could not write '{path}': {error.strerror or error}") from error
    finally:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        part.unlink(missing_ok=True)


def check_free(path: Path, *, replace: bool = False) -> None:
    """Refuse a path at which there is something, unless it is a file that may be replaced."""
    if path.exists() and not (replace and path.is_file()):
        raise InputError("exists already; choose another name, or replace it", field=str(path))


@contextmanager
def whole_file(path: str | Path, *, replace: bool = True) -> Iterator[Path]:
    """Yield the path of a new file beside ``path``; after the ``with`` block, rename the file to ``path``."""
    check_free(Path(path), replace=replace)
    with _renamed(_beside(Path(path)), Path(path)) as part:
        yield part


def write_file(path: str | Path, content: str | bytes, *, replace: bool = True) -> None:
    """Write a file whole or not at all, text as UTF-8; raises the errors of ``whole_file``."""
    with whole_file(path, replace=replace) as part:
        part.write_bytes(content if isinstance(content, bytes) else content.encode())


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write files into a folder, in the order of ``contents``, each whole or not at all; make the folder if needed."""
    make_folder(folder)
    for name, content in contents.items():
        write_file(folder / name, content)


def make_folder(folder: Path) -> None:
    """Make a folder, and those in which it lies, unless it exists."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror}", field=str(folder)) from None


@contextmanager
def whole_folder(path: Path, *, replace: bool = False, marker: str = MANIFEST) -> Iterator[Path]:
    """Yield a new empty folder beside ``path``; after the ``with`` block, rename the folder to ``path``."""
    check_folder(path, replace=replace, marker=marker)
    part = _beside(path)
    make_folder(part)
    with _renamed(part, path):
        yield part


def check_folder(path: Path, *, replace: bool = False, marker: str = MANIFEST) -> None:
    """Refuse a folder that is to be written if it exists and may not be replaced, or cannot be written."""
    nearest = next((place for place in (path, *path.parents) if place.exists()), Path())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            f"cannot be made: '{nearest}' is not a folder that you may write to", field=str(path)
        )
    if not path.exists() or not any(path.iterdir()):
        return
    if not replace:
        check_free(path)
    is_ours = any((path / name).exists() for name in (marker, *OURS))
    if not is_ours or Path.cwd().is_relative_to(path.resolve()):
        raise InputError("is no result of vibroswarm, or the working folder: not replaced", field=str(path))
