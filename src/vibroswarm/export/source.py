"""The source of a function as a syntax tree, and the error that refuses a construct that cannot be exported."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
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

    @cached_property
    def names(self) -> list[str]:
        """Names of its arguments, in order."""
        return [argument.arg for argument in self.tree.args.args]

    def refusal(self, node: ast.AST | None, why: str) -> InputError:
        """Return the error that refuses a construct.

        Args:
            node: the construct, which gives the line; None: the function's first line. why: what is refused, in words
                with which the message begins.
        """
        line = self.before + getattr(node, "lineno", 1)
        return InputError(
            f"{why}, in {self.function.__name__}: this cannot be exported; docs/export.md lists what can",
            field=f"{self.file}, line {line}",
        )

    def refuse_arguments(self) -> None:
        """Refuse arguments with default values or stars, keyword-only ones, and positional-only ones.

        Raises:
            InputError: the function has such arguments.
        """
        arguments = self.tree.args
        if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.defaults:
            raise self.refusal(self.tree, "arguments with defaults or stars")
        if arguments.posonlyargs:
            raise self.refusal(self.tree, "arguments before a slash")


def plain(function: Any) -> Any:
    """Return the Python function behind a function compiled by Numba; any other value unchanged."""
    return getattr(function, "py_func", function)


def is_function(value: Any) -> bool:
    """Return whether a value is a Python function, compiled or not."""
    return isinstance(plain(value), FunctionType)


@cache
def _parsed(function: Callable[..., Any]) -> tuple[ast.FunctionDef, str, int]:
    """Return a function's syntax tree, its file, and the number of lines before it in the file.

    The tree is cached, so it must not be changed.

    Raises:
        InputError: the source cannot be read, or is not that of a plain function.
    """
    code = function.__code__
    try:
        name = Path(code.co_filename).relative_to(PACKAGE.parent).as_posix()
    except ValueError:  # a user's file
        name = code.co_filename
    try:
        text = textwrap.dedent(inspect.getsource(function))
        tree = ast.parse(text).body[0]
    except (OSError, SyntaxError, TypeError):
        raise InputError(
            f"{function.__name__}: its source cannot be read, so it cannot be exported", field=name
        ) from None
    if not isinstance(tree, ast.FunctionDef):
        raise InputError(f"{function.__name__} is not a plain function", field=name)
    return tree, name, code.co_firstlineno - 1


def source_of(function: Any, instead: Mapping[str, Any] | None = None) -> Source:
    """Return the source of a function.

    Args:
        function: a Python function, or one compiled by Numba. instead: values that replace those of global names.
    Raises:
        InputError: the source cannot be read, or is not that of a plain function.
    """
    found = plain(function)
    tree, file, before = _parsed(found)
    return Source(
        function=found, tree=tree, file=file, before=before, space={**found.__globals__, **(instead or {})}
    )


def number_of(value: Any) -> Number | None:
    """Return a value as a plain Python number or truth value; None if it is neither."""
    # Truth values come first, because a Python bool is an int, too.
    kinds = (bool, bool | np.bool_), (int, int | np.integer), (float, float | np.floating)
    return next((kind(value) for kind, own in kinds if isinstance(value, own)), None)


def without_docstring(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return the statements of a function without its docstring."""
    first = body[0] if body else None
    is_text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return body[1:] if is_text and isinstance(first.value.value, str) else body  # type: ignore[union-attr]


MATH: Final[dict[str, int]] = {
    "sqrt": 1, "exp": 1, "log": 1, "log1p": 1, "sin": 1, "cos": 1, "tan": 1, "atan": 1, "erf": 1, "erfc": 1,
    "lgamma": 1, "atan2": 2, "floor": 1, "ceil": 1, "isnan": 1, "degrees": 1, "radians": 1,
}  # fmt: skip
"""Functions of ``math`` that an exported function may call, and their numbers of arguments."""


def math_name(source: Source, node: ast.expr) -> str | None:
    """Return NAME if an expression is ``math.NAME``; None if it is anything else."""
    is_field = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
    return node.attr if is_field and source.space.get(node.value.id) is math else None  # type: ignore[attr-defined]
