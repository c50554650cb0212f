"""Call a compiled kernel from another one by its address, so that one small kernel can call kernels of any types.

Numba compiles what a kernel calls into that kernel. A kernel that calls the event engine and the replay of one strategy
would so compile the engine again for each strategy, which takes 20 s; by their addresses it calls what is compiled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from vibroswarm.core.jit import compiles


def _call_plain(address: Any, arguments: tuple[Any, ...]) -> Any:
    """Call a kernel that is not compiled, whose address is the kernel itself (``jit.address_of``)."""
    return address(*arguments)


def _call_compiled() -> Any:
    """Return the function that Numba replaces, in the kernel that calls it, by the call of an address."""
    from numba.core import cgutils, types
    from numba.extending import intrinsic

    tools: Any = cgutils  # which has no types

    def by_address(typing_context: Any, address: Any, arguments: Any) -> Any:
        del typing_context

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds, convention = list(signature.args[1]), context.call_conv
            kind = convention.get_function_type(types.int64, kinds).as_pointer()
            kernel = builder.inttoptr(values[0], kind)
            unpacked = tools.unpack_tuple(builder, values[1], len(kinds))
            status, result = convention.call_function(builder, kernel, types.int64, kinds, unpacked)
            with tools.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return result

        return types.int64(address, arguments), generate

    return intrinsic(by_address)


call: Final[Callable[[Any, tuple[Any, ...]], Any]] = _call_compiled() if compiles() else _call_plain
"""Call the kernel at an address, which returns an integer, with a tuple of arguments.

Each argument must have exactly the type for which the kernel was compiled (``jit.address_of``).
"""
