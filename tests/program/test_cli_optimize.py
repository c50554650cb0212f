"""The command optimize: a search, a check, a grid, sensitivity, and what it says to bad input."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import polars as pl
import pytest
from vibroswarm.show.markup import unbroken_options

import vibroswarm
from helpers.commands import json_of, output_of, refusal_of, words_of
from helpers.search_functions import steps_of
from vibroswarm.cli import main
from vibroswarm.core.numbers import count

SMALL = (
    Path(__file__).parents[1] / "helpers" / "small_search.toml"
).read_text() + "[search]\nbudget = 150\nfresh = 100\n"
GRID = """
runs = 20
[scenario]
preset = "paper"
[scenario.run]
t_end_s = 100.0
[scenario.strategy]
name = "soft"
[scenario.decision]
min_observations = 20
[grid]
"strategy.soft.eta" = { from = 10, to = 1000, steps = 3 }
"strategy.soft.kappa" = [1.0, 2.0]
"""

COMMANDS = (
    "vibroswarm run --scenario best.toml",
    "vibroswarm evaluate best.toml paper",
    "vibroswarm optimize search.toml --out .",
)


@pytest.fixture
def search(tmp_path: Path) -> str:
    path = tmp_path / "search.toml"
    path.write_text(SMALL)
    return str(path)


@pytest.mark.slow
@pytest.mark.usefixtures("empty_pictures")
def test_a_search_is_made_kept_and_gone_on_with(
    search: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    said = output_of(capsys, "optimize", search, "--out", out)
    assert said.startswith("Best: ")
    assert "during the search (believed)" in said
    assert "on fresh runs (true)" in said
    assert "none failed" in said
    page = (out / "report.html").read_bytes()
    for name in ("best.toml", "printed.json", "history.csv", "steps/00001.parquet"):
        assert (out / name).is_file()
    assert page.count(b"<figure") == 2
    assert not (out / "pictures").exists()
    assert "Done: 150 of 150 runs (100 %)" in output_of(capsys, "show", out)
    steps = steps_of(out)
    about = json_of(capsys, "optimize", search, "--out", out, "--json")
    assert steps_of(out) == steps
    assert not (out / "pictures").exists()
    assert (out / "report.html").read_bytes() == page  # written anew, with nothing of its time in it
    assert main(["optimize", search, "--out", str(out), "--pictures"]) == 0
    assert (out / "pictures" / "scores.png").is_file()
    assert (out / "pictures" / "parameters.svg").is_file()
    assert (out / "report.html").read_bytes() == page
    with monkeypatch.context() as patched:
        patched.setattr("vibroswarm.search.steps.versions", lambda: {"code": "later"})
        said = refusal_of(capsys, "optimize", search, "--out", out)
    assert "was begun by other versions" in said
    assert about["answer"][0][:20].encode() in page
    assert sum(row["runs"] for row in about["tables"]["runs"] if row["stage"] in ("search", "race")) == 150
    true = about["tables"]["truth"][1]
    assert true["score_low"] < true["score"] < true["score_high"]
    with monkeypatch.context() as patched:  # what the page says may be said in its folder
        patched.chdir(out)
        for command in COMMANDS:
            assert command in page.decode()
            assert main([*command.split()[1:], *(["--runs", "4"] if "evaluate" in command else [])]) == 0
        assert (out / "report.html").read_bytes() == page
    assert "--force" in refusal_of(capsys, "optimize", search, "--out", out, "--seed", "4")
    # More fresh runs are advised where too few were made; the search is not repeated.
    about = json_of(capsys, "optimize", search, "--out", out, "--fresh", "130", "--json")
    assert about["tables"]["truth"][1]["runs"] == 130
    assert steps_of(out) == steps


@pytest.mark.slow
def test_killed_and_gone_on_with_it_gives_the_same_bit_by_bit(
    search: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    options = ["optimize", search, "--budget", "900", "--no-pictures", "--out"]
    assert main([*options, str(whole)]) == 0
    command = [*options, str(out)]
    for executor in ("threads", "processes"):
        assert killed([*command, "--executor", executor, "--workers", "2"], out) == -signal.SIGKILL
    assert 0 < len(steps_of(out)) < len(steps_of(whole))
    said = words_of(capsys, "show", out)
    # A step without its .json was being written when the search was killed.
    whole_steps = len(list((out / "steps").glob("[0-9]*.json")))
    assert f"in {count(whole_steps, 'step')}; 0 failed" in said
    assert "to resume" in said
    assert main(command) == 0
    capsys.readouterr()
    for name in (
        "printed.json",
        "best.toml",
        "history.csv",
        "candidates.csv",
        "report.html",
    ):
        assert (out / name).read_bytes() == (whole / name).read_bytes()
    assert steps_of(out) == steps_of(whole)


def killed(command: list[str], out: Path) -> int:
    """Begin the search, or go on with it, and kill it when it has written something; gives its exit code."""
    env = {**os.environ, "PYTHONPATH": str(Path(vibroswarm.__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, "-m", "vibroswarm", *command], env=env, stderr=subprocess.DEVNULL
    )
    before = len(steps_of(out))
    while process.poll() is None and len(steps_of(out)) == before:
        time.sleep(0.001)
    process.kill()
    return process.wait()


def test_a_grid_marks_what_is_not_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "grid.toml", tmp_path / "out"
    path.write_text(GRID)
    line = ["evaluate", path, "--cost", "decision_time", "--no-pictures", "--out", out]
    tables = json_of(capsys, *line, "--json")["tables"]
    table = pl.read_csv(out / "scores.csv")
    assert table.height == len(tables["scores"]) == len(tables["summary"])
    best = table.sort("score").row(0, named=True)
    assert best["above_best"] == 0
    assert best["best_group"]
    assert "on fresh runs" in output_of(capsys, *line)


def test_sensitivity_by_the_command(search: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("SALib")
    options = ["optimize", "sensitivity", search, "--budget", "2600", "--cost", "decision_time"]
    said = output_of(capsys, *options, "--out", tmp_path / "out")
    assert said.index("min_observations") < said.index("sample_interval")  # the gate decides when to decide
    assert pl.read_csv(tmp_path / "out" / "sensitivity.csv").height == 2
