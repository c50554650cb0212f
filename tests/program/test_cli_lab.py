"""``vibroswarm lab`` and ``vibroswarm calibrate`` as a user meets them, on the recordings that the project ships."""

from __future__ import annotations

import importlib
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, output_of, refusal_of
from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, value_of

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
    assert {"run-1.html", "run-2.html", "run-1.png", "scenario.toml", "vibroswarm.json"} <= names
    assert Result.read(kept).seed is None
    assert Recording.read(kept).names == (1, 2, 3, 4, 5)
    page = (kept / "run-2.html").read_text(encoding="utf-8")
    assert "session-2.csv" in page


@pytest.mark.usefixtures("empty_pictures")
def test_a_log_without_decisions_is_replayed(tmp_path, capsys):
    """A CSV with bits sent and messages received, but no decisions: what was logged is shown as unknown."""
    log = read_log(SHIPPED / "session-1.csv").samples.select(*UNITS, "sent", "messages_received")
    command = ["lab", "replay", str(imported(tmp_path, log)), "--strategy", "none", "--draws", "2"]
    about = json_of(capsys, *command, "--json")
    unknown = {
        "decision_time_s",
        "decision_time_low_s",
        "decision_time_high_s",
        "undecided",
        "belief_in_truth",
    }
    (as_logged,) = about["tables"]["as_logged"]
    assert not [name for name in as_logged if name.startswith("consensus")]
    assert {name for name, value in as_logged.items() if value is None} == unknown
    assert about["tables"]["replayed"][0]["undecided"] is not None
    row = next(line for line in output_of(capsys, *command).splitlines() if "as logged" in line)
    assert row.split() == ["1", "as", "logged", "-", "-", "-", "-"]


UNITS = ("robot", "time_s", "x_m", "y_m", "energy")


def imported(tmp_path, samples, *options):
    """Import a table of samples, whose columns have the names of what is read from them; return the folder."""
    samples.write_csv(tmp_path / "mine.csv")
    names = "".join(f'{use} = "{use}"\n' for use in samples.columns)
    (tmp_path / "map.toml").write_text("[columns]\n" + names)
    arguments = [str(tmp_path / "mine.csv"), "--columns", str(tmp_path / "map.toml"), *FLOOR, "--any-floor"]
    assert main(["lab", "import", *arguments, *options, "--out", str(tmp_path / "mine")]) == 0
    return tmp_path / "mine"


@pytest.mark.parametrize(
    ("options", "rule"),
    [([], "equal error"), (["--costs", "1:3"], "costs 1 to 3"), (["--at", "1.47"], "given")],
)
def test_a_threshold_reaches_a_scenario(kept, tmp_path, capsys, options, rule):
    out = tmp_path / "with a threshold.toml"
    thresholds = {
        one["rule"]: one["value"]
        for one in json_of(capsys, "lab", "threshold", kept, *options, "--json")["tables"]["thresholds"]
    }
    assert f"({rule})" in output_of(capsys, "lab", "threshold", kept, *options, "--out", out)
    written = Scenario.read(out)
    assert written.sensor.rms_threshold == pytest.approx(thresholds[rule], abs=0.0005)
    others = Recording.read(kept).scenario.with_values({"sensor.rms_threshold": written.sensor.rms_threshold})
    assert written.hash == others.hash

    # not without --force
    assert "exists" in refusal_of(capsys, "lab", "threshold", kept, *options, "--out", out)
    assert (
        main(["lab", "threshold", str(kept), *options, "--out", str(out), "--force", "--base", "text"]) == 0
    )
    based = preset("text").with_values({"sensor.rms_threshold": written.sensor.rms_threshold})
    assert Scenario.read(out).hash == based.hash


def test_export(kept, tmp_path):
    assert main(["lab", "export", str(kept), "--out", str(tmp_path / "tables")]) == 0
    assert pl.read_csv(tmp_path / "tables" / "motion.csv").height == Result.read(kept).motion.height


@pytest.mark.slow
def test_compare(kept, tmp_path, capsys):
    picture = tmp_path / "side.png"
    found = json_of(capsys, "calibrate", "compare", kept, kept, "--picture", picture, "--json")["tables"]
    assert all(one["as_published"] == pytest.approx(1.0) for one in found["similarities"])
    shares = {one["recognised"]: one["share"] for one in found["told_apart"]}
    assert shares["simulated_by_robot"] < 0.7
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_fit_is_a_scenario_that_runs(kept, tmp_path, capsys, monkeypatch):
    module = importlib.import_module("vibroswarm.calibrate.fit")
    fitted, fit = [], module.fit
    monkeypatch.setattr(module, "fit", lambda *of, **how: fitted.append(fit(*of, **how)) or fitted[-1])
    out = tmp_path / "mine.toml"
    command = ["calibrate", "fit", str(kept), "--candidates", "200", "--set", "run.t_end_s=120"]
    about = json_of(capsys, *command, "--out", out, "--json")
    (fields,) = about["tables"]["fields"]
    made = Scenario.read(out)
    assert made.sensor.rms_threshold == Scenario().sensor.rms_threshold  # what robots are told is the base's
    assert made.run.t_end_s == 120.0
    for name, value in fields.items():
        found = value_of(made, name)
        assert (list(found) if isinstance(found, tuple) else found) == value
    assert {one["name"] for one in about["tables"]["figures"]} >= {
        "veer_rad_s",
        "sensor.edge_reach_m",
        "threshold_mm",
    }
    assert about["made_by"]["motion_runs"] == "240"
    monkeypatch.setattr(
        module, "fit", lambda *of, **how: fitted[-1]
    )  # in words: the same fit, not made again
    assert main(command) == 0
    assert len(fitted) == 1
    assert "What the model lacks" in capsys.readouterr().out
    assert main(["run", "--scenario", str(out), "--out", str(tmp_path / "run")]) == 0


@pytest.mark.slow
def test_folds_judge_on_what_was_held_out(kept, capsys):
    pytest.importorskip("sklearn")
    command = ["calibrate", "fit", str(kept), "--candidates", "200", "--set", "run.t_end_s=120", "--folds"]
    found = json_of(capsys, *command, "--against", kept, "--json")["tables"]
    assert [one["session"] for one in found["folds"]] == [0, 1]
    for session in (0, 1):
        scores = [one for one in found["fold_scores"] if one["session"] == session]
        assert len(scores) == 6
        assert all(0 < one["fitted"] <= 1 for one in scores)
