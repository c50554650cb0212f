"""How the texts of options become values; a wrong one is an ``InputError`` without a field, which the parser adds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, get_args, get_origin

from vibroswarm.core.numbers import number as written
from vibroswarm.errors import InputError, check_choice, share_from, shown

VALUES: Final[dict[Any, str]] = {int: "N", float: "X", str: "NAME", Path: "FILE"}
"""What stands for a value of a type in the help."""


def placeholder(kind: Any) -> str:
    """Return what stands for a value of a type in the help."""
    if get_origin(kind) is tuple:
        return f"{placeholder(get_args(kind)[0])},..."
    return VALUES.get(kind, "NAME")


def reader(kind: Any, low: float = -math.inf, high: float = math.inf) -> Callable[[str], Any]:
    """Return the function that converts a text to a type; numbers are from ``low`` to ``high``."""
    if get_origin(kind) is tuple:
        one = reader(get_args(kind)[0], low, high)
        return lambda text: tuple(dict.fromkeys(one(part.strip()) for part in text.split(",")))
    if get_origin(kind) is Literal:
        return partial(_choice, choices=get_args(kind))
    if kind in (int, float):
        return partial(number, kind=kind, low=low, high=high)
    if kind is Path:
        return path
    return kind  # type: ignore[no-any-return]  # a class, which converts a text when it is called


def _choice(text: str, choices: tuple[str, ...]) -> str:
    check_choice(text, "", choices)
    return text


def path(text: str) -> Path:
    """Convert a text to a path.

    Raises:
        InputError: it is empty, as that of a variable that a shell does not know; ``Path`` would take it for ``.``.
    """
    refuse(not text, "", "is empty; give a path")
    return Path(text)


def number(text: str, kind: type, low: float = -math.inf, high: float = math.inf) -> Any:
    """Convert a text to a whole number (``int``) or a finite number (``float``) from ``low`` to ``high``.

    Raises:
        InputError: it is none, or out of range.
    """
    try:
        value = kind(text)
        is_number = math.isfinite(value)
    except (ValueError, OverflowError):  # OverflowError: an integer of hundreds of digits
        is_number = False
    if not is_number:
        raise InputError(f"{shown(text)} is not {'a whole number' if kind is int else 'a number'}")
    if not low <= value <= high:
        least, most = (written(end, digits=10) for end in (low, high))
        raise InputError(
            f"{text} is not {f'{least} or more' if high == math.inf else f'from {least} to {most}'}"
        )
    return value


share = partial(share_from, field="")
"""Converts a percentage such as ``5%`` to a share, 0.05."""


def pair_of(
    separator: str, form: str, kind: type, low: float, high: float = math.inf
) -> Callable[[str], Any]:
    """Return the function that converts two numbers, such as those of ``1.2x0.8``.

    Args:
        form: what is right, for messages, such as "WxH, such as 1.2x0.8". kind, low, high: as of ``number``.
    """

    def read(text: str) -> tuple[Any, Any]:
        parts = text.lower().split(separator)
        if len(parts) != 2:
            raise InputError(f"'{text}' is not of the form {form}")
        return number(parts[0], kind, low, high), number(parts[1], kind, low, high)

    return read


def refuse(wrong: object, field: str, words: str) -> None:
    """Raise an ``InputError`` with these words about a field, if what is wrong is true."""
    if wrong:
        raise InputError(words, field=field)


def toml_path(text: str) -> Path:
    """Convert a text to the path of a TOML file.

    Raises:
        InputError: it does not end in .toml.
    """
    if not text.endswith(".toml"):
        raise InputError(f"'{text}' does not end in .toml")
    return Path(text)
