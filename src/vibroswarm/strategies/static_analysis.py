"""What the source of a strategy's or a network's functions shows: errors, and what a robot is told.

Errors are found before the functions are compiled. Numba would refuse most of them too, but with messages about types.
Messages here name the file and the line.

A strategy knows of its task what its functions read: fields of ``World``, and where a reading was taken. They are
found in the functions and in all that these call, so that no strategy can forget to state one. A function whose source
cannot be read counts as reading nothing.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from types import FunctionType
from typing import TYPE_CHECKING, Any, Final

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
PARAMETERS: Final = STRATEGY_HOOKS | NETWORK_HOOKS
"""Arguments of each function, in this order; the names are free."""
CHANCE: Final = ("random", "secrets", "uuid")
"""Modules of random numbers that our seeds do not repeat."""


def where(function: Callable[..., Any], line: int | None = None) -> str:
    """Return a place as ``voter.py, line 12, in on_sample``."""
    code = function.__code__
    return f"{code.co_filename}, line {line or code.co_firstlineno}, in {function.__name__}"


def check_function(name: str, function: Callable[..., Any], fields: Mapping[str, tuple[str, ...]]) -> None:
    """Refuse certain errors in a function, and in those of its file that it calls.

    Args:
        name: of the hook. fields: fields of each row, by its name in ``PARAMETERS``, such as ``s``.
    Raises:
        InputError: wrong arguments, an unknown field of a row, a changed global, or random numbers of its own.
    """
    wanted, given = PARAMETERS[name], list(inspect.signature(function).parameters)
    if len(given) != len(wanted):
        raise InputError(
            f"takes {len(given)} arguments ({', '.join(given)}); {name} is given {len(wanted)}: {', '.join(wanted)}",
            field=where(function),
        )
    rows = {mine: ours for mine, ours in zip(given, wanted, strict=True) if ours in fields}
    for attribute, line in _attributes(function):
        row, field = attribute
        if row in rows and field not in fields[rows[row]]:
            known = fields[rows[row]]
            raise InputError(
                f"{row}.{field}: no such field{nearest(field, known)} (there are {', '.join(known) or 'none'})",
                field=where(function, line),
            )
    for callee in _with_callees(function, set()):
        _check_means(callee)


def _check_means(function: Callable[..., Any]) -> None:
    """Refuse changed globals and foreign random numbers in a function."""
    tree = tree_of(function)
    if tree is None:
        return
    first = function.__code__.co_firstlineno - 1
    for node in ast.walk(tree):
        if isinstance(node, ast.Global | ast.Nonlocal):
            raise InputError(
                f"changes the global {', '.join(node.names)}; keep it in State",
                field=where(function, first + node.lineno),
            )
        if isinstance(node, ast.Attribute | ast.Name) and _is_chance(node, function):
            raise InputError(
                "draws random numbers of its own, so that runs could not be repeated; use u(d, k)",
                field=where(function, first + node.lineno),
            )


def _is_chance(node: ast.Attribute | ast.Name, function: Callable[..., Any]) -> bool:
    """Return whether an expression calls a random number generator."""
    names: list[str] = []
    root_node: ast.expr = node
    while isinstance(root_node, ast.Attribute):
        names.append(root_node.attr)
        root_node = root_node.value
    if not isinstance(root_node, ast.Name) or root_node.id not in function.__globals__:
        return False
    value = function.__globals__[root_node.id]
    module = getattr(value, "__module__", None) or getattr(value, "__name__", "")
    root = str(getattr(value, "__name__", "")) if inspect.ismodule(value) else str(module)
    if root.partition(".")[0] in CHANCE:
        return True
    return root.startswith("numpy") and ("random" in names or root.startswith("numpy.random"))


def _with_callees(function: Callable[..., Any], seen: set[Any]) -> Iterator[Callable[..., Any]]:
    """Yield the function and the plain ones of its file that it calls."""
    if function in seen:
        return
    seen.add(function)
    yield function
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType) and value.__module__ == function.__module__:
            yield from _with_callees(value, seen)


def _attributes(function: Callable[..., Any]) -> list[tuple[tuple[str, str], int]]:
    """Return every ``name.field`` of a function, with its line."""
    tree = tree_of(function)
    first = function.__code__.co_firstlineno - 1
    return [
        ((node.value.id, node.attr), first + node.lineno)
        for node in (ast.walk(tree) if tree is not None else ())
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    ]


def tree_of(function: Callable[..., Any]) -> ast.AST | None:
    """Return the syntax tree of a function; None if it was typed in, so that its source cannot be read."""
    try:
        return ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError, TypeError):
        return None


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
