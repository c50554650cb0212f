"""A kernel from the cache runs as compiled, in a process that has loaded nothing to compile it with."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from vibroswarm.core.jit import PLAIN

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")

KERNELS = """
import numpy as np
from vibroswarm.core.jit import allocating_kernel, kernel

@kernel
def twice(x):
    return 2.0 * x

@allocating_kernel
def words_and_matrices(word, x):
    numbers = {word + str(k): k * x for k in range(3)}
    print(sorted(numbers), len({word, "a"}), np.sort(np.array([x, 1.0])))
    if x > 1e9:
        raise ValueError("too large")
    return numbers[word + "2"] + np.linalg.solve(2.0 * np.eye(2), np.ones(2))[0] + hash(word) * 0.0
"""
CALL = """
import sys
import kernels_of_all_sorts as k

number = k.twice(2.0)
compiler = "numba.np.linalg" in sys.modules
print(number, k.words_and_matrices("a", 2.0))
try:
    k.words_and_matrices("a", 2e9)
except ValueError as error:
    print(error)
print(compiler, [sum(one.stats.cache_hits.values()) for one in (k.twice, k.words_and_matrices)])
"""


def test_machine_code_needs_no_compiler(tmp_path: Path) -> None:
    (tmp_path / "kernels_of_all_sorts.py").write_text(KERNELS, encoding="utf-8")
    (tmp_path / "call.py").write_text(CALL, encoding="utf-8")
    cache = str(tmp_path / "cache")
    env = os.environ | {"XDG_CACHE_HOME": cache, "LOCALAPPDATA": cache, "HOME": cache}
    said = [
        subprocess.run(
            [sys.executable, tmp_path / "call.py"],
            env=env,
            capture_output=True,
            text=True,
            check=True,
            timeout=120,
        ).stdout.splitlines()
        for _ in range(2)
    ]
    compiled, loaded = said
    assert compiled.pop() == "True [0, 0]"
    assert loaded.pop() == "False [1, 1]"
    assert loaded == compiled
    assert "4.0 4.5" in loaded
    assert loaded[-1] == "too large"
