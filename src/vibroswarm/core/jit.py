"""The only access to Numba: decorators of kernels, the folder that they are cached in, and modules of generated text.

Numba's own cache looks at the file of a kernel only, so a change of a function that it calls, in another file, would go
unnoticed. Kernels are therefore cached in a folder whose name is a hash of all sources that may hold a kernel, and of
the versions of Python, Numba, LLVM and NumPy. Kernels of a user's file are in a folder of the texts beside it.

Plain mode (``PLAIN``, or no Numba) runs all kernels as plain Python.
"""

from __future__ import annotations

import gc
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache, wraps
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any, Final, ParamSpec, TypeVar
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.user_code import users_text
from vibroswarm.errors import warn_once

P = ParamSpec("P")
R = TypeVar("R")

PLAIN = "1" in (os.environ.get("VIBROSWARM_PLAIN"), os.environ.get("NUMBA_DISABLE_JIT"))
"""Set the environment variable VIBROSWARM_PLAIN (or Numba's own) to 1 to debug the kernels as plain Python."""
COMPILES: Final = not PLAIN and find_spec("numba") is not None
PACKAGE: Final = Path(__file__).parents[1]
"""The folder of this package."""
LAYERS_ABOVE: Final = (
    "calibrate", "cli", "export", "lab", "league", "paper", "plots", "recordings", "report", "run_page",
    "search", "statistics", "study", "testing",
)  # fmt: skip
"""Packages above the simulation: they hold no kernel and change no table of a result."""
ENGINES: Final = {"event": "engine", "fixed-step": "fixed_step", "mujoco": "wheels_step"}
"""Modules of the engines' kernels, by the names of the motion sources."""
UNUSED_DAYS: Final = 30
"""A folder of kernels that was not used for so long is removed."""


@cache
def source_hash() -> str:
    """Return a hash of all sources that a simulation may depend on, and of their names, 16 hexadecimal digits."""
    digest = sha256()
    for file in simulation_sources():
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def simulation_sources() -> list[Path]:
    """Return all source files that a simulation may depend on, sorted by path."""
    files = sorted(PACKAGE.rglob("*.py"))
    return [file for file in files if file.relative_to(PACKAGE).parts[0] not in LAYERS_ABOVE]


@cache
def cache_folder() -> Path | None:
    """Return the folder of kernels of the present sources and versions, which is created; None if it cannot be."""
    import llvmlite
    import numba

    versions = (sys.version, numba.__version__, llvmlite.__version__, np.__version__, platform.machine())
    key = sha256(f"{source_hash()} {versions!r}".encode()).hexdigest()[:20]
    try:
        folder = _user_cache() / "vibroswarm" / "kernels" / key
        if not folder.exists():
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            _remove_unused(folder.parent)
        with tempfile.TemporaryFile(dir=folder):  # fails if the folder is read-only; changes its time
            return folder
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
        warn_once(f"compiled kernels are not cached, but compiled at every start: {error}")
    return None


def _remove_unused(kernels: Path) -> None:
    for folder in kernels.iterdir():
        if folder.stat().st_mtime < time.time() - UNUSED_DAYS * 86400:
            shutil.rmtree(folder, ignore_errors=True)


def _user_cache() -> Path:
    """Return the folder in which programs of this user cache their files, by the custom of the platform."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", str(Path.home() / "AppData/Local")))
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches"
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return named if named.is_absolute() else Path.home() / ".cache"  # the standard ignores relative paths


def is_cached(*sources: str) -> bool:
    """Return whether the engine of one of these motion sources is cached, without names: of any; True if plain."""
    folder = cache_folder() if COMPILES else None
    found = (
        (folder.rglob(f"{ENGINES.get(name, name)}.*.nbc") for name in sources or ENGINES) if folder else ()
    )
    return not COMPILES or any(map(any, found))


def generated(name: str, text: str, *, is_saved: bool = True) -> ModuleType:
    """Return the module of a text, whose name tells it from all others; its kernels are cached if it is saved."""
    folder = cache_folder() if is_saved and COMPILES else None
    file = f"<{name}>" if folder is None else str(folder / f"{name}.py")
    if folder is not None and not Path(file).exists():
        part = folder / f"{name}.{uuid4().hex}"
        part.write_text(text, encoding="utf-8")
        part.replace(file)
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = file
    exec(compile(text, file, "exec"), vars(module))  # noqa: S102  (our own text)
    return module


if COMPILES:
    from numba import _dynfunc  # type: ignore[attr-defined]
    from numba import config as numba_settings
    from numba.core import caching, compiler, typed_passes
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.compiler_machinery import register_pass
    from numba.core.environment import lookup_environment
    from numba.core.registry import CPUDispatcher
    from numba.core.runtime.nrt import rtsys

    numba_config: Any = numba_settings

    class _Locator(caching._CacheLocator):
        """The place of a function's files."""

        def __init__(self, function: Any, file: str) -> None:
            self._py_file, self._line, self._path = (
                file,
                function.__code__.co_firstlineno,
                _folder_of(function),
            )

        from_function = classmethod(lambda cls, function, file: cls(function, file))

        def get_cache_path(self) -> str:
            return str(self._path)

        def get_source_stamp(self) -> str:
            return ""  # all sources are in the names of folders

        def get_disambiguator(self) -> str:
            return str(self._line)

    class _Impl(caching.CompileResultCacheImpl):
        _locator_classes = [_Locator]  # noqa: RUF012

    class _Files(caching.IndexDataCacheFile):
        def _data_name(self, number: int) -> str:
            return self._data_name_pattern.format(
                number=uuid4().int
            )  # two processes that count would give one name

    class _Cache(caching.FunctionCache):
        _impl_class = _Impl

        def __init__(self, function: Any) -> None:
            super().__init__(function)
            self._cache_file = _Files(self._cache_path, self._impl.filename_base, "")

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            """Load machine code without all that Numba compiles with, which takes a tenth of a short command."""
            rtsys.initialize(target_context)
            try:
                return self._load_overload(sig, target_context)
            except Exception:
                return None  # it is compiled, and written again

    def _defined(module: Any) -> dict[str, Any]:
        return {function.name: function for function in module.functions if not function.is_declaration}

    class _Part(JITCodeLibrary):
        """One function in LLVM's form, to be taken in by the kernels that call it; never machine code by itself."""

        def add_linking_library(self, library: Any) -> None:
            if library is not rtsys.library:  # which a kernel takes in by itself
                self._linking_libraries.append(library)

        def finalize(self) -> None:
            self._finalized = True

        def _get_module_for_linking(self) -> Any:
            return self._final_module

    class _Whole(JITCodeLibrary):
        """A kernel that Python calls, with all that it calls, optimised and compiled once."""

        def add_linking_library(self, library: Any) -> None:
            if library not in self._linking_libraries:
                super().add_linking_library(library)
                for called in library._linking_libraries if isinstance(library, _Part) else ():
                    self.add_linking_library(called)

        def finalize(self) -> None:
            self._own = set(_defined(self._final_module))
            # Of Numba's own functions LLVM takes in only those that are called by then, so they come last.
            self._linking_libraries.sort(key=lambda library: not isinstance(library, _Part))
            super().finalize()

        def _optimize_final_module(self) -> None:
            for name, function in _defined(self._final_module).items():
                if name not in self._own:
                    function.linkage = "internal"  # nothing but this kernel calls it
            super()._optimize_final_module()

    @register_pass(mutates_CFG=True, analysis_only=False)
    class _LowerWhole(typed_passes.NativeLowering):
        _name = "vibroswarm_lower_whole"

        def run_pass(self, state: Any) -> bool:
            state.library = _Whole(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            changes: bool = super().run_pass(state)
            for variable in state.library._final_module.global_variables:  # without them print fails
                environment = lookup_environment(variable.name)
                if environment is not None:
                    state.library.codegen.set_env(variable.name, environment)
            return changes

    def _no_entry(library: Any, fndesc: Any, env: Any) -> Any:
        return _dynfunc.make_function(
            fndesc.lookup_module(), fndesc.qualname, "not for Python", 0, env, (library,)
        )

    @register_pass(mutates_CFG=True, analysis_only=False)
    class _LowerPart(typed_passes.NativeLowering):
        _name = "vibroswarm_lower_part"

        def run_pass(self, state: Any) -> bool:
            state.library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)
            state.targetctx.get_executable = _no_entry  # the context is a copy for this function alone
            return bool(super().run_pass(state))

    class _Compiler(compiler.CompilerBase):
        """Names functions by all fields of the records they take; Numba numbers records anew in each process.

        Two processes could give one name to a function for two types of record, and a third that loads both files from
        the cache would run the wrong one.
        """

        lowering: Any = _LowerWhole

        def define_pipelines(self) -> Any:
            identity = self.state.func_id
            identity.unique_id = (
                f"{identity.unique_id}x{sha256(str(self.state.args).encode()).hexdigest()[:16]}"
            )
            passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.passes = [
                (self.lowering if each is typed_passes.NativeLowering else each, about)
                for each, about in passes.passes
                if each is not typed_passes.AnnotateTypes  # a text that nobody reads
            ]
            passes.finalize()
            return [passes]

    class _PartCompiler(_Compiler):
        lowering = _LowerPart

    class Kernel(CPUDispatcher):
        """A function that Numba compiles under our settings."""

        side_by_side, compiler, is_cached = 1, _Compiler, True
        _cache: Any

        def __init__(self, py_func: Any, locals: Any = None, targetoptions: Any = None) -> None:
            super().__init__(py_func, locals or {}, targetoptions, self.compiler)

        def compile(self, sig: Any) -> Any:
            """Compile under our settings: they are process-wide, so Numba's lock is held."""
            if self.is_cached and isinstance(self._cache, caching.NullCache) and _folder_of(self.py_func):
                self._cache = _Cache(self.py_func)
            with global_compiler_lock:
                before, collects = numba_config.SLP_VECTORIZE, gc.isenabled()
                numba_config.SLP_VECTORIZE = self.side_by_side
                gc.disable()  # objects of a compilation live until its end
                try:
                    return super().compile(sig)
                finally:
                    numba_config.SLP_VECTORIZE = before
                    if collects:
                        gc.enable()

    class Branching(Kernel):
        """Compiled without LLVM's superword-level vectorisation."""

        side_by_side = 0

    class Inner(Kernel):
        """Compiled for kernels; called from Python it is plain Python."""

        compiler, is_cached = _PartCompiler, False

        def __call__(self, *arguments: Any) -> Any:
            """Call the function itself."""
            return self.py_func(*arguments)

    class Hook(Inner, Branching):
        """Compiled for the kernels of a strategy."""


def _declare(function: Any, kind: str, **options: bool) -> Any:
    """Declare a kernel, compiled at its first call; in plain mode return the function without NumPy's warnings.

    ``forceinline`` is always given: without it, callees of inlined functions would be inlined too. Functions that no
    array is made in need no counting of references (``_nrt``), which took half of the engines' time.
    """
    is_inner = kind in ("Inner", "Hook")
    if not COMPILES:
        return function if is_inner else wraps(function)(np.errstate(all="ignore")(function))
    shared = {
        "nopython": True,
        "nogil": True,
        "no_cfunc_wrapper": True,
        "error_model": "numpy",
        "boundscheck": False,
    }
    compiled = globals()[kind](function, None, {**shared, "no_cpython_wrapper": is_inner, **options})
    return compiled


def _folder_of(function: Any) -> Path | None:
    """Return the folder of a kernel's files; None: it must not be cached."""
    folder, file = cache_folder(), Path(function.__code__.co_filename)
    if folder is None or not file.is_file():
        return None
    text = "" if file.is_relative_to(folder) else users_text(function)
    if text is None:
        return None
    key = f"-{sha256(text.encode()).hexdigest()[:16]}" if text else ""
    return folder / f"{function.__module__}{key}"


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile ``function`` (IEEE arithmetic, no fastmath), cached on disk; it may not create arrays."""
    return _declare(function, "Kernel", _nrt=False, forceinline=False)  # type: ignore[no-any-return]


def branching_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``kernel`` does, without superword-level vectorisation, which slows code with many branches."""
    return _declare(function, "Branching", _nrt=False, forceinline=False)  # type: ignore[no-any-return]


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``kernel`` does, for functions that create arrays."""
    return _declare(function, "Kernel", forceinline=False)  # type: ignore[no-any-return]


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function that only kernels call; called from Python, as in tests, it runs as plain Python."""
    return _declare(function, "Inner", _nrt=False, forceinline=False)  # type: ignore[no-any-return]


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile as ``inner`` does, inlined into its callers: for small functions and those with one or two callers."""
    return _declare(function, "Inner", _nrt=False, forceinline=True)  # type: ignore[no-any-return]


def inlined_uncached(function: Callable[P, R], boundscheck: bool = False) -> Callable[P, R]:
    """Compile as ``inlined`` does, for the functions of a strategy or network."""
    return _declare(function, "Hook", _nrt=False, forceinline=True, boundscheck=boundscheck)  # type: ignore[no-any-return]


def entry_for(kernel: Callable[P, R], *arguments: P.args, **none: P.kwargs) -> Callable[P, R]:
    """Compile a kernel for exactly these types; return what calls it without Numba's dispatch, 0.1 us an array."""
    del none  # type checkers require P.kwargs where P.args is used
    key: Any = (kernel, *map(_type_key, arguments))
    if COMPILES and key not in _entries:
        compiled: Any = kernel
        signature = tuple(compiled.typeof_pyval(argument) for argument in arguments)
        compiled.compile(signature)
        _entries[key] = compiled.overloads[signature].entry_point
    return _entries[key] if COMPILES else kernel


_entries: dict[Any, Any] = {}
"""Entries by kernel and argument types: Numba takes 2 ms to find the types of fifty arrays."""
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


def zero_rows(count: int | tuple[int, ...], dtype: np.dtype[np.void]) -> NDArray[np.void]:
    """Return zeroed rows whose fields kernels read as attributes (``rows[i].x_m``), compiled or plain."""
    zeros = np.zeros(count, dtype=dtype)
    return zeros if COMPILES else zeros.view(np.recarray)


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view: Numba takes read-only and writable arrays as two types, and would compile twice."""
    view = values.view()
    view.flags.writeable = False
    return view


@kernel
def signed(value: Any) -> int:
    """Convert an integer from a table, of any width, to the signed 64-bit integer that kernels compute with."""
    return np.int64(value)  # type: ignore[return-value]


@kernel
def unsigned(value: Any) -> int:
    """Convert a non-negative index to unsigned, so that compiled code need not check for negative indices."""
    return np.uint64(value)  # type: ignore[return-value]
