"""Kernels that are kept on disk: those of two processes go together, and none is older than its source.

Numba numbers the types of rows anew in each process and puts the number into the names of compiled
functions. Two processes so give one name to a function compiled for two layouts of rows; a third process that loads
both would run the wrong one.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import vibroswarm
from helpers.numba_programs import NumbaPrograms
from helpers.sources import source_of
from vibroswarm.core.jit import LAYERS_ABOVE, PLAIN

BESIDE = ("__init__.py", "__main__.py", "inspection")
# ``inspection`` takes from above without being left out of the hash: its kernels read nothing from above.
"""Files at the top that call into the rooms above, and that no simulation needs."""

KERNELS = """
import numpy as np
from vibroswarm.core.jit import kernel

A = np.dtype([("p", np.float64), ("q", np.float64), ("v", np.float64)])
B = np.dtype([("v", np.float64), ("p", np.float64), ("q", np.float64)])

@kernel
def shared(rows, last):
    total = 0.0
    for k in range(last + 1):  # long enough not to be inlined
        total += rows[k].v * (k + 1)
        if total > 1e300:
            total = -total
    return total

@kernel
def total(rows):
    return shared(rows, rows.size - 1) + shared(rows, 0)
"""
CALL = """
import sys
import numpy as np
import rows_kernels as k

for which in sys.argv[1]:
    rows = np.zeros(3, k.A if which == "a" else k.B)
    rows["v"], rows["p"], rows["q"] = 1.0, 100.0, 1000.0
    print(k.total(rows) + k.shared(rows, 0), list(k.total.overloads.values())[-1].fndesc.mangled_name)
"""


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_kernels_kept_by_two_processes_go_together(tmp_path: Path, numba_programs: NumbaPrograms) -> None:
    (tmp_path / "rows_kernels.py").write_text(KERNELS, encoding="utf-8")
    (tmp_path / "call.py").write_text(CALL, encoding="utf-8")

    def called(which: str) -> list[list[str]]:
        done = numba_programs.run(tmp_path / "call.py", which, cache=tmp_path / "cache")
        assert done.returncode == 0, done.stderr
        return [line.split() for line in done.stdout.splitlines()]

    (in_a,), (in_b,) = called("a"), called("b")
    assert in_a[0] == in_b[0] == "8.0"
    assert in_a[1] != in_b[1], "the same work in both, so that Numba numbers both types alike"
    assert called("ab") == [in_a, in_b]
    assert called("ba") == [in_b, in_a]


FOREIGN = """
import numba
from others import K, twice
from vibroswarm.core.jit import inner, kernel
from vibroswarm.core.rng import uniform

OWN = 1.0

@numba.njit
def foreign(x):
    return x + (uniform(1, 2, 3, 4, 5, 6) < 2.0)

@inner
def thrice(x):
    return 3.0 * foreign(x)

@kernel
def ours(x):
    return foreign(x) + thrice(x) + twice(x) + K + OWN

print(ours(1.0), sum(ours.stats.cache_hits.values()))
"""
OTHERS = """
from vibroswarm.core.jit import inner

K = 100.0

@inner
def twice(x):
    return 2.0 * x
"""


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_a_kernel_is_compiled_anew_after_its_file_or_one_beside_it_has_changed(
    tmp_path: Path, numba_programs: NumbaPrograms
) -> None:
    program, other = tmp_path / "program.py", tmp_path / "others.py"

    def printed(own: str = "OWN = 1.0", beside: str = "K = 100.0") -> str:
        program.write_text(FOREIGN.replace("OWN = 1.0", own), encoding="utf-8")
        other.write_text(OTHERS.replace("K = 100.0", beside), encoding="utf-8")
        without = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
        done = numba_programs.run(program, cache=tmp_path / "cache", env=without)
        assert done.returncode == 0, done.stderr
        return done.stdout.strip()

    assert [printed(), printed()] == ["111.0 0", "111.0 1"]
    assert printed(own="OWN = 2.0") == "112.0 0"
    assert printed(beside="K = 200.0") == "211.0 0"
    for file in (tmp_path / "cache").rglob("*.nbc"):
        file.write_bytes(file.read_bytes()[:100])
    assert [printed(), printed()] == ["111.0 0", "111.0 1"], "a damaged file is written again"


def test_what_is_left_out_of_the_hash_holds_no_kernel_and_nothing_below_needs_it() -> None:
    package = Path(vibroswarm.__file__).parent
    for source in package.rglob("*.py"):
        above = source.relative_to(package).parts[0] in LAYERS_ABOVE
        for module, names in source_of(source).imports:
            if above:
                assert not names & {"kernel", "inner", "inlined", "allocating_kernel", "numba", "njit"}, (
                    source
                )
            elif source.relative_to(package).parts[0] not in BESIDE:
                assert not any(module.startswith(f"vibroswarm.{room}") for room in LAYERS_ABOVE), source
