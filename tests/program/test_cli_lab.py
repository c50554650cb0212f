"""``vibroswarm lab`` and ``vibroswarm calibrate`` as a user meets them, on the recordings that the project ships."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of
from vibroswarm.cli import main
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

SHIPPED = Path(__file__).parents[2] / "examples" / "lab"
FLOOR = ["--floor", str(SHIPPED / "floor.txt")]


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("lab") / "kept"
    logs = [str(SHIPPED / f"session-{k}.csv") for k in (1, 2)]
    assert main(["lab", "import", *logs, *FLOOR, "--out", str(out)]) == 0
    return out


def test_a_recording_is_a_folder_like_any_result(kept):
    names = {path.name for path in kept.iterdir()}
    assert {"run-1.html", "run-2.html", "scenario.toml", "vibroswarm.json"} <= names
    assert Result.read(kept).seed is None
    assert Recording.read(kept).names == (1, 2, 3, 4, 5)
    page = (kept / "run-2.html").read_text(encoding="utf-8")
    assert "session-2.csv" in page


def test_a_log_without_decisions_is_replayed(tmp_path, capsys):
    """A CSV with bits sent and messages received, but no decisions: what was logged is shown as unknown."""
    names = ("robot", "time_s", "x_m", "y_m", "energy", "sent", "messages_received")
    read_log(SHIPPED / "session-1.csv").samples.select(names).write_csv(tmp_path / "mine.csv")
    arguments = [str(tmp_path / "mine.csv"), *FLOOR, "--any-floor", "--out", str(tmp_path / "mine")]
    assert main(["lab", "import", *arguments]) == 0
    command = ["lab", "replay", str(tmp_path / "mine"), "--strategy", "none", "--draws", "2"]
    as_logged, replayed = json_of(capsys, *command, "--json")["tables"]["sessions"]
    assert as_logged["undecided"] is None
    assert replayed["undecided"] is not None


@pytest.mark.parametrize(("options", "rule"), [([], "equal error"), (["--at", "1.47"], "given")])
def test_a_threshold_reaches_a_scenario(kept, tmp_path, capsys, options, rule):
    out = tmp_path / "with a threshold.toml"
    found = json_of(capsys, "lab", "threshold", kept, *options, "--json")["tables"]["thresholds"]
    thresholds = {one["rule"]: one["theta"] for one in found}
    assert main(["lab", "threshold", str(kept), *options, "--out", str(out)]) == 0
    written = Scenario.read(out)
    assert written.sensor.rms_threshold == pytest.approx(thresholds[rule], abs=0.0005)
    others = Recording.read(kept).scenario.with_values({"sensor.rms_threshold": written.sensor.rms_threshold})
    assert written.hash == others.hash


def test_export(kept, tmp_path):
    assert main(["lab", "export", str(kept), "--out", str(tmp_path / "tables")]) == 0
    assert pl.read_csv(tmp_path / "tables" / "motion.csv").height == Result.read(kept).motion.height


@pytest.mark.slow
def test_compare(kept, tmp_path, capsys):
    found = json_of(capsys, "calibrate", "compare", kept, kept, "--out", tmp_path / "out", "--json")["tables"]
    assert all(one["as_published"] == pytest.approx(1.0) for one in found["features"])


@pytest.mark.slow
def test_a_fit_is_a_scenario_that_runs(kept, tmp_path, capsys):
    out = tmp_path / "mine.toml"
    command = ["calibrate", "fit", str(kept), "--candidates", "200", "--set", "run.t_end_s=120", "--folds"]
    found = json_of(capsys, *command, "--out", out, "--json")["tables"]
    made = Scenario.read(out)
    assert made.sensor.rms_threshold == Scenario().sensor.rms_threshold  # what robots are told is the base's
    assert made.run.t_end_s == 120.0
    assert {one["name"] for one in found["estimates"]} >= {"between_m_s", "sensor.edge_reach_m"}
    assert [one["session"] for one in found["scores"]] == [0] * 6 + [1] * 6
    assert all(0 < one["fitted"] <= 1 for one in found["scores"])
    assert main(["run", "--scenario", str(out), "--out", str(tmp_path / "run")]) == 0
