"""A kernel is never used again after anything that is compiled into it has changed, in whichever file it is."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers.numba_programs import NumbaPrograms
from vibroswarm.core.jit import PLAIN

pytestmark = pytest.mark.skipif(PLAIN, reason="nothing is compiled")

NO_BYTECODE = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}
"""Python would not see a change of a file within a second that leaves its size."""
FILES = {
    "program.py": """
import enum
import others.parts
from others.parts import Side, TURN, double
from vibroswarm.core.jit import inner, kernel

OWN = 1.0

@inner
def helper(x):
    return x + OWN

@kernel
def user_kernel(x):
    return double(helper(x)) + others.parts.added() + others.parts.K + Side.LESS.value + TURN.imag

print(user_kernel(1.0), sum(user_kernel.stats.cache_hits.values()))
""",
    "others/__init__.py": "",
    "others/parts.py": """
import enum
from vibroswarm.core.jit import inner

K = 100.0
TURN = 1 + 0j

class Side(enum.IntEnum):
    LESS = 1000

@inner
def inside(x):
    return 2.0 * x

@inner
def double(x):
    return inside(x)

@inner
def added():
    return 10.0
""",
}
"""A user's kernel that calls functions of its own file and of another one: 4 + 10 + 100 + 1000."""


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory, numba_programs: NumbaPrograms) -> Path:
    """The files, and a cache with their kernel."""
    folder = tmp_path_factory.mktemp("stale")
    write(folder)
    done = numba_programs.run(folder / "program.py", cache=folder / "cache", env=NO_BYTECODE)
    assert done.stdout.split() == ["1114.0", "0"], done.stderr
    return folder


def write(folder: Path, change: tuple[str, str, str] | None = None) -> None:
    (folder / "others").mkdir(exist_ok=True)
    for name, text in FILES.items():
        if change is not None and name == change[0]:
            assert change[1] in text
            text = text.replace(*change[1:])
        (folder / name).write_text(text, encoding="utf-8")


@pytest.fixture
def after(compiled: Path, tmp_path: Path, numba_programs: NumbaPrograms) -> Callable[..., list[str]]:
    """What the program prints after a change, with the cache from before: the number, and kernels from the cache."""

    def run(*change: str) -> list[str]:
        shutil.copytree(compiled / "cache", tmp_path / "cache")
        write(compiled, change or None)  # type: ignore[arg-type]
        try:
            done = numba_programs.run(compiled / "program.py", cache=tmp_path / "cache", env=NO_BYTECODE)
        finally:
            write(compiled)
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    return run


def test_what_is_unchanged_comes_from_the_cache(after: Callable[..., list[str]]) -> None:
    assert after() == ["1114.0", "1"]


@pytest.mark.parametrize(
    ("change", "number"),
    [
        (("program.py", "OWN = 1.0", "OWN = 2.0"), "1116.0"),
        (("program.py", "return x + OWN", "return x - OWN"), "1110.0"),
        (("others/parts.py", "return 2.0 * x", "return 3.0 * x"), "1116.0"),
        (("others/parts.py", "return 10.0", "return 20.0"), "1124.0"),
        (("others/parts.py", "K = 100.0", "K = 200.0"), "1214.0"),
        (("others/parts.py", "LESS = 1000", "LESS = 2000"), "2114.0"),
        (("others/parts.py", "0j", "7j"), "1121.0"),
    ],
)
def test_what_has_changed_is_compiled_again(
    change: tuple[str, str, str], number: str, after: Callable[..., list[str]]
) -> None:
    assert after(*change) == [number, "0"]
