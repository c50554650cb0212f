"""``core.whole_kernels``: the passes of Numba that it leaves out."""

from __future__ import annotations

import gc
import io
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core import ir
from numba.core.typed_passes import InlineOverloads, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables

from vibroswarm import preset, simulate
from vibroswarm.core import whole_kernels
from vibroswarm.core.jit import PLAIN
from vibroswarm.inference.closed_loop import record_samples
from vibroswarm.motion.event.engine import events

pytestmark = [
    pytest.mark.skipif(PLAIN, reason="nothing is compiled"),
    pytest.mark.skipif(
        not whole_kernels.is_known(), reason="no passes are left out with this version of Numba"
    ),
]


def watched(patches: pytest.MonkeyPatch) -> dict[type, dict[str, bool]]:
    """For each pass that is left out, the functions for which it runs, and whether it changes them."""
    seen: dict[type, dict[str, bool]] = {each: {} for each in whole_kernels.IDLE}
    run = whole_kernels._Passes._runPass

    def compared(self: Any, index: int, each: Any, state: Any) -> None:
        if type(each) not in seen:
            return run(self, index, each, state)
        before = instructions(state)
        run(self, index, each, state)
        seen[type(each)][state.func_id.func_name] = instructions(state) != before

    patches.setattr(whole_kernels._Passes, "_runPass", compared)
    return seen


@pytest.fixture
def changes(monkeypatch: pytest.MonkeyPatch) -> dict[type, dict[str, bool]]:
    return watched(monkeypatch)


def instructions(state: Any) -> str:
    """What a function is so far, in Numba's form."""
    if state.func_ir is None:
        return ""
    text = io.StringIO()
    state.func_ir.dump(text)
    return text.getvalue()


def compiled(function: Callable[..., Any], signature: tuple[Any, ...], nrt: bool = False) -> None:
    """Compile a function again, with everything that it calls."""
    whole_kernels.declare(function, True, _nrt=nrt).compile(signature)


OURS = """
from test_whole_kernels import changed_of_ours

print(changed_of_ours())
"""


def changed_of_ours() -> dict[str, list[str]]:
    """Compile the kernel of motion again with all passes; return the functions that each of ``IDLE`` changed.

    It needs a process of its own, in which no function that the kernel calls has been compiled before.
    """
    kernel: Any = events
    with pytest.MonkeyPatch.context() as patches:
        seen = watched(patches)
        patches.setattr(whole_kernels, "is_ours", lambda module: False)
        # This compiles the kernel already if it is not in the cache.
        simulate(preset("paper").with_values({"run.t_end_s": 60.0}), 1)
        for signature in kernel.signatures:
            compiled(kernel.py_func, signature)
    assert all(len(functions) > 50 for functions in seen.values()), seen
    return {each.__name__: [name for name in names if names[name]] for each, names in seen.items()}


@pytest.mark.slow
@pytest.mark.long
def test_they_change_none_of_our_functions() -> None:
    here = Path(__file__)
    done = subprocess.run(
        [sys.executable, "-c", OURS], env=os.environ | {"PYTHONPATH": f"{here.parent}{os.pathsep}{here.parents[1]}"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stdout == f"{ {each.__name__: [] for each in whole_kernels.IDLE} }\n", done.stderr


def whole_arrays(values: Any) -> Any:
    return values * 2.0 + 1.0


def closes(x: float) -> Any:
    def inner(y: float) -> float:
        return y + x

    return inner(2.0)


@numba.njit(inline="always")
def taken_in(x: float) -> float:
    return x + 1.0


def calls(x: float) -> float:
    return taken_in(x) * 2.0


@pytest.mark.parametrize(
    ("function", "argument", "changed"),
    [
        (whole_arrays, numba.float64[::1], NopythonRewrites),
        (closes, numba.float64, InlineClosureLikes),
        (calls, numba.float64, InlineInlinables),
    ],
)
def test_they_change_functions_of_users(
    function: Callable[..., Any], argument: Any, changed: type, changes: dict[type, dict[str, bool]]
) -> None:
    compiled(function, (argument,), nrt=True)
    found = {each: functions.get(function.__name__) for each, functions in changes.items()}
    assert found[changed], "as seen by the comparison"
    assert None not in found.values(), "none is left out"
    assert found[InlineOverloads] is False


def test_they_are_left_out_of_our_functions(changes: dict[type, dict[str, bool]]) -> None:
    simulate(preset("paper").with_values({"run.t_end_s": 60.0, "run.stop": "all_decided"}), 1)
    for functions in changes.values():
        functions.clear()  # generated kernels too, where none was in the cache
    kernel: Any = record_samples
    compiled(kernel.py_func, kernel.signatures[0])
    assert not any(changes.values())


def doubled(x: float) -> float:
    return 2.0 * x


twice = whole_kernels.declare(doubled, from_python=False, _nrt=False, forceinline=True)


def four_times(x: float) -> float:
    return float(twice(twice(x)))


def test_numbas_form_of_a_function_is_freed_once_it_is_compiled() -> None:
    """Else looking for garbage takes longer with each kernel, and cached kernels hold texts that nobody reads."""
    kernel = whole_kernels.declare(four_times, from_python=True, _nrt=False)
    kernel.compile((numba.float64,))
    (found,) = kernel.overloads.values()
    found._reduce()  # as it is cached, for which Numba frees its part
    gc.collect()
    code = (doubled.__code__, four_times.__code__)
    lines = {line for one in code for *_, line in one.co_lines()}
    forms = [each.loc for each in gc.get_objects() if type(each) is ir.Expr]
    assert [loc for loc in forms if loc.filename == __file__ and loc.line in lines] == []
    assert found.type_annotation is None
    assert kernel(3.0) == 12.0


PRINTS = """
from vibroswarm.core.jit import inner, kernel

@inner
def shown(k):
    print("sample", k)
    return k

@kernel
def work(n):
    return shown(n)

work(3)
"""


def test_functions_that_a_kernel_calls_print_as_soon_as_they_are_compiled(tmp_path: Path) -> None:
    """As users do in a strategy; it once stopped for ever, and only a kernel from the cache printed."""
    (tmp_path / "prints.py").write_text(PRINTS)
    env = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "prints.py"]
    for _ in range(2):  # compiled, and from the cache
        done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=60)
        assert done.stdout == "sample 3\n", done.stderr


def test_a_relative_cache_folder_is_ignored(tmp_path: Path) -> None:
    """As its standard says; it was made in the working folder."""
    env = os.environ | {"XDG_CACHE_HOME": "cache", "HOME": str(tmp_path / "home")}
    command = [sys.executable, "-c", "from vibroswarm.core.jit import cache_folder; cache_folder()"]
    subprocess.run(command, cwd=tmp_path, env=env, check=True, timeout=60)
    assert not (tmp_path / "cache").exists()
