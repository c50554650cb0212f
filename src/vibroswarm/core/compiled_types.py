"""Rows and arrays whose elements compute in plain Python as in compiled code, whatever their types.

Beside a number of Python, NumPy's scalars keep their type: 200 + 100 overflows in ``uint8``. Compiled code computes
with whole numbers of 64 bits, and with ``float32`` beside any number but another ``float32`` in double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

OPERATORS: Final = (
    *(f"__{way}{name}__" for name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow") for way in ("", "r")),
    "__lt__", "__le__", "__gt__", "__ge__", "__eq__", "__ne__",
)  # fmt: skip
"""Methods of operators of two numbers."""


class _Single(np.float32):
    """An element of a ``float32`` array."""

    def __neg__(self) -> _Single:
        return _Single(super().__neg__())

    def __abs__(self) -> _Single:
        return _Single(super().__abs__())


def _operator(name: str) -> Callable[[_Single, Any], Any]:
    """Return the method of an operator of a ``_Single`` and another number."""

    def method(one: _Single, other: Any) -> Any:
        if not isinstance(other, np.float32):
            return getattr(np.float64, name)(np.float64(one), other)
        result = getattr(np.float32, name)(one, other)
        return _Single(result) if isinstance(result, np.float32) else result

    return method


for _name in OPERATORS:
    setattr(_Single, _name, _operator(_name))


class _Elements(np.ndarray[Any, Any]):
    """An array whose elements compute as in compiled code."""

    def __getitem__(self, index: Any) -> Any:
        element = super().__getitem__(index)
        if isinstance(element, np.integer):
            return np.int64(element)
        return _Single(element) if isinstance(element, np.float32) else element

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(index, np.asarray(value).astype(self.dtype))  # cut to the bits of its type


class _Row(np.record):  # type: ignore[misc]  # NumPy takes its classes, declared final, as parents
    """A row whose fields are attributes, and whose arrays are ``_Elements``."""

    def __getattribute__(self, name: str) -> Any:
        found = super().__getattribute__(name)
        return found.view(_Elements) if type(found) is np.ndarray else found


def new_row(kind: np.dtype[np.void]) -> Any:
    """Return a row of zeros, with its fields as attributes."""
    return np.zeros(1, np.dtype((_Row, kind)))[0]


def as_compiled(array: NDArray[Any]) -> NDArray[Any]:
    """Return a view of an array whose elements compute as in compiled code."""
    return array.view(_Elements)
