"""Call a compiled kernel from another one by its address, so that one small kernel can call kernels of any types.

Numba compiles what a kernel calls into that kernel. A kernel that calls the event engine and the replay of one strategy
would so compile the engine again for each strategy, which takes 20 s; by their addresses it calls what is compiled.
"""

from __future__ import annotations

from typing import Any

from vibroswarm.core.jit import compiles

if compiles():
    from numba.core import cgutils, types
    from numba.extending import intrinsic

    @intrinsic
    def call(typing_context: Any, address: Any, arguments: Any) -> Any:
        """Call the kernel at ``address`` (``jit.address_of``), which returns an integer, and return its result.

        Args:
            address: int. arguments: a tuple; each must have exactly the type for which the kernel was compiled.
        """
        del typing_context

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds, convention = list(signature.args[1]), context.call_conv
            kind = convention.get_function_type(types.int64, kinds).as_pointer()
            status, result = convention.call_function(
                builder,
                builder.inttoptr(values[0], kind),
                types.int64,
                kinds,
                cgutils.unpack_tuple(builder, values[1], len(kinds)),
            )
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return result

        return types.int64(address, arguments), generate

else:

    def call(address: Any, arguments: Any) -> Any:
        """Call a kernel that is not compiled: ``address`` is the kernel itself."""
        return address(*arguments)
