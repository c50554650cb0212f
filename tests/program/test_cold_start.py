"""The first run of all, with nothing compiled yet."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import vibroswarm
from helpers.hostile_files import executed, hostile_folder
from vibroswarm.cli.background_compile import COMMAND
from vibroswarm.core.jit import PLAIN

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PLAIN or sys.platform == "win32", reason="nothing is compiled, or no signals"),
]
RUN = ["-m", "vibroswarm", "run", "--json", "--set", "run.t_end_s=30"]
PROCESSORS = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def started(cache: Path, *arguments: str) -> subprocess.Popen[str]:
    """In a working folder with hostile files (``nothing_hostile_ran``)."""
    source = str(Path(vibroswarm.__file__).parents[1])
    return subprocess.Popen(
        [sys.executable, "-P", *arguments],
        cwd=cache / "working folder",
        env=os.environ | {"XDG_CACHE_HOME": str(cache), "HOME": str(cache), "PYTHONPATH": source},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def other_processes(parent: int) -> list[int]:
    """Processes that ``parent`` started and that compile."""
    command = ["ps", "-A", "-ww", "-o", "pid=,ppid=,args="]  # ww: else rows may be cut after 80 letters
    listed = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = [line.split(None, 2) for line in listed.stdout.splitlines()]
    return [int(pid) for pid, of, *rest in rows if int(of) == parent and COMMAND in " ".join(rest)]


def until_it_compiles(process: subprocess.Popen[str]) -> list[int]:
    """Wait for the line that says so; gives the processes that help: one, or none where one processor is all."""
    assert process.stderr is not None
    assert "compiling the engine" in process.stderr.readline()
    others = other_processes(process.pid)
    assert len(others) == (1 if PROCESSORS >= 2 else 0)
    return others


@pytest.mark.long
def test_without_the_other_process_the_first_run_gives_what_later_ones_give(tmp_path):
    first = started(tmp_path, *RUN)
    for pid in until_it_compiles(first):
        os.kill(pid, signal.SIGKILL)
    out, err = first.communicate(timeout=600)
    assert first.returncode == 0, err
    kept = set(tmp_path.rglob("*.nbc"))
    names = {p.name.split("-")[0] for p in kept}
    assert {"engine.events", "observe.read_samples"} <= names
    generated = [p for p in kept if p.parent.name.startswith("none_ideal_")]
    assert any(p.name.startswith("replay_counts.replay-") for p in generated)
    again = started(tmp_path, *RUN)
    assert again.communicate(timeout=600) == (out, ""), "the same, and nothing compiled"

    # What the other process would have compiled is what this one did: nothing new comes.
    other = started(tmp_path, "-c", COMMAND.replace("end_with_parent();", ""))
    assert other.communicate(timeout=600) == ("", "")
    assert other.returncode == 0
    assert set(tmp_path.rglob("*.nbc")) == kept
    assert not [path for path in tmp_path.rglob("*") if ".tmp." in path.name], "nothing half-written"


@pytest.fixture(autouse=True)
def nothing_hostile_ran(tmp_path):
    """The process that compiles beside the first one executes no file of the working folder."""
    folder = hostile_folder(tmp_path)
    yield
    assert executed(folder) == []
