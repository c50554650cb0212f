"""Processes that were forked fail in words where they would hang, and work where they can."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import vibroswarm

ROOT = Path(__file__).parents[2]
STUDY = "runs = 4\n[scenario]\nrun = { t_end_s = 60 }\n[grid]\n'strategy.name' = ['none', 'soft']\n"
LONGEST_S = 120.0
"""What hangs is ended after this."""


def script(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "script.py").write_text(text, encoding="utf-8")
    env = os.environ | {"PYTHONPATH": str(Path(vibroswarm.__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "script.py"], cwd=folder, env=env, capture_output=True, text=True, timeout=LONGEST_S
    )


def of_the_documentation() -> str:
    text = (ROOT / "docs" / "cluster.md").read_text(encoding="utf-8")
    (block,) = re.findall(
        r"^```python\n(.*?ProcessPoolExecutor.*?)^```$", text, flags=re.DOTALL | re.MULTILINE
    )
    return str(block).replace("(8,", "(1,")


@pytest.mark.slow
def test_the_documentations_pool_of_processes_ends(tmp_path: Path) -> None:
    done = script(tmp_path, of_the_documentation() + "    print(result.runs().height)\n")
    assert done.stdout.split() == ["8"], done.stderr


needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="nothing can be forked")


@needs_fork
def test_a_pool_of_forked_processes_fails_in_words(tmp_path: Path) -> None:
    forked = of_the_documentation().replace('"spawn"', '"fork"')
    begins = (
        "import polars as pl\n\npl.DataFrame({'a': [2, 1]}).sort('a')\n"  # else by chance, before or after
    )
    forked = forked.replace("if __name__", begins + "if __name__")
    assert 'get_context("fork")' in forked
    done = script(tmp_path, forked)
    assert done.returncode == 1
    assert "RunError: this process was forked after polars" in done.stderr
    assert "get_context('spawn')" in done.stderr


CHILDREN = """
import os
import sys

from vibroswarm import preset, simulate, verdict
from vibroswarm.errors import RunError

scenario = preset("paper")
# Robots that report an estimate, and a floor that changes.
reporting = scenario.with_values({"strategy.name": "mcp", "change.at_s": 300.0, "change.to": "invert"})


def outcome(act):
    child = os.fork()
    if child == 0:
        try:
            act()
        except RunError as error:
            os._exit(3 if "spawn" in str(error) else 4)
        except BaseException:
            os._exit(5)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def write():
    simulate(scenario, seed=8).write("out", replace=True)


def grandchild():
    if outcome(lambda: verdict(simulate(scenario, seed=8))):
        raise RunError("spawn")


def outcomes():
    return [
        outcome(lambda: simulate(scenario, seed=8)),
        outcome(lambda: verdict(simulate(scenario, seed=8))),
        outcome(lambda: simulate(reporting, seed=8)),
        outcome(lambda: simulate(scenario, seed=8, progress=lambda share: None)),
        outcome(write),
        outcome(grandchild),
    ]


print(*outcomes())
verdict(simulate(scenario, seed=7))
print(*outcomes())
"""


@pytest.mark.slow
@needs_fork
@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads cannot be seen")
def test_what_works_after_a_fork_is_not_refused(tmp_path: Path) -> None:
    """Without polars' threads all works; with them, what needs none of them."""
    assert script(tmp_path, CHILDREN).stdout.splitlines() == ["0 0 0 0 0 0", "0 3 0 3 3 3"]
