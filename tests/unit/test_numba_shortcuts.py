"""``core.numba_shortcuts``: what Numba computes, and only while a kernel of ours is compiled."""

from __future__ import annotations

import math
import re
from functools import partial, wraps
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import base
from numba.core.compiler import Flags
from numba.np.unsafe.ndarray import to_fixed_tuple

from vibroswarm.core import whole_kernels
from vibroswarm.core.jit import PLAIN, kernel
from vibroswarm.core.numba_shortcuts import (
    equal_settings,
    hash_of_settings,
    replacements,
    shortcuts,
)

pytestmark = [
    pytest.mark.skipif(PLAIN, reason="nothing is compiled"),
    pytest.mark.skipif(not whole_kernels.is_known(), reason="no shortcuts with this version of Numba"),
]


def mixed(values: Any, limit: int) -> Any:
    """What shortcuts are about: operators on several types, branches, loops, tuples, lists, calls."""
    total, least = 0.0, math.inf
    for k in range(values.size):
        x, y = values[k] + k, (values[k] * 2 if k > limit else values[k] / 3)
        if x > y and k != limit:
            total += math.sqrt(abs(x - y)) + np.minimum(x, y)
        else:
            least = min(least, float(int(y) % 7), x)
    weights = np.array([1.5, 2.5, least])  # a list that becomes an array
    return total, weights[limit % 3], -limit


def machine_code(values: Any) -> str:
    """Compile ``mixed``; names, and so the lengths of texts, differ in a counter of compiled functions."""
    compiled = numba.njit(mixed)
    expected = mixed(values, 3)
    assert compiled(values, 3) == pytest.approx(expected)
    (text,) = compiled.inspect_llvm().values()
    return re.sub(r"B\d+v\d+|\[\d+ x i8\]", "", str(text))


def test_the_code_is_that_which_numba_makes() -> None:
    values = np.linspace(-3.0, 9.0, 20)
    numbas = machine_code(values)
    with shortcuts():
        assert machine_code(values) == numbas
        assert machine_code(values) == numbas, "from remembered signatures"


def test_settings_are_equal_if_all_entries_are() -> None:
    one, other = Flags(), Flags()
    other.nrt = False  # as it is by default
    assert one == other
    assert equal_settings(one, other)
    assert hash_of_settings(one) == hash_of_settings(other)
    other.nrt = True
    assert one != other
    assert not equal_settings(one, other)
    assert not equal_settings(one, None)
    assert hash_of_settings(one) != hash_of_settings(other)


def test_functions_with_and_without_loc_are_told_apart() -> None:
    def with_loc(builder: Any, loc: Any = None) -> None: ...

    def without(builder: Any) -> None: ...

    @wraps(with_loc)
    def wrapped(*args: Any) -> None: ...

    functions = [with_loc, without, wrapped, partial(with_loc), partial(without), len]
    numbas = [base._has_loc(function) for function in functions]
    assert numbas == [True, False, True, True, False, False]
    with shortcuts():
        assert [base._has_loc(function) for function in functions * 2] == numbas * 2


def scaled(x: float, by: int, down: bool) -> float:
    return x / by if down else x * by


def first_of(x: Any, count: int) -> Any:
    return to_fixed_tuple(x, count)[0]


def asks_for_number(x: Any, count: int) -> Any:
    return x[numba.literally(count)]


def compiled_calls() -> tuple[Any, Any]:
    """The dispatcher of ``scaled``, which is called with several numbers written out, and the compiled caller."""
    part: Any = numba.njit(scaled)
    needs_number: Any = numba.njit(first_of)
    asks: Any = numba.njit(asks_for_number)

    def calls(x: Any, k: int) -> float:
        scales = part(x[0], 2, True) + part(x[0], 3, False) + part(x[0], k, k > 3)
        return scales + needs_number(x, 2) + asks(x, 1)

    return part, numba.njit(calls)


def test_a_function_is_compiled_once_for_all_numbers_that_are_written_out() -> None:
    """But for a function that must know the number; Numba itself compiles for each."""
    values = np.array([1.5, 2.5, 3.5])
    expected = 1.5 / 2 + 1.5 * 3 + 1.5 / 7 + 1.5 + 2.5
    with shortcuts():
        part, calls = compiled_calls()
        assert calls(values, 7) == expected
        assert len(part.signatures) == 1
    part, calls = compiled_calls()
    assert calls(values, 7) == expected
    assert len(part.signatures) == 3


def test_numba_is_as_it_was_outside_of_our_kernels() -> None:
    parts = [(owner, name) for owner, name, _ in replacements()]
    before = [vars(owner)[name] for owner, name in parts]
    inside: list[bool] = []
    with shortcuts(), shortcuts():
        inside += [vars(owner)[name] is not old for (owner, name), old in zip(parts, before, strict=True)]
    assert all(inside)
    assert [vars(owner)[name] for owner, name in parts] == before
    with pytest.raises(ValueError, match="fails"), shortcuts():
        raise ValueError("fails")
    assert [vars(owner)[name] for owner, name in parts] == before

    @kernel
    def refused(x: int) -> Any:
        return x.nothing  # type: ignore[attr-defined]

    with pytest.raises(numba.TypingError, match="nothing"):
        refused(1)
    assert [vars(owner)[name] for owner, name in parts] == before
