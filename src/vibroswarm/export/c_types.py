"""Types and values of the translated program, and how C writes them.

Types are numbers, rows, arrays of fixed size, and tuples that functions return.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, get_type_hints

import numpy as np

from vibroswarm.export.source import Number
from vibroswarm.strategies.base import Array as DeclaredArray
from vibroswarm.strategies.base import arrays_of

INT: Final = "vs_int"
"""32 bits: ticks, counts and indices. Products of two are computed in 64 bits, or as floating-point numbers."""
LONG: Final = "int64_t"
"""Random words, seeds, and larger numbers."""
INTEGERS: Final = (INT, LONG)
REAL: Final = "vs_real"
STORED: Final = "vs_stored"
"""Type of floating-point numbers in a robot's arrays."""
BOOL: Final = "bool"
VOID: Final = "void"

OF_PYTHON: Final[dict[Any, str]] = {int: INT, float: REAL, bool: BOOL}
STORAGE: Final = {
    "float64": STORED, "float32": STORED, "int64": "int64_t", "int32": "int32_t", "int16": "int16_t",
    "uint8": "uint8_t",
}  # fmt: skip
"""C types of array elements."""


@dataclass(frozen=True)
class CArray:
    """An array of fixed size: ``element`` is a C type of numbers, or a ``Struct``."""

    element: Any
    shape: tuple[int, ...]

    @property
    def number(self) -> Any:
        """Type of an element in an expression."""
        if self.element == STORED:
            return REAL
        return self.element if isinstance(self.element, Struct) or self.element in (REAL, LONG) else INT


@dataclass(frozen=True)
class Struct:
    """A row or named tuple.

    Args:
        name: in C. source: the Python class. mutable: its fields are changed in place, as those of rows.
        omitted: fields that the program does not have.
    """

    name: str
    source: Any = field(compare=False, default=None)
    fields: tuple[tuple[str, Any], ...] = field(compare=False, default=())
    mutable: bool = field(compare=False, default=False)
    omitted: tuple[str, ...] = field(compare=False, default=())

    def type_of(self, name: str) -> Any:
        """Return the type of a field; None if there is none of this name."""
        return dict(self.fields).get(name)


@dataclass(frozen=True)
class CTuple:
    """Several values that a function returns."""

    items: tuple[Any, ...]

    @property
    def name(self) -> str:
        """Name of its type in C."""
        short = {INT: "i", LONG: "l", REAL: "r", BOOL: "b"}
        return "vs_tuple_" + "".join(short[item] for item in self.items)


def c_name(kind: Any) -> str:
    """Return a type's name in C; of arrays that of the element."""
    if isinstance(kind, CArray):
        return c_name(kind.element)
    return kind.name if isinstance(kind, Struct | CTuple) else str(kind)


def declaration(kind: Any, name: str) -> str:
    """Return the declaration of a variable or field."""
    if isinstance(kind, CArray):
        return f"{c_name(kind)} {name}" + "".join(f"[{size}]" for size in kind.shape)
    return f"{c_name(kind)} {name}"


def parameter(kind: Any, name: str) -> str:
    """Return the declaration of a function's parameter: rows and arrays are passed by address."""
    if isinstance(kind, CArray):
        return declaration(kind, name)
    if isinstance(kind, Struct):
        return f"{'' if kind.mutable else 'const '}{kind.name} *{name}"
    return f"{c_name(kind)} {name}"


def joined(one: Any, other: Any) -> Any:
    """Return the type that holds values of both types, ``other`` if ``one`` is None; None if there is no such type."""
    if one is None or one == other:
        return other
    order = (BOOL, INT, LONG, REAL)
    if one in order and other in order:
        return order[max(order.index(one), order.index(other))]
    if isinstance(one, CTuple) and isinstance(other, CTuple) and len(one.items) == len(other.items):
        items = tuple(joined(a, b) for a, b in zip(one.items, other.items, strict=True))
        return None if None in items else CTuple(items)
    return None


def struct_of_class(
    name: str, declared: type, *, mutable: bool = False, omitted: tuple[str, ...] = (), like: Any = None
) -> Struct:
    """Return the type of a class of annotated fields.

    Args:
        omitted: fields left out. like: an instance, whose arrays give their sizes.
    """
    fields: list[tuple[str, Any]] = []
    for field_name, hint in get_type_hints(declared).items():
        if field_name in omitted:
            continue
        if hint in OF_PYTHON:
            fields.append((field_name, LONG if field_name == "seed" else OF_PYTHON[hint]))
        else:
            value: np.ndarray[Any, Any] = getattr(like, field_name)
            element = STORAGE[value.dtype.name]
            fields.append(
                (field_name, CArray(REAL if element == STORED and not mutable else element, value.shape))
            )
    return Struct(name, declared, tuple(fields) or (("unused", INT),), mutable, omitted)


def struct_of_row(
    name: str, fields: Mapping[str, type], *, mutable: bool = True, source: Any = None
) -> Struct:
    """Return the type of a strategy's rows."""
    found = tuple((field_name, OF_PYTHON[kind]) for field_name, kind in fields.items())
    return Struct(name, source, found or (("unused", INT),), mutable)


def struct_of_arrays(name: str, declared: type, sizes: Mapping[str, int]) -> Struct:
    """Return the type of a robot's arrays."""
    arrays: Mapping[str, DeclaredArray] = arrays_of(declared)
    fields = tuple((key, CArray(STORAGE[value.kind], (value.size(sizes),))) for key, value in arrays.items())
    return Struct(name, declared, fields or (("unused", INT),), True)


def typedef(kind: Struct | CTuple) -> str:
    """Return the definition of a type in C."""
    if isinstance(kind, CTuple):
        lines = [f"    {declaration(item, f'v{k}')};" for k, item in enumerate(kind.items)]
    else:
        lines = [f"    {declaration(item, name)};" for name, item in kind.fields]
    return "\n".join(["typedef struct {", *lines, f"}} {kind.name};"])


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
