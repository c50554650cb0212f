"""``vibroswarm show`` on whatever commands write, and one rule for folders that exist already."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from helpers.commands import json_of, output_of, refusal_of, words_of
from vibroswarm.cli import main
from vibroswarm.core.folders import kind_of

ROOT = Path(__file__).parents[2]
SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]
STUDY = ["--runs", "4", "--robots", "2", *SHORT]
LEAGUE = ["--patterns", "stripe", "--strategy", "none,soft", "--robots", "2", *SHORT]
LOGS = [f"examples/lab/session-{k}.csv" for k in (1, 2)]
ON_FLOOR = ["--floor", "examples/lab/floor.txt", "--tiles", "5x5"]

COMMANDS: dict[str, list[str]] = {
    "run": ["run", "--robots", "2", *SHORT],
    "evaluate": ["evaluate", "--strategy", "none,soft", "--no-pictures", *STUDY],
    "detect": ["detect", "--fills", "0.4,0.6", *STUDY],
    "league": ["league", "--runs", "3", "--belief-runs", "0", *LEAGUE],
    "optimize": ["optimize", "search.toml", "--budget", "120", "--fresh", "4", "--no-pictures"],
    "lab import": ["lab", "import", *LOGS, *ON_FLOOR],
}
SEARCH = """
[scenario]
preset = "paper"
swarm = { robots = 2 }
run = { t_end_s = 60 }
[space]
"decision.min_observations" = { from = 1, to = 20 }
[search]
method = "random"
finalists = 2
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """The folder in which commands run, with their input."""
    place = tmp_path_factory.mktemp("written")
    shutil.copytree(ROOT / "examples", place / "examples")
    (place / "search.toml").write_text(SEARCH)
    return place


@pytest.fixture(autouse=True)
def here(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setenv("COLUMNS", "60")


def out_of(name: str) -> str:
    return name.replace(" ", "-")


def made(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What the command prints when its folder is made, or made again."""
    return output_of(capsys, *COMMANDS[name], "--out", out_of(name))


def results(text: str) -> list[str]:
    """Lines of results, without those of where they are saved."""
    places = ("Saved", "Page", "Report", "Not saved")
    return [line for line in text.splitlines() if line.strip() and not line.startswith(places)]


@pytest.mark.slow
@pytest.mark.usefixtures("blank_pictures")
@pytest.mark.parametrize("name", COMMANDS)
def test_results_are_shown_again_and_only_the_same_work_goes_on(name, capsys):
    Path(out_of(name)).mkdir()  # an empty folder is used
    printed = results(made(name, capsys))
    assert len(printed) >= 4
    assert max(map(len, printed)) <= 60, "no line is wider than the terminal"
    shown = results(output_of(capsys, "show", out_of(name)))
    assert shown[-len(printed) :] == printed
    assert json_of(capsys, "show", out_of(name), "--json")
    assert results(made(name, capsys)) == printed, "the same work is no obstacle"
    other = [*COMMANDS[name], "--out", out_of(name), "--seed", "7"]
    if name == "lab import":
        other = ["lab", "import", LOGS[0], *ON_FLOOR, "--out", out_of(name)]
    err = refusal_of(capsys, *other)
    assert out_of(name) in err
    assert "give another --out, or add --force to replace it" in err
    assert results(output_of(capsys, "show", out_of(name))) == shown, "nothing was changed"


@pytest.mark.slow
def test_force_replaces_what_vibroswarm_wrote_and_nothing_else(tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*COMMANDS["evaluate"], "--out", str(out)]) == 0
    assert main([*COMMANDS["run"], "--out", str(out)]) == 2
    assert main([*COMMANDS["run"], "--out", str(out), "--force"]) == 0
    assert (out / "run.html").exists()
    assert kind_of(out) == "result"
    assert main([*COMMANDS["evaluate"], "--out", str(out)]) == 2
    assert main([*COMMANDS["evaluate"], "--out", str(out), "--force"]) == 0
    assert kind_of(out) == "study"
    assert not (out / "run.html").exists()
    mine = tmp_path / "thesis"
    mine.mkdir()
    (mine / "thesis.tex").write_text("ten years")
    capsys.readouterr()
    for name in COMMANDS:
        assert main([*COMMANDS[name], "--out", str(mine), "--force"]) == 2, name
        assert "not replaced" in capsys.readouterr().err
        assert [path.name for path in mine.iterdir()] == ["thesis.tex"]
    assert "is not a folder of vibroswarm" in refusal_of(
        capsys, "reproduce", "--only", "fill-ratios", "--out", mine
    )


def test_a_scenario_is_shown(capsys):
    assert main(["scenario", "--robots", "8", "--out", "scenario.toml"]) == 0
    assert "swarm.robots 8 5" in words_of(capsys, "show", "scenario.toml")
    json_of(capsys, "show", "scenario.toml", "--json")
