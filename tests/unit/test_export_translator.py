"""The translator from Python to C: what it refuses, with file and line, and Python's meaning of operators."""

from __future__ import annotations

import math
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from helpers.exported_robots import STRICT
from vibroswarm.errors import InputError
from vibroswarm.export.c_functions import Program
from vibroswarm.export.c_types import (
    BOOL,
    INT,
    REAL,
    CArray,
    Struct,
    Value,
    struct_of_class,
    typedef,
)
from vibroswarm.export.parameters import ASSETS


class Pair(NamedTuple):
    first: float
    second: int


class Lines(NamedTuple):
    seen_hz: Any


ROW = Struct("vs_Row", None, (("count", INT), ("mean", REAL), ("values", CArray("vs_stored", (3,)))), True)
PAIR = struct_of_class("vs_Pair", Pair)
PAIR_OF_ROWS = Struct("vs_Rows", None, (("row", ROW), ("other", ROW)), True)
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def program() -> Program:
    return Program({Pair: PAIR}, {}, {}, "no template", {})


def add_one(row: Any) -> float:
    row.mean += 1.0
    return float(row.mean)


def read_mean(row: Any) -> float:
    return float(row.mean)


def integers(a: int, b: int) -> tuple[int, int, int, int, int]:
    return a // b, a % b, min(a, b), max(a, b), abs(a)


def reals(x: float, y: float) -> tuple[float, float, float, float, float]:
    return x % y, min(x, y), max(x, y), abs(x), float(round(x))


def swapped(x: float, y: float) -> tuple[float, float]:
    x, y = y, x + y
    return x, y


def choices(a: int, b: int) -> tuple[float, float]:
    chosen = 1.0 if (a < b <= 7 and a != 3) or b == 2 else 0.0
    product = a * b / 3
    return chosen, product


def products(a: int, b: int) -> tuple[float, float, float, float]:
    smaller = 1.0 if -(a * b) < 0 else 0.0
    return (a * b) % 1.5, -(a * b) / 3, smaller, int(a * b) / 3


def beyond_32_bits(a: int, b: int) -> tuple[float, float, float, float, float]:
    larger = 1.0 if a * a + b * b > 2_000_000_000 else 0.0
    return (
        (a * b) // 1000 / 1,
        a * 16807 % 2147483647 / 1,
        (a * b - 7) / 2,
        larger,
        abs(a * b - b * b) % 97 / 1,
    )


def chosen_products(a: int, b: int) -> tuple[float, float, float]:
    return min(a * b, 7) / 1, max(7, a * b, b) / 1, (a * b if a < b else b) / 1


def signs_of_zero(x: float, y: float) -> tuple[float, float, float]:
    zero, small = x * 0.0, x / 1e7
    return math.atan2(zero % y, -1.0), math.atan2(-y % y, -1.0), math.atan2(math.ceil(small), -1.0)


def powers(x: float, y: float) -> tuple[float, float, float, float]:
    return x**4, (x - y) ** 3, (1.0 + x * x) ** -7, x ** math.floor(y / 1e5)


def large_and_once(a: int, b: int) -> tuple[float, float]:
    left, rounds = b % 100, 0
    for _ in range(left):  # computed before the loop changes it
        left -= 1
        rounds += 1
    return min(a, 3_000_000_000) / 1, rounds / 1


def generated_names(a: int, b: int) -> tuple[float, float]:
    held_1, k_1, vs_mod_i, int64_t = b, 0, a, 2
    for j in range(1, 6, 4):
        for i in range(a * 0 + held_1 % 7):
            k_1 += i * j
    a, held_1 = held_1, a % 5
    return float(k_1 + held_1), a * int64_t / 1 + vs_mod_i


def swapped_pairs(x: float, y: float) -> tuple[float, float]:
    one, other = Pair(x, 1), Pair(y, 2)
    one, other = other, one
    return one.first, other.first


FUNCTIONS = (
    (integers, INT, 5), (reals, REAL, 5), (swapped, REAL, 2), (swapped_pairs, REAL, 2), (choices, INT, 2),
    (products, INT, 4), (beyond_32_bits, INT, 5), (chosen_products, INT, 3), (signs_of_zero, REAL, 3),
    (generated_names, INT, 2), (large_and_once, INT, 2),
)  # fmt: skip


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Any:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    import ctypes

    folder = tmp_path_factory.mktemp("c")
    made = program()
    functions = (*FUNCTIONS, (powers, REAL, 4))
    texts = [made.function(function, [kind, kind]) for function, kind, _ in functions]
    lines = ["#define VS_PRECISION 3", '#include "vibroswarm_runtime.h"']
    lines += [typedef(kind) for kind in (PAIR, *made.tuples.values())]
    lines += [item.text for item in texts]
    for (function, kind, count), item in zip(functions, texts, strict=True):
        values = " ".join(f"out[{k}] = (double)found.v{k};" for k in range(count))
        lines.append(
            f"void call_{function.__name__}({kind} a, {kind} b, double *out) "
            f"{{ const {item.returns.name} found = {item.name}(a, b); {values} }}"
        )
    (folder / "f.c").write_text("\n".join(lines))
    shutil.copy(ASSETS / "vibroswarm_runtime.h", folder)
    command = ["gcc", *STRICT, "-fPIC", "-shared", "f.c", "-o", "f.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "f.so"))

    def call(function: Any, kind: str, count: int, a: Any, b: Any) -> list[float]:
        argument = ctypes.c_int32 if kind == INT else ctypes.c_double
        out = (ctypes.c_double * count)()
        getattr(library, f"call_{function.__name__}")(argument(a), argument(b), out)
        return list(out)

    return call


SMALL = st.integers(-1000, 1000)
REALS = st.floats(-1e6, 1e6)


@settings(max_examples=200, deadline=None)
@given(SMALL, SMALL.filter(bool), REALS, REALS.filter(bool))
def test_operators_mean_what_they_mean_in_python(compiled: Any, a: int, b: int, x: float, y: float) -> None:
    for function, kind, count in FUNCTIONS:
        given = (a, b) if kind == INT else (x, y)
        assert compiled(function, kind, count, *given) == [float(value) for value in function(*given)]


def test_products_do_not_overflow(compiled: Any) -> None:
    assert compiled(choices, INT, 2, 2_000_000_000, 2_000_000_000)[1] == 4e18 / 3
    assert compiled(products, INT, 4, 1_000_000, 3_001) == list(products(1_000_000, 3_001))
    for a, b in ((70_001, -90_000), (-1_234_567, 7_654_321), (46_341, 1)):
        assert compiled(beyond_32_bits, INT, 5, a, b) == list(beyond_32_bits(a, b))
        assert compiled(chosen_products, INT, 3, a, b) == list(chosen_products(a, b))


def test_whole_powers_are_those_of_the_simulation(compiled: Any) -> None:
    """Numba multiplies; pow of the C library, which Python calls, differs from it in the last bit."""
    of_numba, rng = njit(powers), np.random.default_rng(1)
    for x, y in rng.uniform(-1e6, 1e6, (300, 2)):
        assert compiled(powers, REAL, 4, x, y) == list(of_numba(x, y))
    assert any(powers(x, 0.0) != of_numba(x, 0.0) for x in rng.random(100))


def several_through_a_function(r: Any) -> None:
    r.row.mean, y = 1.0, read_mean(r.row)
    r.other.mean = y


def a_product_among_several(r: Any) -> None:
    r.row.mean, r.other.mean = 1.0, r.row.mean * r.other.count * r.other.count
    r.row.mean, r.other.mean = r.other.mean, r.row.mean + r.other.count * r.other.count
    x, y = r.row.mean, 0.0
    x, y = y, r.row.count * r.row.count
    r.row.mean, r.other.mean = r.other.mean + 0.0 * x, y


@needs_gcc
@pytest.mark.parametrize("function", [several_through_a_function, a_product_among_several])
def test_several_values_are_computed_before_the_first_is_assigned(function: Any, tmp_path: Path) -> None:
    """Also where a function reads the row, and where a product needs more than 32 bits."""
    made = program()
    text = made.function(function, [PAIR_OF_ROWS])
    lines = ["#define VS_PRECISION 3", "#include <stdio.h>", '#include "vibroswarm_runtime.h"']
    lines += [typedef(kind) for kind in (ROW, PAIR_OF_ROWS)]
    lines += [item.text for item in made.compiled.values()]
    lines.append(
        "int main(void) { vs_Rows r = {{100000, 2.5, {3.5, 4.5, 5.5}}, {200000, 6.5, {7.5, 8.5, 9.5}}}; "
        f'{text.name}(&r); printf("%.17g %.17g\\n", (double)r.row.mean, (double)r.other.mean); return 0; }}'
    )
    (tmp_path / "f.c").write_text("\n".join(lines))
    shutil.copy(ASSETS / "vibroswarm_runtime.h", tmp_path)
    command = ["gcc", *STRICT, "-Wno-unused-function", "f.c", "-o", "f", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "f")], check=True, capture_output=True, text=True)
    row = SimpleNamespace(count=100000, mean=2.5, values=[3.5, 4.5, 5.5])
    other = SimpleNamespace(count=200000, mean=6.5, values=[7.5, 8.5, 9.5])
    function(SimpleNamespace(row=row, other=other))
    assert [float(word) for word in done.stdout.split()] == [row.mean, other.mean]


def beside_a_change(row: Any) -> float:
    return float(row.mean) + add_one(row)


def test_a_call_that_changes_a_row_stands_alone() -> None:
    """C leaves the order open in which it computes the parts of an expression."""
    with pytest.raises(InputError, match=r"'add_one\(row\)', in beside_a_change, cannot be exported"):
        program().function(beside_a_change, [ROW])


def test_constants_keep_their_precision_where_memory_is_shorter() -> None:
    """With ``VS_PRECISION`` 2 a robot's arrays are in float."""
    kind = struct_of_class("vs_Lines", Lines, like=Lines(np.zeros(2)))
    assert kind.type_of("seen_hz") == CArray(REAL, (2,))


def test_names_of_c_are_avoided() -> None:
    assert Value("x", BOOL).constant is None
    made = program().function(with_keywords, [REAL])
    assert "double_ =" in made.text
    assert "short_ = " in made.text
    assert "short__ = " in made.text
    assert "log_ = vs_log(short__);" in made.text  # whose ``log`` is the C library's


def with_keywords(x: float) -> float:
    double = 2.0 * x
    short = double
    short_ = short + x
    log = math.log(short_)
    return log
