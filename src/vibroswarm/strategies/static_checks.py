"""Errors in the functions of a strategy or a network that can be found before they are compiled.

Numba would refuse most of them too, but with messages about types. Messages here name the file and the line.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from types import FunctionType
from typing import Any, Final

from vibroswarm.errors import InputError, nearest

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
