"""``vibroswarm evaluate``, ``detect`` and ``show``, and the one rule for ``--out``."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of, output_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.core.folders import kind_of
from vibroswarm.study.spec import Study

SHORT = ["--robots", "2", "--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]
TEXT = """
runs = 20
[scenario]
preset = "paper"
swarm = { robots = 2 }
run = { t_end_s = 60 }
[grid]
"strategy.name" = ["none", "soft"]
"""


@pytest.fixture
def study(tmp_path: Path) -> Path:
    path = tmp_path / "my studies" / "one.toml"
    path.parent.mkdir()
    path.write_text(TEXT)
    return path


def evaluate(*arguments: object) -> int:
    return main(["evaluate", *(str(word) for word in arguments), "--no-pictures"])


def test_a_study_is_saved_and_continued(study, tmp_path, capsys):
    out = tmp_path / "out put" / "one"
    assert evaluate(study, "--out", out) == 0
    assert "2 cells, 20 runs each, seed 1" in capsys.readouterr().err
    assert pl.read_csv(out / "summary.csv").height == 2
    before = sorted(path.name for path in out.rglob("*"))
    assert evaluate(study, "--out", out) == 0
    assert sorted(path.name for path in out.rglob("*")) == before
    capsys.readouterr()
    assert evaluate(study, "--out", out, "--runs", "30") == 0
    assert "resumed: 40 of 60 runs kept" in capsys.readouterr().err
    assert Study.open(out)[1].frame.height == 60
    assert evaluate(out / "study.toml", "--out", out) == 0, "its own study file is the study"
    assert not list(tmp_path.rglob("*/.*"))
    assert "soft" in output_of(capsys, "show", out)


def test_a_folder_is_new_or_the_same_or_forced(study, tmp_path, capsys):
    out = tmp_path / "out"
    assert evaluate(study, "--out", out) == 0
    files = set((out / "runs").iterdir())
    other = [*SHORT[:4], "--strategy", "soft", "--runs", "20", "--out", out]
    assert "--force" in refusal_of(capsys, "evaluate", *other)
    assert evaluate(*other, "--force") == 0
    assert set((out / "runs").iterdir()) == files, "its runs were there already"
    assert Study.open(out)[1].frame.height == 20
    assert main(["run", *SHORT, "--out", str(out)]) == 2
    assert main(["run", *SHORT, "--out", str(out), "--force"]) == 0
    assert kind_of(out) == "result"
    assert not (out / "summary.csv").exists()
    mine = tmp_path / "thesis"
    mine.mkdir()
    (mine / "thesis.tex").write_text("ten years")
    for command in ("run", "evaluate", "detect", "league", "optimize"):
        assert "something else" in refusal_of(capsys, command, "--out", mine, "--force")
    assert [path.name for path in mine.iterdir()] == ["thesis.tex"]


BAD = {
    "evaluate nowhere.toml": "nowhere.toml",
    "evaluate not.toml": "is not TOML",
    "evaluate field.toml": "did you mean 'swarm.robots'?",
    "evaluate one.toml --executor thread": "there is no executor 'thread'",
    "evaluate one.toml --out out --shard 5/4": "'5/4' is not a part",
    "evaluate one.toml --strategy soft": "--strategy: is not for a study file",
    "evaluate one.toml --out one.toml": "one.toml",
    "evaluate one.toml --cost authors": "did you mean 'authors_code'?",
    "evaluate --runs 5 --until 2%": "either a number of runs or a precision",
    "evaluate --vary swarm.robots=5,0": "in the cell with swarm.robots = 0",
    "show nowhere": "nowhere",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_named_and_ends_with_2(line, tmp_path, monkeypatch, capsys):
    texts = {"one": TEXT, "not": "runs = ", "field": TEXT.replace("strategy.name", "swarm.robot")}
    for name, text in texts.items():
        (tmp_path / f"{name}.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert BAD[line] in printed.err.splitlines()[-1]
    assert len(list(tmp_path.rglob("*"))) == len(texts), "nothing half-written"


@pytest.mark.slow
def test_until_a_precision(capsys):
    line = ["evaluate", "--until", "40%", "--json", *SHORT, "--set", "run.t_end_s=120"]
    (cell,) = json_of(capsys, *line)["tables"]["summary"]
    assert cell["runs"] == 100
    half = (cell["decision_time_s_high"] - cell["decision_time_s_low"]) / 2
    assert half <= 0.4 * cell["decision_time_s"]


@pytest.mark.slow
@pytest.mark.usefixtures("empty_pictures")
def test_detect_says_what_is_needed(tmp_path, capsys):
    line = ["detect", "--robots", "2,6", "--fills", "0.2,0.48,0.8", "--runs", "60", "--error", "20%"]
    line += ["--false-alarms", "25%", "--set", "run.t_end_s=300", "--set", "decision.min_observations=30"]
    output_of(capsys, *line, "--out", tmp_path / "out")
    need = pl.read_csv(tmp_path / "out" / "needed.csv")
    assert need["fill_ratio"].to_list() == [0.2, 0.2, 0.48, 0.48, 0.8, 0.8]
    assert need["robots"].to_list() == [2, 6, 2, 6, 2, 6]
    assert need["false_alarm"].null_count() == 2  # above the boundary there are none
    easy = need.filter((pl.col("fill_ratio") == 0.2) & (pl.col("robots") == 6))
    assert easy["needed_s"][0] < 300
    assert easy["missed_high"][0] < 0.2
    assert need.filter(pl.col("fill_ratio") == 0.48)["needed_s"].null_count() == 2


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_ctrl_c_ends_with_130_and_finished_runs_are_used(executor, study, tmp_path):
    out = tmp_path / "out"
    line = [sys.executable, "-m", "vibroswarm", "evaluate", study, "--out", out, "--no-pictures"]
    line += ["--runs", "100000", "--executor", executor, "--workers", "2"]
    process = subprocess.Popen(line, stderr=subprocess.PIPE, text=True, start_new_session=True)
    until_s = time.monotonic() + 120.0
    while process.poll() is None and len(list((out / "runs").glob("*.parquet"))) < 2:
        assert time.monotonic() < until_s
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all its processes
    err = process.communicate(timeout=60)[1]
    assert process.returncode == 130, err
    assert err.splitlines()[-1].startswith("vibroswarm: interrupted")
    assert "Traceback" not in err
    runs = Study.open(out)[1]
    assert runs.store.damaged == []
    assert 0 < sum(runs.there.values()) < 200_000
