"""Kernels for a strategy: their source with the strategy's functions in place of those of ``hooks``.

Numba keeps a kernel on disk by its source and the types it is called with. Functions that are passed as arguments, or
closed over, are of another type in each process, and so are never found again. Here each strategy gets a module of its
own, made of a kernel's source text, known to Python by a name that holds the hash of that text, of the strategy's and
of our code: it is compiled once, and found by every process after that.
"""

from __future__ import annotations

import hashlib
import inspect
import linecache
import sys
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np

from vibroswarm.compiled import inlined, made, source_hash
from vibroswarm.inference import hooks
from vibroswarm.strategies.base import Strategy, arrays_of
from vibroswarm.strategies.world import u

FOLDER: Final = Path(__file__).parent
PACKAGE: Final = "vibroswarm_made"
"""Modules that are made are known to Python by names that begin so."""
IMPORT: Final = "from vibroswarm.inference.hooks import"

VIEWS: Final = '''

class Arrays(NamedTuple):
    """The arrays of some robots, (robots, size) each."""
{fields}

class Views(NamedTuple):
    """A robot's arrays."""
{fields}

@inlined
def views(arrays, i):
    return Views({values})
'''


def draws(strategy: Strategy) -> bool:
    """Whether an own sample asks for a number, as far as can be seen: it may then be given beforehand."""
    function = strategy.on_sample
    return any(function.__globals__.get(name) is u for name in function.__code__.co_names)


def key_of(strategy: Strategy) -> str:
    """12 hexadecimal digits of all that a strategy's kernels are made from."""
    text = strategy.source or inspect.getsource(inspect.getmodule(strategy.on_sample) or hooks)
    whole = "\0".join((source_hash(), strategy.name, text))  # the kernels' sources are of our own
    return hashlib.sha256(whole.encode()).hexdigest()[:12]


def arrays_for(strategy: Strategy, robots: int, sizes: Mapping[str, int]) -> Any:
    """The arrays of so many robots, all zeros; 0 where a strategy has none.

    Args:
        sizes: what their sizes are made of: robots, rows, columns, tiles.
    """
    declared = arrays_of(strategy.arrays)
    if not declared:
        return 0
    arrays = {name: np.zeros((robots, one.size(sizes)), one.kind) for name, one in declared.items()}
    return vars(hooks_of(strategy))["Arrays"](**arrays)


@cache
def hooks_of(strategy: Strategy) -> ModuleType:
    """The module that takes the place of ``hooks``."""
    return _hooks_module(f"{PACKAGE}.{strategy.name}_{key_of(strategy)}.hooks", strategy)


@cache
def kernels(strategy: Strategy, template: str) -> ModuleType:
    """The module of a kernel's source for this strategy.

    Args:
        template: name of a module of this folder: ``replay_counts``, ...
    """
    made_hooks = hooks_of(strategy).__name__
    text = (FOLDER / f"{template}.py").read_text()
    if IMPORT not in text:
        raise ValueError(f"{template} takes no hooks")
    package = made_hooks.rpartition(".")[0]
    return _made(f"{package}.{template}", text.replace(IMPORT, f"from {made_hooks} import"))


def _hooks_module(name: str, strategy: Strategy) -> ModuleType:
    """The strategy's functions, compiled, and for those that it leaves out what stands for them."""
    fields = tuple(arrays_of(strategy.arrays))
    text = "from typing import Any, NamedTuple\n\nfrom vibroswarm.compiled import inlined\n"
    if fields:
        text += VIEWS.format(
            fields="\n".join(f"    {field}: Any" for field in fields),
            values=", ".join(f"arrays.{field}[i]" for field in fields),
        )
    else:
        text += "\n\n@inlined\ndef views(arrays, i):\n    return 0\n"
    names = strategy.message_type.names or ()
    bit = "m.bit" if "bit" in names else "0"
    text += f"\n\n@inlined\ndef bit_of(m):\n    return {bit}\n"
    if strategy.on_timer is not None:
        text += "\n\n@inlined\ndef next_s(s):\n    return s.next_s\n"
    module = _made(name, text)
    found: dict[str, Callable[..., Any]] = {
        one: getattr(strategy, one) or getattr(hooks, one)
        for one in (
            "begin",
            "on_counts",
            "on_message",
            "on_sample",
            "on_timer",
            "decision",
            "belief",
            "steer",
        )
    }
    for one, function in found.items():
        setattr(module, one, inlined(function))
    if strategy.on_timer is None:
        vars(module)["next_s"] = inlined(hooks.next_s)
    if strategy.on_message is None and strategy.on_counts is not None:
        on_counts = vars(module)["on_counts"]
        namespace: dict[str, Any] = {"on_counts": on_counts}
        text = "def on_message(s, a, m, sender, t_s, d, p, w):\n    on_counts(s, m.bit, 1 - m.bit, p, w)\n"
        vars(module)["on_message"] = inlined(_function("on_message", text, f"{name}.on_message", namespace))
    vars(module)["HAS_TIMER"] = strategy.on_timer is not None
    vars(module)["HAS_STEER"] = strategy.steer is not None
    vars(module)["IS_OPINION"] = strategy.decides == "opinion"
    return module


def _function(function: str, text: str, name: str, namespace: dict[str, Any]) -> Callable[..., Any]:
    module = _made(name, text)
    vars(module).update(namespace)
    found: Callable[..., Any] = getattr(module, function)
    return found


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
