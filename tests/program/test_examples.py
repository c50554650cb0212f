"""Every example runs, with few runs, and says what it is meant to show."""

from __future__ import annotations

import re
import runpy
import shutil
import sys
from pathlib import Path

import polars as pl
import pytest

from helpers.commands import json_of
from vibroswarm import Result, Study
from vibroswarm.cli import main
from vibroswarm.search import Search
from vibroswarm.study.runs import groups_of

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
SCRIPTS = ("fill_ratios", "first_run", "own_cost", "own_floor", "replay_recording")


@pytest.fixture
def run_example(tmp_path, monkeypatch, capsys):
    """Runs a script of a copy of the folder, as from the command line; gives what it says."""
    folder = shutil.copytree(EXAMPLES, tmp_path / "examples")
    monkeypatch.chdir(tmp_path)

    def run(name: str, *arguments: str) -> str:
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *arguments])
        capsys.readouterr()
        runpy.run_path(str(folder / f"{name}.py"), run_name="__main__")
        return str(capsys.readouterr().out)

    return run


def test_every_script_is_tested():
    assert tuple(sorted(path.stem for path in EXAMPLES.glob("*.py"))) == SCRIPTS


def test_first_run(run_example):
    told = run_example("first_run", "kept")
    assert "consensus: right, after 891.48 s" in told
    assert Result.read("kept").seed == 2
    assert Path("kept/run.html").stat().st_size > 50_000


@pytest.mark.slow
@pytest.mark.parametrize("folder", sorted(path.parent.name for path in EXAMPLES.glob("papers/*/study.toml")))
def test_experiments_of_others_run(run_example, folder, tmp_path, capsys):
    """All of their cells, for the beginning of one run; ``test_papers.py`` looks at whole ones."""
    study = tmp_path / "examples" / "papers" / folder / "study.toml"
    text = re.sub(r"t_end_s = [\d.]+", "t_end_s = 20.0", study.read_text(encoding="utf-8"))
    if "t_end_s" not in text:
        text = text.replace("[scenario]\n", "[scenario]\nrun.t_end_s = 20.0\n")
    study.write_text(re.sub(r"(?m)^runs = \d+", "runs = 1", text), encoding="utf-8")
    told = json_of(capsys, "evaluate", str(study), "--trust", "--no-pictures", "--json")
    assert len(told["tables"]["summary"]) == len(Study.read(study).cells)


def test_the_figure_of_fill_ratios(run_example, capsys):
    command = ["evaluate", "examples/fill_ratios.toml", "--out", "study", "--runs", "20"]
    assert main([*command, "--no-pictures"]) == 0
    told = run_example("fill_ratios", "study", "figure")
    assert "over 20 runs each" in told
    numbers = pl.read_csv("figure/decision_time_s.csv")
    assert sorted(set(numbers["x"])) == [0.44, 0.48, 0.52, 0.56]
    assert (numbers["low"] < numbers["high"]).all()
    for name in ("decision_time_s", "swarm_right", "swarm_wrong"):
        assert Path(f"figure/{name}.pdf").read_bytes().startswith(b"%PDF")
        assert "<svg" in Path(f"figure/{name}.svg").read_text(encoding="utf-8")


def test_the_files_are_what_they_say():
    study = Study.read(EXAMPLES / "fill_ratios.toml")
    assert len(study.cells) == 12
    assert len(groups_of(study.cells)) == 1
    assert Search.read(EXAMPLES / "search.toml").objectives[0].name == "expected_time_to_right"
    assert len(Search.read(EXAMPLES / "own_cost.toml").space.names) == 3
