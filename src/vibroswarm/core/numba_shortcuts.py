"""Parts of Numba that take most of the time of a compilation, done faster while one of our kernels is compiled.

Numba types and translates a function in Python; LLVM takes less than a third of the time. Much of the rest is spent on
repetition: the type of ``a + b`` is looked for among dozens of templates at each addition, settings are compared entry
by entry, the variables of every statement are listed some twenty times, and events are sent that nobody listens to.
What is computed here is what Numba computes, so the compiled kernels are the same; but Numba compiles a function again
for each number that is written out in a call of it, and here it is compiled once.

These are inner parts of Numba, used with the versions that ``whole_kernels.KNOWN`` lists. They are replaced under
Numba's lock and only while one of our kernels is compiled, so a user's own compilations are as they were.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from types import CodeType, FunctionType
from typing import Any, Final

from numba.core import base, dispatcher, errors, event, inline_closurecall, ir, types
from numba.core.postproc import PostProcessor, VariableLifetime
from numba.core.targetconfig import ConfigStack, TargetConfig
from numba.core.transforms import canonicalize_cfg
from numba.core.types.functions import BaseFunction

Signatures = dict[tuple[Any, ...], tuple[Any, Any, Any, Any]]
"""Signatures by function, context, argument types and settings: each with the function, which is so kept alive, the key
of the implementation and the settings."""


def list_variables(self: Any, value: Any) -> list[Any]:
    """Return the variables in a value of an instruction; in place of ``ir.Inst._rec_list_vars``."""
    del self
    found: list[Any] = []
    _collect((value,), found)
    return found


WITHOUT_VARIABLES: Final = {
    ir.Loc,
    str,
    int,
    float,
    bool,
    type(None),
    type(len),
    type(ir.UNDEFINED),
    ir.Const,
    ir.Global,
    ir.FreeVar,
    ir.Arg,
}
"""Types of values that hold no variable; most values are of one of these."""


def _collect(values: Iterable[Any], found: list[Any]) -> None:
    """Append the variables in some values to ``found``, in order."""
    for value in values:
        kind = type(value)
        if kind is ir.Var:
            found.append(value)
        elif kind in WITHOUT_VARIABLES:
            continue
        elif kind is ir.Expr:
            _collect(value._kws.values(), found)
        elif isinstance(value, list | tuple):
            _collect(value, found)
        elif isinstance(value, dict):
            _collect(value.values(), found)
        elif isinstance(value, ir.Inst):
            found.extend(value.list_vars())  # type: ignore[no-untyped-call]


def equal_settings(self: Any, other: Any) -> bool:
    """Return whether settings are equal, comparing only those that are given; in place of ``TargetConfig.__eq__``."""
    if self is other:
        return True
    if not isinstance(other, TargetConfig):
        return False
    if type(self) is not type(other):
        return bool(self.values() == other.values())  # type: ignore[no-untyped-call]
    mine, theirs = self._values, other._values
    return bool(mine == theirs) or all(
        getattr(self, name) == getattr(other, name) for name in {**mine, **theirs}
    )


TELLING: Final = ("nrt", "forceinline", "no_cpython_wrapper", "no_cfunc_wrapper")
"""Settings in which our kernels, their parts and Numba's own functions differ."""


def hash_of_settings(self: Any) -> int:
    """Return a hash that tells most settings apart; in place of ``TargetConfig.__hash__``."""
    return hash(tuple(getattr(self, name, None) for name in TELLING))


def remembering(numbas: Callable[..., Any], signatures: Signatures) -> Callable[..., Any]:
    """Return ``BaseFunction.get_call_type`` that looks a signature up among the known ones first.

    Args:
        numbas: Numba's own. signatures: those that are known; extended.
    """

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        settings = ConfigStack.top_or_none()  # type: ignore[no-untyped-call]
        key = (id(self), id(context), args, tuple(kws.items()), settings)
        known = signatures.get(key)
        if known is None:
            signature = numbas(self, context, args, kws)
            # Settings are a part of the key, and may be changed later: a copy is kept.
            kept = None if settings is None else settings.copy()
            implementation = self._impl_keys[signature.args]
            signatures[*key[:-1], kept] = (self, context, signature, implementation)
            return signature
        _, _, signature, self._impl_keys[signature.args] = known
        return signature

    return get_call_type


def without_literals(numbas: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``types.Dispatcher.get_call_type`` that takes a literal argument as any number of its type.

    Numba compiles a function again for each number and truth value that is written out in a call of it.
    """

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        plain = tuple(map(types.unliteral, args))
        if plain == args:
            return numbas(self, context, args, kws)
        try:
            return numbas(self, context, plain, kws)
        except errors.NumbaError:  # a function may need to know the number
            return numbas(self, context, args, kws)

    return get_call_type


def post_process(numbas: Callable[..., None]) -> Callable[..., None]:
    """Return ``PostProcessor.run`` without the lists of variables at the beginning of each block.

    Only generators, and functions that Numba leaves to Python's interpreter, need these lists.
    """

    def run(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        function = self.func_ir
        if function.is_generator:
            numbas(self, emit_dels, extend_lifetimes)
            return
        function.blocks = canonicalize_cfg(function.blocks)  # type: ignore[no-untyped-call]
        function.variable_lifetime = VariableLifetime(function.blocks)  # type: ignore[no-untyped-call]
        function.generator_info = None
        if emit_dels:
            self._insert_var_dels(extend_lifetimes=extend_lifetimes)

    return run


def without_lists(numbas: Callable[..., Any]) -> Callable[..., Any]:
    """Return ``inline_closurecall._inline_const_arraycall`` that looks only into blocks that make a list.

    Numba turns a list made in a block, and passed to ``numpy.array`` there, into an array.
    """

    def inline(block: Any, *others: Any) -> Any:
        makes_list = any(
            isinstance(each, ir.Assign) and isinstance(each.value, ir.Expr) and each.value.op == "build_list"
            for each in block.body
        )
        return numbas(block, *others) if makes_list else None

    return inline


def has_loc(numbas: Callable[[Any], bool], known: dict[CodeType, bool]) -> Callable[[Any], bool]:
    """Return ``base._has_loc``, whether a function takes ``loc``, that looks at the parameters of a function once.

    Args:
        numbas: Numba's own. known: what was found, by the code of functions; extended.
    """

    def of(function: Any) -> bool:
        if not isinstance(function, FunctionType) or "__wrapped__" in vars(function):
            return numbas(function)
        code = function.__code__
        if code not in known:
            known[code] = numbas(function)
        return known[code]

    return of


def no_timer(kind: str, callback: Callable[[float], None]) -> Any:
    """Measure nothing; in place of ``event.install_timer`` in dispatchers, which time all calls of LLVM."""
    del kind, callback
    return nullcontext()


class _Events:
    """The module ``numba.core.event`` for dispatchers, without timers."""

    install_timer = staticmethod(no_timer)

    def __getattr__(self, name: str) -> Any:
        return getattr(event, name)


_signatures: Final[Signatures] = {}
_with_loc: Final[dict[CodeType, bool]] = {}
_depth = 0
"""How many of our kernels are being compiled, one for the other."""


def replacements() -> list[tuple[Any, str, Any]]:
    """Return what is replaced: its owner, its name there, and what takes its place."""
    return [
        (ir.Inst, "_rec_list_vars", list_variables),
        (TargetConfig, "__eq__", equal_settings),
        (TargetConfig, "__hash__", hash_of_settings),
        (BaseFunction, "get_call_type", remembering(BaseFunction.get_call_type, _signatures)),
        (types.Dispatcher, "get_call_type", without_literals(types.Dispatcher.get_call_type)),
        (PostProcessor, "run", post_process(PostProcessor.run)),
        (
            inline_closurecall,
            "_inline_const_arraycall",
            without_lists(vars(inline_closurecall)["_inline_const_arraycall"]),
        ),
        (base, "_has_loc", has_loc(vars(base)["_has_loc"], _with_loc)),
        (dispatcher, "ev", _Events()),
    ]


@contextmanager
def shortcuts() -> Iterator[None]:
    """Context manager: take the shortcuts. The caller holds Numba's lock."""
    global _depth
    ours = replacements() if _depth == 0 else []  # inside another one they are taken already
    numbas = [(owner, name, vars(owner)[name]) for owner, name, _ in ours]
    _depth += 1
    try:
        for owner, name, part in ours:
            setattr(owner, name, part)
        yield
    finally:
        _depth -= 1
        for owner, name, part in numbas:
            setattr(owner, name, part)
