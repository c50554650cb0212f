"""The one door to Numba: ``@kernel`` compiles a function where Numba is, and leaves it plain elsewhere.

Numba's own disk cache looks only at the file of the function itself, so a change in a function that it
calls from another file would go unseen. The cache folder is therefore named by a hash of all sources that
may hold a kernel or what one is made from, and of the versions that matter: a changed kernel is never run
stale. A process that finds a source changed while it imports keeps nothing. See ``kernel_cache`` for the files.
"""

from __future__ import annotations

import gc
import hashlib
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from vibroswarm.notices import say_once

P = ParamSpec("P")
R = TypeVar("R")

PLAIN = "1" in (os.environ.get("VIBROSWARM_PLAIN"), os.environ.get("NUMBA_DISABLE_JIT"))
"""Set the environment variable VIBROSWARM_PLAIN (or Numba's own) to 1 to step through the kernels as plain Python."""


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData/Local")))
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


ABOVE: Final = (
    "analysis",
    "cli",
    "page",
    "plots",
    "study",
    "optimize",
    "lab",
    "calibrate",
    "paper",
    "testing",
)
"""Rooms that stand above the simulation: they hold no kernel and change no table of a result."""


@cache
def source_hash() -> str:
    """16 hexadecimal digits of all sources that a simulation may depend on: the state of the code."""
    digest = hashlib.sha256()
    for source in _sources():
        name = source.relative_to(PACKAGE)
        digest.update(name.as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


PACKAGE: Final = Path(__file__).parent


def _sources() -> list[Path]:
    """All sources that a simulation may depend on."""
    found = sorted(PACKAGE.rglob("*.py"))
    return [source for source in found if source.relative_to(PACKAGE).parts[0] not in ABOVE]


@cache
def cache_folder() -> Path | None:
    """Folder of the compiled kernels of these sources and versions, or None if there is none to be trusted."""
    import llvmlite
    import numba

    from vibroswarm import kernel_cache

    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__, platform.machine())
    key = hashlib.sha256(f"{source_hash()} {versions!r}".encode()).hexdigest()[:20]
    try:
        base = _user_cache()
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = base
        for name in ("vibroswarm", "kernels", key):
            folder = folder / name
            folder.mkdir(mode=0o700, exist_ok=True)
        why = kernel_cache.why_unsafe(folder, base)
        if why is None:
            with tempfile.TemporaryFile(dir=folder):
                return folder
    except (OSError, RuntimeError) as error:  # a read-only or missing home
        why = str(error)
    say_once(f"compiled kernels are not kept, and compiled at every start: {why}")
    return None


ENGINES: Final = ("event", "fixed_step")


def is_cached(*modules: str) -> bool:
    """Whether an engine of these sources has been compiled and kept before (or needs no compiling).

    Others do not count: a floor that is drawn compiles a little before any robot moves.

    Args:
        modules: last names of those that hold the engine; without, any will do.
    """
    if not _compiles():
        return True
    folder = cache_folder()
    return folder is not None and any(any(folder.rglob(f"{engine}.*.nbc")) for engine in modules or ENGINES)


def zero_rows(count: int | tuple[int, ...], dtype: np.dtype[np.void]) -> NDArray[np.void]:
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


def branching_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """As ``kernel``, without LLVM's vectors of equal operations side by side.

    Where branches are many, to gather single numbers into a vector and to part them again takes longer.
    """
    return _compile(function, side_by_side=False, _nrt=False, forceinline=False)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """As ``kernel``, for what only kernels call: it is compiled with each that does. From Python, it is plain."""
    return _compile(function, from_python=False, _nrt=False, forceinline=False)


def part(function: Callable[P, R]) -> Callable[P, R]:
    """As ``inlined``, for functions that come from elsewhere: they are compiled with each kernel, and never kept."""
    return _compile(function, from_python=False, keeps=False, _nrt=False, forceinline=True)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As ``inner``, put into its callers: for what is called at one or two places, or is as small as a call."""
    return _compile(function, from_python=False, _nrt=False, forceinline=True)


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


def _stamp(path: Path) -> tuple[int, int]:
    about = path.stat()
    return about.st_mtime_ns, about.st_size


_stamps = {str(source): _stamp(source) for source in _sources()} if _compiles() else {}
"""Of the sources as they were before any of them with a kernel was imported."""


def made(file: str, text: str) -> None:
    """Let kernels of a source that is no file, but was made, be kept by a hash of its text."""
    if not _compiles():
        return
    from vibroswarm import kernel_cache

    kernel_cache.MADE[file] = hashlib.sha256(text.encode()).digest()


def _is_changed(source: str) -> bool:
    """Whether a source was changed since this began; a time that is still to come is no sign of it."""
    from vibroswarm import kernel_cache

    path = Path(source)
    if source in kernel_cache.MADE:
        return False
    if source in _stamps:
        return _stamp(path) != _stamps[source]
    return _hashed_at_s < path.stat().st_mtime <= time.time()


def _compile(
    function: Callable[P, R],
    from_python: bool = True,
    side_by_side: bool = True,
    keeps: bool = True,
    **options: bool,
) -> Callable[P, R]:
    if not _compiles():
        return function
    import numba

    from vibroswarm import kernel_cache

    if not _compiled:
        _name_records_by_their_fields()
    options |= {"nogil": True, "no_cfunc_wrapper": True, "no_cpython_wrapper": not from_python}
    njit: Any = numba.njit  # its stubs do not know all options
    compiled: Any = njit(error_model="numpy", **options)(function)
    folder = cache_folder() if keeps else None
    if folder is not None:
        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, str(folder)
        try:
            compiled._cache = kernel_cache.KernelCache(function)
        finally:
            config.CACHE_DIR = before
    if not from_python:
        _call_plain(compiled)
    _set_for_compiling(compiled, side_by_side)
    if not keeps:
        return cast("Callable[P, R]", compiled)
    _compiled.append(compiled)
    if _is_changed(function.__code__.co_filename):
        _forget()
    result: Callable[P, R] = compiled
    return result


def entry_for(kernel: Callable[P, R], *arguments: P.args, **none: P.kwargs) -> Callable[P, R]:
    """A kernel as it is compiled for arguments of these types, without Numba's look at the types of each call.

    That look takes some 0.1 microseconds an array. Who calls it must give arguments of exactly these types.
    """
    del none
    if not _compiles():
        return kernel
    dispatcher: Any = kernel
    key = (dispatcher, *map(_kind_of, arguments))
    if key not in _entries:
        signature = tuple(dispatcher.typeof_pyval(one) for one in arguments)
        dispatcher.compile(signature)
        _entries[key] = dispatcher.overloads[signature].entry_point
    found: Callable[P, R] = _entries[key]
    return found


_entries: dict[Any, Any] = {}
"""Kernels as they are compiled for arguments of some kinds: Numba takes 2 ms to find the types of fifty arrays."""


def _kind_of(value: Any) -> Any:
    """What decides the type that Numba gives an argument."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.ndim, flags.writeable, flags.c_contiguous, flags.f_contiguous, flags.aligned
    if isinstance(value, tuple):
        return (type(value), *map(_kind_of, value))
    if isinstance(value, np.generic):
        return type(value), value.dtype
    return type(value), isinstance(value, int) and value.bit_length() > 63


def _call_plain(compiled: Any) -> None:
    """Let Python call the plain function: what only kernels call has no entry for Python, which takes time to make."""
    kind = type(compiled)
    called = {"__call__": lambda self, *arguments: self.py_func(*arguments)}
    compiled.__class__ = type(kind.__name__, (kind,), called)


def _set_for_compiling(compiled: Any, side_by_side: bool) -> None:
    """Let this kernel be compiled under ``_settings``."""
    compile_one, module = compiled.compile, compiled.py_func.__module__

    def compile_under_settings(signature: Any) -> Any:
        for tell in _told:
            tell(module)
        with _settings(side_by_side):
            return compile_one(signature)

    compiled.compile = compile_under_settings


_told: list[Callable[[str], None]] = []


def tell_before_compiling(tell: Callable[[str], None]) -> None:
    """Have ``tell`` called with a kernel's module before that kernel is looked up in the cache, or compiled."""
    _told.append(tell)


OBJECTS_BETWEEN: Final = 50_000
"""While Numba compiles, Python looks for dead objects after as many new ones. After 700 as else, it does so a
thousand times, and finds next to nothing: one part in twenty of the time."""


@contextmanager
def _settings(side_by_side: bool) -> Iterator[None]:
    """LLVM's vectors of equal operations side by side, which Numba leaves out, are 5 to 10 % of most kernels.

    These are settings of the whole process, and put back.
    """
    from numba import config

    numbas: Any = config
    vectors, objects = numbas.SLP_VECTORIZE, gc.get_threshold()
    numbas.SLP_VECTORIZE = int(side_by_side)
    gc.set_threshold(max(objects[0], OBJECTS_BETWEEN) if objects[0] else 0, *objects[1:])
    try:
        yield
    finally:
        numbas.SLP_VECTORIZE = vectors
        gc.set_threshold(*objects)


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


@kernel
def unsigned(value: Any) -> int:
    """An index that is not below 0: compiled code need not ask whether it counts from the end.

    Only such may be added to it: with a signed number it would make a float.
    """
    return np.uint64(value)  # type: ignore[return-value]
