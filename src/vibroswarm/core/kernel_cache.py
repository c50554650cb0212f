"""Numba's kernel cache on disk, made safe against any state of the disk.

A damaged file is rewritten. A file that cannot be read or written is skipped. Each file begins with a hash of its
content, since half a kernel might load without an error, and crash when it runs. A loaded kernel can do anything, so a
folder that other users may write to is not used (``why_unsafe``). Each kernel's file has a unique name, so that two
processes never write to the same file. (Numba numbers its files, and two processes that count at once give two
kernels the same number.)

An overload is a kernel compiled for one signature (types of arguments).
"""

from __future__ import annotations

import hashlib
import os
import pickle
import stat
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, Final
from uuid import uuid4

from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    UserProvidedCacheLocator,
)
from numba.core.runtime.nrt import rtsys

from vibroswarm.core import whole_kernels
from vibroswarm.core.compiled_code import UnknownValueError, compiled_text, is_ours
from vibroswarm.errors import warn_once

PACKAGE: Final = Path(__file__).parents[1]
"""The folder of this package."""
BY_OTHERS: Final = stat.S_IWGRP | stat.S_IWOTH
"""Mode bits of a folder that group or others may write to."""
DIGEST: Final = hashlib.sha256().digest_size
"""Length of the hash at the start of each file, bytes."""


def why_unsafe(folder: Path, base: Path) -> str | None:
    """Return why other users could put a file into a cache folder, in words; None if they cannot.

    Args:
        folder: the cache folder. The folder itself and its parents below ``base`` must belong to this user, and nobody
            else may write to them.
        base: the user's own folder. It and its parents may have other owners, but must not be writable by everybody,
            unless only owners may replace what they contain (sticky bit, as of /tmp).
    """
    if not hasattr(os, "geteuid"):  # Windows has no such modes; there the cache lies in the user's own folder
        return None
    resolved, resolved_base = folder.resolve(), base.resolve()
    for place in (resolved, *resolved.parents):
        status = place.stat()
        if resolved_base in place.parents:  # ``place`` lies below the base
            if status.st_uid != os.geteuid():
                return f"'{place}' belongs to another user"
            if status.st_mode & BY_OTHERS:
                return f"others may write to '{place}'; run: chmod go-w '{place}'"
        elif status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            return f"everybody may write to '{place}'"
    return None


class _Locator(UserProvidedCacheLocator):
    """The folder of our kernels, and no other; sources are identified by content.

    Numba's setting ``CACHE_DIR`` is not used: another thread may change it meanwhile, and kernels would be read from
    the working folder.
    """

    folder: ClassVar[Path]

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._py_func = py_func
        self._cache_path = str(self.folder / self.get_suitable_cache_subpath(py_file))

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator:
        """Return the locator of a function, whether or not it has a source file."""
        return cls(py_func, py_file)

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the name of the folder of a source file's kernels.

        Numba names it by the file's place. For files of this package it is named by their place in the package, so that
        another installation of the same sources need not compile them again.
        """
        path = Path(py_file)
        if path.is_relative_to(PACKAGE):
            return ".".join((PACKAGE.name, *path.relative_to(PACKAGE).parent.parts))
        return str(super().get_suitable_cache_subpath(py_file))

    def ensure_cache_path(self) -> None:
        """Create the folder; a failure shows later, when a file is written."""
        with suppress(OSError):
            Path(self.get_cache_path()).mkdir(mode=0o700, exist_ok=True)

    def get_source_stamp(self) -> bytes:
        """Return nothing so far: what a user's function calls may not be defined yet (``stamp``)."""
        return b""

    def stamp(self) -> bytes:
        """Return a hash of all that is compiled with the function; cached kernels with another one are not used.

        It is empty for functions of this package and of generated modules: all of that is in the name of the folder.

        Raises:
            UnknownValueError: it reads a value that cannot be described.
        """
        if is_ours(self._py_func.__module__) or Path(self._py_file).is_relative_to(
            Path(self._cache_path).parent
        ):
            return b""
        return hashlib.sha256(compiled_text(self._py_func).encode()).digest()


class _Impl(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - as Numba has it


class _Files(IndexDataCacheFile):
    """The cache files of one function: an index of its overloads, and a file with a unique name for each overload."""

    def save(self, key: Any, data: Any) -> None:
        """Save a compiled overload, ``data``, under its signature, ``key``; remove the file that it replaces.

        The overload's file is written before the index, so that the index never names a file that does not exist.
        """
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
        """Return the file name of each cached overload, by signature.

        Empty if there is no index, if it is damaged, or if it belongs to another source or another version of Numba.
        """
        content = self._read(self._index_path)
        if content is None:
            return {}
        version, stamp, overloads = pickle.loads(content)  # noqa: S301 - the folder is this user's alone
        return dict(overloads) if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        """Return the overload in a file.

        Raises:
            FileNotFoundError: the file is missing or damaged; Numba then compiles the overload again.
        """
        content = self._read(self._data_path(name))
        if content is None:
            raise FileNotFoundError(name)
        return pickle.loads(content)  # noqa: S301 - the folder is this user's alone

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), self._dump(data))

    def _read(self, path: str) -> bytes | None:
        """Return the content of a file without its hash; None if the file is missing, or damaged (with a warning)."""
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            return None
        if hashlib.sha256(content[DIGEST:]).digest() == content[:DIGEST]:
            return content[DIGEST:]
        # ``_cache_path`` is the subfolder of one source file; the message names the folder of all kernels.
        warn_once(f"kernels in '{Path(self._cache_path).parent}' are damaged and will be recompiled")
        return None

    def _write(self, path: str, content: bytes) -> None:
        with self._open_for_write(path) as stream:
            stream.write(hashlib.sha256(content).digest() + content)


class KernelCache(FunctionCache):
    """Numba's cache of a function, for which no state of the disk is an error."""

    _impl_class = _Impl

    def __init__(self, function: Any, folder: Path) -> None:
        _Locator.folder = folder  # the same for all kernels of a process
        super().__init__(function)
        # Replaces the ``IndexDataCacheFile`` that Numba has created with the same arguments.
        self._cache_file = _Files(self._cache_path, self._impl.filename_base, b"")
        self._is_stamped = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled overload for the signature ``sig``, or None if it has to be compiled; never raise."""
        if not self._is_stamped and self._enabled:
            self._set_stamp()
        try:
            if not whole_kernels.is_known():
                return super().load_overload(sig, target_context)
            # Numba first loads all that it can compile, which takes a tenth of a short command. Machine code needs
            # only addresses: those of the runtime, and of the modules that its file names, which reading it loads.
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except OSError as error:
            self._say(error)
        except Exception as error:  # the file is intact, but its content cannot be loaded
            warn_once(
                f"a compiled kernel in '{self._cache_path}' cannot be used ({error}) and will be recompiled"
            )
        return None

    def _set_stamp(self) -> None:
        """Find out what is compiled with the function; if that cannot be described, cache nothing."""
        self._is_stamped = True
        try:
            self._cache_file._source_stamp = self._impl.locator.stamp()
        except UnknownValueError as unknown:
            self.disable()
            warn_once(
                f"{self._name} reads {unknown}, of which no change can be seen, and is compiled at every start"
            )

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled overload, ``data``, under its signature, ``sig``; warn if it cannot be saved."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self._say(error)

    def _say(self, error: OSError) -> None:
        """Warn once that the cache cannot be used."""
        folder = Path(self._cache_path).parent  # of all kernels, as in ``_read``
        warn_once(
            f"kernels cannot be read from '{folder}' or saved there ({error.strerror or error}); "
            "those not saved are compiled at every start"
        )
