"""Compile a kernel and all functions that it calls to machine code once, as one module.

By itself Numba optimises each function together with all that it calls, and makes machine code of it. A function at the
bottom of a tall tree of calls is so compiled as many times as there are levels above it, although only the kernel that
Python calls is ever run. Here a function that a kernel calls is only translated to LLVM's form, as a part. The kernel
takes in all its parts, and is optimised and compiled once, under its own settings (``jit.branching_kernel``): a first
start takes little more than half the time, and kernels are some 5 % faster.

A user's own compiled function may call our kernels too. Numba compiles it, and for it our functions as well, in the
ordinary way: a part is used only where the function being compiled is one of ours (``_is_ours``).

These are inner parts of Numba, used with the versions that they were tested with (``KNOWN``). With another version
kernels are compiled in Numba's way: to the same numbers, but more slowly.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any, Final

import numba
from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import compiler, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import PassManager, _pass_registry, register_pass
from numba.core.environment import lookup_environment
from numba.core.errors import new_error_context as error_context  # type: ignore[attr-defined]
from numba.core.postproc import PostProcessor
from numba.core.runtime.nrt import rtsys
from numba.core.targetconfig import ConfigStack
from numba.core.transforms import canonicalize_cfg

from vibroswarm.core.compiled_code import is_ours
from vibroswarm.core.numba_shortcuts import shortcuts

KNOWN: Final = ((0, 68),)
"""Versions of Numba whose inner parts are as this module takes them to be."""


def is_known() -> bool:
    """Return whether this version of Numba is one of ``KNOWN``."""
    return numba.version_info[:2] in KNOWN


def faster() -> AbstractContextManager[None]:
    """Return a context manager under which Numba compiles faster (``numba_shortcuts``); the caller holds its lock."""
    return shortcuts() if is_known() else nullcontext()


def declare(function: Callable[..., Any], from_python: bool, **options: Any) -> Any:
    """Declare a function as ``numba.njit`` does; return its dispatcher.

    Args:
        from_python: whether Python calls the compiled form; if not, only other kernels do.
        options: of ``numba.njit``.
    """
    njit: Any = numba.njit  # its stubs lack some options
    if not is_known():
        return njit(**options)(function)
    dispatcher = njit(**options, **({"pipeline_class": WholeCompiler} if from_python else {}))(function)
    parts: list[Any] = []

    def used(of_kind: Any) -> Any:
        """Return what the function being compiled now calls: the part, created at first use, or the dispatcher."""
        if not _is_ours():
            return super(of_kind, dispatcher)
        if not parts:
            part_options = options | {"no_cpython_wrapper": True}
            parts.append(njit(**part_options, pipeline_class=PartCompiler)(function))
        return parts[0]

    kind = type(dispatcher)

    class WithPart(kind):  # type: ignore[misc, valid-type]
        """A dispatcher whose function is taken into our kernels as a part."""

        def get_call_template(self, args: Any, kws: Any) -> Any:
            return used(WithPart).get_call_template(args, kws)

        def get_overload(self, sig: Any) -> Any:
            return used(WithPart).get_overload(sig)

    WithPart.__name__ = WithPart.__qualname__ = kind.__name__
    dispatcher.__class__ = WithPart
    return dispatcher


_under_way: list[Any] = []
"""The flags of each of our functions that is being compiled; the innermost is the last one."""


def _is_ours() -> bool:
    """Return whether the function that is being compiled is one of ours, by the flags on top of Numba's stack."""
    return bool(_under_way) and ConfigStack.top_or_none() is _under_way[-1]


class _Simplified(JITCodeLibrary):
    """Takes in modules whose functions are simplified one by one; Numba does so for those only declared too."""

    def add_llvm_module(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        for name, function in _defined(ll_module).items():
            if name.startswith(FROM_PYTHON):
                _leave_alone(function)
                continue
            passes, builder = self._codegen._function_pass_manager()
            passes.run(function, builder)
        self._final_module.link_in(ll_module)


FROM_PYTHON: Final = "_ZN7cpython"
"""Beginning of the name of the function by which Python calls a kernel: it takes hundreds of values out of objects."""


def _leave_alone(function: Any) -> None:
    """Have a function translated as it is: it runs once a call, and optimising it took a sixth of a compilation."""
    for attribute in ("noinline", "optnone"):
        function.add_function_attribute(attribute)


class Part(_Simplified):
    """One function in LLVM's form, to be taken in by the kernels that call it; never machine code by itself."""

    def add_linking_library(self, library: Any) -> None:
        """Note what this function calls."""
        if library is not rtsys.library:  # which a kernel takes in by itself
            self._linking_libraries.append(library)

    def finalize(self) -> None:
        """There is nothing to optimise or to compile."""
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return all of it, also what nothing calls so far: a part that is taken in later may call it."""
        return self._final_module


class Whole(_Simplified):
    """A kernel that Python calls, with all that it calls."""

    def add_linking_library(self, library: Any) -> None:
        """Take in a library, with all that it calls if it is a part."""
        if library in self._linking_libraries:
            return
        super().add_linking_library(library)
        if isinstance(library, Part):
            for called in library._linking_libraries:
                self.add_linking_library(called)

    def finalize(self) -> None:
        """Optimise it as one module, and compile it to machine code."""
        self._own = set(_defined(self._final_module))
        # Of Numba's own functions LLVM takes in only those that are called by then, so they come last.
        self._linking_libraries.sort(key=lambda library: not isinstance(library, Part))
        super().finalize()

    def _optimize_final_module(self) -> None:
        taken_in = _defined(self._final_module)
        for name in taken_in.keys() - self._own:
            taken_in[name].linkage = "internal"  # nothing but this kernel calls it
        super()._optimize_final_module()

    def _verify_declare_only_symbols(self) -> None:
        """Raise if a compiled function is called that is not here; it would be called at address 0."""
        super()._verify_declare_only_symbols()
        for function in self._final_module.functions:
            if function.is_declaration and function.name.startswith("_ZN"):
                raise AssertionError(f"'{function.name}' was not taken in")


def _defined(module: Any) -> dict[str, Any]:
    return {function.name: function for function in module.functions if not function.is_declaration}


@register_pass(mutates_CFG=True, analysis_only=False)
class LowerWhole(typed_passes.NativeLowering):
    """Translate a kernel to LLVM's form, take in all that it calls, and make machine code."""

    _name = "vibroswarm_lower_whole"

    def run_pass(self, state: Any) -> bool:
        """Run Numba's pass with a library of another kind."""
        state.library = Whole(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        changes = bool(super().run_pass(state))
        _set_environments(state.library)
        return changes


def _set_environments(library: Whole) -> None:
    """Give each part that a kernel has taken in its environment, without which ``print`` fails and keeps Python's lock.

    Numba does so when it makes machine code of a function, and when it loads a kernel from the cache.
    """
    for variable in library._final_module.global_variables:
        environment = lookup_environment(variable.name)
        if environment is not None:
            library.codegen.set_env(variable.name, environment)


@register_pass(mutates_CFG=True, analysis_only=False)
class LowerPart(typed_passes.NativeLowering):
    """Translate a function to LLVM's form, and no further."""

    _name = "vibroswarm_lower_part"

    def run_pass(self, state: Any) -> bool:
        """Run Numba's pass with a library of another kind, and make no machine code."""
        state.library = Part(state.targetctx.codegen(), state.func_id.func_qualname)
        state.targetctx.get_executable = _no_entry  # the context is a copy for this function alone
        changes = bool(super().run_pass(state))
        # Types of all expressions, which would keep them alive; Numba too drops them, where it saves a function.
        state.cr.fndesc.typemap = state.cr.fndesc.calltypes = None
        return changes


def _no_entry(library: Any, fndesc: Any, env: Any) -> Any:
    """Return what stands for a function that Python cannot call, in Numba's form."""
    name = fndesc.qualname.split(".")[-1]
    return _dynfunc.make_function(fndesc.lookup_module(), name, "not for Python", 0, env, (library,))


class _Passes(PassManager):
    """Numba's passes, run without events, timings, and Numba's checks of its own passes."""

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:  # noqa: N802  (Numba's name)
        pss.analysis = self._analysis
        with error_context("Pass {name}", name=pss.name()):
            changes = [
                run(internal_state) for run in (pss.run_initialization, pss.run_pass, pss.run_finalizer)
            ]
        if _pass_registry.get(type(pss)).mutates_CFG:
            function = internal_state.func_ir
            if any(changes):
                PostProcessor(function).run()
            else:
                function.blocks = canonicalize_cfg(function.blocks)


IDLE: Final = (
    untyped_passes.InlineClosureLikes,
    untyped_passes.InlineInlinables,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
)
"""Passes that change no function of this package, and are left out there: none has closures, lists, or arithmetic with
whole arrays, and none calls what Numba takes in by itself."""
UNREAD: Final = (typed_passes.AnnotateTypes,)
"""Passes whose results nobody reads, left out for all: a text of each function's types, for ``inspect_types``."""


class _OurCompiler(compiler.CompilerBase):
    """Compiles by Numba's passes, with ``lowering`` in place of Numba's last step."""

    lowering: Any

    def _compile_core(self) -> Any:
        before = len(_under_way)
        try:
            return super()._compile_core()
        finally:
            del _under_way[before:]

    def define_pipelines(self) -> list[Any]:
        """Return the one list of passes; the flags of this function are on top of Numba's stack by now."""
        _under_way.append(ConfigStack.top_or_none())
        numbas: Any = compiler.DefaultPassBuilder
        passes = _Passes("vibroswarm")
        left_out = (*UNREAD, *IDLE) if is_ours(self.state.func_id.modname) else UNREAD
        for define in (
            numbas.define_untyped_pipeline,
            numbas.define_typed_pipeline,
            numbas.define_nopython_lowering_pipeline,
        ):
            for each, about in define(self.state).passes:
                if each not in left_out:
                    passes.add_pass(self.lowering if each is typed_passes.NativeLowering else each, about)
        passes.finalize()
        return [passes]


class WholeCompiler(_OurCompiler):
    """Compiles a kernel that Python calls."""

    lowering = LowerWhole


class PartCompiler(_OurCompiler):
    """Compiles a function that kernels call."""

    lowering = LowerPart
