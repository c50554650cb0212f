"""How the texts of options become values; a wrong one is an ``InputError`` without a field, which the parser adds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin

from vibroswarm.errors import InputError, check_choice, share_from, shown

VALUES: Final[dict[Any, str]] = {int: "N", float: "X", Path: "FILE"}
"""What stands for a value of a type in the help."""
share = partial(share_from, field="")
"""Converts a percentage such as ``5%`` to a share, 0.05."""


def placeholder(kind: Any) -> str:
    """Return what stands for a value of a type in the help."""
    if get_origin(kind) is tuple:
        return f"{placeholder(get_args(kind)[0])},..."
    return VALUES.get(kind, "NAME")


def reader(kind: Any, low: float = -math.inf, high: float = math.inf) -> Callable[[str], Any]:
    """Return the function that converts a text to a type; numbers are from ``low`` to ``high``."""
    if get_origin(kind) is tuple:
        read = reader(get_args(kind)[0], low, high)
        return lambda text: tuple(dict.fromkeys(read(part.strip()) for part in text.split(",")))
    if get_origin(kind) is Literal:
        return partial(_choice, choices=get_args(kind))
    if kind in (int, float):
        return partial(number, kind=kind, low=low, high=high)
    return path if kind is Path else str


def _choice(text: str, choices: tuple[str, ...]) -> str:
    check_choice(text, "", choices)
    return text


def path(text: str) -> Path:
    """Convert a text to a path; an empty one, as of an unset variable of a shell, would be the working folder."""
    refuse(not text, "", "is empty; give a path")
    return Path(text)


def number(text: str, kind: type, low: float = -math.inf, high: float = math.inf) -> Any:
    """Convert a text to a whole number (``int``) or a finite number (``float``) from ``low`` to ``high``."""
    try:
        value = kind(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high or abs(value) == math.inf:
        wanted = "a whole number" if kind is int else "a number"
        bounds = "" if low == -math.inf else f" from {low:g}" + ("" if high == math.inf else f" to {high:g}")
        raise InputError(f"{shown(text)} is not {wanted}{bounds}")
    return value


def pair_of(
    separator: str, form: str, kind: type, low: float, high: float = math.inf
) -> Callable[[str], Any]:
    """Return the function that converts two numbers, such as those of ``1.2x0.8``; ``form`` is for messages."""

    def read(text: str) -> tuple[Any, Any]:
        parts = text.lower().split(separator)
        refuse(len(parts) != 2, "", f"'{text}' is not of the form {form}")
        return number(parts[0], kind, low, high), number(parts[1], kind, low, high)

    return read


def refuse(wrong: object, field: str, message: str) -> None:
    """Raise an ``InputError`` about a field if something is wrong."""
    if wrong:
        raise InputError(message, field=field or None)
