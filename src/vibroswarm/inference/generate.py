"""Kernels for a strategy: their source with the strategy's functions in place of those of ``hooks``.

Numba keeps a kernel on disk by its source and the types it is called with. Functions that are passed as arguments, or
closed over, are of another type in each process, and so are never found again. Here each strategy gets a module of its
own, made of a kernel's source text, known to Python by a name that holds the hash of that text, of the strategy's and
of our code: it is compiled once, and found by every process after that.
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

from vibroswarm.compiled import made, part, source_hash
from vibroswarm.errors import InputError
from vibroswarm.inference import hooks
from vibroswarm.networks.base import Network
from vibroswarm.strategies.base import Strategy, arrays_of
from vibroswarm.strategies.world import u

FOLDER: Final = Path(__file__).parent
PACKAGE: Final = "vibroswarm_made"
"""Modules that are made are known to Python by names that begin so."""
IMPORT: Final = "from vibroswarm.inference.hooks import"

HEAD: Final = """from typing import Any, NamedTuple

from vibroswarm.compiled import part
"""
VIEWS: Final = '''

class Arrays(NamedTuple):
    """The arrays of some robots, (robots, size) each."""
{fields}


class Views(NamedTuple):
    """A robot's arrays."""
{fields}


@part
def views(arrays, i):
    return Views({values})
'''
AS_COUNTS: Final = """

@part
def on_message(s, a, m, sender, t_s, d, p, w):
    on_counts(s, m.bit, 1 - m.bit, p, w)
"""


def draws(strategy: Strategy) -> bool:
    """Whether an own sample asks for a number, as far as can be seen: it may then be given beforehand."""
    function = strategy.on_sample
    return any(value is u for value in globals_of(function).values())


def key_of(*declared: Strategy | Network) -> str:
    """12 hexadecimal digits of all that a strategy's and a network's kernels are made from."""
    texts = [one.source or _text_of(one) for one in declared]
    whole = "\0".join((source_hash(), *texts))  # the kernels' sources are of our own
    return hashlib.sha256(whole.encode()).hexdigest()[:12]


def _text_of(declared: Strategy | Network) -> str:
    """The source of the module that functions come from; of what was typed in, the functions themselves."""
    functions = _functions_of(declared)
    try:
        return inspect.getsource(inspect.getmodule(functions[0]) or hooks) if functions else ""
    except OSError:
        return "\0".join(_described(function) for function in functions)


def _described(function: Callable[..., Any]) -> str:
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
    """The arrays of so many robots, all zeros; 0 where a strategy has none.

    Args:
        sizes: what their sizes are made of: robots, rows, columns, tiles.
    """
    declared = arrays_of(strategy.arrays)
    if not declared:
        return 0
    arrays = {name: np.zeros((robots, one.size(sizes)), one.kind) for name, one in declared.items()}
    return vars(hooks_of(strategy, network))["Arrays"](**arrays)


@cache
def hooks_of(strategy: Strategy, network: Network) -> ModuleType:
    """The module that takes the place of ``hooks``."""
    name = f"{PACKAGE}.{strategy.name}_{network.name}_{key_of(strategy, network)}.hooks"
    return _hooks_module(name, strategy, network)


@cache
def kernels(strategy: Strategy, network: Network, template: str) -> ModuleType:
    """The module of a kernel's source for this strategy and network.

    Args:
        template: name of a module of this folder: ``replay_counts``, ...
    """
    made_hooks = hooks_of(strategy, network).__name__
    text = (FOLDER / f"{template}.py").read_text()
    if IMPORT not in text:
        raise ValueError(f"{template} takes no hooks")
    package = made_hooks.rpartition(".")[0]
    return _made(f"{package}.{template}", text.replace(IMPORT, f"from {made_hooks} import"))


OF_STRATEGY: Final = (
    "begin", "on_counts", "on_message", "on_sample", "on_timer", "decision", "belief", "steer",
)  # fmt: skip
OF_NETWORK: Final = ("lost", "send")


def _hooks_module(name: str, strategy: Strategy, network: Network) -> ModuleType:
    """The strategy's and the network's functions, compiled, and for those left out what stands for them."""
    fields = tuple(arrays_of(strategy.arrays))
    text = HEAD
    if fields:
        text += VIEWS.format(
            fields="\n".join(f"    {field}: Any" for field in fields),
            values=", ".join(f"arrays.{field}[i]" for field in fields),
        )
    else:
        text += "\n\n@part\ndef views(arrays, i):\n    return 0\n"
    bit = "m.bit" if "bit" in (strategy.message_type.names or ()) else "0"
    text += f"\n\n@part\ndef bit_of(m):\n    return {bit}\n"
    text += f"\n\n@part\ndef next_s(s):\n    return {'s.next_s' if strategy.on_timer else '0.0'}\n"
    if strategy.on_message is None and strategy.on_counts is not None:
        text += AS_COUNTS
    module = _made(name, text)
    space = vars(module)
    made_parts: dict[Callable[..., Any], Any] = {}
    for declared, names in ((strategy, OF_STRATEGY), (network, OF_NETWORK)):
        for one in names:
            if one == "on_message" and one in space:
                continue
            space[one] = compiled_part(getattr(declared, one) or getattr(hooks, one), made_parts)
    space["HAS_TIMER"] = strategy.on_timer is not None
    space["HAS_STEER"] = strategy.steer is not None
    space["IS_OPINION"] = strategy.decides == "opinion"
    space["HAS_SEND"] = network.send is not None
    space["ASKS_PLACES"] = network.asks_places
    return module


def globals_of(function: Callable[..., Any]) -> dict[str, Any]:
    """The globals that a function reads, by name."""
    names = {
        one.argval for one in dis.get_instructions(function) if one.opname in ("LOAD_GLOBAL", "LOAD_NAME")
    }
    return {name: function.__globals__[name] for name in sorted(names) if name in function.__globals__}


def compiled_part(function: Callable[..., Any], made_parts: dict[Callable[..., Any], Any]) -> Any:
    """A function as a part of a kernel, and with it the plain functions of its module that it calls.

    Raises:
        InputError: functions that call each other in a circle.
    """
    if function in made_parts:
        if made_parts[function] is None:
            raise InputError(
                f"{function.__name__} calls itself; a robot's program does not", field="strategy"
            )
        return made_parts[function]
    if not isinstance(function, FunctionType):
        return function  # compiled already
    made_parts[function] = None
    called = {
        name: compiled_part(value, made_parts)
        for name, value in globals_of(function).items()
        if isinstance(value, FunctionType) and value.__module__ == function.__module__
    }
    whole = function
    if called:
        space = {**function.__globals__, **called}
        whole = FunctionType(
            function.__code__, space, function.__name__, function.__defaults__, function.__closure__
        )
        whole.__module__, whole.__qualname__ = function.__module__, function.__qualname__
    made_parts[function] = part(whole)
    return made_parts[function]


def _made(name: str, text: str) -> ModuleType:
    """A module of this text, known to Python, and to who shows a line of it."""
    file = str(FOLDER / "made" / f"{name}.py")
    made(file, text)
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    module = ModuleType(name)
    module.__file__ = file
    _register(module)
    exec(compile(text, file, "exec"), vars(module))  # noqa: S102  (our own text)
    return module


def _register(module: ModuleType) -> None:
    parts = module.__name__.split(".")
    for count in range(1, len(parts)):
        parent = ".".join(parts[:count])
        if parent not in sys.modules:
            package = ModuleType(parent)
            package.__path__ = []
            sys.modules[parent] = package
    sys.modules[module.__name__] = module
