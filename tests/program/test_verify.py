"""Saved runs are simulated again and compared; a changed number is seen."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of
from vibroswarm import Study, preset
from vibroswarm.study import store as module
from vibroswarm.study.batch import Task, simulate_runs
from vibroswarm.study.store import verify

SHORT = preset("paper").with_values({"run.t_end_s": 60.0, "swarm.robots": 2})


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("verify") / "study"
    Study.of(SHORT, 6, 5, strategy__name=["none", "soft"]).run(folder)
    return folder


def test_a_study_is_the_same(study: Path, capsys: pytest.CaptureFixture[str]) -> None:
    some = verify(study.parent, 5, seed=2)
    assert (some.runs.height, some.saved, some.holds) == (5, 12, True)
    assert json_of(capsys, "verify", study, "--json")["answer"][0].startswith("Verified: 12 of 12 runs")


def test_one_bit_is_seen(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: the last bit of one number."""

    def changed(task: Task) -> pl.DataFrame:
        frame = simulate_runs(task)
        name = next(name for name, kind in frame.schema.items() if kind == pl.Float64)
        values = frame[name].to_numpy().copy()
        values.view("uint64")[0] ^= 1
        return frame.with_columns(pl.Series(name, values))

    monkeypatch.setattr(module, "simulate_runs", changed)
    found = verify(study, 3)
    assert not found.holds
    assert all(found.runs["columns"])
