"""The only access to Numba: ``@kernel`` compiles a function if Numba is installed, and returns it unchanged
otherwise.

Numba's disk cache checks only the file of the function itself, so a change in a function that it calls from
another file would go unnoticed. The cache folder is therefore named by a hash of all sources that may hold a
kernel or a template of one, and of the relevant versions: a changed kernel is never run stale. A process that
finds a source changed while it imports caches nothing. See ``kernel_cache`` for the files.
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

from vibroswarm.errors import warn_once

P = ParamSpec("P")
R = TypeVar("R")

PLAIN = "1" in (os.environ.get("VIBROSWARM_PLAIN"), os.environ.get("NUMBA_DISABLE_JIT"))
"""Set the environment variable VIBROSWARM_PLAIN (or Numba's own) to 1 to debug the kernels as plain Python."""


def _user_cache() -> Path:
    """Return the user's cache folder on this platform."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData/Local")))
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


LAYERS_ABOVE: Final = (
    "analysis",
    "cli",
    "plots",
    "report",
    "run_page",
    "view",
    "study",
    "optimize",
    "league",
    "recordings",
    "tracking",
    "calibrate",
    "paper",
    "export",
    "notebook",
    "testing",
)
"""Packages above the simulation: they hold no kernel and change no table of a result."""


@cache
def source_hash() -> str:
    """Return 16 hexadecimal digits of all sources that a simulation may depend on, as first seen by this process."""
    return hash_of_sources()


def hash_of_sources() -> str:
    """Return ``source_hash`` of the files as they are now."""
    digest = hashlib.sha256()
    for source in simulation_sources():
        name = source.relative_to(PACKAGE)
        digest.update(name.as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


PACKAGE: Final = Path(__file__).parents[1]


def simulation_sources() -> list[Path]:
    """Return all sources that a simulation may depend on."""
    sources = sorted(PACKAGE.rglob("*.py"))
    return [source for source in sources if source.relative_to(PACKAGE).parts[0] not in LAYERS_ABOVE]


@cache
def cache_folder() -> Path | None:
    """Return the folder of the compiled kernels of these sources and versions, or None if none can be trusted."""
    import llvmlite
    import numba

    from vibroswarm.core import kernel_cache

    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__, platform.machine())
    key = hashlib.sha256(f"{source_hash()} {versions!r}".encode()).hexdigest()[:20]
    try:
        base = _user_cache()
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = base
        for name in ("vibroswarm", "kernels", key):
            folder = folder / name
            folder.mkdir(mode=0o700, exist_ok=True)
        reason = kernel_cache.why_unsafe(folder, base)
        if reason is None:
            with tempfile.TemporaryFile(dir=folder):
                return folder
    except (OSError, RuntimeError) as error:  # a read-only or missing home
        reason = str(error)
    warn_once(f"compiled kernels are not cached, but compiled at every start: {reason}")
    return None


ENGINES: Final = {
    "event": "engine",
    "fixed-step": "fixed_step",
    "mujoco-planar": "planar_step",
    "mujoco": "wheels_step",
}
"""Modules of the engines, by the names of their motion sources."""


def is_cached(*sources: str) -> bool:
    """Return whether an engine's kernels are cached, or need no compiling.

    Other kernels do not count: drawing a floor compiles a few before any robot moves.

    Args:
        sources: names of motion sources; True if any one of them is cached. Without names, any engine will do.
    """
    if not compiles():
        return True
    folder = cache_folder()
    return folder is not None and any(
        any(folder.rglob(f"{ENGINES.get(name, name)}.*.nbc")) for name in sources or ENGINES
    )


def zero_rows(count: int | tuple[int, ...], dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Return zeroed rows whose fields kernels read as attributes (``rows[i].x_m``), compiled or plain."""
    zeros = np.zeros(count, dtype=dtype)
    return zeros if compiles() else zeros.view(np.recarray)


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view.

    Numba treats read-only and writable arrays as two types and would compile each kernel twice. Table columns are
    read-only, so all arrays that kernels only read are passed as such.
    """
    view = values.view()
    view.flags.writeable = False
    return view


@cache
def compiles() -> bool:
    """Return whether kernels are compiled, rather than run as plain Python."""
    return not PLAIN and find_spec("numba") is not None


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` in nopython mode (IEEE arithmetic, no fastmath), cached on disk.

    It may not allocate. So Numba need not count references to its array arguments: the counting, atomic at every
    call, took half of the engines' time.
    """
    return _compile(function, _nrt=False, forceinline=False)


def branching_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``kernel`` does, without LLVM's vectors of equal operations side by side.

    In code with many branches, gathering single numbers into a vector and splitting it again takes longer.
    """
    return _compile(function, side_by_side=False, _nrt=False, forceinline=False)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that only kernels call, together with each caller; called from Python, it runs as plain
    Python."""
    return _compile(function, from_python=False, _nrt=False, forceinline=False)


def inlined_uncached(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``inlined`` does, without caching: for functions of generated modules, compiled with each kernel."""
    return _compile(function, from_python=False, keeps=False, _nrt=False, forceinline=True)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``inner`` does, inlined into its callers: for small functions and those with one or two callers."""
    return _compile(function, from_python=False, _nrt=False, forceinline=True)


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``kernel`` does, for functions that create arrays."""
    return _compile(function, forceinline=False)


def _name_records_by_their_fields() -> None:
    """Name the compiled functions of different row layouts differently, and alike in every process.

    Numba names them by a number that each process counts up as it meets layouts. Two processes can so cache one
    function under one name for two layouts, and a third that loads both runs the wrong one.
    """
    from numba import types

    def mangling_args(self: Any) -> tuple[str, tuple[str]]:
        return "Record", (hashlib.sha256(self.name.encode()).hexdigest()[:16],)

    record: Any = types.Record
    record.mangling_args = property(mangling_args)


_compiled: list[Any] = []
_hashed_at_s = time.time()


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_mtime_ns, status.st_size


_stamps = {str(source): _stamp(source) for source in simulation_sources()} if compiles() else {}
"""Time of change and size of each source, before any module with a kernel was imported."""


def register_source(file: str, text: str) -> None:
    """Register the text of a generated module, so that its kernels are cached by a hash of that text."""
    if not compiles():
        return
    from vibroswarm.core import kernel_cache

    kernel_cache.GENERATED[file] = hashlib.sha256(text.encode()).digest()


def _is_changed(source: str) -> bool:
    """Return whether a source file was changed since this process read it.

    Generated sources never count as changed, nor does a time of change in the future (a clock that was wrong).
    """
    from vibroswarm.core import kernel_cache

    path = Path(source)
    if source in kernel_cache.GENERATED:
        return False
    if source in _stamps:
        return _stamp(path) != _stamps[source]
    # Without a stamp, by its time alone.
    return _hashed_at_s < path.stat().st_mtime <= time.time()


def _compile(
    function: Callable[P, R],
    from_python: bool = True,
    side_by_side: bool = True,
    keeps: bool = True,
    **options: bool,
) -> Callable[P, R]:
    """Compile ``function`` with Numba and these options; return it unchanged in plain mode."""
    if not compiles():
        return function
    import numba

    from vibroswarm.core import kernel_cache

    if not _compiled:
        _name_records_by_their_fields()
    options |= {"nogil": True, "no_cfunc_wrapper": True, "no_cpython_wrapper": not from_python}
    njit: Any = numba.njit  # its stubs lack some options
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
        _disable_caching()
    result: Callable[P, R] = compiled
    return result


def entry_for(kernel: Callable[P, R], *arguments: P.args, **none: P.kwargs) -> Callable[P, R]:
    """Return a kernel compiled for arguments of these types, without Numba's dispatch; the kernel itself in plain mode.

    Dispatch takes some 0.1 microseconds per array. Callers must pass arguments of exactly these types.
    """
    del none
    if not compiles():
        return kernel
    dispatcher: Any = kernel
    key = (dispatcher, *map(_type_key, arguments))
    if key not in _entries:
        signature = tuple(dispatcher.typeof_pyval(argument) for argument in arguments)
        dispatcher.compile(signature)
        _entries[key] = dispatcher.overloads[signature].entry_point
    entry: Callable[P, R] = _entries[key]
    return entry


_entries: dict[Any, Any] = {}
"""Compiled entry points by kernel and argument types: Numba takes 2 ms to find the types of fifty arrays."""


def _type_key(value: Any) -> Any:
    """Return a key for the type that Numba gives an argument."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        return value.dtype, value.ndim, flags.writeable, flags.c_contiguous, flags.f_contiguous, flags.aligned
    if isinstance(value, tuple):
        return (type(value), *map(_type_key, value))
    if isinstance(value, np.generic):
        return type(value), value.dtype
    return type(value), isinstance(value, int) and value.bit_length() > 63


def _call_plain(compiled: Any) -> None:
    """Make calls from Python run the uncompiled function, since an entry point for Python takes time to compile."""
    kind = type(compiled)
    called = {"__call__": lambda self, *arguments: self.py_func(*arguments)}
    compiled.__class__ = type(kind.__name__, (kind,), called)


def _set_for_compiling(compiled: Any, side_by_side: bool) -> None:
    """Compile this kernel under ``_settings``, and notify the listeners before."""
    compile_one, module = compiled.compile, compiled.py_func.__module__

    def compile_under_settings(signature: Any) -> Any:
        for listener in _compile_listeners:
            listener(module)
        with _settings(side_by_side):
            return compile_one(signature)

    compiled.compile = compile_under_settings


_compile_listeners: list[Callable[[str], None]] = []


def add_compile_listener(listener: Callable[[str], None]) -> None:
    """Call ``listener`` with a kernel's module before that kernel is loaded from the cache or compiled."""
    _compile_listeners.append(listener)


OBJECTS_BETWEEN: Final = 50_000
"""Garbage-collection threshold while Numba compiles. At the default of 700 Python would collect a thousand times,
find almost nothing, and take 5 % of the time."""


@contextmanager
def _settings(side_by_side: bool) -> Iterator[None]:
    """Set LLVM's superword-level vectorisation, and collect garbage less often, while a kernel is compiled.

    The vectorisation is off in Numba; it speeds most kernels up by 5 to 10 %. Both settings are process-wide and are
    restored.
    """
    from numba import config

    numba_config: Any = config
    vectorize, gc_threshold = numba_config.SLP_VECTORIZE, gc.get_threshold()
    numba_config.SLP_VECTORIZE = int(side_by_side)
    gc.set_threshold(max(gc_threshold[0], OBJECTS_BETWEEN) if gc_threshold[0] else 0, *gc_threshold[1:])
    try:
        yield
    finally:
        numba_config.SLP_VECTORIZE = vectorize
        gc.set_threshold(*gc_threshold)


def _disable_caching() -> None:
    """Cache nothing compiled, because a source was changed after it was hashed, during import."""
    from numba.core.caching import NullCache

    for compiled in _compiled:
        compiled._cache = NullCache()


@kernel
def signed(value: Any) -> int:
    """Convert an integer of a table, of any width, to the signed integer that kernels compute with.

    Numba would compile callees for each width, and turn mixed signed and unsigned arithmetic into floats.
    """
    return np.int64(value)  # type: ignore[return-value]


@kernel
def unsigned(value: Any) -> int:
    """Convert a non-negative index to unsigned, so that compiled code need not check for negative indices.

    Only unsigned numbers may be added to it: a signed one would turn the result into a float.
    """
    return np.uint64(value)  # type: ignore[return-value]
