"""Files of the working folder that have the names of modules are not executed, here or in any process started."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import vibroswarm
from helpers.hostile_files import executed, hostile_folder

SOURCES = Path(vibroswarm.__file__).parents[1]


@pytest.fixture
def hostile(tmp_path):
    return hostile_folder(tmp_path)


def ran(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder, env=os.environ | {"PYTHONPATH": str(SOURCES)},
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert executed(folder) == []
    return done


def test_control_the_files_are_executed_without_the_safe_path(hostile):
    subprocess.run([sys.executable, "-c", "import vibroswarm"], cwd=hostile, capture_output=True, check=False)
    assert executed(hostile)


@pytest.mark.parametrize(
    "words", ["-m vibroswarm floors list", "-mvibroswarm --version", "-Bm vibroswarm --version"]
)
def test_python_m_vibroswarm_leaves_the_working_folder_out(words, hostile):
    """Of these, ``vibroswarm.py`` alone is Python's own choice: ``python -m`` looks for it before we are there."""
    (hostile / "vibroswarm.py").unlink()
    done = ran(hostile, *words.split())
    assert done.returncode == 0, done.stderr


def test_with_p_not_even_a_file_of_our_own_name_is_executed(hostile):
    assert ran(hostile, "-P", "-m", "vibroswarm", "--version").returncode == 0


def test_packages_of_others_keep_their_working_folder(tmp_path):
    """``python -m tool`` of somebody who imports vibroswarm finds its own modules beside it."""
    package = tmp_path / "tool"
    package.mkdir()
    (package / "__init__.py").write_text("import vibroswarm\n")
    (package / "__main__.py").write_text("import beside; print(beside.HERE)\n")
    (tmp_path / "beside.py").write_text("HERE = 1\n")
    done = subprocess.run(
        [sys.executable, "-m", "tool", "-m", "vibroswarm"],
        cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(SOURCES)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "1\n", "")


@pytest.mark.slow
@pytest.mark.parametrize("flag", [["-P"], []])
def test_worker_processes(flag, hostile):
    if not flag:
        (hostile / "vibroswarm.py").unlink()
    done = ran(
        hostile, *flag, "-m", "vibroswarm", "evaluate", "--executor", "processes", "--workers", "1", "--runs", "4",
        "--robots", "2", "--set", "run.t_end_s=30", "--no-pictures",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


SCRIPT = """
from vibroswarm import Study, preset
if __name__ == "__main__":
    short = preset("text").with_values({"run.t_end_s": 20.0, "swarm.robots": 2})
    print(Study.of(short, runs=4, seed=1).run(executor="processes", workers=1).frame.height)
"""


@pytest.mark.slow
def test_worker_processes_of_a_script_elsewhere(hostile, tmp_path):
    script = tmp_path / "scripts" / "study.py"
    script.parent.mkdir()
    script.write_text(SCRIPT)
    done = ran(hostile, str(script))
    assert (done.returncode, done.stdout) == (0, "4\n"), done.stderr


@pytest.mark.slow
def test_a_process_that_cannot_begin_is_not_called_out_of_memory(tmp_path):
    """A script without the guard that ``spawn`` needs fails in each worker process before any work."""
    (tmp_path / "elsewhere").mkdir()
    script = tmp_path / "unguarded.py"
    script.write_text(SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    done = ran(tmp_path / "elsewhere", str(script))
    assert done.returncode == 1
    assert "out of memory" not in done.stderr
