"""Runs have the same bits on processors with other vector instructions."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path
from typing import Final

import pytest

from vibroswarm.core.jit import PACKAGE, simulation_sources
from vibroswarm.simulation import versions

ROUNDED_BY_PROCESSOR: Final = frozenset(
    {
        "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "logaddexp", "power", "float_power", "sin", "cos",
        "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "dot", "vdot", "inner", "matmul",
        "tensordot", "einsum", "convolve", "correlate", "linalg", "polynomial", "fft",
    }
)  # fmt: skip
"""Functions of NumPy that have other last bits with other vector instructions."""
NOT_IN_RUNS: Final = {
    "floors/difficulty.py": "measures of a floor",
    "inspection": "reads runs that are there",
    "motion/footprint.py": "starts of MuJoCo's wheels, which round by MuJoCo's own library",
    "motion/physics": "MuJoCo",
    "motion/pose.py": "poses between samples, after a run",
    "sensors/acceleration.py": "coupled tiles: an inverse, which the documentation names",
}

RUN = """
import numpy as np  # before the suite's choice of instructions
from helpers.ledger import hash_of_result
from vibroswarm import preset, simulate
for name, fields in (
    ("calibrated", {"strategy.name": "places", "localisation.method": "mixture"}),
    ("paper", {"floor.source": "patch:2*0.2@0.5+0.4x0.03", "sensor.edge_reach_m": 0.01}),
):
    print(hash_of_result(simulate(preset(name).with_values({"run.t_end_s": 200.0, **fields}), 7, 3)), end=" ")
numbers = np.random.default_rng(1).random((2, 1000))
print(*(numbers @ numbers.T).ravel().tolist(), sep="\\n")
"""


def printed(**variables: str) -> tuple[list[str], str]:
    """Hashes of the runs, and products by linear algebra, with these environment variables in place of the suite's."""
    kept = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))} | variables
    for name in {"NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE"} - variables.keys():
        kept.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-P", "-c", RUN], env=kept, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    *runs, products = done.stdout.split(maxsplit=2)
    return runs, products


@pytest.mark.skipif("X86_V3" not in versions()["architecture"], reason="needs an x86 processor with AVX2")
def test_runs_are_equal_with_other_vector_instructions() -> None:
    as_they_are, of_here = printed()
    without, of_others = printed(NPY_DISABLE_CPU_FEATURES="X86_V4 X86_V3", OPENBLAS_CORETYPE="Prescott")
    assert as_they_are == without
    assert of_here != of_others  # linear algebra does differ, so the runs are equal for another reason


@pytest.mark.parametrize("of_processor", [True, False])
def test_what_rounds_by_the_processor_is_found(of_processor: bool) -> None:
    assert (
        bool(functions_in("np.exp(x) + a @ b" if of_processor else "np.sqrt(x) + math.exp(y)"))
        == of_processor
    )


def test_no_run_depends_on_functions_that_round_by_the_processor() -> None:
    found = {
        name: used
        for source in simulation_sources()
        if (used := functions_in(source.read_text(encoding="utf-8")))
        and not any(name_of(source).startswith(part) for part in NOT_IN_RUNS)
        for name in [name_of(source)]
    }
    # Nodes from linear algebra are rounded there.
    assert found == {"core/elementary.py": {"polynomial"}}


def name_of(source: Path) -> str:
    return source.relative_to(PACKAGE).as_posix()


def functions_in(text: str) -> set[str]:
    """The functions of ``ROUNDED_BY_PROCESSOR`` that a module takes from NumPy, and ``@``."""
    found = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "np":
            found.add(node.attr)
        elif isinstance(node, ast.ImportFrom) and str(node.module).startswith("numpy."):
            found.add(str(node.module).split(".")[1])
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            found.add("@")
    return found & (ROUNDED_BY_PROCESSOR | {"@"})
