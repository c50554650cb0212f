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

import vibroswarm
from helpers.commands import json_of, output_of, refusal_of
from vibroswarm.cli import main

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


@pytest.fixture
def search(tmp_path: Path) -> str:
    path = tmp_path / "search.toml"
    path.write_text(SMALL)
    return str(path)


@pytest.mark.slow
def test_a_search_is_made_kept_and_gone_on_with(
    search: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert output_of(capsys, "optimize", search, "--out", out).startswith("Best: ")
    archive = (out / "archive.parquet").read_bytes()
    about = json_of(capsys, "optimize", search, "--out", out, "--json")
    assert (out / "archive.parquet").read_bytes() == archive
    (row,) = about["tables"]["truth"]
    assert row["score_low"] < row["score"] < row["score_high"]
    assert pl.read_csv(out / "candidates.csv")["runs"].sum() == 150
    about = json_of(capsys, "optimize", search, "--out", out, "--budget", "300", "--fresh", "130", "--json")
    assert about["tables"]["truth"][0]["runs"] == 130
    assert pl.read_csv(out / "candidates.csv")["runs"].sum() == 300
    refusal_of(capsys, "optimize", search, "--out", out, "--seed", "4")
    assert main(["run", "--scenario", str(out / "best.toml")]) == 0


@pytest.mark.slow
def test_killed_and_gone_on_with_it_gives_the_same_bit_by_bit(search: str, tmp_path: Path) -> None:
    whole, out = tmp_path / "whole", tmp_path / "out"
    options = ["optimize", search, "--budget", "900", "--no-pictures", "--out"]
    assert main([*options, str(whole)]) == 0
    command = [*options, str(out)]
    for executor in ("threads", "processes"):
        assert killed([*command, "--executor", executor, "--workers", "2"], out) == -signal.SIGKILL
    assert main(command) == 0
    for name in ("archive.parquet", "best.toml", "history.csv", "candidates.csv", "report.json"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()


def killed(command: list[str], out: Path) -> int:
    """Begin the search, or go on with it, and kill it when it has written something; gives its exit code."""
    env = {**os.environ, "PYTHONPATH": str(Path(vibroswarm.__file__).parents[1])}
    process = subprocess.Popen(
        [sys.executable, "-m", "vibroswarm", *command], env=env, stderr=subprocess.DEVNULL
    )
    archive = out / "archive.parquet"
    before = archive.stat().st_mtime_ns if archive.exists() else 0
    while process.poll() is None and (not archive.exists() or archive.stat().st_mtime_ns == before):
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
