"""Checks of the hooks of strategies and networks, and what a robot knows of its task.

A hook is a function that the simulator calls, such as ``on_sample``; its arguments are listed in ``PARAMETERS`` and
explained in ``base``. Hooks of this package are checked by its tests, not at every start (``is_shipped``).

A robot knows everything that its hooks read: fields of ``World``, and the places of readings. A field counts as read if
its name is in the code of a hook, or of a function that a hook calls, so no author of a strategy can forget to state
one.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from itertools import chain
from textwrap import dedent
from types import FunctionType, ModuleType
from typing import TYPE_CHECKING, Any, Final

from vibroswarm.core.user_code import is_known
from vibroswarm.errors import InputError, nearest

if TYPE_CHECKING:
    from vibroswarm.strategies.base import Strategy

STRATEGY_HOOKS: Final[dict[str, tuple[str, ...]]] = {
    "begin": ("s", "a", "d", "p", "w"),
    "on_counts": ("s", "ones", "zeros", "p", "w"),
    "on_message": ("s", "a", "m", "sender", "t_s", "d", "p", "w"),
    "on_sample": ("s", "a", "x", "out", "d", "p", "w"),
    "on_timer": ("s", "a", "t_s", "out", "d", "p", "w"),
    "decision": ("s", "a", "p", "w"),
    "belief": ("s", "a", "p", "w"),
    "steer": ("s", "a", "x", "d", "p", "w"),
    "opposite": ("m",),
}
"""Arguments of the hooks of strategies, by name of the hook; ``base`` explains them."""
NETWORK_HOOKS: Final[dict[str, tuple[str, ...]]] = {
    "lost": ("sender", "receiver", "d", "p", "w"),
    "send": (
        "n",
        "a",
        "sender",
        "tick",
        "number",
        "bytes_on_air",
        "x_m",
        "y_m",
        "arrival_tick",
        "d",
        "p",
        "w",
    ),
}
"""Arguments of the hooks of networks, by name of the hook; ``networks.base`` explains them."""
PARAMETERS: Final = STRATEGY_HOOKS | NETWORK_HOOKS
"""Arguments of each hook. Their number and order are checked; a hook may give them names that none of them has here."""
UNUSED: Final = "unused"
"""The field of a row that has no fields."""
SHARED: Final = ("m", "p")
"""Rows that a hook must not change, since other robots read them too. (``opposite`` changes its own message.)"""
CHANCE: Final = ("random", "secrets", "uuid")
"""Modules, beside ``numpy.random``, whose random numbers a seed of the simulation does not determine."""


def where(function: Callable[..., Any], line: int | None = None) -> str:
    """Return where a function, or one of its lines, stands: ``voter.py, line 12, in on_sample``."""
    code = _plain(function).__code__
    return f"{code.co_filename}, line {line or code.co_firstlineno}, in {code.co_name}"


def check_function(name: str, function: Callable[..., Any], fields: Mapping[str, tuple[str, ...]]) -> None:
    """Refuse a hook with wrong arguments, with a field that does not exist, or with random numbers of its own."""
    wanted, given = PARAMETERS[name], list(inspect.signature(function).parameters)
    pairs = list(zip(given, wanted, strict=False))
    if len(given) != len(wanted) or any(mine in wanted and mine != ours for mine, ours in pairs):
        raise InputError(
            f"takes {', '.join(given)}; {name} is given, in this order, {', '.join(wanted)}",
            field=where(function),
        )
    rows = dict(pairs)
    for node in _nodes_of(function):
        if not isinstance(node, ast.Attribute) or not isinstance(node.value, ast.Name):
            continue
        row, used = rows.get(node.value.id, ""), f"{node.value.id}.{node.attr}"
        known = [field for field in fields.get(row, ()) if field != UNUSED]
        if row in fields and node.attr not in known:
            raise InputError(
                f"{used}: no such field{nearest(node.attr, known)} (there are {', '.join(known) or 'none'})",
                field=where(function, node.lineno),
            )
        if row in SHARED and isinstance(node.ctx, ast.Store) and name != "opposite":
            raise InputError(f"changes {used}, which others read too", field=where(function, node.lineno))
    refuse_chance([function], "use u(d, k)")


def refuse_chance(functions: Iterable[object], instead: str) -> None:
    """Refuse functions that draw random numbers of their own, themselves or in functions of users that they call."""
    for called in _called(function for function in functions if not is_shipped(function)):
        if not is_known(called.__module__) and _draws(called):
            raise InputError(
                f"draws random numbers of its own, so that runs could not be repeated; {instead}",
                field=where(called),
            )


def _draws(function: FunctionType) -> bool:
    """Return whether a function names a random number generator, under whatever name it was imported."""
    names = function.__code__.co_names
    for value in map(function.__globals__.get, names):
        owner = type(getattr(value, "__self__", None))  # of ``getrandbits``, a method of a hidden generator
        module = value.__name__ if isinstance(value, ModuleType) else _module_of(value) or _module_of(owner)
        if module.partition(".")[0] in CHANCE or module.startswith("numpy.random"):
            return True
        if module == "numpy" and "random" in names:
            return True
    return False


def _called(functions: Iterable[object]) -> list[FunctionType]:
    """Return Python functions, and those that they call, directly or through each other, but those of libraries."""
    found = [_plain(function) for function in functions]
    for function in found:  # grows
        if isinstance(function, FunctionType):
            named = (_plain(function.__globals__.get(name)) for name in function.__code__.co_names)
            found += [one for one in named if isinstance(one, FunctionType) and one not in found]
    return [one for one in found if isinstance(one, FunctionType)]


def _nodes_of(function: Callable[..., Any]) -> Iterator[ast.AST]:
    """Yield the nodes of a function's syntax tree, with the lines of its file; none if its source cannot be read."""
    try:
        lines, first = inspect.getsourcelines(_plain(function))
        tree = ast.parse(dedent("".join(lines)))
    except (OSError, SyntaxError):  # typed at a prompt, or a part of an expression
        return
    yield from ast.walk(ast.increment_lineno(tree, first - 1))


def _plain(function: Any) -> Any:
    return getattr(function, "py_func", function)


def _module_of(value: object) -> str:
    return str(getattr(value, "__module__", None) or "")


def is_shipped(*parts: object) -> bool:
    """Return whether all of these functions and classes are of this package; None counts as one of them."""
    package = f"{__name__.partition('.')[0]}."
    return all(part is None or _module_of(part).startswith(package) for part in parts)


FACTS: Final[dict[str, tuple[str, ...]]] = {
    "T_end": ("t_end_s",),
    "boundary": ("decision_boundary", "boundary", "beliefs"),
    "grid": ("rows", "columns", "tile_width_m", "tile_height_m", "left_m", "bottom_m"),
    "arena": ("width_m", "height_m"),
    "swarm size": ("robots",),
}
"""What a robot knows, and the fields of ``World`` of which its strategy reads at least one in that case."""
OF_RATES: Final = ("false_positive", "false_negative")
"""Fields of error rates. ``boundary``, the boundary of readings, may be computed from error rates as well."""
PLACE: Final = ("x_m", "y_m", "heading_rad", "spread_m", "lagged_x_m", "lagged_y_m")
"""Fields of ``Reading`` that say where this reading, or the lagged one, was taken."""


def told(strategy: Strategy, boundary_of: str) -> tuple[str, ...]:
    """Return what a robot with this strategy knows of its task, such as "grid" or "error rates"."""
    read = fields_read(strategy)
    found = [fact for fact, fields in FACTS.items() if read & set(fields)]
    if strategy.boundary_half and "boundary" not in found:  # a boundary of 1/2 is built into its rules
        found.append("boundary")
    if strategy.knows_error_rates or (boundary_of == "tiles" and read & {*OF_RATES, "boundary", "beliefs"}):
        found.append("error rates")
    if reads_places(strategy):
        found.append("place of each reading")
    return tuple(found)


def reads_places(strategy: Strategy) -> bool:
    """Return whether the hooks of a strategy read where a reading was taken (``PLACE``)."""
    return not fields_read(strategy).isdisjoint(PLACE)


@cache
def fields_read(strategy: Strategy) -> frozenset[str]:
    """Return the names that the strategy's hooks, and functions called by them, read: fields of rows among them."""
    called = _called(getattr(strategy, hook) for hook in STRATEGY_HOOKS)
    return frozenset(chain.from_iterable(one.__code__.co_names for one in called))
