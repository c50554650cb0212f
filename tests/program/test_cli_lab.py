"""``vibroswarm lab`` and ``vibroswarm calibrate`` as a user meets them, on the recordings that the project ships."""

from __future__ import annotations

import importlib
import re
import runpy
from datetime import datetime, timedelta
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, output_of, refusal_of, remarks_of, words_of
from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.core.numbers import percent
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
    about = json_of(capsys, *arguments, "--set", "sensor.rms_threshold=1.0", "--json")
    assert about["made_by"]["stated"].startswith("sensor.rms_threshold")
    counts = {one["name"]: one["count"] for one in about["tables"]["counts"] if one["session"] == 1}
    assert counts["samples"] == 181
    assert Recording.read(tmp_path / "a").scenario.sensor.rms_threshold == 1.0  # what is stated goes first
    said = output_of(capsys, *arguments, "--force", "--set", "sensor.rms_threshold=1.0")
    assert "(stated: 1.0, WHICH DOES NOT FIT)" in said
    assert "The floor fits" in said


@pytest.mark.usefixtures("empty_pictures")
def test_a_csv_of_ones_own(tmp_path, capsys):
    arguments = [str(SHIPPED / "camera.csv"), "--columns", str(SHIPPED / "columns.toml"), *FLOOR]
    said = output_of(capsys, "lab", "import", *arguments, "--out", tmp_path / "mine")
    assert "decisions, beliefs or numbers of messages sent are not logged" in " ".join(said.split())
    assert "which 38.7 % of the energies exceed" in " ".join(
        said.split()
    )  # by the preset's threshold, a guess
    page = (tmp_path / "mine" / "run.html").read_text(encoding="utf-8")
    assert "beliefs replayed at an unknown threshold, not logged" in page
    known = [*arguments, "--set", "sensor.rms_threshold=1.33", "--out", str(tmp_path / "known")]
    assert "threshold of these robots" not in output_of(capsys, "lab", "import", *known)
    assert "beliefs replayed, not logged" in (tmp_path / "known" / "run.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("empty_pictures")
def test_lost_rows_and_a_stated_stop_in_a_log_without_beliefs(tmp_path, capsys):
    """The page of such a log was refused, and tau was less a stop of 1 s whatever stop was stated."""
    rows = pl.read_csv(SHIPPED / "camera.csv")
    rows = rows.with_columns(sends=pl.int_range(pl.len()).over("id"))
    rows.filter(pl.col("sends") != 3).write_csv(tmp_path / "log.csv")
    columns = tmp_path / "columns.toml"
    columns.write_text(
        (SHIPPED / "columns.toml").read_text() + 'sent = "sends"\n[settings]\n"sample.stop_ms" = 600.0\n'
    )
    command = ["lab", "import", tmp_path / "log.csv", "--columns", columns, *FLOOR, "--out", tmp_path / "a"]
    said = " ".join(output_of(capsys, *command).split())
    lost = rows["id"].n_unique()
    assert f"{lost} samples without a row" in said
    assert "less a stop of 0.600 s" in said
    recording = Recording.read(tmp_path / "a")
    assert recording.robots["samples"].sum() == rows.height
    stated = output_of(capsys, *command, "--force", "--set", "sample.stop_ms=700.0")
    assert "less a stop of 0.700 s" in " ".join(stated.split())


@pytest.mark.usefixtures("empty_pictures")
@pytest.mark.parametrize(("sep", "zone"), [("T", "Z"), ("T", ""), (" ", "+02:00")])
def test_times_may_be_timestamps(tmp_path, capsys, sep, zone):
    """Each was refused as no number, though loggers write them."""
    head, *rows = (SHIPPED / "camera.csv").read_text().splitlines()
    begin = datetime(2026, 5, 1, 23, 59)
    stamped = [
        (begin + timedelta(milliseconds=int(t_ms))).isoformat(sep) + f"{zone},{rest}"
        for t_ms, _, rest in (row.partition(",") for row in rows)
    ]
    assert {len(row.partition(",")[0]) for row in stamped} == {
        19 + len(zone),
        26 + len(zone),
    }  # mixed precision
    log = tmp_path / "log.csv"
    log.write_text("\n".join([head, *stamped]))
    command = [
        "lab",
        "import",
        str(log),
        "--columns",
        str(SHIPPED / "columns.toml"),
        *FLOOR,
        "--out",
        "{out}",
    ]
    assert main([word.format(out=tmp_path / "stamped") for word in command]) == 0
    times_s = Recording.read(tmp_path / "stamped").motion["time_s"].sort()
    assert times_s.to_numpy() == pytest.approx(sorted((int(row.split(",")[0]) - 3040) / 1000 for row in rows))
    other = "" if zone else "Z"
    for wrong in (
        f"2026-05-01T23:59:05{other}",
        f"2026-02-30T10:00:00{zone}",
        f"2026-05-01T23:59:60{zone}",
        "7",
    ):
        stamped[5] = ",".join([wrong, rows[5].partition(",")[2]])
        log.write_text("\n".join([head, *stamped]))
        refusal = refusal_of(capsys, *command)
        assert f"log.csv, row 7: '{wrong}' in column 't_ms' is not a time such as 2026-05-01T10" in refusal
    stamped[5] = ",".join([f"2027-05-01T23:59:05{zone}", rows[5].partition(",")[2]])
    log.write_text("\n".join(["", head, *stamped]))
    refusal = refusal_of(capsys, *command)
    assert (
        f"log.csv, row 8: '2027-05-01T23:59:05{zone}' in column 't_ms' is more than 10000000 s after"
        in refusal
    )
    log.write_text("\n".join([head, *stamped[:5]]))
    refusal = refusal_of(capsys, *command, "--acceleration", str(log))
    assert "times have to be those of the acceleration: numbers, not timestamps" in refusal


@pytest.mark.usefixtures("empty_pictures")
def test_a_log_of_messages_without_posteriors_is_read_again(tmp_path, capsys):
    head, *rows = (SHIPPED / "camera.csv").read_text().splitlines()
    log, columns = tmp_path / "log.csv", tmp_path / "columns.toml"
    log.write_text("\n".join([f"{head},recv", *(f"{row},{k // 5}" for k, row in enumerate(rows))]))
    more = 'messages_received = "recv"\n[settings]\n"sample.stop_ms" = 700.0\n'
    columns.write_text((SHIPPED / "columns.toml").read_text() + more)
    arguments = [str(log), "--columns", str(columns), *FLOOR, "--out", str(tmp_path / "mine")]
    assert main(["lab", "import", *arguments]) == 0
    recording = Recording.read(tmp_path / "mine")
    assert recording.scenario.sample.stop_ms == 700.0
    assert recording.robots["messages_received"].null_count() == 0
    assert recording.robots["alpha"].null_count() == recording.robots.height
    for command in (["show"], ["lab", "replay", "--draws", "2"], ["lab", "threshold"], ["lab", "export"]):
        more = ["--format", "csv", "--out", str(tmp_path / "tables")] if "export" in command else []
        assert main([*command, str(tmp_path / "mine"), *more]) == 0, command
    table = tmp_path / "mine" / "inference.parquet"
    table.write_bytes(table.read_bytes()[:-9])
    assert "inference.parquet: is cut off" in refusal_of(capsys, "show", tmp_path / "mine")


def test_replay(kept, capsys):
    said = output_of(
        capsys, "lab", "replay", kept, "--gate", "own", "--set", "rms_threshold=1.4", "--draws", "5"
    )
    assert "rms_threshold 1.4" in said
    assert said.count("as logged") == 2
    about = json_of(capsys, "lab", "replay", kept, "--strategy", "soft", "--draws", "3", "--json")
    assert [(one["strategy"], one["session"]) for one in about["tables"]["replayed"]] == [
        ("soft", 1),
        ("soft", 2),
    ]


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


def test_threshold(kept, tmp_path, capsys):
    said = output_of(capsys, "lab", "threshold", kept, "--costs", "1:3", "--at", "1.33")
    assert all(
        word in said
        for word in ("equal error", "least error", "costs 1 to 3", "theta_E = 1.330 (given)", "in use")
    )
    document = json_of(capsys, "lab", "threshold", kept, "--json")
    found = document["tables"]
    assert [row["rule"] for row in found["thresholds"]] == ["equal error", "least error", "in use"]
    assert found["edge_profile"][-1]["to_m"] is None
    equal, near = found["thresholds"][0], found["edge_profile"][0]
    kinds = ("false_positive", "false_negative")
    still, vibrating = (percent(equal[f"all_samples_{kind}"]) for kind in kinds)
    of_inner = [percent(equal[f"inner_samples_{kind}"]) for kind in kinds]
    assert f"{still} of the samples on still tiles read as vibrating, {vibrating} of" in document["answer"][0]
    words = " ".join(said.split())
    assert f" {still} ({of_inner[0]}) {vibrating} ({of_inner[1]}) " in words
    still, vibrating = (percent(near[kind]) for kind in kinds)
    assert f"0 to 10 mm {still} of {near['still']} {vibrating} of {near['vibrating']} " in words
    # Sessions are judged by the threshold of the others, if there are any.
    assert [row["session"] for row in found["unseen"]] == [1, 2]
    assert not document["warnings"]
    log = ["lab", "import", str(SHIPPED / "session-1.csv"), *FLOOR, "--out", str(tmp_path / "one")]
    assert main(log) == 0
    assert "judges itself" in output_of(capsys, "lab", "threshold", tmp_path / "one")


UNITS = ("robot", "time_s", "x_m", "y_m", "energy")


def imported(tmp_path, samples, *options):
    """Import a table of samples, whose columns have the names of what is read from them; return the folder."""
    samples.write_csv(tmp_path / "mine.csv")
    names = "".join(f'{use} = "{use}"\n' for use in samples.columns)
    (tmp_path / "map.toml").write_text("[columns]\n" + names)
    arguments = [str(tmp_path / "mine.csv"), "--columns", str(tmp_path / "map.toml"), *FLOOR, "--any-floor"]
    assert main(["lab", "import", *arguments, *options, "--out", str(tmp_path / "mine")]) == 0
    return tmp_path / "mine"


def imported_with(tmp_path, energy):
    """Import the first session of the example with energies made of its own, and without bits."""
    samples = read_log(SHIPPED / "session-1.csv").samples.select(UNITS)
    return imported(tmp_path, samples.with_columns(energy=energy))


@pytest.mark.usefixtures("empty_pictures")
def test_a_threshold_of_small_energies_keeps_its_digits(tmp_path, capsys):
    mine, out = imported_with(tmp_path, pl.col("energy") * 1e-6), tmp_path / "threshold.toml"
    said = words_of(capsys, "lab", "threshold", mine, "--out", out)
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
    said = words_of(capsys, "lab", "threshold", mine)
    assert "energies do not tell them apart" in said
    assert "No: vibrating tiles do not read" in said
    assert "it can be decided" not in said


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


@pytest.mark.usefixtures("empty_pictures")
def test_export_and_import_again(tmp_path):
    """In the format of Webots; in that of the robots: ``test_three_kinds.py``."""
    made, log = str(tmp_path / "made"), str(tmp_path / "again.txt")
    assert main(["run", "--set", "run.t_end_s=30", *FLOOR, "--out", made]) == 0
    assert main(["lab", "export", made, "--format", "webots", "--out", log]) == 0
    assert main(["lab", "import", log, *FLOOR, "--any-floor", "--out", str(tmp_path / "again")]) == 0
    late = Result.read(made).motion.filter(pl.col("time_s") > 5.0)
    assert Recording.read(tmp_path / "again").motion.height == late.height


@pytest.mark.slow
def test_compare(kept, tmp_path, capsys):
    picture = tmp_path / "side.png"
    found = json_of(capsys, "calibrate", "compare", kept, kept, "--picture", picture, "--json")["tables"]
    assert all(one["as_published"] == pytest.approx(1.0) for one in found["similarities"])
    shares = {one["recognised"]: one["share"] for one in found["told_apart"]}
    assert shares["simulated_by_robot"] < 0.7
    assert picture.read_bytes().startswith(b"\x89PNG")


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
    """Each column is the comparison with that simulation alone, also if one is named as another's limits."""
    other = kept.with_name(f"{kept.name}_low")
    assert main(["run", "--set", "run.t_end_s=250", *FLOOR, "--out", str(other)]) == 0
    both = json_of(capsys, "calibrate", "compare", kept, kept, other, "--json")["tables"]
    for folder in (kept, other):
        alone = json_of(capsys, "calibrate", "compare", kept, folder, "--json")
        for name, rows in alone["tables"].items():
            of_both = [one for one in both[name] if one["simulated"] == str(folder)]
            assert [{key: one[key] for key in row} for one, row in zip(of_both, rows, strict=True)] == rows
    out = output_of(capsys, "calibrate", "compare", kept, kept, other)
    assert f"real - {kept.name}" in out
    assert f"real - {other.name}" in out
    assert main(["calibrate", "compare", str(kept), str(kept), str(kept)]) == 2
    short = tmp_path / "short"
    assert main(["run", "--set", "run.t_end_s=10", *FLOOR, "--out", str(short)]) == 0
    assert f"{short}: cannot be compared with '{kept}': sessions: " in refusal_of(
        capsys, "calibrate", "compare", kept, other, short
    )
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
    assert "is not a field that a replay can change" in refusal_of(
        capsys, "lab", "replay", kept, "--set", "sample_interval_ms=100"
    )
    assert "--set strategy.name: is set by --strategy" in refusal_of(
        capsys, "lab", "replay", kept, "--set", "strategy.name=soft"
    )
    assert "--set decision.gate: is also set by --gate" in refusal_of(
        capsys, "lab", "replay", kept, "--gate", "own", "--set", "gate=total"
    )


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
    assert "--floor: is random, but a recording has one floor" in refusal_of(capsys, *line, *random)


def test_too_few_intervals_to_tell_apart_are_said(kept, capsys):
    pytest.importorskip("sklearn")
    printed = output_of(capsys, "calibrate", "compare", kept, kept, "--intervals")
    assert "A session has fewer than 200 undisturbed intervals" in " ".join(printed.split())
    assert "ceiling" in printed


def test_figures(kept, capsys):
    assert "speed lost in 1200 s, %" in output_of(capsys, "calibrate", "figures", kept)
    assert "names a folder twice" in refusal_of(capsys, "calibrate", "figures", kept, kept)
    about = json_of(capsys, "calibrate", "figures", kept, "--at", "1.55", "--json")
    assert about["made_by"]["rms_threshold"] == "1.55"
    used = Recording.read(kept).scenario.sensor.rms_threshold
    assert f"errors at a threshold of {used:g}." in output_of(capsys, "calibrate", "figures", kept)
    assert main(["calibrate", "figures", str(kept), "--at", "high"]) == 2


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
    assert words in refusal_of(capsys, "calibrate", "fit", kept, *more)


def test_compare_results_without_samples(tmp_path, capsys):
    tiny = str(tmp_path / "tiny")
    assert main(["run", "--set", "run.t_end_s=0.02", "--out", tiny]) == 0
    assert "has no samples, and nothing can be compared" in refusal_of(
        capsys, "calibrate", "compare", tiny, tiny
    )


def test_a_law_with_its_error_is_a_scenario_and_a_law_for_other_sessions(kept, tmp_path, capsys):
    law = tmp_path / "a law.toml"
    document = json_of(capsys, "lab", "threshold", kept, "--law", law, "--json")
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
    said = output_of(capsys, "inspect", kept, "--laws", law)
    assert "'a law.toml', fitted to 2 sessions on a known floor" in " ".join(said.split())
    assert "The session judges itself" in said
    # by the other session
    assert "judges itself" not in output_of(capsys, "inspect", kept)

    # not without --force
    assert "exists" in refusal_of(capsys, "lab", "threshold", kept, "--law", law)
    assert "also the file of --out" in refusal_of(
        capsys, "lab", "threshold", kept, "--law", law, "--out", law, "--force"
    )


@pytest.mark.usefixtures("empty_pictures")
def test_places_are_replayed_with_the_law_of_a_file(kept, tmp_path, capsys):
    law = tmp_path / "law.toml"
    law.write_text(preset("calibrated").with_values({"law.sessions": ("0123456789abcdef",)}).to_toml())
    given = ["lab", "replay", str(kept), "--strategy", "none,places", "--draws", "3"]
    said = words_of(capsys, *given, "--laws", law, "--set", "min_observations=0")
    assert "as if robots knew where the camera saw them" in said
    assert "upper bound" in said
    assert "judges itself" not in said
    assert "steers its robots" in refusal_of(capsys, "lab", "replay", kept, "--strategy", "explore")
    assert main(["lab", "replay", str(kept), "--laws", str(tmp_path / "none.toml")]) == 2


@pytest.mark.usefixtures("empty_pictures")
def test_a_log_that_is_given_twice_is_warned_of(tmp_path, capsys):
    log = str(SHIPPED / "session-1.csv")
    copy = tmp_path / "copy.csv"
    copy.write_bytes(Path(log).read_bytes())
    for second in (log, str(copy)):
        assert f"Warning: '{second}' is '{log}' again" in remarks_of(
            capsys, "lab", "import", log, second, *FLOOR, "--out", str(tmp_path / "lab"), "--force"
        )


@pytest.mark.parametrize("stated", [[], ["--set", "robot.battery_life_s=20000"]])
def test_a_session_may_be_longer_than_the_battery_of_a_preset(tmp_path, stated):
    """That of the presets lasts 8400 s, in a simulation."""
    rows = [(k % 2, 5 * k, 0.5, 0.5, 1.0) for k in range(1, 1800)]
    recording = Recording.read(imported(tmp_path, pl.DataFrame(rows, UNITS, orient="row"), *stated))
    assert recording.scenario.robot.battery_life_s == (20000.0 if stated else 8996.0)


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
    assert words in refusal_of(
        capsys, "lab", "export", kept, "--format", format, "--session", session, "--out", out
    )
