"""Kernels that one process compiled and kept on disk do not disturb those of another.

Numba numbers the types of rows anew in each process and puts the number into the names of compiled
functions. Two kernels kept by two processes may so hold one name for a helper compiled for two layouts of
rows; a third process that loads both would run the wrong one.
"""

from __future__ import annotations

import gc
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import vibroswarm.core.jit
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
def of_a(rows):
    return shared(rows, rows.size - 1) + shared(rows, 0)

@kernel
def of_b(rows):
    return shared(rows, rows.size - 1) + shared(rows, 0)
"""
CALL = """
import sys
import numpy as np
import rows_kernels as k

for which in sys.argv[1]:
    rows = np.zeros(3, k.A if which == "a" else k.B)
    rows["v"], rows["p"], rows["q"] = 1.0, 100.0, 1000.0
    print((k.of_a if which == "a" else k.of_b)(rows))
"""


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_kernels_kept_by_two_processes_go_together(tmp_path: Path, numba_programs: NumbaPrograms) -> None:
    (tmp_path / "rows_kernels.py").write_text(KERNELS, encoding="utf-8")
    (tmp_path / "call.py").write_text(CALL, encoding="utf-8")

    def called(which: str) -> list[float]:
        done = numba_programs.run(tmp_path / "call.py", which, cache=tmp_path / "cache")
        assert done.returncode == 0, done.stderr
        return [float(word) for word in done.stdout.split()]

    assert called("a") == [7.0]
    assert called("b") == [7.0]
    assert called("ab") == [7.0, 7.0]
    assert called("ba") == [7.0, 7.0]


FOREIGN = """
import gc
import sys
import numba
from vibroswarm.core.jit import inner, kernel
from vibroswarm.core.rng import uniform
from vibroswarm.robot.belief import belief_below
from vibroswarm.strategies.soft import weight

before = gc.isenabled(), numba.config.SLP_VECTORIZE

@numba.njit
def total(n):
    found = 0.0
    for k in range(n):
        found += uniform(1, 2, 3, 4, k, 0) + belief_below(3, k + 1, 0.5) + weight(3, k + 1, 0.2, 1500.0, 2.0)
    return found

@numba.njit
def chance(k):
    return uniform(1, 2, 3, 4, k, 0)

@inner
def thrice(k):
    return 3.0 * chance(k)

@kernel
def ours(n):
    found = 0.0
    for k in range(n):
        found += chance(k) + thrice(k) / 3.0 + belief_below(3, k + 1, 0.5)
    return found

# In either order, since a function is compiled once for kernels of ours and once for the user's.
for called in (ours, total) if "ours" in sys.argv else (total, ours):
    print(called(100), called.py_func(100))
assert (gc.isenabled(), numba.config.SLP_VECTORIZE) == before
"""


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
@pytest.mark.parametrize("first", ["ours", "the user's"])
def test_a_users_own_compiled_function_and_our_kernels_call_each_other(
    first: str, tmp_path: Path, numba_programs: NumbaPrograms
) -> None:
    """What Python calls and what only kernels call, compiled at first and from the cache."""
    (tmp_path / "foreign.py").write_text(FOREIGN, encoding="utf-8")
    for _ in ("compiled", "from the cache"):
        done = numba_programs.run(tmp_path / "foreign.py", first, cache=tmp_path / "cache")
        assert done.returncode == 0, done.stderr
        lines = done.stdout.splitlines()
        assert len(lines) == 2
        for line in lines:
            compiled, plain = map(float, line.split())
            assert compiled == pytest.approx(plain, rel=1e-12)
            assert 100.0 < plain < 250.0


PARTS = """
from vibroswarm.core import whole_kernels
whole_kernels.KNOWN = whole_kernels.KNOWN if "known" in __import__("sys").argv else ()
from vibroswarm.core.jit import inner, kernel

NEVER = False

@inner
def deep(x):
    return 3.0 * x

@inner
def never(x):
    if NEVER:
        return deep(x)
    return x

@inner
def always(x):
    return deep(x) + 1.0

@kernel
def both(x):
    return never(x) + always(x)

print(both(2.0), deep(2.0))
"""


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
@pytest.mark.parametrize("version", ["known", "another"])
def test_a_kernel_is_compiled_with_all_that_it_calls(
    version: str, tmp_path: Path, numba_programs: NumbaPrograms
) -> None:
    """Also a part that its first caller never calls; and by a version of Numba whose inner parts are not known."""
    (tmp_path / "parts.py").write_text(PARTS, encoding="utf-8")
    for _ in ("compiled", "from the cache"):
        done = numba_programs.run(tmp_path / "parts.py", version, cache=tmp_path / "cache")
        assert done.stdout.split() == ["9.0", "6.0"]
    saved = {path.name.split("-")[0] for path in tmp_path.rglob("parts.*.nbc")}
    assert saved == {"parts.both"}


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


def test_threads_that_compile_at_once_leave_the_users_settings() -> None:
    """Without a lock, the second thread would take the settings of the first for the user's."""
    from numba import config

    from vibroswarm.core.jit import _settings

    before = gc.isenabled(), config.SLP_VECTORIZE

    def compile_for(seconds: float) -> None:
        with _settings(True):
            time.sleep(seconds)

    with ThreadPoolExecutor(2) as threads:
        first = threads.submit(compile_for, 0.3)
        time.sleep(0.1)
        second = threads.submit(compile_for, 0.5)
    assert first.result() is second.result() is None
    assert before == (True, config.SLP_VECTORIZE) == (gc.isenabled(), before[1])


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_kernels_are_not_read_from_the_working_folder_whatever_other_threads_do(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Numba's own setting is empty while another thread declares a kernel: then its folder is the working folder."""
    import numba

    from vibroswarm.core import kernel_cache

    named = kernel_cache._Locator.get_suitable_cache_subpath

    def named_while_another_thread_declares(file: str) -> str:
        monkeypatch.setattr(numba.config, "CACHE_DIR", "")
        return named(file)

    naming = staticmethod(named_while_another_thread_declares)
    monkeypatch.setattr(kernel_cache._Locator, "get_suitable_cache_subpath", naming)
    declared = vibroswarm.core.jit.kernel(lambda x: x + 1.0)
    assert Path(declared._cache._cache_path).parent == vibroswarm.core.jit.cache_folder()


def test_collection_that_the_user_has_turned_off_stays_off() -> None:
    from vibroswarm.core.jit import _settings

    with _settings(True), _settings(True):
        assert not gc.isenabled()
    assert gc.isenabled()
    gc.disable()
    try:
        with _settings(True):
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
