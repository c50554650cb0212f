"""``vibroswarm evaluate`` and ``show`` as a user meets them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest

import vibroswarm
from helpers.commands import refusal_of
from vibroswarm.cli import main
from vibroswarm.study.spec import Study

QUIET = ["--no-pictures"]
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


def sweep(*arguments: object) -> int:
    return main(["evaluate", *(str(a) for a in arguments), *QUIET])


def test_a_study_is_kept_and_gone_on_with(study, tmp_path, capsys):
    out = tmp_path / "out put" / "one"
    assert sweep(study, "--out", out) == 0
    told = capsys.readouterr()
    assert "2 cells, 20 runs each, seed 1" in told.err
    assert "20 runs per cell" in told.out
    assert str(out) in told.out
    assert pl.read_csv(out / "summary.csv").height == 2
    before = sorted(p.name for p in out.rglob("*"))
    assert sweep(study, "--out", out) == 0
    assert sorted(p.name for p in out.rglob("*")) == before
    assert sweep(study, "--out", out, "--runs", "30") == 0
    assert Study.open(out)[1].frame.height == 60
    assert sweep(out / "study.toml", "--out", out) == 0, "its own study file is the study"
    assert not list(tmp_path.rglob("*/.*"))


def test_runs_stay_when_another_study_takes_the_folder(study, tmp_path, capsys):
    out = tmp_path / "out"
    assert sweep(study, "--out", out) == 0
    files = set((out / "runs").iterdir())
    line = ["--robots", "2", "--set", "run.t_end_s=60", "--strategy", "soft", "--runs", "20", "--out", out]
    assert "holds another study" in refusal_of(capsys, "evaluate", *line, *QUIET)
    assert sweep(*line, "--force") == 0
    assert set((out / "runs").iterdir()) == files, "its runs were there already"
    assert Study.open(out)[1].frame.height == 20


BAD = {
    "evaluate nowhere.toml": ("nowhere.toml", "cannot be read"),
    "evaluate not.toml": ("not.toml", "is not TOML"),
    "evaluate field.toml": ("grid.swarm.robot", "did you mean 'swarm.robots'?"),
    "evaluate zero.toml": ("runs: 0 is wrong",),
    "evaluate one.toml --workers 0": ("--workers: 0 is not from 1 to 4096",),
    "evaluate one.toml --executor thread": ("there is no executor 'thread'",),
    "evaluate one.toml --out out --shard 5/4": ("--shard", "'5/4' is not a part"),
    "evaluate one.toml --shard 1/2": ("--shard", "needs --out"),
    "evaluate until.toml --out out --shard 1/2": ("--shard", "needs a number of runs"),
    "evaluate one.toml --seed 1": ("--seed", "is not for a study file"),
    "evaluate one.toml --strategy soft": ("--strategy: is not for a study file",),
    "evaluate one.toml --out file": ("file", "is a file; give the name of a folder"),
    "evaluate one.toml --out thesis": ("thesis", "exists but is not a study"),
    "evaluate one.toml --out other": ("other", "holds another study"),
    "evaluate one.toml --cost authors": ("did you mean 'authors_code'?",),
    "evaluate --runs 5 --until 2%": ("--until", "not both"),
    "evaluate --until 2": ("until", "such as 2%"),
    "evaluate --until 2% --figure robots_rigth": ("figure", "did you mean 'robots_right'?"),
    "evaluate --vary robots=5": ("robots", "did you mean 'swarm.robots'?"),
    "evaluate --vary swarm.robots=5,0": ("in the cell with swarm.robots = 0",),
    "evaluate --strategy none,sof": ("did you mean 'soft'?",),
    "show nowhere": ("nowhere", "there is no such file"),
}


@pytest.fixture(scope="module")
def workplace(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("bad")
    files = {
        "one": TEXT,
        "not": "runs = ",
        "field": TEXT.replace("strategy.name", "swarm.robot"),
        "zero": TEXT.replace("runs = 20", "runs = 0"),
        "until": TEXT.replace("runs = 20", 'until = "2%"'),
        "seed": f"seed = 9\n{TEXT}",
    }
    for name, text in files.items():
        (place / f"{name}.toml").write_text(text)
    (place / "file").write_text("mine")
    (place / "thesis").mkdir()
    (place / "thesis" / "thesis.tex").write_text("ten years")
    assert sweep(place / "seed.toml", "--out", place / "other") == 0
    return place


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_named_and_ends_with_2(line, workplace, monkeypatch, capsys):
    monkeypatch.chdir(workplace)
    before = sorted(workplace.rglob("*"))
    arguments = [*line.split(), *({"show": []}.get(line.split()[0], QUIET))]
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ""
    last = told.err.splitlines()[-1]
    assert last.startswith("vibroswarm: error: ")
    for words in BAD[line]:
        assert words in last
    assert sorted(workplace.rglob("*")) == before, "nothing half-written"


def test_a_floor_file_beside_the_study(tmp_path, monkeypatch):
    (tmp_path / "my floor.txt").write_text("01\n11\n")
    (tmp_path / "s.toml").write_text(
        'runs = 5\n[scenario]\nrun = { t_end_s = 60 }\n[grid]\n"floor.source" = ["my floor.txt", "random:0.44"]\n'
    )
    monkeypatch.chdir("/")
    assert sweep(tmp_path / "s.toml", "--out", tmp_path / "out") == 0
    (tmp_path / "my floor.txt").unlink()
    found = Study.open(tmp_path / "out")[1].where(floor__source="my floor.txt").frame
    assert found["fill_ratio"].unique().to_list() == [0.75]
    assert main(["show", str(tmp_path / "out")]) == 0


def command(*arguments: object, **more: object) -> subprocess.Popen[str]:
    env = {**os.environ, "PYTHONPATH": str(Path(vibroswarm.__file__).parents[1]), **dict(more.pop("env", {}))}  # type: ignore[call-overload]
    line = [sys.executable, "-m", "vibroswarm", *(str(a) for a in arguments)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env, **more)  # type: ignore[call-overload,no-any-return]


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_ctrl_c_ends_with_130_and_what_is_done_is_kept(executor, study, tmp_path):
    out = tmp_path / "out"
    line = [
        "evaluate",
        study,
        "--out",
        out,
        "--runs",
        "100000",
        "--executor",
        executor,
        "--workers",
        "2",
        *QUIET,
    ]
    process = command(*line, start_new_session=True)
    until_s = time.monotonic() + 120.0
    while process.poll() is None and len(list((out / "runs").glob("*.parquet"))) < 2:
        assert time.monotonic() < until_s
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all its processes
    began_s = time.monotonic()
    told, err = process.communicate(timeout=60)
    assert time.monotonic() - began_s < 20.0
    assert process.returncode == 130, err
    assert told == ""
    said = f"vibroswarm: interrupted; finished work is saved in '{out}'. To resume: vibroswarm evaluate "
    assert err.splitlines()[-1].startswith(said)
    assert "Traceback" not in err
    assert "leaked" not in err
    runs = Study.open(out)[1]
    assert runs.store.damaged == []
    assert 0 < sum(runs.there.values()) < 200_000
