"""Tasks and sources of motion from outside the package, through the whole program."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm import preset, tasks
from vibroswarm.cli import main
from vibroswarm.motion import source
from vibroswarm.result import Result
from vibroswarm.scenario import plugins
from vibroswarm.simulation import simulate
from vibroswarm.study.spec import Study

SHORT = ("--set", "run.t_end_s=200", "--set", "decision.min_observations=10")
HALVES = '''"""Does the left part of the floor vibrate more than the right?"""

from typing import Annotated

from pydantic import Field

from vibroswarm.tasks import Task


class Params:
    columns: Annotated[int, Field(ge=1)] = 2


def truth(floor, asked, p):
    left, right = (half.sum() for half in (floor.tiles[:, : p.columns], floor.tiles[:, -p.columns :]))
    return None if left == right else int(left > right)


halves = Task(name="halves", truth=truth, params=Params, answers=("it is the right", "it is the left"))
'''
STANDING = '''"""Robots that stand in a row, and sample every ten seconds."""

import numpy as np

from vibroswarm.motion.motion_tables import END_ROW, SAMPLE_ROW
from vibroswarm.motion.source import Source


class Standing:
    failure = None

    def __init__(self, scenario, moves):
        self.every, self.robots = round(10.0 / scenario.tick_s), scenario.swarm.robots

    def begin(self, seed, run):
        self.run, self.tick = run, 0

    def rows(self, dtype, **values):
        rows = np.zeros(self.robots, dtype=dtype)
        rows["robot"], rows["x_m"], rows["y_m"] = np.arange(self.robots), 0.1 + 0.1 * np.arange(self.robots), 0.5
        for name, value in values.items():
            rows[name] = value
        return rows

    def advance(self, until, sink):
        for k in range(max(self.tick - 1, 0) // self.every, max(until - 1, 0) // self.every):
            times = {"tick": (k + 1) * self.every, "stop_tick": k * self.every, "stop": self.every}
            sink.samples(self.rows(SAMPLE_ROW, run=self.run, sample=k, **times))
        self.tick = max(self.tick, until)

    def finish(self, sink):
        return self.rows(END_ROW, run=self.run, tick=self.tick, stop_tick=-1)


standing = Source("standing", Standing)
'''


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "halves.py").write_text(HALVES, encoding="utf-8")
    (tmp_path / "standing.py").write_text(STANDING, encoding="utf-8")
    yield tmp_path  # type: ignore[misc]
    as_in_another_process()


def as_in_another_process() -> None:
    """Nothing of these files is known, nor their texts."""
    tasks.base.forget("halves")
    source.forget("standing")
    plugins._texts.clear()


def right_by_hand(result: Result, run: int) -> int | None:
    tiles = np.array(result.floor(run).tiles, dtype=int)
    left, right = int(tiles[:, :2].sum()), int(tiles[:, 3:].sum())
    return None if left == right else int(left > right)


def test_a_task_says_which_decision_is_right(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, task = files / "out", f"{files / 'halves.py'}:halves"
    command = ["run", "--task", task, *SHORT, "--set", "task.halves.columns=2", "--out", str(out)]
    output_of(capsys, *command)
    result = Result.read(out)
    assert (out / "halves.py").read_text(encoding="utf-8") == HALVES
    usual = simulate(
        preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 10}), 1, 30
    )
    other = simulate(usual.scenario.with_values({"task.name": "halves"}), 1, 30)
    assert other.robots.drop("belief_in_truth").equals(usual.robots.drop("belief_in_truth")), (
        "nobody acts otherwise"
    )
    assert other.runs["truth"].to_list() == [right_by_hand(other, run) for run in range(30)]
    assert set(other.runs["truth"].to_list()) == {None, 0, 1}
    assert set(usual.runs["truth"].to_list()) == {0}
    assert result.runs["truth"].to_list() == other.runs["truth"].to_list()[:1]


@pytest.mark.slow
def test_motion_of_a_file(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also in a study that another process continues, if it is trusted."""
    motion, out, study = f"{files / 'standing.py'}:standing", files / "out", str(files / "a study")
    output_of(capsys, "run", "--motion", motion, *SHORT, "--out", out)
    result = Result.read(out)
    assert result.source.startswith("standing.py:standing sha256:")
    assert result.motion["time_s"].unique().to_list() == [10.0 * k for k in range(1, 20)]
    options = ["--no-pictures", "--out", study, "--runs"]
    assert main(["evaluate", "--motion", motion, *SHORT, "--strategy", "none,soft", *options, "8"]) == 0
    as_in_another_process()
    again = ["evaluate", f"{study}/study.toml", *options, "12"]
    assert "is not loaded" in refusal_of(capsys, *again)
    assert main([*again, "--trust", "--executor", "processes", "--workers", "1"]) == 0
    assert [*Study.open(Path(study))[1].there.values()] == [12, 12]
