"""``vibroswarm lab`` and ``vibroswarm calibrate`` as a user meets them, on the recordings that the project ships."""

from __future__ import annotations

import importlib
import json
import re
import runpy
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.recordings.log_readers import read_log
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


def told(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_the_shipped_recordings_are_those_that_the_script_makes(tmp_path):
    runpy.run_path(str(SHIPPED / "make.py"))["make"](tmp_path)
    for made in sorted(tmp_path.iterdir()):
        # Beliefs have other last bits with another C library, and so may another last digit.
        pairs = zip(
            *(re.split("[ ,\n]", text) for text in (made.read_text(), (SHIPPED / made.name).read_text())),
            strict=True,
        )
        for one, other in pairs:
            assert one == other or abs(float(one) - float(other)) < 2e-6, made.name


def test_a_recording_is_a_folder_like_any_result(kept):
    names = {path.name for path in kept.iterdir()}
    assert {"run-1.html", "run-2.html", "run-1.png", "scenario.toml", "vibroswarm.json"} <= names
    assert Result.read(kept).seed is None
    assert Recording.read(kept).names == (1, 2, 3, 4, 5)
    page = (kept / "run-2.html").read_text(encoding="utf-8")
    assert "session-2.csv" in page


@pytest.mark.usefixtures("empty_pictures")
def test_what_is_told_of_an_import(tmp_path, capsys):
    log = str(SHIPPED / "session-1.csv")
    arguments = ["lab", "import", log, *FLOOR, "--out", str(tmp_path / "a")]
    assert main([*arguments, "--set", "sensor.rms_threshold=1.0", "--json"]) == 0
    about = told(capsys)
    assert about["made_by"]["stated"].startswith("sensor.rms_threshold")
    counts = {one["name"]: one["count"] for one in about["tables"]["counts"] if one["session"] == 1}
    assert counts["samples"] == 181
    assert Recording.read(tmp_path / "a").scenario.sensor.rms_threshold == 1.0  # what is stated goes first
    assert main([*arguments, "--force", "--set", "sensor.rms_threshold=1.0"]) == 0
    said = capsys.readouterr().out
    assert "(stated: 1.0, WHICH DOES NOT FIT)" in said
    assert "The floor fits" in said


@pytest.mark.usefixtures("empty_pictures")
def test_a_csv_of_ones_own(tmp_path, capsys):
    arguments = [str(SHIPPED / "camera.csv"), "--columns", str(SHIPPED / "columns.toml"), *FLOOR]
    assert main(["lab", "import", *arguments, "--out", str(tmp_path / "mine")]) == 0
    said = capsys.readouterr().out
    assert "decisions, beliefs or numbers of messages sent are not logged" in " ".join(said.split())
    assert "which 38.7 % of the energies exceed" in " ".join(
        said.split()
    )  # by the preset's threshold, a guess
    page = (tmp_path / "mine" / "run.html").read_text(encoding="utf-8")
    assert "beliefs replayed at an unknown threshold, not logged" in page
    known = [*arguments, "--set", "sensor.rms_threshold=1.33", "--out", str(tmp_path / "known")]
    assert main(["lab", "import", *known]) == 0
    assert "threshold of these robots" not in capsys.readouterr().out
    assert "beliefs replayed, not logged" in (tmp_path / "known" / "run.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("empty_pictures")
def test_a_log_of_messages_without_posteriors_is_read_again(tmp_path, capsys):
    head, *rows = (SHIPPED / "camera.csv").read_text().splitlines()
    log, columns = tmp_path / "log.csv", tmp_path / "columns.toml"
    log.write_text("\n".join([f"{head},recv", *(f"{row},{k // 5}" for k, row in enumerate(rows))]))
    columns.write_text((SHIPPED / "columns.toml").read_text() + 'messages_received = "recv"\n')
    arguments = [str(log), "--columns", str(columns), *FLOOR, "--out", str(tmp_path / "mine")]
    assert main(["lab", "import", *arguments]) == 0
    robots = Recording.read(tmp_path / "mine").robots
    assert robots["messages_received"].null_count() == 0
    assert robots["alpha"].null_count() == robots.height
    for command in (["show"], ["lab", "replay", "--draws", "2"], ["lab", "threshold"], ["lab", "export"]):
        more = ["--format", "csv", "--out", str(tmp_path / "tables")] if "export" in command else []
        assert main([*command, str(tmp_path / "mine"), *more]) == 0, command
    capsys.readouterr()


def test_replay(kept, capsys):
    assert (
        main(["lab", "replay", str(kept), "--gate", "own", "--set", "rms_threshold=1.4", "--draws", "5"]) == 0
    )
    said = capsys.readouterr().out
    assert "rms_threshold 1.4" in said
    assert said.count("as logged") == 2
    assert main(["lab", "replay", str(kept), "--strategy", "soft", "--draws", "3", "--json"]) == 0
    about = told(capsys)
    assert [(one["strategy"], one["session"]) for one in about["tables"]["replayed"]] == [
        ("soft", 1),
        ("soft", 2),
    ]


@pytest.mark.usefixtures("empty_pictures")
def test_a_log_without_decisions_is_replayed(kept, tmp_path, capsys):
    """A CSV with bits sent and messages received, but no decisions: what was logged is shown as unknown."""
    log = read_log(SHIPPED / "session-1.csv")
    uses = ("robot", "time_s", "x_m", "y_m", "energy", "sent", "messages_received")
    log.samples.select(uses).write_csv(tmp_path / "mine.csv")
    (tmp_path / "map.toml").write_text("[columns]\n" + "".join(f'{use} = "{use}"\n' for use in uses))
    arguments = [str(tmp_path / "mine.csv"), "--columns", str(tmp_path / "map.toml"), *FLOOR]
    assert main(["lab", "import", *arguments, "--out", str(tmp_path / "mine")]) == 0
    command = ["lab", "replay", str(tmp_path / "mine"), "--strategy", "none", "--draws", "2"]
    capsys.readouterr()
    assert main([*command, "--json"]) == 0
    about = told(capsys)
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
    assert main(command) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if "as logged" in line)
    assert row.split() == ["1", "as", "logged", "-", "-", "-", "-"]


def test_threshold(kept, capsys):
    assert main(["lab", "threshold", str(kept), "--costs", "1:3", "--at", "1.33"]) == 0
    said = capsys.readouterr().out
    assert all(
        word in said
        for word in ("equal error", "least error", "costs 1 to 3", "theta_E = 1.330 (given)", "in use")
    )
    assert main(["lab", "threshold", str(kept), "--json"]) == 0
    found = told(capsys)["tables"]
    assert [row["rule"] for row in found["thresholds"]] == ["equal error", "least error", "in use"]
    assert found["edge_profile"][-1]["to_m"] is None


UNITS = ("robot", "time_s", "x_m", "y_m", "energy")


def imported_with(tmp_path, energy):
    """Import the first session of the example with energies made of its own, and without bits."""
    samples = read_log(SHIPPED / "session-1.csv").samples.select(UNITS)
    samples.with_columns(energy=energy).write_csv(tmp_path / "mine.csv")
    (tmp_path / "map.toml").write_text("[columns]\n" + "".join(f'{use} = "{use}"\n' for use in UNITS))
    arguments = [str(tmp_path / "mine.csv"), "--columns", str(tmp_path / "map.toml"), *FLOOR, "--any-floor"]
    assert main(["lab", "import", *arguments, "--out", str(tmp_path / "mine")]) == 0
    return tmp_path / "mine"


@pytest.mark.usefixtures("empty_pictures")
def test_a_threshold_of_small_energies_keeps_its_digits(tmp_path, capsys):
    mine, out = imported_with(tmp_path, pl.col("energy") * 1e-6), tmp_path / "threshold.toml"
    assert main(["lab", "threshold", str(mine), "--out", str(out)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(r"Use theta_E = 0\.00000\d{4} \[", said)
    assert "at the 1.330 of the scenario 0.0 % and 100.0 %" in said  # not "in use": nobody said so
    assert "0.0 % No: vibrating tiles do not read as vibrating more often than still ones." in said
    assert 1e-7 < Scenario.read(out).sensor.rms_threshold < 1e-5
    assert main(["lab", "threshold", str(mine), "--law", str(tmp_path / "law.toml")]) == 0
    sensor = Scenario.read(tmp_path / "law.toml").sensor
    mean = sensor.vibrating_location + sensor.vibrating_shape * sensor.vibrating_scale
    assert 1e-6 < mean < 4e-6


@pytest.mark.usefixtures("empty_pictures")
def test_energies_that_tell_nothing_are_warned_of(tmp_path, capsys):
    mine = imported_with(tmp_path, pl.lit(1.0))
    capsys.readouterr()
    assert main(["lab", "threshold", str(mine)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "energies do not tell them apart" in said
    assert "No: vibrating tiles do not read" in said
    assert "it can be decided" not in said


@pytest.mark.parametrize(
    ("options", "rule"),
    [([], "equal error"), (["--costs", "1:3"], "costs 1 to 3"), (["--at", "1.47"], "given")],
)
def test_a_threshold_reaches_a_scenario(kept, tmp_path, capsys, options, rule):
    out = tmp_path / "with a threshold.toml"
    assert main(["lab", "threshold", str(kept), *options, "--json"]) == 0
    thresholds = {one["rule"]: one["value"] for one in told(capsys)["tables"]["thresholds"]}
    assert main(["lab", "threshold", str(kept), *options, "--out", str(out)]) == 0
    assert f"({rule})" in capsys.readouterr().out
    written = Scenario.read(out)
    assert written.sensor.rms_threshold == pytest.approx(thresholds[rule], abs=0.0005)
    others = Recording.read(kept).scenario.with_values({"sensor.rms_threshold": written.sensor.rms_threshold})
    assert written.hash == others.hash

    assert main(["lab", "threshold", str(kept), *options, "--out", str(out)]) == 2  # not without --force
    assert "exists" in capsys.readouterr().err
    assert (
        main(["lab", "threshold", str(kept), *options, "--out", str(out), "--force", "--base", "text"]) == 0
    )
    based = preset("text").with_values({"sensor.rms_threshold": written.sensor.rms_threshold})
    assert Scenario.read(out).hash == based.hash


@pytest.mark.usefixtures("empty_pictures")
def test_export_and_import_again(kept, tmp_path, capsys):
    assert main(["run", "--set", "run.t_end_s=30", *FLOOR, "--out", str(tmp_path / "made")]) == 0
    for name, suffix in (("rugbot", ".csv"), ("webots", ".txt")):
        log = tmp_path / f"again{suffix}"
        assert main(["lab", "export", str(tmp_path / "made"), "--format", name, "--out", str(log)]) == 0
        assert main(["lab", "import", str(log), *FLOOR, "--any-floor", "--out", str(tmp_path / name)]) == 0
    made, again = Result.read(tmp_path / "made"), Recording.read(tmp_path / "webots")
    late = made.motion.filter(pl.col("time_s") > 5.0)
    assert again.motion.height == late.height
    assert main(["lab", "export", str(kept), "--format", "csv", "--out", str(tmp_path / "tables")]) == 0
    assert (tmp_path / "tables" / "inference.csv").is_file()


@pytest.mark.slow
def test_compare(kept, tmp_path, capsys):
    picture = tmp_path / "side.png"
    assert main(["calibrate", "compare", str(kept), str(kept), "--picture", str(picture), "--json"]) == 0
    found = told(capsys)["tables"]
    assert all(one["as_published"] == pytest.approx(1.0) for one in found["similarities"])
    shares = {one["recognised"]: one["share"] for one in found["told_apart"]}
    assert shares["simulated_by_robot"] < 0.7
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main(["calibrate", "compare", str(kept), str(kept)]) == 0
    assert "ceiling" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("empty_pictures")
def test_a_comparison_has_a_picture_of_each_feature(kept, tmp_path):
    several = tmp_path / "pictures"
    assert main(["calibrate", "compare", str(kept), str(kept), "--pictures", str(several)]) == 0
    names = {"avoidance", "vibrating", "still", "places", "distances", "steps", "together"}
    assert {one.stem for one in several.iterdir()} == names
    picture = tmp_path / "side.png"
    picture.write_bytes(b"")
    assert main(["calibrate", "compare", str(kept), str(kept), "--pictures", str(picture)]) == 2


@pytest.mark.slow
def test_compare_several(kept, tmp_path, capsys):
    """Each column is the comparison with that simulation alone."""
    other = tmp_path / "other"
    assert main(["run", "--set", "run.t_end_s=250", *FLOOR, "--out", str(other)]) == 0
    capsys.readouterr()
    assert main(["calibrate", "compare", str(kept), str(kept), str(other), "--json"]) == 0
    both = told(capsys)["tables"]
    for folder in (kept, other):
        assert main(["calibrate", "compare", str(kept), str(folder), "--json"]) == 0
        for name, rows in told(capsys)["tables"].items():
            of_both = [one for one in both[name] if one["simulated"] == str(folder)]
            assert [{key: one[key] for key in row} for one, row in zip(of_both, rows, strict=True)] == rows
    assert main(["calibrate", "compare", str(kept), str(kept), str(other)]) == 0
    out = capsys.readouterr().out
    assert f"real - {kept.name}" in out
    assert "real - other" in out
    assert main(["calibrate", "compare", str(kept), str(kept), str(kept)]) == 2
    short = tmp_path / "short"
    assert main(["run", "--set", "run.t_end_s=10", *FLOOR, "--out", str(short)]) == 0
    capsys.readouterr()
    assert main(["calibrate", "compare", str(kept), str(other), str(short)]) == 2
    assert f"{short}: cannot be compared with '{kept}': sessions: " in capsys.readouterr().err
    assert main(["calibrate", "compare", str(kept), str(kept), str(other), "--picture", "x.png"]) == 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["lab", "import", "nowhere.csv", *FLOOR, "--out", "x"], "there is no such file"),
        (["lab", "import", "nowhere.csv", "--out", "x"], "on which floor were the robots?"),
        (["lab", "import", "nowhere.csv", "--floor", "random:0.48", "--out", "x"], "is random"),
        (
            ["lab", "import", "x.csv", "--reader", "rugbot", "--columns", "x.toml", *FLOOR, "--out", "x"],
            "--reader: conflicts with --columns",
        ),
        (["lab", "replay", "nowhere"], "is not a recording"),
        (["lab", "threshold", "nowhere", "--costs", "1"], "is not of the form A:B"),
        (["lab", "threshold", "nowhere", "--out", "mine.txt"], "end in .toml"),
        (["lab", "threshold", "nowhere", "--base", "text"], "has no effect without --out"),
        (
            ["lab", "replay", "nowhere", "--strategy", "softly"],
            "unknown strategy 'softly', did you mean 'soft'",
        ),
        (["lab", "export", "nowhere", "--format", "rugbt", "--out", "x"], "did you mean 'rugbot'"),
        (["lab", "export", "nowhere", "--session", "0", "--out", "x"], "--session: 0 is not 1 or more"),
        (["calibrate", "compare", "nowhere", "nowhere"], "is not a run of vibroswarm"),
        (["calibrate", "fit", "nowhere", "--against", "x"], "--against: has no effect without --folds"),
    ],
)
def test_wrong_input_is_said_in_one_line(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_replay_sets_only_what_it_can(kept, capsys):
    assert main(["lab", "replay", str(kept), "--set", "sample_interval_ms=100"]) == 2
    assert "is not a field that a replay can change" in capsys.readouterr().err
    assert main(["lab", "replay", str(kept), "--set", "strategy.name=soft"]) == 2
    assert "--set strategy.name: is set by --strategy" in capsys.readouterr().err
    assert main(["lab", "replay", str(kept), "--gate", "own", "--set", "gate=total"]) == 2
    assert "--set decision.gate: is also set by --gate" in capsys.readouterr().err


@pytest.mark.parametrize("redraw", ["run", "study"])
@pytest.mark.parametrize("task", [["import"], ["track", "--markers", "0,1", "--log"]])
def test_a_recording_has_no_random_floor(task, redraw, tmp_path, capsys):
    random = ["--floor", "random:0.48", "--set", f"floor.redraw={redraw}", "--out", str(tmp_path / "out")]
    if "track" in task:
        pytest.importorskip("cv2")
        (tmp_path / "log.csv").write_text("robot,time_s,energy\n0,1.0,1.5\n1,1.0,0.5\n")
        sizes = ["--marker-size", "40", "--marker-height", "50"]
        line = ["lab", task[0], "v.avi", *task[1:], str(tmp_path / "log.csv"), *sizes]
    else:
        line = ["lab", *task, str(SHIPPED / "session-1.csv")]
    assert main([*line, *random]) == 2
    assert "--floor: is random, but a recording has one floor" in capsys.readouterr().err


def test_too_few_intervals_to_tell_apart_are_said(kept, capsys):
    pytest.importorskip("sklearn")
    assert main(["calibrate", "compare", str(kept), str(kept), "--intervals"]) == 0
    assert "A session has fewer than 200 undisturbed intervals" in " ".join(capsys.readouterr().out.split())


def test_figures(kept, capsys):
    assert main(["calibrate", "figures", str(kept)]) == 0
    assert "speed lost in 1200 s, %" in capsys.readouterr().out
    assert main(["calibrate", "figures", str(kept), str(kept)]) == 2
    assert "names a folder twice" in capsys.readouterr().err
    assert main(["calibrate", "figures", str(kept), "--at", "1.55", "--json"]) == 0
    assert told(capsys)["made_by"]["rms_threshold"] == "1.55"
    assert main(["calibrate", "figures", str(kept), "--at", "high"]) == 2


@pytest.mark.slow
def test_a_fit_is_a_scenario_that_runs(kept, tmp_path, capsys, monkeypatch):
    module = importlib.import_module("vibroswarm.calibrate.fit")
    fitted, fit = [], module.fit
    monkeypatch.setattr(module, "fit", lambda *of, **how: fitted.append(fit(*of, **how)) or fitted[-1])
    out = tmp_path / "mine.toml"
    command = ["calibrate", "fit", str(kept), "--candidates", "200", "--set", "run.t_end_s=120"]
    assert main([*command, "--out", str(out), "--json"]) == 0
    about = told(capsys)
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
    assert main([*command, "--against", str(kept), "--json"]) == 0
    found = told(capsys)["tables"]
    assert [one["session"] for one in found["folds"]] == [0, 1]
    for session in (0, 1):
        scores = [one for one in found["fold_scores"] if one["session"] == session]
        assert len(scores) == 6
        assert all(0 < one["fitted"] <= 1 for one in scores)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--candidates", "12"], "from 200"),
        (["--out", "mine.txt"], ".toml"),
        (["--base", "papr"], "paper"),
        (["--set", "walk.nothing=3"], "no such field"),
    ],
)
def test_a_fit_refuses(kept, capsys, more, words):
    assert main(["calibrate", "fit", str(kept), *more]) == 2
    assert words in capsys.readouterr().err


def test_compare_results_without_samples(tmp_path, capsys):
    tiny = str(tmp_path / "tiny")
    assert main(["run", "--set", "run.t_end_s=0.02", "--out", tiny]) == 0
    assert main(["calibrate", "compare", tiny, tiny]) == 2
    assert "has no samples, and nothing can be compared" in capsys.readouterr().err


def test_a_law_with_its_error_is_a_scenario_and_a_law_for_other_sessions(kept, tmp_path, capsys):
    law = tmp_path / "a law.toml"
    assert main(["lab", "threshold", str(kept), "--law", str(law), "--json"]) == 0
    document = told(capsys)
    fields = {row["field"]: row for row in document["tables"]["law"]}
    written = Scenario.read(law)
    assert len(written.law.sessions) == 2
    assert len(written.law.draws) == 40
    for name in ("vibrating_scale", "still_scale", "edge_reach_m", "tile_spread"):
        row = fields[f"sensor.{name}"]
        assert getattr(written.sensor, name) == row["value"]
        assert row["low"] < row["high"]
        assert row["error"] > 0.0

    assert main(["run", "--scenario", str(law), "--set", "run.t_end_s=60"]) == 0
    capsys.readouterr()
    assert main(["inspect", str(kept), "--laws", str(law)]) == 0
    said = capsys.readouterr().out
    assert "'a law.toml', fitted to 2 sessions on a known floor" in " ".join(said.split())
    assert "The session judges itself" in said
    assert main(["inspect", str(kept)]) == 0  # by the other session
    assert "judges itself" not in capsys.readouterr().out

    assert main(["lab", "threshold", str(kept), "--law", str(law)]) == 2  # not without --force
    assert "exists" in capsys.readouterr().err
    assert main(["lab", "threshold", str(kept), "--law", str(law), "--out", str(law), "--force"]) == 2
    assert "also the file of --out" in capsys.readouterr().err


def test_sessions_are_judged_by_the_threshold_of_the_others(kept, tmp_path, capsys):
    assert main(["lab", "threshold", str(kept), "--json"]) == 0
    document = told(capsys)
    assert [row["session"] for row in document["tables"]["unseen"]] == [1, 2]
    assert not document["warnings"]
    one = tmp_path / "one"
    assert main(["lab", "import", str(SHIPPED / "session-1.csv"), *FLOOR, "--out", str(one)]) == 0
    capsys.readouterr()
    assert main(["lab", "threshold", str(one)]) == 0
    assert "judges itself" in capsys.readouterr().out


@pytest.mark.usefixtures("empty_pictures")
def test_places_are_replayed_with_the_law_of_a_file(kept, tmp_path, capsys):
    law = tmp_path / "law.toml"
    law.write_text(preset("calibrated").with_values({"law.sessions": ("0123456789abcdef",)}).to_toml())
    given = ["lab", "replay", str(kept), "--strategy", "none,places,field", "--draws", "3"]
    assert main([*given, "--laws", str(law), "--set", "min_observations=0"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "as if robots knew where the camera saw them" in said
    assert "upper bound" in said
    assert "judges itself" not in said
    assert main(["lab", "replay", str(kept), "--strategy", "explore"]) == 2
    assert "steers its robots" in capsys.readouterr().err
    assert main(["lab", "replay", str(kept), "--laws", str(tmp_path / "none.toml")]) == 2


@pytest.mark.usefixtures("empty_pictures")
def test_a_log_that_is_given_twice_is_warned_of(tmp_path, capsys):
    log = str(SHIPPED / "session-1.csv")
    copy = tmp_path / "copy.csv"
    copy.write_bytes(Path(log).read_bytes())
    for second in (log, str(copy)):
        assert main(["lab", "import", log, second, *FLOOR, "--out", str(tmp_path / "lab"), "--force"]) == 0
        assert f"Warning: '{second}' is '{log}' again" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("stated", [[], ["--set", "robot.battery_life_s=20000"]])
def test_a_session_may_be_longer_than_the_battery_of_a_preset(tmp_path, stated):
    """That of the presets lasts 8400 s, in a simulation."""
    uses = ("robot", "time_s", "x_m", "y_m", "energy")
    rows = "".join(f"{k % 2},{5 * k},0.5,0.5,1.0\n" for k in range(1, 1800))
    (tmp_path / "long.csv").write_text(",".join(uses) + "\n" + rows)
    (tmp_path / "map.toml").write_text("[columns]\n" + "".join(f'{use} = "{use}"\n' for use in uses))
    log = [str(tmp_path / "long.csv"), "--columns", str(tmp_path / "map.toml"), *FLOOR, "--any-floor"]
    assert main(["lab", "import", *log, *stated, "--out", str(tmp_path / "lab")]) == 0
    assert Recording.read(tmp_path / "lab").scenario.robot.battery_life_s == (20000.0 if stated else 8996.0)


@pytest.mark.parametrize(
    ("format", "session", "words"),
    [
        ("rugbot", "3", "--session: there is no session 3; there are 1 to 2"),
        ("csv", "2", "--session: has no effect with --format csv"),
    ],
)
def test_a_session_that_is_not_written_is_refused_by_its_option(
    kept, tmp_path, capsys, format, session, words
):
    out = str(tmp_path / "out")
    assert main(["lab", "export", str(kept), "--format", format, "--session", session, "--out", out]) == 2
    assert words in capsys.readouterr().err
