"""Types and values of the program that is translated to C, and how they are written in C.

A type is the name of a number's type in C (``INT``, ``LONG``, ``REAL``, ``BOOL``), a ``Struct`` (a row or named
tuple), a ``CArray`` of fixed size, or a ``CTuple`` (several values that a function returns).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any, Final, get_type_hints

import numpy as np

from vibroswarm.export.source import MATH, Number
from vibroswarm.strategies.base import Array as DeclaredArray
from vibroswarm.strategies.base import arrays_of

INT: Final = "vs_int"
"""32 bits: ticks, counts and indices. Products of two are computed in 64 bits, or as floating-point numbers."""
LONG: Final = "int64_t"
"""Random words, seeds, and larger numbers."""
INTEGERS: Final = (INT, LONG)
"""Types of whole numbers."""
REAL: Final = "vs_real"
"""Floating-point numbers: float or double."""
STORED: Final = "vs_stored"
"""Type of floating-point numbers in a robot's arrays; it may be shorter than ``REAL``, to save memory."""
BOOL: Final = "bool"
"""Truth values."""
VOID: Final = "void"
"""Type of the result of a function that returns nothing."""

OF_PYTHON: Final[dict[Any, str]] = {int: INT, float: REAL, bool: BOOL}
"""Types in C of Python's types of numbers."""
STORAGE: Final = {
    "float64": STORED, "float32": STORED, "int64": "int64_t", "int32": "int32_t", "int16": "int16_t",
    "uint8": "uint8_t",
}  # fmt: skip
"""C types of array elements."""


@dataclass(frozen=True)
class CArray:
    """An array of fixed size: ``element`` is a C type of numbers, or a ``Struct``."""

    element: Any
    """Type of its elements in memory."""
    shape: tuple[int, ...]

    @property
    def number(self) -> Any:
        """Type that an element has in expressions: short integers become ``INT``, stored numbers ``REAL``."""
        if self.element == STORED:
            return REAL
        return self.element if isinstance(self.element, Struct) or self.element in (REAL, LONG) else INT


@dataclass(frozen=True)
class Struct:
    """A row or named tuple, as a struct in C. Two structs of one name are equal."""

    name: str
    """Name of its type in C."""
    source: Any = field(compare=False, default=None)
    """The Python class; None if there is none."""
    fields: tuple[tuple[str, Any], ...] = field(compare=False, default=())
    """Names and types of its fields."""
    mutable: bool = field(compare=False, default=False)
    """Whether its fields can be changed in place: those of a row can, those of a named tuple cannot."""
    omitted: tuple[str, ...] = field(compare=False, default=())
    """Fields of the Python class that the program does not have."""

    def type_of(self, name: str) -> Any:
        """Return the type of a field; None if there is no such field."""
        return dict(self.fields).get(name)


@dataclass(frozen=True)
class CTuple:
    """Several values that a function returns."""

    items: tuple[Any, ...]
    """Types of the values, which are all numbers."""

    @property
    def name(self) -> str:
        """Name of its type in C, such as ``vs_tuple_ir`` of a whole and a floating-point number."""
        short = {INT: "i", LONG: "l", REAL: "r", BOOL: "b"}
        return "vs_tuple_" + "".join(short[item] for item in self.items)

    @property
    def fields(self) -> tuple[tuple[str, Any], ...]:
        """Names and types of its members: v0, v1, ..."""
        return tuple((f"v{k}", item) for k, item in enumerate(self.items))


def c_name(kind: Any) -> str:
    """Return the name of a type in C; for an array that of its elements' type."""
    if isinstance(kind, CArray):
        return c_name(kind.element)
    return kind.name if isinstance(kind, Struct | CTuple) else str(kind)


def is_by_reference(kind: Any) -> bool:
    """Return whether a Python variable of this type is a reference through which an array or row can be changed."""
    return isinstance(kind, CArray) or (isinstance(kind, Struct) and kind.mutable)


def declaration(kind: Any, name: str) -> str:
    """Return the declaration of a variable or field in C, without semicolon."""
    if isinstance(kind, CArray):
        return f"{c_name(kind)} {name}" + "".join(f"[{size}]" for size in kind.shape)
    return f"{c_name(kind)} {name}"


def parameter(kind: Any, name: str, *, writes: bool) -> str:
    """Return the declaration of a function's parameter in C: structs and arrays are passed by address."""
    if not isinstance(kind, CArray | Struct):
        return declaration(kind, name)
    constant = "" if writes and is_by_reference(kind) else "const "
    return constant + declaration(kind, f"*{name}" if isinstance(kind, Struct) else name)


def joined(one: Any, other: Any) -> Any:
    """Return the narrowest type that holds both, in the order bool, INT, LONG, REAL; None if there is none."""
    if one is None or one == other:
        return other
    order = (BOOL, INT, LONG, REAL)
    return order[max(order.index(one), order.index(other))] if one in order and other in order else None


EMPTY: Final = (("unused", INT),)
"""The fields of a struct whose class has none, because C has no empty structs; known by ``is``, not by the name."""


def struct_of_class(name: str, declared: type, *, omitted: tuple[str, ...] = (), like: Any = None) -> Struct:
    """Return the struct of a class of annotated fields."""
    fields: list[tuple[str, Any]] = []
    for field_name, hint in get_type_hints(declared).items():
        if field_name in omitted:
            continue
        if hint in OF_PYTHON:  # a number; seeds need 64 bits
            fields.append((field_name, LONG if field_name == "seed" else OF_PYTHON[hint]))
        else:
            value: np.ndarray[Any, Any] = getattr(like, field_name)
            element = STORAGE[value.dtype.name]
            # Arrays of constants keep full precision; only a robot's memory may be shorter.
            fields.append((field_name, CArray(REAL if element == STORED else element, value.shape)))
    return Struct(name, declared, tuple(fields) or EMPTY, omitted=omitted)


def struct_of_row(name: str, fields: Mapping[str, type], *, mutable: bool = True) -> Struct:
    """Return the struct of a strategy's row (state, message or parameters) with these fields."""
    found = tuple((field_name, OF_PYTHON[kind]) for field_name, kind in fields.items())
    return Struct(name, None, found or EMPTY, mutable)


def struct_of_arrays(name: str, declared: type, sizes: Mapping[str, int]) -> Struct:
    """Return the struct of a strategy's arrays in a robot."""
    arrays: Mapping[str, DeclaredArray] = arrays_of(declared)
    fields = tuple((key, CArray(STORAGE[value.kind], (value.size(sizes),))) for key, value in arrays.items())
    return Struct(name, declared, fields or EMPTY, mutable=True)


def typedef(kind: Struct | CTuple) -> str:
    """Return the definition of a struct in C."""
    lines = [f"    {declaration(item, identifier(name))};" for name, item in kind.fields]
    return "\n".join(["typedef struct {", *lines, f"}} {kind.name};"])


OMITTED: Final = "omitted"
"""Type of a field that the program does not have."""
SUFFIX: Final = {REAL: "", INT: "_i", LONG: "_l"}
"""Suffixes of the names of the runtime's functions, by the type of their arguments."""
CALLED: Final = (*MATH, "fabs", "fmod", "rint", "pow")
"""Functions of the C library that the runtime calls."""
KEYWORDS: Final = frozenset(
    (
        "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
        "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
        "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "bool",
        "true", "false", "I", "NAN", "INFINITY", "NULL",
        # Words of C++ that Python does not have: sketches for Arduino include the header.
        "asm", "catch", "const_cast", "constexpr", "decltype", "delete", "dynamic_cast", "explicit", "export", "friend",
        "mutable", "namespace", "new", "noexcept", "nullptr", "operator", "private", "protected", "public",
        "reinterpret_cast", "static_assert", "static_cast", "template", "this", "throw", "typeid", "typename", "using",
        "virtual", "wchar_t", "xor", "compl", "bitand", "bitor",
        # Functions that the program calls, in double and in single precision.
        *CALLED, *(f"{name}f" for name in CALLED),
    )
)  # fmt: skip
"""Names that are avoided in C: its keywords, macros of its headers, functions of its library, keywords of C++."""
GENERATED: Final = re.compile(r"(held|k)_\d+|(vs|VS)_\w*|u?int\d+_t")
"""Names that are avoided too: of variables that the translation makes, and of the runtime's functions and types."""


@dataclass(frozen=True)
class Value:
    """An expression in C."""

    text: str
    """The expression itself."""
    type: Any
    """Its type in C."""
    constant: Number | None = None
    """Its number, if that is known when the program is translated."""
    is_place: bool = False
    """Whether it has an address in memory."""
    is_stored: bool = False
    """Whether it is the target of an assignment that holds floating-point numbers as they are stored."""
    real: str = ""
    """For a whole number that might overflow 32 bits: its text as a floating-point number; else empty."""
    wide: str = ""
    """For a whole number that might overflow 32 bits: its text as a number of 64 bits; else empty."""
    pointer: str = ""
    """For a row that is a parameter: its name, which is a pointer in C."""
    root: str = ""
    """For a row or array: the parameter that it is, or is part of; empty if there is none."""


def literal(number: Number) -> Value:
    """Return a number as a constant in C."""
    if isinstance(number, bool):
        return Value("true" if number else "false", BOOL, number)
    if isinstance(number, int):
        is_small = abs(number) < 2**31
        text = str(number) if is_small else f"INT64_C({number})"
        return Value(f"({text})" if number < 0 else text, INT if is_small else LONG, number)
    special = {"nan": "VS_NAN", "inf": "VS_INFINITY", "-inf": "(-VS_INFINITY)"}
    return Value(special.get(repr(number), f"VS_R({number!r})"), REAL, number)


def widened(text: str) -> Value:
    """Return a whole number, computed in 64 bits, that might overflow 32 bits."""
    return Value(f"((vs_int){text})", INT, real=f"((vs_real){text})", wide=text)


def identifier(name: str) -> str:
    """Return a Python name as a name in C; one that C, C++ or the translation uses gets an underscore more."""
    plain = name.rstrip("_")
    return f"{name}_" if plain in KEYWORDS or GENERATED.fullmatch(plain) else name


def address(value: Value) -> str:
    """Return the text of the address of a row."""
    return value.pointer or f"&{value.text}"


def bare(text: str) -> str:
    """Return an expression without a pair of parentheses around all of it."""
    depths = list(accumulate((character == "(") - (character == ")") for character in text))
    is_whole = text.startswith("(") and depths.index(0) == len(text) - 1
    return text[1:-1] if is_whole else text


def as_type(value: Value, kind: Any) -> str:
    """Return the text of a value where one of a type is needed that holds it: whole numbers become floating-point."""
    if kind == REAL:
        return as_real(value)
    return value.wide if kind == LONG and value.wide else value.text


def as_real(value: Value) -> str:
    """Return the text of a number as a floating-point number."""
    if value.type == REAL or value.real:
        return value.real or value.text
    if value.constant is not None:
        return literal(float(value.constant)).text
    return f"((vs_real){value.text})"
