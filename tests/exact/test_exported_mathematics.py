"""Exported C's small sin, cos, tan and erfc against Python's, which are right to about one unit in the last place."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from collections.abc import Callable

import numpy as np
import pytest

from helpers.exported_robots import STRICT
from vibroswarm.export.parameters import ASSETS

Function = Callable[[float], float]
NAMES = ("sin", "cos", "tan", "erfc")
pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Function]:
    folder = tmp_path_factory.mktemp("mathematics")
    lines = ["#define VS_PRECISION 2", '#include "vibroswarm_runtime.h"']
    lines += [f"double call_{name}(double x) {{ return vs_{name}(x); }}" for name in NAMES]
    (folder / "m.c").write_text("\n".join(lines))
    command = [
        "gcc",
        *STRICT,
        "-Wno-unused-function",
        "-fPIC",
        "-shared",
        "-I",
        str(ASSETS),
        "m.c",
        "-o",
        "m.so",
    ]
    subprocess.run([*command, "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "m.so"))
    functions: dict[str, Function] = {}
    for name in NAMES:
        function = getattr(library, f"call_{name}")
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
        functions[name] = function
    return functions


def angles() -> list[float]:
    rng = np.random.default_rng(3)
    near_right = (2 * rng.integers(-500, 500, 2000) + 1) * (math.pi / 2)
    return np.concatenate(
        [rng.uniform(-7, 7, 20_000), rng.uniform(-1e6, 1e6, 20_000), near_right, near_right - math.pi / 2]
    ).tolist()


def worst_error(function: Function, right: Function, at: list[float]) -> float:
    """Return the largest relative error."""
    return max(abs(function(x) - right(x)) / max(abs(right(x)), 1e-300) for x in at)


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_angles_are_right_to_the_last_places(name: str, small: dict[str, Function]) -> None:
    assert worst_error(small[name], getattr(math, name), angles()) < 6e-16  # half of it may be Python's own


def test_a_right_angle_as_one_number_does_not_pass() -> None:
    def naive(x: float) -> float:
        turned = math.floor(x / (math.pi / 2) + 0.5)
        rest = x - turned * (math.pi / 2)
        return (math.sin(rest), math.cos(rest), -math.sin(rest), -math.cos(rest))[turned % 4]

    assert worst_error(naive, math.sin, angles()) > 1e-12


def erfc_error(function: Function) -> float:
    """Return the largest relative error over its bound."""
    at = np.random.default_rng(4).uniform(-6.0, 26.0, 50_000).tolist()
    return max(abs(function(x) / math.erfc(x) - 1.0) / (2.2e-15 + 2.7e-16 * x * x) for x in at)


def test_erfc_is_right_far_into_its_tail(small: dict[str, Function]) -> None:
    assert erfc_error(small["erfc"]) < 1.0
    assert erfc_error(lambda x: 1.0 - math.erf(x)) > 1e6
    assert [small["erfc"](x) for x in (-math.inf, -30.0, 0.0, 30.0, math.inf)] == [
        2.0,
        2.0,
        pytest.approx(1.0),
        0,
        0,
    ]


def test_what_is_no_number_stays_none(small: dict[str, Function]) -> None:
    assert all(math.isnan(function(math.nan)) for function in small.values())
    assert math.isnan(small["sin"](math.inf))
