"""The only access to Numba: ``@kernel`` compiles a function if Numba is installed, and returns it unchanged
otherwise.

Numba's disk cache checks only the file of the function itself, so a change in a function that it calls from
another file would go unnoticed. The cache folder is therefore named by a hash of all sources that may hold a
kernel or a template of generated kernels (``inference.generated_kernels``), and of the versions of Python, Numba, LLVM
and NumPy: changed sources have another folder, so that no outdated kernel is run. If a source file was changed between
the import of this module, which hashes it, and its own import, this process caches no kernel from then on. See
``kernel_cache`` for the files in the folder.

Plain mode (``PLAIN``, or Numba missing) runs all kernels as plain Python.
"""

from __future__ import annotations

import gc
import hashlib
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
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
    """Return the folder in which programs of this user cache their files, by the custom of the platform."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData/Local")))
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches"
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return named if named.is_absolute() else Path.home() / ".cache"  # the standard ignores relative paths


LAYERS_ABOVE: Final = (
    "analysis",
    "cli",
    "documents",
    "plots",
    "show",
    "run_page",
    "study",
    "optimize",
    "league",
    "recordings",
    "tracking",
    "calibrate",
    "paper",
    "export",
    "testing",
)
"""Packages above the simulation: they hold no kernel and change no table of a result."""


@cache
def source_hash() -> str:
    """Return a hash of all sources that a simulation may depend on, as they were at this process's first call."""
    return hash_of_files(PACKAGE, simulation_sources())


def hash_of_files(folder: Path, files: Iterable[Path]) -> str:
    """Return a hash (16 hexadecimal digits) of the contents of files, and of their names in a folder."""
    digest = hashlib.sha256()
    for file in files:
        name = file.relative_to(folder)
        digest.update(name.as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


PACKAGE: Final = Path(__file__).parents[1]
"""The folder of this package."""


def simulation_sources() -> list[Path]:
    """Return all source files that a simulation may depend on, sorted by path."""
    sources = sorted(PACKAGE.rglob("*.py"))
    return [source for source in sources if source.relative_to(PACKAGE).parts[0] not in LAYERS_ABOVE]


@cache
def cache_folder() -> Path | None:
    """Return the folder of cached kernels for the present sources and versions of Python and its packages.

    The folder is created if needed. The result is None, with a warning, if the folder cannot be written to or if other
    users may write to it.
    """
    import llvmlite
    import numba

    from vibroswarm.core import kernel_cache

    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__, platform.machine())
    key = hashlib.sha256(f"{source_hash()} {versions!r}".encode()).hexdigest()[:20]
    try:
        base = _user_cache()
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = base
        # One by one: with ``parents=True``, only the last folder would get ``mode``.
        for name in ("vibroswarm", "kernels", key):
            folder = folder / name
            folder.mkdir(mode=0o700, exist_ok=True)
        reason = kernel_cache.why_unsafe(folder, base)
        if reason is None:
            with tempfile.TemporaryFile(dir=folder):  # fails if the folder is read-only
                return folder
    except (OSError, RuntimeError) as error:  # the user's home is missing or read-only
        reason = str(error)
    warn_once(f"compiled kernels are not cached, but compiled at every start: {reason}")
    return None


ENGINES: Final = {
    "event": "engine",
    "fixed-step": "fixed_step",
    "mujoco": "wheels_step",
}
"""Modules of the engines, by the names of their motion sources."""


def is_cached(*sources: str) -> bool:
    """Return whether the kernels of at least one of these engines are cached; always True in plain mode.

    If they are not, callers announce the wait for the compilation, or compile before they start worker processes. Only
    files of the engines' own modules count: a cache may also hold kernels of other modules, such as those that draw a
    floor, while no engine has been compiled yet.

    Args:
        sources: names of motion sources; without names, all engines of ``ENGINES``.
    """
    if not compiles():
        return True
    folder = cache_folder()
    # The name of each kernel's file begins with the name of the kernel's module. For a motion source that is not in
    # ENGINES, such as a user's, the name of the source is taken for that of its module.
    return folder is not None and any(
        any(folder.rglob(f"{ENGINES.get(name, name)}.*.nbc")) for name in sources or ENGINES
    )


def zero_rows(count: int | tuple[int, ...], dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Return zeroed rows whose fields kernels read as attributes (``rows[i].x_m``), compiled or plain."""
    zeros = np.zeros(count, dtype=dtype)
    return zeros if compiles() else zeros.view(np.recarray)


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view of an array, to be passed to kernels that only read it.

    Numba treats read-only and writable arrays as two types, so a kernel that gets both would be compiled twice. The
    columns of tables are read-only, so every array that a kernel only reads is passed as read-only.
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

    The function may not create arrays. Numba therefore need not count references to its array arguments
    (``_nrt=False``); the counting, by atomic operations at every call, took half of the engines' time.
    """
    return _compile(function, _nrt=False, forceinline=False)


def branching_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``kernel`` does, but without LLVM's superword-level vectorisation (``side_by_side=False``).

    That vectorisation turns equal operations on several numbers into one vector operation. In code with many branches,
    gathering the numbers into a vector and splitting it again takes longer than the vector operation saves.
    """
    return _compile(function, side_by_side=False, _nrt=False, forceinline=False)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that only kernels call; called from Python, as in tests, it runs as plain Python."""
    return _compile(function, from_python=False, _nrt=False, forceinline=False)


def inlined_uncached(function: Callable[P, R], boundscheck: bool = False) -> Callable[P, R]:
    """Compile as ``inlined`` does, without a cache file: for the functions of a strategy or network, and their callees.

    The types of these functions' arguments are defined by generated modules (``inference.generated_kernels``), and
    their code is part of the cached kernels of those modules. LLVM's superword-level vectorisation is off: it would
    pack the few single additions to a state into vectors, and wait for each.

    Args:
        boundscheck: whether an index beyond an array raises an IndexError; without it, it reads or spoils other memory.
    """
    return _compile(
        function,
        from_python=False,
        cached=False,
        side_by_side=False,
        _nrt=False,
        forceinline=True,
        boundscheck=boundscheck,
    )


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``inner`` does, inlined into its callers: for small functions and those with one or two callers."""
    return _compile(function, from_python=False, _nrt=False, forceinline=True)


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``kernel`` does, for functions that create arrays."""
    return _compile(function, forceinline=False)


def _name_records_by_their_fields() -> None:
    """Make Numba name compiled functions by the fields of the structured rows (records) that they take.

    Numba itself names them by a number that counts the record types each process has met. Two processes could then
    cache one function for two record types under the same name, and a third process that loads both files would run
    the wrong one. A hash of the record's fields is different for different records, and the same in every process.
    """
    from numba import types

    # Replaces Numba's property of this name. The name of a record type lists its fields.
    def mangling_args(self: Any) -> tuple[str, tuple[str]]:
        return "Record", (hashlib.sha256(self.name.encode()).hexdigest()[:16],)

    record: Any = types.Record
    record.mangling_args = property(mangling_args)


_compiled: list[Any] = []
"""All kernels declared so far that may be cached on disk."""
_changed_sources: set[str] = set()
"""Sources found to be changed after they were hashed; from the first one on, no kernel is cached."""
_hashed_at_s = time.time()
"""Time of this module's import, during which its first kernel (``signed``) has the sources hashed: a file that was
changed later may differ from what was hashed."""


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_mtime_ns, status.st_size


_stamps = {str(source): _stamp(source) for source in simulation_sources()} if compiles() else {}
"""Time of change and size of each source, before any module with a kernel was imported."""


_never_cached: set[str] = set()


def never_cache(file: str) -> None:
    """Cache no kernel of a file that is compiled from now on."""
    _never_cached.add(file)


def _is_changed(source: str) -> bool:
    """Return whether a source file was changed after this process had started to import this package.

    A generated module is known by its name, so it never counts as changed. Nor does a file whose time of change lies in
    the future, which only a wrong clock explains.
    """
    path, folder = Path(source), cache_folder()
    if folder is None or path.is_relative_to(folder) or not path.is_file():
        return False
    if source in _stamps:
        return _stamp(path) != _stamps[source]
    # Files outside the package, such as a user's own strategy, have no stamp: only their time of change is known.
    return _hashed_at_s < path.stat().st_mtime <= time.time()


def _quiet(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that computes as ``function`` does, without NumPy's warnings, as its compiled form would.

    Kernels rely on infinity and nan: places without a robot are infinitely far away.
    """

    @wraps(function)
    def quiet(*arguments: P.args, **named: P.kwargs) -> R:
        with np.errstate(all="ignore"):
            return function(*arguments, **named)

    return quiet


def _compile(
    function: Callable[P, R],
    from_python: bool = True,
    side_by_side: bool = True,
    cached: bool = True,
    **options: bool,
) -> Callable[P, R]:
    """Declare ``function`` as a Numba kernel, compiled at its first call; return it unchanged in plain mode.

    Args:
        from_python: whether Python calls the compiled form; if not, calls from Python run the function itself.
        side_by_side: whether LLVM's superword-level vectorisation is on (``_settings``).
        cached: whether compiled code may be cached on disk. It is cached only until a source file is found to be
            changed: the cache folder is named by a hash of the sources as they were when this process started.
        options: further options of ``numba.njit``: ``_nrt=False`` turns reference counting off, ``forceinline=True``
            inlines the function into its callers. ``forceinline`` is always given: without it, Numba compiles a
            function with the value of the caller for which it is compiled, so callees of inlined functions would be
            inlined too.
    """
    if not compiles():
        return _quiet(function) if from_python else function

    from vibroswarm.core import kernel_cache, whole_kernels

    if not _compiled:
        # This replaces a property of one of Numba's classes: once in a process is enough, but it must be done before
        # the first kernel that may be cached, since cached files hold the names that Numba gave.
        _name_records_by_their_fields()
    options |= {
        "nogil": True,  # threads run kernels at the same time
        "no_cfunc_wrapper": True,  # C code calls no kernel: saves compile time
        "no_cpython_wrapper": not from_python,
    }
    # Error model "numpy": division by 0 gives inf or NaN, not an error.
    compiled: Any = whole_kernels.declare(function, from_python, error_model="numpy", **options)
    # A function that only kernels call is in the cached machine code of these kernels.
    is_saved = cached and from_python and function.__code__.co_filename not in _never_cached
    folder = cache_folder() if is_saved else None
    if folder is not None:
        compiled._cache = kernel_cache.KernelCache(function, folder)
    if not from_python:
        _call_plain(compiled)
    _set_for_compiling(compiled, side_by_side)
    # Without a cache there is none to disable. The code is part of the cached kernels of generated modules, but these
    # are named by a hash of its source.
    if not cached:
        return cast("Callable[P, R]", compiled)
    _compiled.append(compiled)
    if _is_changed(function.__code__.co_filename):
        _changed_sources.add(function.__code__.co_filename)
    if _changed_sources:
        _disable_caching()  # of all kernels declared so far, including this one
    result: Callable[P, R] = compiled
    return result


def entry_for(kernel: Callable[P, R], *arguments: P.args, **none: P.kwargs) -> Callable[P, R]:
    """Compile a kernel for the types of these arguments; return a function that calls it without Numba's dispatch.

    Dispatch, which finds the compiled form for the types of each call, takes some 0.1 microseconds per array. The
    returned function skips it, so callers must pass arguments of exactly these types. In plain mode the kernel itself
    is returned.
    """
    del none  # there are no keyword arguments; type checkers require P.kwargs where P.args is used
    if not compiles():
        return kernel
    entry: Callable[P, R] = _overload(kernel, arguments).entry_point
    return entry


def address_of(kernel: Callable[..., int], *arguments: Any) -> Any:
    """Compile a kernel for the types of these arguments; return its address for ``kernel_call.call``.

    In plain mode the kernel itself is returned.
    """
    if not compiles():
        return kernel
    compiled = _overload(kernel, arguments)
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def _overload(kernel: Any, arguments: tuple[Any, ...]) -> Any:
    """Return the compiled form of a kernel for the types of these arguments."""
    key = (kernel, *map(_type_key, arguments))
    if key not in _overloads:
        signature = tuple(kernel.typeof_pyval(argument) for argument in arguments)
        kernel.compile(signature)
        _overloads[key] = kernel.overloads[signature]
    return _overloads[key]


_overloads: dict[Any, Any] = {}
"""Compiled forms by kernel and argument types: Numba takes 2 ms to find the types of fifty arrays."""


TYPE_FLAGS: Final = 0x1 | 0x2 | 0x100 | 0x400
"""Flags of an array on which its Numba type depends: C-contiguous, Fortran-contiguous, aligned, writeable."""


def _type_key(value: Any) -> Any:
    """Return a key that tells arguments of different Numba types apart; it is computed faster than the Numba type."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.num & TYPE_FLAGS
    if isinstance(value, tuple):
        return (type(value), *map(_type_key, value))
    if isinstance(value, np.generic):
        return type(value), value.dtype
    # Numba takes an integer of more than 63 bits as unsigned.
    return type(value), isinstance(value, int) and value.bit_length() > 63


def _call_plain(compiled: Any) -> None:
    """Make calls from Python run the uncompiled function; Python looks ``__call__`` up in the class."""
    kind = type(compiled)
    called = {"__call__": lambda self, *arguments: self.py_func(*arguments)}
    compiled.__class__ = type(kind.__name__, (kind,), called)


def _set_for_compiling(compiled: Any, side_by_side: bool) -> None:
    """Make a kernel notify ``_compile_listeners``, and then compile under ``_settings``, whenever it compiles."""
    compile_one, module = compiled.compile, compiled.py_func.__module__

    def compile_under_settings(signature: Any) -> Any:
        for listener in _compile_listeners:
            listener(module)
        with _settings(side_by_side):
            return compile_one(signature)

    compiled.compile = compile_under_settings


_compile_listeners: list[Callable[[str], None]] = []
"""Functions to be called with a kernel's module before that kernel is loaded from the cache or compiled."""


def add_compile_listener(listener: Callable[[str], None]) -> None:
    """Call ``listener`` with a kernel's module before that kernel is loaded from the cache or compiled."""
    _compile_listeners.append(listener)


@contextmanager
def _settings(side_by_side: bool) -> Iterator[None]:
    """Set LLVM's superword-level vectorisation, collect no garbage and take shortcuts, while a kernel compiles.

    Superword-level vectorisation combines equal operations on several numbers. It is off in Numba by default, and
    speeds most kernels up by 5 to 10 %. The many objects of a compilation live until its end, so that looking for
    garbage among them finds little. Both settings are process-wide; they are restored afterwards. Numba compiles
    one kernel at a time; its lock is taken here already, so that no other thread takes these settings for the user's.
    """
    from numba import config
    from numba.core.compiler_lock import global_compiler_lock

    from vibroswarm.core import whole_kernels

    numba_config: Any = config
    with global_compiler_lock:
        vectorize, collects = numba_config.SLP_VECTORIZE, gc.isenabled()
        numba_config.SLP_VECTORIZE = int(side_by_side)
        gc.disable()
        try:
            with whole_kernels.faster():
                yield
        finally:
            numba_config.SLP_VECTORIZE = vectorize
            if collects:
                gc.enable()


def _disable_caching() -> None:
    """Stop caching all kernels declared so far, because a source was changed after it was hashed.

    The cache folder is named by the hash of the old source, but each kernel may call a function of the changed source.
    """
    from numba.core.caching import NullCache

    for compiled in _compiled:
        compiled._cache = NullCache()


@kernel
def signed(value: Any) -> int:
    """Convert an integer from a table, of any width, to the signed 64-bit integer that kernels compute with.

    Without the conversion, Numba would compile each function that takes the integer once for each width, and would turn
    the sum of a signed and an unsigned integer into a float.
    """
    return np.int64(value)  # type: ignore[return-value]


@kernel
def unsigned(value: Any) -> int:
    """Convert a non-negative index to unsigned, so that compiled code need not check for negative indices.

    Only unsigned numbers may be added to the result: the sum with a signed number would be a float.
    """
    return np.uint64(value)  # type: ignore[return-value]
