"""The replay kernel of a strategy and a network: ``replay_messages`` with their functions for ``default_hooks``.

Functions that are passed as arguments, or are closed over, have another type in each process, so a kernel that uses
them would never be found in the cache. Here each strategy and network get a module of their own: the text of
``replay_messages``, in which generated text takes the place of the import from ``default_hooks``. The name of the
module has a hash of that text and of the texts of users' files; this package's own code is in the name of the folder of
kernels.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import RLock
from types import FunctionType, ModuleType
from typing import Any, Final
from uuid import uuid4

import numpy as np

from vibroswarm.core.jit import generated, inlined_uncached
from vibroswarm.core.user_code import globals_of, is_known, users_text
from vibroswarm.inference import default_hooks
from vibroswarm.networks.base import Network
from vibroswarm.strategies.base import Strategy, arrays_of
from vibroswarm.strategies.static_analysis import NETWORK_HOOKS, PARAMETERS, STRATEGY_HOOKS
from vibroswarm.strategies.world import u

TEMPLATE: Final = Path(__file__).with_name("replay_messages.py")
"""Source of the kernel."""
IMPORT: Final = re.compile(r"from vibroswarm\.inference\.default_hooks import \([^)]*\)")
"""Text of the template that is replaced."""
HEADER: Final = """from typing import NamedTuple

from vibroswarm.core.jit import inlined_uncached

"""
"""Beginning of the generated text."""
CLASS: Final = """
class {name}(NamedTuple):
{fields}
"""
"""Text of a class of arrays: those of some robots, (robots, size) each, those of a robot, or those of a network."""
HOOK: Final = """

@inlined_uncached
def {head}:
    {body}
"""
"""Text of a function that only accesses fields and arrays by their declared names."""
_building = RLock()
"""Held while a module is made: of two threads, the second would take one that is not filled yet."""


@cache
def uses_uniforms(strategy: Strategy) -> bool:
    """Return whether ``on_sample`` names ``u``: then its first numbers are computed for all samples at once."""
    return any(value is u for value in globals_of(strategy.on_sample).values())


def arrays_for(strategy: Strategy, network: Network, robots: int, sizes: Mapping[str, int]) -> Any:
    """Return a strategy's arrays, zeroed, (robots, size) each, as a named tuple; 0 if it has none."""
    declared = arrays_of(strategy.arrays)
    if not declared:
        return 0
    arrays = {name: np.zeros((robots, array.size(sizes)), array.kind) for name, array in declared.items()}
    return vars(kernels(strategy, network))["Arrays"](**arrays)


def network_arrays_for(strategy: Strategy, network: Network, params: object, sizes: Mapping[str, int]) -> Any:
    """Return a network's list parameters and zeroed arrays as a named tuple; 0 if it has none."""
    arrays = network.arrays_of(params, sizes)
    return vars(kernels(strategy, network))["NetworkArrays"](**arrays) if arrays else 0


def kernels(strategy: Strategy, network: Network) -> ModuleType:
    """Return the module of the replay kernel of a strategy and a network, which is built at the first call."""
    with _building:
        return _built(strategy, network)


@cache
def _built(strategy: Strategy, network: Network) -> ModuleType:
    hooks = {name: getattr(strategy, name) for name in STRATEGY_HOOKS}
    hooks |= {name: getattr(network, name) for name in NETWORK_HOOKS}
    own = {name: hook for name, hook in hooks.items() if hook is not None}
    text = IMPORT.sub(lambda _: _text(strategy, network, own), TEMPLATE.read_text(encoding="utf-8"))
    used = users_text(*own.values())
    key = uuid4().hex if used is None else sha256(f"{text}\0{used}".encode()).hexdigest()[:16]
    name = f"vibroswarm_generated_{strategy.name}_{network.name}_{key}"
    module, compiled = generated(name, text, is_saved=used is not None), dict[Callable[..., Any], Any]()
    for hook in PARAMETERS:
        if hook not in vars(module):  # else it is generated
            vars(module)[hook] = compiled_hook(own.get(hook) or getattr(default_hooks, hook), compiled)
    return module


def _text(strategy: Strategy, network: Network, own: Mapping[str, Callable[..., Any]]) -> str:
    """Return the text that takes the place of ``default_hooks``, except ``own`` hooks and those not declared."""
    fields, of_network = tuple(arrays_of(strategy.arrays)), tuple(arrays_of(network.arrays))
    classes = {"Arrays": fields, "Views": fields, "NetworkArrays": (*network.lists, *of_network)}
    has_bit = "bit" in (strategy.message_type.names or ())
    constants = {
        "COUNTS": "on_counts" in own and "on_timer" not in own,
        "HEARS_ALL": network.send is None and network.lost is None,
        "HAS_TIMER": "on_timer" in own,
        "HAS_STEER": "steer" in own,
        "IS_OPINION": strategy.decides == "opinion",
        "HAS_SEND": network.send is not None,
        "READS_POSITIONS": network.reads_positions,
    }
    opposite = "m.kind = (m.kind + 1) % w.kinds" if strategy.has_opposite else "return"
    if "opposite" in own or has_bit:
        opposite = "opposite(m)" if "opposite" in own else "m.bit = 1 - m.bit"
    views = f"Views({', '.join(f'arrays.{each}[i]' for each in fields)})"
    hooks = {
        "views(arrays, i)": f"return {views if fields else 0}",
        "clear_network(a)": "\n    ".join(f"a.{each}[:] = 0" for each in of_network) or "return",
        "bit_of(m)": f"return {'m.bit' if has_bit else '0'}",
        "is_message(m)": f"return {'m.bit == 0 or m.bit == 1' if has_bit else 'True'}",
        "next_s(s)": f"return {'s.next_s' if 'on_timer' in own else '0.0'}",
        "opposite_of(m, w)": opposite,  # of what a faulty robot would send
    }
    if "on_message" not in own and "on_counts" in own:
        # Pass a single message to ``on_counts``, as a count of one.
        hooks["on_message(s, a, m, sender, t_s, d, p, w)"] = "on_counts(s, m.bit, 1 - m.bit, p, w)"
    given = {
        name: "\n".join(f"    {each}: Any" for each in of_class)
        for name, of_class in classes.items()
        if of_class
    }
    return "".join(
        (
            HEADER,
            *(f"{name} = {value}\n" for name, value in constants.items()),
            *(CLASS.format(name=name, fields=each) for name, each in given.items()),
            *(HOOK.format(head=head, body=body) for head, body in hooks.items()),
        )
    )


def compiled_hook(function: Callable[..., Any], compiled: dict[Callable[..., Any], Any]) -> Any:
    """Compile a function for use in a kernel, with the Python functions that it calls; return the compiled form.

    What is compiled is a copy, in whose globals the functions that it calls are replaced by their compiled forms, if
    they are of the same module, of ``vibroswarm.strategies`` or of a module of users. Any other function stays as it
    is, and the kernel compiles only if Numba can compile a call of it.
    """
    if not isinstance(function, FunctionType):
        return function  # compiled already
    if function not in compiled:
        module = str(function.__module__)
        called = {
            name: compiled_hook(value, compiled)
            for name, value in globals_of(function).items()
            if isinstance(value, FunctionType)
            and (value.__module__ == module or is_hook_code(str(value.__module__)))
        }
        copy = FunctionType(
            function.__code__,
            {**function.__globals__, **called},
            function.__name__,
            function.__defaults__,
            function.__closure__,
        )
        copy.__module__, copy.__qualname__ = module, function.__qualname__
        compiled[function] = inlined_uncached(copy, boundscheck=not module.startswith("vibroswarm."))
    return compiled[function]


def is_hook_code(module: str) -> bool:
    """Return whether functions of a module may be called by any strategy."""
    return module.startswith("vibroswarm.strategies.") or not is_known(module)
