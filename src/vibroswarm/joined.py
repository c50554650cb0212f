"""Numba's compiler put together anew: a kernel and all that it calls become machine code once, as one module.

Numba optimises each function by itself, with all that it calls in it, and makes machine code of it, though
only the kernel that Python calls is ever run: what stands at the bottom of a tall tree of calls is so
compiled as many times as there are floors above it. Here a function that kernels call is only brought into
LLVM's form; the kernel at the top takes in all of them and is optimised and compiled, once. That module
knows all calls of what is in it, and LLVM makes somewhat faster code of it too.

Passes that look for what no kernel has (closures, ``with``, literals that choose branches) are left out.

These are Numba's inner parts, so they are used with the versions of Numba that they were tried with
(``KNOWN``). With others, kernels compile as Numba does it by itself: slower, to the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numba
from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import compiler, typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import PassManager, _pass_registry, register_pass
from numba.core.runtime.nrt import rtsys

KNOWN: Final = ((0, 68),)
"""Versions of Numba whose inner parts are as this file takes them to be."""


def is_known() -> bool:
    """Whether this version of Numba is one of ``KNOWN``."""
    return numba.version_info[:2] in KNOWN


_njit: Any = numba.njit  # its stubs do not know all options


def whole(function: Callable[..., Any], **options: Any) -> Any:
    """A kernel that Python calls, for ``numba.njit``'s options. Kernels that call it take it in as ``part``."""
    if not is_known():
        return _njit(**options)(function)
    kernel = _njit(pipeline_class=WholeCompiler, **options)(function)
    taken_in = part(function, **options)
    kernel.__class__ = _kind(
        kernel,
        get_call_template=lambda self, args, kws: taken_in.get_call_template(args, kws),
        get_overload=lambda self, signature: taken_in.get_overload(signature),
    )
    return kernel


def part(function: Callable[..., Any], **options: Any) -> Any:
    """What only kernels call; from Python, the plain function is called."""
    options["no_cpython_wrapper"] = True
    if is_known():
        options["pipeline_class"] = PartCompiler
    dispatcher = _njit(**options)(function)
    dispatcher.__class__ = _kind(dispatcher, __call__=lambda self, *arguments: function(*arguments))
    return dispatcher


def _kind(dispatcher: Any, **methods: Any) -> Any:
    """The class of a dispatcher, with other methods."""
    return type(type(dispatcher).__name__, (type(dispatcher),), methods)


class _Simplified(JITCodeLibrary):
    """Takes in modules whose functions are simplified one by one; Numba does so for those only declared too."""

    def add_llvm_module(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        for function in _defined(ll_module).values():
            passes, builder = self._codegen._function_pass_manager()
            passes.run(function, builder)
        self._final_module.link_in(ll_module)


class Part(_Simplified):
    """One function in LLVM's form, to be taken in by the kernels that call it; never machine code by itself."""

    def add_linking_library(self, library: Any) -> None:
        """Note what this function calls."""
        if library is not rtsys.library:  # which a kernel takes in by itself
            self._linking_libraries.append(library)

    def finalize(self) -> None:
        """There is nothing to be done."""
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """All of it, called so far or not: LLVM would leave out what it may, and a later part may call that."""
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
        """Optimise it as one, and make machine code."""
        self._own = set(_defined(self._final_module))
        # Of Numba's own functions LLVM takes in only what is called by then, so that they come last.
        self._linking_libraries.sort(key=lambda library: not isinstance(library, Part))
        super().finalize()

    def _optimize_final_module(self) -> None:
        taken_in = _defined(self._final_module)
        for name in taken_in.keys() - self._own:
            taken_in[name].linkage = "internal"  # none but this kernel calls it
        super()._optimize_final_module()

    def _verify_declare_only_symbols(self) -> None:
        """Raise where a compiled function is called that is not here; else it would be called at address 0."""
        super()._verify_declare_only_symbols()
        for function in self._final_module.functions:
            if function.is_declaration and function.name.startswith("_ZN"):
                raise AssertionError(f"'{function.name}' was not taken in")


def _defined(module: Any) -> dict[str, Any]:
    """The functions that are in a module, by name."""
    return {function.name: function for function in module.functions if not function.is_declaration}


@register_pass(mutates_CFG=True, analysis_only=False)
class LowerWhole(typed_passes.NativeLowering):
    """Bring a kernel into LLVM's form, take in all that it calls, and make machine code."""

    _name = "vibroswarm_lower_whole"

    def run_pass(self, state: Any) -> bool:
        """As Numba's, with a library of another kind."""
        state.library = Whole(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class LowerPart(typed_passes.NativeLowering):
    """Bring a function into LLVM's form, and no further."""

    _name = "vibroswarm_lower_part"

    def run_pass(self, state: Any) -> bool:
        """As Numba's, with a library of another kind and no machine code."""
        state.library = Part(state.targetctx.codegen(), state.func_id.func_qualname)
        state.targetctx.get_executable = _no_entry  # of a copy of the context, for this function alone
        return bool(super().run_pass(state))


def _no_entry(library: Any, fndesc: Any, env: Any) -> Any:
    """What stands for a function that Python cannot call, as Numba makes it."""
    name = fndesc.qualname.split(".")[-1]
    return _dynfunc.make_function(fndesc.lookup_module(), name, "not for Python", 0, env, (library,))


class Passes(PassManager):
    """Passes one after the other, with nothing measured or told between them."""

    def run(self, state: Any) -> None:
        """Run them."""
        for kind, _ in self.passes:
            one = _pass_registry.get(kind).pass_inst
            one.analysis = self._analysis
            one.run_initialization(state)
            one.run_pass(state)
            one.run_finalizer(state)


NEEDED: Final = (
    untyped_passes.TranslateByteCode,
    untyped_passes.FixupArgs,
    untyped_passes.IRProcessing,
    untyped_passes.GenericRewrites,
    untyped_passes.ReconstructSSA,
    typed_passes.NopythonTypeInference,
    typed_passes.PreLowerStripPhis,
    typed_passes.InlineOverloads,
    typed_passes.IRLegalization,
    typed_passes.AnnotateTypes,
)
"""Passes of Numba's that kernels need, before they are brought into LLVM's form."""


@cache
def _passes(lowering: Any) -> Passes:
    passes = Passes("vibroswarm")
    for each in (*NEEDED, lowering, typed_passes.NoPythonBackend):
        passes.add_pass(each)
    passes.finalize()
    return passes


class WholeCompiler(compiler.CompilerBase):
    """Compiles a kernel that Python calls."""

    def define_pipelines(self) -> list[Any]:
        """The one list of passes."""
        return [_passes(LowerWhole)]


class PartCompiler(compiler.CompilerBase):
    """Compiles a function that kernels call."""

    def define_pipelines(self) -> list[Any]:
        """The one list of passes."""
        return [_passes(LowerPart)]
