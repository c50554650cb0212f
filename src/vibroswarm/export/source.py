"""The source of a function as a syntax tree, and the error that refuses what cannot be exported."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, Final

import numpy as np

from vibroswarm.core.jit import PACKAGE
from vibroswarm.errors import InputError

Number = bool | int | float


@dataclass(frozen=True)
class Source:
    """A function and its source."""

    function: Callable[..., Any]
    tree: ast.FunctionDef
    file: str
    """The file's path: from the package's folder on, or in full for a user's file."""
    before: int
    """Number of lines in the file before the function: lines of the tree count from its first line."""
    space: Mapping[str, Any]
    """Values of the global names that it may read."""

    @property
    def names(self) -> list[str]:
        """Names of its arguments, in order."""
        return [argument.arg for argument in self.tree.args.args]

    def require(self, condition: object, node: ast.AST) -> None:
        """Refuse a construct unless a condition holds."""
        if not condition:
            text = ast.unparse(node).splitlines()[0][:60]
            raise InputError(
                f"'{text}', in {self.function.__name__}, cannot be exported; docs/export.md lists what can",
                field=f"{self.file}, line {self.before + getattr(node, 'lineno', 1)}",
            )


def plain(function: Any) -> Any:
    """Return the Python function behind a function compiled by Numba; any other value unchanged."""
    return getattr(function, "py_func", function)


def is_function(value: Any) -> bool:
    """Return whether a value is a Python function, compiled or not."""
    return isinstance(plain(value), FunctionType)


@cache
def _parsed(function: Callable[..., Any]) -> tuple[ast.FunctionDef, str]:
    """Return a function's syntax tree, and its file. The tree is cached, so it must not be changed."""
    path = Path(function.__code__.co_filename)
    name = path.relative_to(PACKAGE.parent).as_posix() if path.is_relative_to(PACKAGE.parent) else str(path)
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, SyntaxError, TypeError):
        tree = None
    if not isinstance(tree, ast.FunctionDef):
        raise InputError(
            f"{function.__name__}: its source cannot be read, or it is no plain function", field=name
        )
    return tree, name


def source_of(function: Any, instead: Mapping[str, Any] | None = None) -> Source:
    """Return the source of a function."""
    found = plain(function)
    tree, file = _parsed(found)
    return Source(
        found, tree, file, found.__code__.co_firstlineno - 1, {**found.__globals__, **(instead or {})}
    )


def number_of(value: Any) -> Number | None:
    """Return a value as a plain Python number or truth value; None if it is neither."""
    # Truth values come first, because a Python bool is an int, too.
    kinds = (bool, bool | np.bool_), (int, int | np.integer), (float, float | np.floating)
    return next((kind(value) for kind, own in kinds if isinstance(value, own)), None)


MATH: Final[dict[str, int]] = {
    "sqrt": 1, "exp": 1, "log": 1, "log1p": 1, "sin": 1, "cos": 1, "tan": 1, "atan": 1, "erf": 1, "erfc": 1,
    "lgamma": 1, "atan2": 2, "floor": 1, "ceil": 1, "isnan": 1,
}  # fmt: skip
"""Functions of ``math`` that an exported function may call, and their numbers of arguments."""


def math_name(source: Source, node: ast.expr) -> str | None:
    """Return NAME if an expression is ``math.NAME``; None if it is anything else."""
    is_field = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    return node.attr if is_field and source.space.get(node.value.id) is math else None  # type: ignore[attr-defined]
