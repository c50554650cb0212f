"""Kernels of a strategy, generated from templates with the strategy's functions in place of ``default_hooks``.

Numba caches a kernel on disk by its source and argument types. Functions that are passed as arguments, or are closed
over, have another type in each process, so a kernel that uses them would never be found in the cache. Here each
strategy and network get modules of their own. One, ``hooks``, holds their compiled functions and replaces
``default_hooks``. The others are copies of templates (modules of this folder) that import from it. Their names contain
a hash of the strategy, the network and our code, so a kernel is compiled once, and later processes find it.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from threading import RLock
from types import FunctionType, ModuleType
from typing import Any, Final
from uuid import uuid4

import numpy as np

from vibroswarm.core.compiled_code import UnknownValueError, compiled_text, globals_of, is_known, is_ours
from vibroswarm.core.generated_modules import generated_module
from vibroswarm.core.jit import inlined_uncached, source_hash
from vibroswarm.errors import InputError, warn_once
from vibroswarm.inference import default_hooks
from vibroswarm.inference.replay_arrays import detailed_reading, own_reading
from vibroswarm.networks.base import Network
from vibroswarm.strategies.base import Strategy, arrays_of
from vibroswarm.strategies.static_analysis import NETWORK_HOOKS, PARAMETERS, STRATEGY_HOOKS, is_shipped
from vibroswarm.strategies.world import u

FOLDER: Final = Path(__file__).parent
"""Folder of the templates."""
PACKAGE: Final = "vibroswarm_generated"
"""Prefix of the names of generated modules."""
STRATEGIES: Final = "vibroswarm.strategies."
"""Functions of these modules may be called by any strategy."""
IMPORT: Final = "from vibroswarm.inference.default_hooks import"
"""Text of templates that is replaced by an import from the generated module ``hooks``."""

HEADER: Final = """from typing import Any, NamedTuple

from vibroswarm.core.jit import inlined_uncached
from vibroswarm.errors import CodeError
"""
"""Beginning of a generated module ``hooks``."""
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
TRUTH: Final = """found = own_{hook}({arguments})
    if found != 0 and found != 1:
        raise CodeError("{kind} '{name}': {hook} returned neither True nor False")
    return found != 0"""
"""Body of a hook that calls a user's and refuses what is no truth value: a probability would count as True."""
TRUTHS: Final = ("on_sample", "on_timer", "lost")
"""Hooks that return a truth value."""


_building = RLock()
"""Held while modules are made: a thread would import the module that another has registered and not filled yet."""


@cache
def uses_uniforms(strategy: Strategy) -> bool:
    """Return whether the strategy's ``on_sample`` uses the function ``u``, and so may draw random numbers.

    If it does, it is worth computing the first random number of each sample in advance, for all samples at once. Only
    ``on_sample`` itself is searched: if only functions that it calls use ``u``, numbers are computed when drawn.
    """
    function = strategy.on_sample
    return any(value is u for value in globals_of(function).values())


def key_of(*declared: Strategy | Network) -> str:
    """Return a hash, 12 hexadecimal digits, of all code from which the kernels of a strategy and a network are made.

    The names of the modules of that code are part of it: a cached kernel refers to them. A user's file has one name if
    it is imported, and another if it is loaded by name.

    Raises:
        UnknownValueError: a user's code reads a value of which no change can be seen.
    """
    # ``source_hash`` is that of this package's own source, which includes the templates.
    text = "\0".join((source_hash(), *map(_declared_text, declared)))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


_of_ours: dict[Strategy | Network, str] = {}
"""Texts of strategies and networks whose code is this package's, which stays as it is."""


def _declared_text(declared: Strategy | Network) -> str:
    if declared in _of_ours:
        return _of_ours[declared]
    users = [each for each in _functions_of(declared) if not is_ours(each.__module__)]
    modules = sorted({str(function.__module__) for function in users})
    # ``source`` is the text of a user's file that was loaded by name (``scenario.plugins``). It is empty for strategies
    # and networks of this package, of installed packages and of a user's own program. What a user's file takes from
    # other files is compiled in, and is not in its text.
    text = "\0".join((declared.source or _text_of(declared), *modules, *map(compiled_text, users)))
    if not users:
        _of_ours[declared] = text
    return text


def _text_of(declared: Strategy | Network) -> str:
    """Return a text that differs if the code of a strategy's or network's functions differs.

    It is the source of the modules that define them; the functions of one strategy may come from several. Functions
    without a source file, such as those typed into an interactive session, are described by their bytecode. The text is
    empty if there are no functions.
    """
    texts: dict[str, None] = {}  # in the order of the functions, each text once
    for function in _functions_of(declared):
        module = inspect.getmodule(function)
        text = ""
        if module is not None:
            with suppress(OSError, TypeError):  # TypeError: the module of an interactive session has no file
                text = inspect.getsource(module)
        texts[text or compiled_text(function)] = None
    return "\0".join(texts)


def _functions_of(declared: Strategy | Network) -> list[Callable[..., Any]]:
    return [value for value in vars(declared).values() if isinstance(value, FunctionType)]


def arrays_for(strategy: Strategy, network: Network, robots: int, sizes: Mapping[str, int]) -> Any:
    """Return a strategy's arrays for ``robots`` robots, zeroed: a named tuple of arrays of shape (robots, size).

    The result is 0 if the strategy has no arrays.

    Args:
        sizes: numbers of robots, rows, columns and tiles, by name; declared sizes of arrays are formulas of these.
    """
    declared = arrays_of(strategy.arrays)
    if not declared:
        return 0
    arrays = {name: np.zeros((robots, array.size(sizes)), array.kind) for name, array in declared.items()}
    return vars(hooks_of(strategy, network))["Arrays"](**arrays)


def network_arrays_for(strategy: Strategy, network: Network, params: object, sizes: Mapping[str, int]) -> Any:
    """Return the arrays of a network as a named tuple: its parameters that are lists, and its own arrays, zeroed.

    The result is 0 if the network has neither.

    Args:
        strategy: with the network, it selects the generated module that defines the named tuple. params: the network's
            parameters. sizes: numbers of robots, rows, columns and tiles, by name.
    """
    arrays = network.arrays_of(params, sizes)
    return vars(hooks_of(strategy, network))["NetworkArrays"](**arrays) if arrays else 0


def hooks_of(strategy: Strategy, network: Network) -> ModuleType:
    """Return the module ``hooks`` of a strategy and a network: their compiled functions under the names of hooks."""
    try:
        key = key_of(strategy, network)
    except UnknownValueError as unknown:
        warn_once(
            f"strategy '{strategy.name}' or network '{network.name}' reads {unknown}, of which no change can be seen: "
            "its kernels are compiled at every start"
        )
        key = ""
    with _building:
        return _hooks_of(strategy, network, key)


@cache
def _hooks_of(strategy: Strategy, network: Network, key: str) -> ModuleType:
    """Return ``hooks_of`` for a key of all that it is made of; empty: it is not known."""
    name = f"{PACKAGE}.{strategy.name}_{network.name}_{key or uuid4().hex}.hooks"
    return _hooks_module(name, strategy, network, is_saved=bool(key))


def kernels(strategy: Strategy, network: Network, template: str) -> ModuleType:
    """Return the module that is generated from a template for a strategy and a network, built at the first call.

    Args:
        template: name of a module of this folder that imports from ``default_hooks``, such as ``replay_counts``.
    Raises:
        ValueError: the module does not import from ``default_hooks``.
    """
    with _building:
        return _kernels(hooks_of(strategy, network), template)


@cache
def _kernels(hooks: ModuleType, template: str) -> ModuleType:
    text = (FOLDER / f"{template}.py").read_text()
    if IMPORT not in text:
        raise ValueError(f"{template} takes no hooks")
    package = hooks.__name__.rpartition(".")[0]
    text = text.replace(IMPORT, f"from {hooks.__name__} import")
    return generated_module(f"{package}.{template}", text, is_saved=hooks.IS_SAVED)


def _hooks_module(name: str, strategy: Strategy, network: Network, *, is_saved: bool) -> ModuleType:
    """Build the module ``hooks`` of a strategy and a network, which has all names that ``default_hooks`` has.

    Functions that only access fields and arrays by their declared names are generated as text. The others are the
    functions of the strategy and of the network, compiled; ``default_hooks`` provides those that they do not define.

    Args:
        name: full name of the module. is_saved: whether its kernels are cached.
    """
    fields, of_network = tuple(arrays_of(strategy.arrays)), tuple(arrays_of(network.arrays))
    classes = {"Arrays": fields, "Views": fields, "NetworkArrays": (*network.lists, *of_network)}
    text = HEADER
    for class_name, of_class in classes.items():
        if of_class:
            text += CLASS.format(name=class_name, fields="\n".join(f"    {field}: Any" for field in of_class))
    has_bit = "bit" in (strategy.message_type.names or ())
    opposite = "return"
    if strategy.opposite is not None:
        opposite = "opposite(m)"
    elif has_bit:
        opposite = "m.bit = 1 - m.bit"
    elif strategy.has_opposite:
        opposite = "m.kind = (m.kind + 1) % w.kinds"
    views = f"Views({', '.join(f'arrays.{field}[i]' for field in fields)})"
    hooks = {
        "views(arrays, i)": f"return {views if fields else 0}",
        "clear_network(a)": "\n    ".join(f"a.{field}[:] = 0" for field in of_network) or "return",
        # Only kernels that count bits call ``bit_of``. For messages without a bit it returns 0 and is not used.
        "bit_of(m)": f"return {'m.bit' if has_bit else '0'}",
        "is_message(m)": f"return {'m.bit == 0 or m.bit == 1' if has_bit else 'True'}",
        # ``next_s`` is called only if there is a timer.
        "next_s(s)": f"return {'s.next_s' if strategy.on_timer else '0.0'}",
        "opposite_of(m, w)": opposite,  # of what a faulty robot would send
    }
    if strategy.on_message is None and strategy.on_counts is not None:
        # Pass a single message to ``on_counts``, as a count of one.
        hooks["on_message(s, a, m, sender, t_s, d, p, w)"] = "on_counts(s, m.bit, 1 - m.bit, p, w)"
    checked = [
        (declared, hook)
        for declared in (strategy, network)
        for hook in TRUTHS
        if not is_shipped(getattr(declared, hook, None))
    ]
    for declared, hook in checked:
        kind, arguments = type(declared).__name__.lower(), ", ".join(PARAMETERS[hook])
        hooks[f"{hook}({arguments})"] = TRUTH.format(
            hook=hook, arguments=arguments, kind=kind, name=declared.name
        )
    text += "".join(HOOK.format(head=head, body=body) for head, body in hooks.items())
    module = generated_module(name, text, is_saved=is_saved)
    space = vars(module)
    space["IS_SAVED"] = is_saved
    compiled: dict[Callable[..., Any], Any] = {}
    for declared, names in ((strategy, STRATEGY_HOOKS), (network, NETWORK_HOOKS)):
        for hook in names:
            if hook in space:
                continue  # generated as text above
            space[hook] = compiled_hook(getattr(declared, hook) or getattr(default_hooks, hook), compiled)
    for declared, hook in checked:
        space[f"own_{hook}"] = compiled_hook(getattr(declared, hook), compiled)
    space["reading_of"] = detailed_reading if strategy.reads_details else own_reading
    space["HAS_TIMER"] = strategy.on_timer is not None
    space["HAS_STEER"] = strategy.steer is not None
    space["IS_OPINION"] = strategy.decides == "opinion"
    space["HAS_SEND"] = network.send is not None
    space["READS_POSITIONS"] = network.reads_positions
    return module


def _is_hook_code(function: FunctionType, module: str) -> bool:
    """Return whether it belongs to the hook's own module, to ``vibroswarm.strategies`` or to a module of users."""
    name = function.__module__
    return name == module or str(name).startswith(STRATEGIES) or not is_known(name)


def compiled_hook(function: Callable[..., Any], compiled: dict[Callable[..., Any], Any]) -> Any:
    """Compile a function for use in a kernel, with the Python functions that it calls; return the compiled form.

    The function itself is not changed. If it calls functions for which ``_is_hook_code`` is true, what is compiled is a
    copy, in whose globals they are replaced by their compiled forms. Any other function that it calls stays as it is,
    and the kernel compiles only if Numba can compile a call of it.

    Args:
        function: a Python function; a function that is compiled already is returned as it is.
        compiled: compiled forms of functions so far, extended. None in place of a form marks a function that is being
            compiled, so that a function that calls itself is detected.
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
    compiled[function] = None  # being compiled
    called = {
        name: compiled_hook(value, compiled)
        for name, value in globals_of(function).items()
        if isinstance(value, FunctionType) and _is_hook_code(value, function.__module__)
    }
    rebound = function  # what is compiled: the function itself, or its copy with other globals
    if called:
        space = {**function.__globals__, **called}
        rebound = FunctionType(
            function.__code__, space, function.__name__, function.__defaults__, function.__closure__
        )
        rebound.__module__, rebound.__qualname__ = function.__module__, function.__qualname__
    compiled[function] = inlined_uncached(rebound, boundscheck=not is_ours(function.__module__))
    return compiled[function]
