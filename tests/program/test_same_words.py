"""What a command does is one call from Python with the same words: answer, tables and folder are the same."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from helpers.commands import json_of, remarks_of
from vibroswarm.cli import main
from vibroswarm.documents import document_of
from vibroswarm.documents.league import league_document
from vibroswarm.documents.search import search_document
from vibroswarm.league.words import league_of, played
from vibroswarm.optimize.words import grid_of, grid_searched, search_of, searched
from vibroswarm.show.data import document_data
from vibroswarm.show.document import Document
from vibroswarm.simulation import simulate
from vibroswarm.study.detection import detect
from vibroswarm.study.evaluation import evaluate
from vibroswarm.study.scenario_words import scenario_of
from vibroswarm.study.words import detection_scenario, study_of

HERE = Path(__file__).parents[1] / "helpers"
SETTINGS = ["run.t_end_s=60", "decision.min_observations=5"]
SHORT = ["--robots", "2", *(word for setting in SETTINGS for word in ("--set", setting))]
SEARCH = HERE / "small_search.toml"
GRID = """
runs = 10
[scenario]
preset = "paper"
swarm = { robots = 2 }
run = { t_end_s = 60 }
[space]
"decision.min_observations" = [1, 20]
"""


def a_run(seed: int) -> Document:
    scenario = scenario_of(robots=2, settings=SETTINGS, strategy="soft", floor="diagonal:0.46")
    return document_of(simulate(scenario, seed))  # type: ignore[return-value]


def an_evaluation(seed: int) -> Document:
    study = study_of(strategy=["none", "soft"], robots=2, settings=SETTINGS, runs=6, seed=seed)
    return document_of(evaluate(study))  # type: ignore[return-value]


def a_detection(seed: int) -> Document:
    scenario = detection_scenario(more_than=0.4, settings=SETTINGS)
    return document_of(detect(scenario, robots=[2], fills=[0.28, 0.6], runs=4, seed=seed))  # type: ignore[return-value]


def a_league(seed: int) -> Document:
    asked = league_of(
        strategy=["none", "soft"],
        robots=[2],
        settings=SETTINGS,
        patterns=["stripe"],
        runs=3,
        seed=seed,
        untuned=True,
    )
    standings, tables = played(asked, belief_runs=0, fault_runs=0)
    return league_document(standings, tables | {"summary": standings.summary})


def a_search(seed: int) -> Document:
    return search_document(*searched(search_of(SEARCH, budget=60, fresh=4, seed=seed)))


def a_grid(seed: int) -> Document:
    from vibroswarm.documents.grid import grid_document

    return grid_document(*grid_searched(*grid_of(Path("grid.toml"), fresh=4, seed=seed)))


CASES: dict[str, tuple[list[str], Callable[[int], Document]]] = {
    "run": (["run", *SHORT, "--strategy", "soft", "--floor", "diagonal:0.46"], a_run),
    "evaluate": (["evaluate", *SHORT, "--strategy", "none,soft", "--runs", "6"], an_evaluation),
    "detect": (
        ["detect", *SHORT, "--more-than", "40%", "--fills", "0.28,0.6", "--runs", "4"],
        a_detection,
    ),
    "league": (
        [
            *(
                "league",
                *SHORT,
                "--strategy",
                "none,soft",
                "--patterns",
                "stripe",
                "--runs",
                "3",
                "--untuned",
            ),
            *("--belief-runs", "0", "--fault-runs", "0"),
        ],
        a_league,
    ),
    "optimize": (["optimize", str(SEARCH), "--budget", "60", "--fresh", "4"], a_search),
    "grid": (["optimize", "grid.toml", "--method", "grid", "--fresh", "4"], a_grid),
}


@pytest.mark.parametrize("name", CASES)
def test_a_command_is_one_call_with_the_same_words(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("grid.toml").write_text(GRID, encoding="utf-8")
    words, called = CASES[name]
    printed = json_of(capsys, *words, "--seed", "3", "--json", "-q")
    of_run = {"answer", "robots_were_told"}  # `run --json` has the robots of its verdict
    wanted = of_run if name == "run" else {"answer", "robots_were_told", "warnings", "tables"}
    here, other = (json.loads(json.dumps(document_data(called(seed)))) for seed in (3, 4))
    assert {key: here[key] for key in wanted} == {key: printed[key] for key in wanted}
    if name != "run":  # negative control
        assert other["tables"] != printed["tables"]


@pytest.mark.usefixtures("one_picture")
def test_a_study_in_a_folder_is_that_of_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tables and page too; the command goes on in the folder that the call has made."""
    line = ["evaluate", *SHORT, "--strategy", "none,soft", "--runs", "6"]
    study = study_of(strategy=["none", "soft"], robots=2, settings=SETTINGS, runs=6)
    evaluate(study, tmp_path / "called")
    assert main([*line, "--out", str(tmp_path / "command")]) == 0
    for table in ("summary.csv", "comparisons.csv"):
        ours, theirs = (tmp_path / folder / table for folder in ("called", "command"))
        assert ours.read_bytes() == theirs.read_bytes()
    assert (tmp_path / "called" / "report.html").is_file()
    assert "Nothing to do: all runs exist." in remarks_of(capsys, *line, "--out", str(tmp_path / "called"))
