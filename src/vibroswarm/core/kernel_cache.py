"""Numba's kernel cache on disk, made safe against any state of the disk.

A damaged file is rewritten; a file that cannot be read or written is skipped. Each file begins with a hash of its
content, since half a kernel may well load, and crash. Loaded kernels can run anything, so a folder that others
may write to is not used (``why_unsafe``). Two processes that cache kernels at once never write to one file:
Numba's own numbers, counted by each process, gave two kernels one name.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final
from uuid import uuid4

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)

from vibroswarm.errors import warn_once

BY_OTHERS: Final = stat.S_IWGRP | stat.S_IWOTH
DIGEST: Final = hashlib.sha256().digest_size


def why_unsafe(folder: Path, base: Path) -> str | None:
    """Return why others could place a program in a cache folder, or None.

    Args:
        folder: it and its parents below ``base`` must belong to this user alone.
        base: above that, nobody but the owner may replace a folder.
    """
    if not hasattr(os, "geteuid"):  # Windows has no such modes; the folder lies in the user's own
        return None
    resolved, below = folder.resolve(), base.resolve()
    for place in (resolved, *resolved.parents):
        status = place.stat()
        if below in place.parents:
            if status.st_uid != os.geteuid():
                return f"'{place}' belongs to another user"
            if status.st_mode & BY_OTHERS:
                return f"others may write to '{place}'; run: chmod go-w '{place}'"
        elif status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            return f"everybody may write to '{place}'"
    return None


class _Locator(UserProvidedCacheLocator):
    """The folder in Numba's ``CACHE_DIR``, and no other; sources are identified by content."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        """Accept any function, including those of generated modules."""
        return cls(py_func, py_file)

    def ensure_cache_path(self) -> None:
        """Create the folder; whether it is writable shows later."""
        with suppress(OSError):
            Path(self.get_cache_path()).mkdir(mode=0o700, exist_ok=True)

    def get_source_stamp(self) -> bytes:
        """Return a hash of the source."""
        return _hash_of(self._py_file)


GENERATED: Final[dict[str, bytes]] = {}
"""Hashes of the texts of generated modules, by file name."""


def _hash_of(path: str) -> bytes:
    return GENERATED[path] if path in GENERATED else _hash_of_file(path)


@cache
def _hash_of_file(path: str) -> bytes:
    return hashlib.sha256(Path(path).read_bytes()).digest()


class _Impl(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - as Numba has it


class _Files(IndexDataCacheFile):
    """An index by signature, and a file with a unique name for each kernel."""

    def save(self, key: Any, data: Any) -> None:
        """Save a kernel: its file first, the index last."""
        name = f"{self._index_name.removesuffix('.nbi')}.{uuid4().hex[:16]}.nbc"
        self._save_data(name, data)
        overloads = self._load_index()
        before = overloads.get(key)
        overloads[key] = name
        self._save_index(overloads)
        if before is not None:
            with suppress(OSError):
                Path(self._data_path(before)).unlink()

    def _load_index(self) -> dict[Any, str]:
        """Load the index of cached kernels; empty if there is none, or if it is of other sources or another version."""
        content = self._read(self._index_path)
        if content is None:
            return {}
        version, stamp, overloads = pickle.loads(content)  # noqa: S301 - the folder is this user's alone
        return dict(overloads) if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        content = self._read(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)  # the caller recompiles
        return pickle.loads(content)  # noqa: S301 - as above

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _read(self, path: str) -> bytes | None:
        """Return the content of a file, or None if it is missing or damaged."""
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            return None
        if hashlib.sha256(content[DIGEST:]).digest() == content[:DIGEST]:
            return content[DIGEST:]
        warn_once(f"kernels in '{Path(self._cache_path).parent}' are damaged and will be recompiled")
        return None

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as stream:
            stream.write(hashlib.sha256(content).digest() + content)


class KernelCache(FunctionCache):
    """Numba's cache of a function, for which no state of the disk is an error."""

    _impl_class = _Impl

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel for a signature, or None if it has to be compiled."""
        try:
            return super().load_overload(sig, target_context)
        except OSError as error:
            self._say(error)
        except Exception as error:  # an intact file that cannot be loaded all the same
            warn_once(
                f"a compiled kernel in '{self._cache_path}' cannot be used ({error}) and will be recompiled"
            )
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a kernel if possible."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self._say(error)

    def _say(self, error: OSError) -> None:
        """Warn once that the cache cannot be used."""
        folder = Path(self._cache_path).parent
        warn_once(
            f"kernels cannot be read from '{folder}' or saved there ({error.strerror or error}); "
            "those not saved are compiled at every start"
        )
