"""The one door to Numba: ``@kernel`` compiles a function where Numba is, and leaves it plain elsewhere.

Numba's own disk cache looks only at the file of the function itself, so a change in a function that it
calls from another file would go unseen. The cache folder is therefore named by a hash of all sources that
may hold a kernel or what one is made from, and of the versions that matter: a changed kernel is never run
stale. A process that finds a source changed while it imports keeps nothing.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

P = ParamSpec("P")
R = TypeVar("R")

PLAIN = os.environ.get("VIBROSWARM_PLAIN", "") == "1"
"""Set the environment variable VIBROSWARM_PLAIN to 1 to step through the kernels as plain Python."""


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData/Local")))
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


ABOVE: Final = ("analysis", "cli", "page", "plots", "study", "optimize", "lab", "calibrate", "paper")
"""Rooms that stand above the simulation: they hold no kernel and change no table of a result."""


@cache
def source_hash() -> str:
    """16 hexadecimal digits of all sources that a simulation may depend on: the state of the code."""
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    for source in sorted(folder.rglob("*.py")):
        name = source.relative_to(folder)
        if name.parts[0] not in ABOVE:
            digest.update(name.as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


@cache
def cache_folder() -> Path | None:
    """Folder of the compiled kernels of these sources and versions, or None if none can be written."""
    import llvmlite
    import numba

    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__, platform.machine())
    key = hashlib.sha256(f"{source_hash()} {versions!r}".encode()).hexdigest()[:20]
    try:
        folder = _user_cache() / "vibroswarm" / "kernels" / key
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except (OSError, RuntimeError):  # a read-only or missing home: compile anew each time
        return None


ENGINES: Final = ("event", "fixed_step")


def is_cached() -> bool:
    """Whether the engine of these sources has been compiled and kept before (or needs no compiling).

    Others do not count: a floor that is drawn compiles a little before any robot moves.
    """
    if not _compiles():
        return True
    folder = cache_folder()
    return folder is not None and any(any(folder.rglob(f"{engine}.*.nbc")) for engine in ENGINES)


def zero_rows(count: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Zeroed rows whose fields kernels read as attributes (``rows[i].x_m``), compiled or plain."""
    zeros = np.zeros(count, dtype=dtype)
    return zeros if _compiles() else zeros.view(np.recarray)


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """A view that kernels may only read.

    The memory of a table may not be written, that of an array may: to Numba two types, for each of which it would
    compile a kernel anew. So they are all given as what may not.
    """
    view = values.view()
    view.flags.writeable = False
    return view


@cache
def _compiles() -> bool:
    return not PLAIN and find_spec("numba") is not None


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` in nopython mode (IEEE arithmetic, no fastmath), cached on disk.

    It may not allocate. So Numba need not count references to the arrays that it is given: the counting,
    atomic at every call, was half the time of the engines.
    """
    return _compile(function, _nrt=False, forceinline=False)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """As ``kernel``, for what only kernels call: the entry from Python takes a quarter of the time to compile.

    Called from Python, it is the plain function.
    """
    return _without_entry(_compile(function, _nrt=False, forceinline=False, no_cpython_wrapper=True))


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As ``inner``, put into its callers: for what is called at one or two places, or is as small as a call."""
    return _without_entry(_compile(function, _nrt=False, forceinline=True, no_cpython_wrapper=True))


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """As ``kernel``, for functions that make arrays."""
    return _compile(function, forceinline=False)


def _name_records_by_their_fields() -> None:
    """Let the compiled functions of different row layouts have different names, in every process.

    Numba names them after a number that a process counts up as it meets layouts. Two processes can so keep
    one function under one name for two layouts, and a third that loads both runs the wrong one.
    """
    from numba import types

    def mangling_args(self: Any) -> tuple[str, tuple[str]]:
        return "Record", (hashlib.sha256(self.name.encode()).hexdigest()[:16],)

    record: Any = types.Record
    record.mangling_args = property(mangling_args)


_compiled: list[Any] = []
_hashed_at_s = time.time()


def _compile(function: Callable[P, R], **options: bool) -> Callable[P, R]:
    if not _compiles():
        return function
    import numba

    if not _compiled:
        _name_records_by_their_fields()
    folder = cache_folder()
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder) if folder else before
    try:
        njit: Any = numba.njit  # its stubs do not know all options
        compiled: Any = njit(
            cache=folder is not None, nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options
        )(function)
    finally:
        config.CACHE_DIR = before
    _let_pairs_be_vectors(compiled)
    _compiled.append(compiled)
    if Path(function.__code__.co_filename).stat().st_mtime > _hashed_at_s:
        _forget()
    result: Callable[P, R] = compiled
    return result


def _let_pairs_be_vectors(compiled: Any) -> None:
    """Compile with LLVM's vectors of equal operations side by side, which Numba leaves out: 5 to 10 % of the engines.

    Only these kernels: it is a setting of the whole process, and is put back.
    """
    from numba import config

    settings: Any = config
    compile_one = compiled.compile

    def compile_with_vectors(signature: Any) -> Any:
        before = settings.SLP_VECTORIZE
        settings.SLP_VECTORIZE = 1
        try:
            return compile_one(signature)
        finally:
            settings.SLP_VECTORIZE = before

    compiled.compile = compile_with_vectors


def _without_entry(compiled: Callable[P, R]) -> Callable[P, R]:
    """Let calls from Python go to the plain function: there is no compiled entry for them."""
    if _compiles():
        dispatcher: Any = type(compiled)
        called = {"__call__": lambda self, *arguments: self.py_func(*arguments)}
        compiled.__class__ = type(dispatcher.__name__, (dispatcher,), called)
    return compiled


def _forget() -> None:
    """A source was changed after it was hashed, while the package was being imported: keep nothing compiled."""
    from numba.core.caching import NullCache

    for compiled in _compiled:
        compiled._cache = NullCache()


@kernel
def signed(value: Any) -> int:
    """A whole number of a table, in whatever bits it is kept, as kernels reckon with it.

    Numba would compile for each size anew what is given one, and reckon unsigned with signed numbers as floats.
    """
    return np.int64(value)  # type: ignore[return-value]
