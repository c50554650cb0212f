"""``vibroswarm evaluate``, ``sweep``, ``merge`` and ``show`` as a user meets them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

import vibroswarm
from helpers.commands import output_of, remarks_of
from vibroswarm.cli import main
from vibroswarm.core import folders
from vibroswarm.study import executors
from vibroswarm.study.spec import FORMAT
from vibroswarm.study.study_result import StudyResult

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


def test_a_sweep_is_kept_and_told(study, tmp_path, capsys):
    out = tmp_path / "out put" / "one"
    assert sweep(study, "--out", out) == 0
    told = capsys.readouterr()
    assert "2 cells, 20 runs each, seed 1; all see the same paths and readings" in told.err
    assert "To do: 20 runs of motion\n" in told.err
    assert "20 runs per cell" in told.out
    assert str(out) in told.out
    assert StudyResult.open(out).runs().height == 40
    assert pl.read_csv(out / "summary.csv").height == 2
    before, again = sorted(p.name for p in out.rglob("*")), ("evaluate", study, "--out", out, *QUIET)
    assert "Nothing to do: all runs exist." in remarks_of(capsys, *again)
    assert sorted(p.name for p in out.rglob("*")) == before
    assert "To do: 10 runs of motion" in remarks_of(capsys, *again, "--runs", "30")
    assert StudyResult.open(out).runs().height == 60
    assert sweep(out / "study.toml", "--out", out) == 0, "its own study file is the study"
    assert not list(tmp_path.rglob("*/.*"))


def test_evaluate_is_the_sweep_of_its_options(tmp_path, study, capsys):
    line = ["evaluate", "--robots", "2", "--set", "run.t_end_s=60", "--strategy", "none,soft", "--runs", "20"]
    assert main([*line, "--out", str(tmp_path / "e"), *QUIET]) == 0
    again = remarks_of(capsys, "evaluate", study, "--out", tmp_path / "e", *QUIET)
    assert "Nothing to do: all runs exist." in again, "another study would be refused"


def test_shares_are_merged_as_a_sweep_is(study, tmp_path, capsys):
    line = ["evaluate", str(study), "--out", str(tmp_path / "whole"), "--runs", "400", "--no-pictures"]
    assert main(line) == 0
    shares = [str(tmp_path / f"share {k}") for k in (1, 2, 3)]
    for k, folder in enumerate(shares, 1):
        share = ("--runs", "400", "--shard", f"{k}/3")
        assert f"Shard {k} of 3 is done" in output_of(
            capsys, "evaluate", study, "--out", folder, *share, *QUIET
        )
    out = tmp_path / "joined"
    assert main(["evaluate", "merge", str(out), *shares[:2], "--no-pictures"]) == 1
    told = capsys.readouterr().err
    assert "is incomplete" in told
    assert "Traceback" not in told
    assert main(["evaluate", "merge", str(out), shares[2], "--no-pictures"]) == 0
    a, b = StudyResult.open(out), StudyResult.open(tmp_path / "whole")
    assert_frame_equal(a.robots(), b.robots(), check_exact=True)
    assert_frame_equal(a.runs(), b.runs(), check_exact=True)
    assert (out / "summary.csv").read_bytes() == (tmp_path / "whole" / "summary.csv").read_bytes()
    joined, whole = ((tmp_path / name / "comparisons.csv").read_text() for name in ("joined", "whole"))
    assert joined == whole


BAD = {
    "evaluate nowhere.toml": ("nowhere.toml", "cannot be read"),
    "evaluate .": ("is a folder",),
    "evaluate binary.toml": ("binary.toml", "UTF-8"),
    "evaluate not.toml": ("not.toml", "is not TOML"),
    "evaluate field.toml": ("grid.swarm.robot", "did you mean 'swarm.robots'?"),
    "evaluate empty.toml": ("grid", "is empty"),
    "evaluate zero.toml": ("runs: 0 is wrong",),
    "evaluate newer.toml": ("is of format", "this version reads format"),
    "evaluate one.toml --runs 0": ("runs: 0 is wrong",),
    "evaluate one.toml --runs many": ("--runs", "'many' is not a whole number"),
    "evaluate one.toml --workers 0": ("--workers: 0 is not from 1 to 4096",),
    "evaluate one.toml --workers x": ("--workers", "not a whole number"),
    "evaluate one.toml --executor thread": ("--executor", "did you mean 'threads'?"),
    "evaluate one.toml --executor dask://127.0.0.1:1": ("no Dask scheduler answers at 'dask://127.0.0.1:1'",),
    "evaluate one.toml --executor nowhere.json": ("there is no scheduler file 'nowhere.json'",),
    "evaluate one.toml --out out --shard 5/4": ("--shard", "'5/4' is not a job"),
    "evaluate one.toml --out out --shard half": ("--shard", "such as 3/16"),
    "evaluate one.toml --shard 1/2": ("--shard", "needs --out"),
    "evaluate one.toml --out out --shard 1/2 --json": ("--json", "--shard runs a part"),
    "evaluate one.toml --out out --batch 0:0-5 --open": ("--open", "--batch runs a part"),
    "evaluate one.toml --out out --shard 1/2 --batch 0:0-5": ("--batch", "cannot be used with --shard"),
    "evaluate until.toml --out out --shard 1/2": ("--shard", "needs a fixed number of runs"),
    "evaluate one.toml --out out --batch 7": ("--batch", "is not a batch"),
    "evaluate one.toml --out out --batch 3:0-5": ("--batch", "there is no group 3"),
    "evaluate one.toml --style colum": ("--style", "did you mean 'column'?"),
    "evaluate one.toml --style slide": ("--style", "needs --out DIR"),
    "evaluate one.toml --mixed": ("--mixed", "has no effect without --out DIR"),
    "evaluate one.toml --seed 1": ("--seed", "is not for a study file"),
    "evaluate one.toml --motion event": ("--motion", "is not for a study file"),
    "evaluate one.toml --strategy soft": ("--strategy: is not for a study file",),
    "evaluate one.toml --set swarm.robots=2": ("--set: is not for a study file",),
    "evaluate one.toml --vary swarm.robots=2,3": ("--vary: is not for a study file",),
    "evaluate one.toml --max-runs 0": ("--max-runs", "is not for a study file"),
    "evaluate one.toml --out file": ("file", "is a file; give the name of a folder"),
    "evaluate one.toml --out dangling": ("dangling", "is a symbolic link to nothing"),
    "evaluate one.toml --out file/deeper": ("cannot be made: 'file' is not a folder",),
    "evaluate one.toml --out thesis": ("thesis", "exists but is not a study"),
    "evaluate one.toml --out newer": ("newer", "this version reads format"),
    "evaluate one.toml --out other": ("other", "holds another study", "seed is 9 there and 1 here"),
    "evaluate one.toml --out /proc/nobody": ("/proc/nobody", "cannot be made"),
    "evaluate --runs 0": ("runs", "0 is wrong"),
    "evaluate --runs 5 --until 2%": ("--until", "not both"),
    "evaluate --until 2": ("until", "such as 2%"),
    "evaluate --until 2% --figure robots_rigth": ("figure", "did you mean 'robots_right'?"),
    "evaluate --until 2% --max-runs 5": ("max_runs", "whole number from 100"),
    "evaluate --until 2% --shard 1/2 --out out": ("--shard", "needs a fixed number of runs"),
    "evaluate --figure robots_right": ("--figure", "needs --until"),
    "evaluate --keep-samples": ("--keep-samples", "needs --out DIR"),
    "evaluate --vary robots=5": ("robots", "did you mean 'swarm.robots'?"),
    "evaluate --vary swarm.robots": ("--vary", "section.field=value,value"),
    "evaluate --vary robot.robots=2": (
        "--vary robot.robots: there is no such field, did you mean 'swarm.robots'?",
    ),
    "evaluate --vary swarm.robots=5,0": ("in the cell with swarm.robots = 0",),
    "evaluate --vary swarm.robots=5 --vary swarm.robots=6": ("varied twice",),
    "evaluate --strategy none,sof": ("did you mean 'soft'?",),
    "evaluate --strategy none,soft --vary strategy.name=none": ("also set by --strategy",),
    "evaluate --strategy soft --vary strategy.name=none,soft": ("also set by --strategy",),
    "evaluate --task share --vary task.name=share,mean": ("also set by --task",),
    "evaluate --seed x": ("--seed", "not a whole number"),
    "evaluate --motion evnt": ("motion", "did you mean 'event'?"),
    "show nowhere": ("nowhere", "there is no such file"),
    "show file": ("file", "neither a folder nor a file that vibroswarm shows"),
    "show newer": ("newer", "this version reads format"),
    "evaluate merge out nowhere": ("nowhere", "is not a study of vibroswarm"),
    "evaluate merge out other another": ("another", "is of another study than 'other'"),
    "evaluate merge file other": ("file", "is a file; give the name of a folder"),
}


@pytest.fixture(scope="module")
def workplace(tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("bad")
    files = {
        "one": TEXT,
        "not": "runs = ",
        "field": TEXT.replace("strategy.name", "swarm.robot"),
        "empty": "runs = 5\n[grid]\n",
        "zero": TEXT.replace("runs = 20", "runs = 0"),
        "newer": f"format = {FORMAT + 1}\n" + TEXT,
        "until": TEXT.replace("runs = 20", 'until = "2%"'),
    }
    for name, text in files.items():
        (place / f"{name}.toml").write_text(text)
    (place / "binary.toml").write_bytes(b"\xff\xfe\x00\x00")
    (place / "file").write_text("mine")
    (place / "dangling").symlink_to("nowhere")
    (place / "thesis").mkdir()
    (place / "thesis" / "thesis.tex").write_text("ten years")
    for name, seed in (("newer", 1), ("other", 9), ("another", 8)):
        (place / "s.toml").write_text(f"seed = {seed}\n" + TEXT)
        assert sweep(place / "s.toml", "--out", place / name) == 0
    about = json.loads((place / "newer" / "vibroswarm.json").read_text())
    (place / "newer" / "vibroswarm.json").write_text(json.dumps(about | {"format": folders.FORMAT + 1}))
    return place


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_named_and_ends_with_2(line, workplace, monkeypatch, capsys):
    monkeypatch.chdir(workplace)
    monkeypatch.setattr(executors, "CONNECT_S", 1.0)
    before = sorted(workplace.rglob("*"))
    quiet = {"show": [], "merge": ["--no-pictures"]}
    arguments = [*line.split(), *quiet.get(line.split()[0], QUIET)]
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
    result = StudyResult.open(tmp_path / "out")
    assert result.where(source="my floor.txt").runs()["fill_ratio"].unique().to_list() == [0.75]
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
    while process.poll() is None and len(list((out / "shards").glob("*.json"))) < 2:
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
    result = StudyResult.open(out)
    assert result.store.damaged == []
    there = int(result.cells["there"].sum())
    assert 0 < there < 200_000
