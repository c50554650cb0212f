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
from vibroswarm.core.jit import allocating_kernel, kernel

@kernel
def twice(x):
    return 2.0 * x

@allocating_kernel
def number_of_words(word, times):
    if times > 100:
        raise ValueError("too many", times)
    first = {word + str(k % 3): k for k in range(times)}
    return len(first) + hash(word) * 0.0
"""
CALL = """
import sys
import kernels_of_all_sorts as k

number = k.twice(2.0)
compiler = "numba.np.linalg" in sys.modules
print(number, k.number_of_words("a", 10))
try:
    k.number_of_words("a", 1000)
except ValueError as error:
    print(error)
print(compiler, [sum(one.stats.cache_hits.values()) for one in (k.twice, k.number_of_words)])
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
    assert loaded == ["4.0 3.0", "('too many', 1000)"]
