"""Kernels of a strategy, generated from templates with the strategy's functions in place of ``default_hooks``.

Numba caches a kernel on disk by its source and argument types. Functions that are passed as arguments or closed
over have a different type in each process, so a kernel that uses them is never found again. Here each strategy
gets its own module, made from the template's text and registered under a name that contains the hash of that
text, of the strategy and of our code. It is compiled once, and every later process finds it.
"""

from __future__ import annotations

import dis
import hashlib
import inspect
import linecache
import sys
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, Final

import numpy as np

from vibroswarm.core.jit import inlined_uncached, register_source, source_hash
from vibroswarm.errors import InputError
from vibroswarm.inference import default_hooks
from vibroswarm.inference.replay_arrays import detailed_reading, own_reading
from vibroswarm.networks.base import Network
from vibroswarm.strategies.base import Strategy, arrays_of
from vibroswarm.strategies.static_analysis import NETWORK_HOOKS, STRATEGY_HOOKS
from vibroswarm.strategies.world import u

FOLDER: Final = Path(__file__).parent
PACKAGE: Final = "vibroswarm_generated"
"""Prefix of the names of generated modules."""
STRATEGIES: Final = "vibroswarm.strategies."
"""Functions of these modules may be called by any strategy."""
IMPORT: Final = "from vibroswarm.inference.default_hooks import"

HEADER: Final = """from typing import Any, NamedTuple

from vibroswarm.core.jit import inlined_uncached
"""
VIEWS: Final = '''

class Arrays(NamedTuple):
    """The arrays of some robots, (robots, size) each."""
{fields}


class Views(NamedTuple):
    """A robot's arrays."""
{fields}


@inlined_uncached
def views(arrays, i):
    return Views({values})
'''
NETWORK_ARRAYS: Final = '''

class NetworkArrays(NamedTuple):
    """The arrays of a network."""
{fields}


@inlined_uncached
def clear_network(a):
{zeroed}
'''
OPPOSITE_BIT: Final = """

@inlined_uncached
def opposite(m):
    m.bit = 1 - m.bit
"""
AS_COUNTS: Final = """

@inlined_uncached
def on_message(s, a, m, sender, t_s, d, p, w):
    on_counts(s, m.bit, 1 - m.bit, p, w)
"""


def uses_uniforms(strategy: Strategy) -> bool:
    """Return whether ``on_sample`` reads ``u``, so that it may draw a number, which can be computed in advance."""
    function = strategy.on_sample
    return any(value is u for value in globals_of(function).values())


def key_of(*declared: Strategy | Network) -> str:
    """Return 12 hexadecimal digits of everything the kernels of a strategy and a network are made from."""
    texts = [item.source or _text_of(item) for item in declared]
    text = "\0".join((source_hash(), *texts))  # which covers the templates
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _text_of(declared: Strategy | Network) -> str:
    """Return the source of the module that defines the functions; a description of their code if there is no source
    file, as for functions typed in; "" if there are no functions."""
    functions = _functions_of(declared)
    try:
        return inspect.getsource(inspect.getmodule(functions[0]) or default_hooks) if functions else ""
    except OSError:
        return "\0".join(_described(function) for function in functions)


def _described(function: Callable[..., Any]) -> str:
    """Describe a function without source text by its bytecode and the constants it reads."""
    code = function.__code__
    plain = {
        name: value
        for name, value in globals_of(function).items()
        if isinstance(value, int | float | str | bool)
    }
    return repr((code.co_code, code.co_consts, code.co_names, plain))


def _functions_of(declared: Strategy | Network) -> list[Callable[..., Any]]:
    return [value for value in vars(declared).values() if isinstance(value, FunctionType)]


def arrays_for(strategy: Strategy, network: Network, robots: int, sizes: Mapping[str, int]) -> Any:
    """Return zeroed arrays for ``robots`` robots; 0 if the strategy has none.

    Args:
        sizes: values of robots, rows, columns and tiles.
    """
    declared = arrays_of(strategy.arrays)
    if not declared:
        return 0
    arrays = {name: np.zeros((robots, array.size(sizes)), array.kind) for name, array in declared.items()}
    return vars(hooks_of(strategy, network))["Arrays"](**arrays)


def network_arrays_for(strategy: Strategy, network: Network, params: object, sizes: Mapping[str, int]) -> Any:
    """Return the arrays of a network, its lists of parameters among them; 0 if it has none.

    Args:
        params: of the network. sizes: values of robots, rows, columns and tiles.
    """
    arrays = network.arrays_of(params, sizes)
    return vars(hooks_of(strategy, network))["NetworkArrays"](**arrays) if arrays else 0


@cache
def hooks_of(strategy: Strategy, network: Network) -> ModuleType:
    """Return the module that replaces ``default_hooks``."""
    name = f"{PACKAGE}.{strategy.name}_{network.name}_{key_of(strategy, network)}.hooks"
    return _hooks_module(name, strategy, network)


@cache
def kernels(strategy: Strategy, network: Network, template: str) -> ModuleType:
    """Return the module generated from a template for this strategy and network.

    Args:
        template: name of a module of this folder: ``replay_counts``, ...
    """
    made_hooks = hooks_of(strategy, network).__name__
    text = (FOLDER / f"{template}.py").read_text()
    if IMPORT not in text:
        raise ValueError(f"{template} takes no hooks")
    package = made_hooks.rpartition(".")[0]
    return _generated_module(f"{package}.{template}", text.replace(IMPORT, f"from {made_hooks} import"))


def _hooks_module(name: str, strategy: Strategy, network: Network) -> ModuleType:
    """Build the module of the compiled functions of a strategy and a network, with defaults for those left out."""
    fields = tuple(arrays_of(strategy.arrays))
    text = HEADER
    if fields:
        text += VIEWS.format(
            fields="\n".join(f"    {field}: Any" for field in fields),
            values=", ".join(f"arrays.{field}[i]" for field in fields),
        )
    else:
        text += "\n\n@inlined_uncached\ndef views(arrays, i):\n    return 0\n"
    lists, of_network = tuple(network.lists), tuple(arrays_of(network.arrays))
    if lists or of_network:
        text += NETWORK_ARRAYS.format(
            fields="\n".join(f"    {field}: Any" for field in (*lists, *of_network)),
            zeroed="\n".join(f"    a.{field}[:] = 0" for field in of_network) or "    return",
        )
    else:
        text += "\n\n@inlined_uncached\ndef clear_network(a):\n    return\n"
    bit = "m.bit" if "bit" in (strategy.message_type.names or ()) else "0"
    text += f"\n\n@inlined_uncached\ndef bit_of(m):\n    return {bit}\n"
    text += (
        f"\n\n@inlined_uncached\ndef next_s(s):\n    return {'s.next_s' if strategy.on_timer else '0.0'}\n"
    )
    if strategy.on_message is None and strategy.on_counts is not None:
        text += AS_COUNTS
    if strategy.opposite is None and strategy.has_opposite:
        text += OPPOSITE_BIT
    module = _generated_module(name, text)
    space = vars(module)
    compiled: dict[Callable[..., Any], Any] = {}
    for declared, names in ((strategy, STRATEGY_HOOKS), (network, NETWORK_HOOKS)):
        for hook in names:
            if hook in space:
                continue
            space[hook] = compiled_hook(getattr(declared, hook) or getattr(default_hooks, hook), compiled)
    space["reading_of"] = detailed_reading if strategy.reads_details else own_reading
    space["HAS_TIMER"] = strategy.on_timer is not None
    space["HAS_STEER"] = strategy.steer is not None
    space["IS_OPINION"] = strategy.decides == "opinion"
    space["HAS_SEND"] = network.send is not None
    space["READS_POSITIONS"] = network.reads_positions
    return module


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the globals that a function reads, by name."""
    names = {
        instruction.argval
        for instruction in dis.get_instructions(function)
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    return {name: function.__globals__[name] for name in sorted(names) if name in function.__globals__}


def _is_hook_code(function: FunctionType, module: str) -> bool:
    """Return whether a function that a hook calls is compiled with the hook: one of the hook's module or of the
    strategies."""
    return function.__module__ == module or function.__module__.startswith(STRATEGIES)


def compiled_hook(function: Callable[..., Any], compiled: dict[Callable[..., Any], Any]) -> Any:
    """Compile a function for use in a kernel, and the plain functions of its module and of strategies that it calls.

    Args:
        compiled: functions compiled so far, extended; None marks one whose calls are being compiled.
    Raises:
        InputError: a function calls itself, directly or indirectly.
    """
    if function in compiled:
        if compiled[function] is None:
            raise InputError(
                f"{function.__name__} calls itself, which a robot's program may not", field="strategy"
            )
        return compiled[function]
    if not isinstance(function, FunctionType):
        return function  # compiled already
    compiled[function] = None
    called = {
        name: compiled_hook(value, compiled)
        for name, value in globals_of(function).items()
        if isinstance(value, FunctionType) and _is_hook_code(value, function.__module__)
    }
    rebound = function
    if called:
        space = {**function.__globals__, **called}
        rebound = FunctionType(
            function.__code__, space, function.__name__, function.__defaults__, function.__closure__
        )
        rebound.__module__, rebound.__qualname__ = function.__module__, function.__qualname__
    compiled[function] = inlined_uncached(rebound)
    return compiled[function]


def _generated_module(name: str, text: str) -> ModuleType:
    """Build and register a module from its text, so that tracebacks can show its lines."""
    file = str(FOLDER / "generated" / f"{name}.py")
    register_source(file, text)
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    module = ModuleType(name)
    module.__file__ = file
    _register(module)
    exec(compile(text, file, "exec"), vars(module))  # noqa: S102  (our own text)
    return module


def _register(module: ModuleType) -> None:
    """Register a generated module and its parent packages in ``sys.modules``."""
    parts = module.__name__.split(".")
    for count in range(1, len(parts)):
        parent = ".".join(parts[:count])
        if parent not in sys.modules:
            package = ModuleType(parent)
            package.__path__ = []
            sys.modules[parent] = package
    sys.modules[module.__name__] = module
