"""Values of expressions in C, and numbers and names as C writes them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from vibroswarm.export.c_types import BOOL, INT, LONG, REAL
from vibroswarm.export.source import Number

OMITTED: Final = "omitted"
SUFFIX: Final = {REAL: "", INT: "_i", LONG: "_l"}
"""Of functions of the runtime, by the type of their arguments."""
KEYWORDS: Final = frozenset(
    (
        "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
        "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
        "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool",
        "true", "false", "I",
    )
)  # fmt: skip


@dataclass(frozen=True)
class Value:
    """An expression in C.

    Args:
        constant: its number, if it is known. is_place: it names a place in memory. real, wide: the same as a
            floating-point number and in 64 bits, where whole numbers of 32 bits might overflow.
    """

    text: str
    type: Any
    constant: Number | None = None
    is_place: bool = False
    real: str = ""
    wide: str = ""


def literal(number: Number) -> Value:
    """Return a number in C."""
    if isinstance(number, bool):
        return Value("true" if number else "false", BOOL, number)
    if isinstance(number, int):
        is_small = abs(number) < 2**31
        text = str(number) if is_small else f"INT64_C({number})"
        return Value(f"({text})" if number < 0 else text, INT if is_small else LONG, number)
    if math.isnan(number):
        return Value("VS_NAN", REAL, number)
    if math.isinf(number):
        return Value("VS_INFINITY" if number > 0 else "(-VS_INFINITY)", REAL, number)
    return Value(f"VS_R({number!r})", REAL, number)


def identifier(name: str) -> str:
    """Return a Python name as a C name."""
    return f"{name}_" if name in KEYWORDS else name


def address(value: Value) -> str:
    """Return the address of a row."""
    inner = value.text.removeprefix("(*").removesuffix(")")
    return inner if value.text == f"(*{inner})" and inner.isidentifier() else f"&{value.text}"


def field_of(text: str, name: str) -> str:
    """Return the text of a row's field."""
    inner = text.removeprefix("(*").removesuffix(")")
    if text == f"(*{inner})" and inner.isidentifier():
        return f"{inner}->{identifier(name)}"
    return f"{text}.{identifier(name)}"


def as_real(value: Value) -> str:
    """Return a number as a floating-point one."""
    if value.type == REAL or value.real:
        return value.real or value.text
    if value.constant is not None:
        return literal(float(value.constant)).text
    return f"((vs_real){value.text})"
