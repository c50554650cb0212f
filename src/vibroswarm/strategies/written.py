"""What can be seen to be wrong with the functions of a strategy or a network before they are compiled.

Numba would refuse most of it too, but in words about types. What is found names the file and the line.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from types import FunctionType
from typing import Any, Final

from vibroswarm.errors import InputError, nearest

PARAMETERS: Final[dict[str, tuple[str, ...]]] = {
    "begin": ("s", "a", "d", "p", "w"),
    "on_counts": ("s", "ones", "zeros", "p", "w"),
    "on_message": ("s", "a", "m", "sender", "t_s", "d", "p", "w"),
    "on_sample": ("s", "a", "x", "out", "d", "p", "w"),
    "on_timer": ("s", "a", "t_s", "out", "d", "p", "w"),
    "decision": ("s", "a", "p", "w"),
    "belief": ("s", "a", "p", "w"),
    "steer": ("s", "a", "x", "d", "p", "w"),
    "lost": ("sender", "receiver", "d", "p", "w"),
    "send": ("n", "sender", "tick", "number", "bytes_on_air", "x_m", "y_m", "arrival_tick", "d", "p", "w"),
}
"""What each function is given, in this order; the names are free."""
CHANCE: Final = ("random", "secrets", "uuid")
"""Modules of numbers that no seed of ours repeats."""


def where(function: Callable[..., Any], line: int | None = None) -> str:
    """``voter.py, line 12, in on_sample``."""
    code = function.__code__
    return f"{code.co_filename}, line {line or code.co_firstlineno}, in {function.__name__}"


def check_function(name: str, function: Callable[..., Any], fields: Mapping[str, tuple[str, ...]]) -> None:
    """Refuse what is surely wrong with one function, and those of its file that it calls.

    Args:
        name: of the hook. fields: what rows are given have: by ``PARAMETERS``' name, such as ``s``.
    Raises:
        InputError: it takes other arguments, uses a field that its row has not, changes a global, or draws by itself.
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
    for one in _with_callees(function, set()):
        _check_means(one)


def _check_means(function: Callable[..., Any]) -> None:
    tree = _tree(function)
    if tree is None:
        return
    first = function.__code__.co_firstlineno - 1
    for node in ast.walk(tree):
        if isinstance(node, ast.Global | ast.Nonlocal):
            raise InputError(
                f"changes {', '.join(node.names)}, which is not its own; keep it in State",
                field=where(function, first + node.lineno),
            )
        if isinstance(node, ast.Attribute | ast.Name) and _is_chance(node, function):
            raise InputError(
                "draws by itself, so that nothing could be repeated; take numbers from u(d, k)",
                field=where(function, first + node.lineno),
            )


def _is_chance(node: ast.Attribute | ast.Name, function: Callable[..., Any]) -> bool:
    names: list[str] = []
    inner: ast.expr = node
    while isinstance(inner, ast.Attribute):
        names.append(inner.attr)
        inner = inner.value
    if not isinstance(inner, ast.Name) or inner.id not in function.__globals__:
        return False
    found = function.__globals__[inner.id]
    module = getattr(found, "__module__", None) or getattr(found, "__name__", "")
    root = str(getattr(found, "__name__", "")) if inspect.ismodule(found) else str(module)
    if root.partition(".")[0] in CHANCE:
        return True
    return root.startswith("numpy") and ("random" in names or root.startswith("numpy.random"))


def _with_callees(function: Callable[..., Any], seen: set[Any]) -> Iterator[Callable[..., Any]]:
    """The function and the plain ones of its file that it calls."""
    if function in seen:
        return
    seen.add(function)
    yield function
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, FunctionType) and value.__module__ == function.__module__:
            yield from _with_callees(value, seen)


def _attributes(function: Callable[..., Any]) -> list[tuple[tuple[str, str], int]]:
    """Every ``name.field`` of a function, with its line."""
    tree = _tree(function)
    first = function.__code__.co_firstlineno - 1
    return [
        ((node.value.id, node.attr), first + node.lineno)
        for node in (ast.walk(tree) if tree is not None else ())
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    ]


def _tree(function: Callable[..., Any]) -> ast.AST | None:
    try:
        return ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError, TypeError):  # typed in, with nothing to read it from again
        return None
