"""Saved runs are simulated again and compared; a changed number is seen."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest
from vibroswarm.search.verify import verify

from vibroswarm import Result, Study, preset, simulate
from vibroswarm.cli import main
from vibroswarm.search import verify as module
from vibroswarm.study.batch import Task, simulate_runs

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verify") / "result"
    simulate(SHORT, 3, 4, poses=True).write(folder)
    return folder


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verify") / "study"
    Study.of(SHORT, 6, 5, strategy__name=["none", "soft"]).run(folder)
    return folder


@pytest.mark.parametrize(("table", "column"), [("robots", "belief_below"), ("motion", "time_s")])
def test_one_bit_is_seen(tmp_path: Path, result: Path, table: str, column: str) -> None:
    """Negative control: the last bit of one number of one run is changed."""
    read = Result.read(result)
    frame: pl.DataFrame = getattr(read, table)
    values = frame[column].to_numpy().copy()
    place = int((frame["run"] == 2).arg_true()[0])
    values.view("uint64")[place] ^= 1
    changed = frame.with_columns(pl.Series(column, values))
    object.__setattr__(read, table, changed)
    read.write(tmp_path / "changed")
    found = verify(tmp_path / "changed")
    assert not found.holds
    assert found.runs.filter(~found.runs["same"]).rows() == [("", 2, False, table)]


def test_a_study_is_the_same_and_a_sample_says_how_sure_that_is(study: Path) -> None:
    assert verify(study).runs.height == 12
    some = verify(study, 5, seed=2)
    assert (some.runs.height, some.saved, some.holds) == (5, 12, True)
    assert some.share_that_differs.high == pytest.approx(0.434, abs=1e-3)  # Wilson, 0 of 5
    assert set(some.runs["cell"]) <= {"none", "soft"}


def test_other_runs_are_seen(
    study: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Negative control: runs of another seed."""

    def with_another_seed(task: Task) -> pl.DataFrame:
        return simulate_runs(task._replace(seed=task.seed + 1))

    monkeypatch.setattr(module, "simulate_runs", with_another_seed)
    assert main(["verify", str(study), "--runs", "3", "--json"]) == 1
    assert len(json.loads(capsys.readouterr().out)["tables"]["differing"]) == 3
