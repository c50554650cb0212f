"""List what a robot is told before it starts, read from the source of its strategy.

A strategy knows of its task what its functions read: fields of ``World``, and where a reading was taken. They are
found in the functions and in all that these call, so that no strategy can forget to state one. A function whose source
cannot be read counts as reading nothing.
"""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Iterator
from types import FunctionType
from typing import Any, Final

from vibroswarm.strategies.base import Strategy
from vibroswarm.strategies.static_checks import STRATEGY_HOOKS, tree_of

FACTS: Final[dict[str, tuple[str, ...]]] = {
    "T_end": ("t_end_s",),
    "boundary": ("decision_boundary", "boundary", "beliefs"),
    "grid": ("rows", "columns", "tile_width_m", "tile_height_m", "left_m", "bottom_m"),
    "arena": ("width_m", "height_m"),
    "swarm size": ("robots",),
}
"""What a robot knows if its strategy reads one of these fields of ``World``."""
OF_RATES: Final = ("false_positive", "false_negative")
"""Fields of error rates. The boundary of readings follows from them too."""
PLACE: Final = ("x_m", "y_m", "heading_rad", "spread_m", "lagged_x_m", "lagged_y_m")
"""Fields of ``Reading`` that say where it, or an earlier one, was taken."""
WORLD, READING = "w", "x"


def told(strategy: Strategy, boundary_of: str) -> tuple[str, ...]:
    """Return what a robot is told.

    Args:
        boundary_of: ``decision.boundary_of``; error rates are told if it is "tiles", otherwise readings are taken at
            face value.
    """
    read = fields_read(strategy)
    found = [fact for fact, fields in FACTS.items() if read & set(fields)]
    if strategy.boundary_half and "boundary" not in found:
        found.append("boundary")
    if strategy.knows_error_rates or (boundary_of == "tiles" and read & {*OF_RATES, "boundary", "beliefs"}):
        found.append("error rates")
    if read & set(PLACE):
        found.append("place of each reading")
    return (*found, *strategy.told)


def fields_read(strategy: Strategy) -> set[str]:
    """Return the fields of ``World`` and ``Reading`` that its functions read."""
    read: set[str] = set()
    seen: set[tuple[Any, frozenset[str]]] = set()
    for hook, parameters in STRATEGY_HOOKS.items():
        function = getattr(strategy, hook)
        if function is None:
            continue
        given = list(inspect.signature(_plain(function)).parameters)
        rows = {mine for mine, ours in zip(given, parameters, strict=True) if ours in (WORLD, READING)}
        read |= set(_read(function, frozenset(rows), seen))
    return read


def _plain(function: Any) -> Any:
    """Return the Python function of one that may be compiled."""
    return getattr(function, "py_func", function)


def _read(
    function: Callable[..., Any], rows: frozenset[str], seen: set[tuple[Any, frozenset[str]]]
) -> Iterator[str]:
    """Yield fields of the parameters ``rows`` that a function reads, or one to which it passes them."""
    plain = _plain(function)
    if not rows or (plain, rows) in seen:
        return
    seen.add((plain, rows))
    tree = tree_of(plain)
    if tree is None:
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in rows:
            yield node.attr
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            callee = plain.__globals__.get(node.func.id)
            if callee is not None and isinstance(_plain(callee), FunctionType):
                names = list(inspect.signature(_plain(callee)).parameters)
                passed = {
                    name
                    for name, given in [*zip(names, node.args, strict=False)]
                    if isinstance(given, ast.Name) and given.id in rows
                }
                passed |= {
                    word.arg
                    for word in node.keywords
                    if word.arg and isinstance(word.value, ast.Name) and word.value.id in rows
                }
                yield from _read(callee, frozenset(passed), seen)
