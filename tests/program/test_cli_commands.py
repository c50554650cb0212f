"""Words of commands: older ones name the new ones, lists of names, and how the parts of a command line are read."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm import InputError, preset
from vibroswarm.cli import main
from vibroswarm.cli.command_line import Option, bound, help_of, parser_of
from vibroswarm.cli.commands import COMMANDS
from vibroswarm.documents.plan import CELLS_DRAWN, PAGE_OF_CELL_S, PAGE_S, PAGE_SAMPLES, work_sentence
from vibroswarm.study import detection
from vibroswarm.study.runner import Expected, Job

OLDER = {
    "sweep study.toml --out out": "evaluate STUDY.toml",
    "merge a b": "evaluate merge",
    "tradeoff --runs 5": "evaluate tradeoff",
    "tune": "league tune",
    "optimize --check=p.toml": "optimize compare FIRST SECOND",
    "optimize --sensitivity": "optimize sensitivity",
}


@pytest.mark.parametrize("line", OLDER)
def test_older_words_name_the_new_ones_in_one_line(line, capsys):
    assert main(line.split()) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    assert told.err.endswith(f" is now 'vibroswarm {OLDER[line]}'\n")
    new = OLDER[line].split()
    assert " ".join(new[:2]) in COMMANDS or new[0] in COMMANDS


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ("strategies", ("soft", "dmvd", "places")),
        ("networks", ("ideal", "tree")),
        ("sensors", ("gamma", "energies")),
        ("motions", ("event", "mujoco")),
        ("tasks", ("fill_ratio",)),
        ("presets", ("paper", "calibrated")),
    ],
)
def test_names_are_listed_with_a_line_each(command, names, capsys):
    lines = output_of(capsys, command).splitlines()
    for name in names:
        (line,) = (line for line in lines if line.split()[:1] == [name])
        assert len(line.split()) > 2, line


def inspect(
    folder: Annotated[Path, Option("a folder", "DIR")],
    /,
    *logs: Annotated[Path, Option("logs", "LOG")],
    runs: Annotated[int, Option("runs", low=1, high=9)] = 3,
    share: Annotated[float | None, Option("5 % or so")] = None,
    style: Annotated[Literal["page", "slide"], Option("{names}")] = "page",
    sizes: Annotated[tuple[int, ...], Option("sizes")] = (5, 10),
    settings: Annotated[Sequence[str], Option("set", name="--set")] = (),
    quick: Annotated[bool, Option("quickly")] = False,
) -> None:
    """Inspect a folder.

    example:
      inspect out
    """


def parsed(*words: str) -> dict[str, object]:
    values = parser_of("inspect", inspect, {}).parse_args(words)
    return dict(bound(inspect, vars(values)).arguments)


def test_a_function_becomes_a_command_line():
    assert parsed("out", "a.csv", "b.csv") == {
        "folder": Path("out"),
        "logs": (Path("a.csv"), Path("b.csv")),
        "runs": 3,
        "share": None,
        "style": "page",
        "sizes": (5, 10),
        "settings": [],
        "quick": False,
    }
    line = ["out", "a", "--set", "x=1", "--set", "y=2", "--sizes", "3,4,3", "--quick", "--share", "0.5"]
    found = parsed(*line)
    assert (found["settings"], found["sizes"], found["share"]) == (["x=1", "y=2"], (3, 4), 0.5)
    parser = parser_of("inspect", inspect, {})
    texts = {action.dest: help_of(action) for action in parser._actions}
    assert texts["runs"] == "runs (default 3)"
    assert texts["style"] == "page, slide (default page)"
    assert parser.description == "Inspect a folder."
    assert "inspect out" in parser.format_help()
    assert "5 % or so" in parser.format_help()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("out a --runs 0", "--runs: 0 is not from 1 to 9"),
        ("out a --runs x", "--runs: 'x' is not a whole number"),
        ("out a --share nan", "--share: 'nan' is not a number"),
        ("out a --style pagee", "--style: there is no 'pagee', did you mean 'page'?"),
        ("out a --sizes 3,x", "--sizes: 'x' is not a whole number"),
        ("out a --run 3", "--run: unknown option, did you mean '--runs'?"),
        ("out a --runs-each 3", "--runs-each: unknown option, did you mean '--runs'?"),
        ("out a --shrub 3", "--shrub: unknown option; "),  # its dashes alone made it similar to --share
        ("out", "inspect: the following arguments are required: LOG"),
    ],
)
def test_what_is_wrong_names_the_option(line, words):
    with pytest.raises(InputError) as error:
        parsed(*line.split())
    assert str(error.value).startswith(words)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("run --runs 5", "--runs: unknown option; for many runs: vibroswarm evaluate"),
        ("optimize --scenario a.toml", "--scenario: unknown option; set it in the search file"),
    ],
)
def test_an_option_of_another_command_leads_there(line, words, capsys):
    assert main(line.split()) == 2
    assert words in capsys.readouterr().err


def test_a_parameter_without_an_option_is_a_mistake():
    def forgotten(*, runs: int = 3) -> None: ...

    forgotten.__annotations__["runs"] = int
    with pytest.raises(TypeError, match="runs"):
        parser_of("forgotten", forgotten, {})
    assert isinstance(parser_of("inspect", inspect, {}), argparse.ArgumentParser)


def test_an_estimate_covers_the_whole_command():
    left = Expected(runs=100, core_s=10.0, tried=26)
    assert "100 runs of motion; about 10 s of one core in all" in work_sentence(left)
    again = left._replace(again_runs=100, again_s=10.0)
    assert "100 runs of motion and 100 runs on other seeds; about 20 s of one core" in work_sentence(again)
    drawn = work_sentence(again, page_cells=2)
    assert "100 runs on other seeds and the report" in drawn
    assert int(drawn.split("about ")[1].split()[0]) > 20 + PAGE_S
    few, many = (work_sentence(left, page_cells=cells) for cells in (CELLS_DRAWN, 10_000))
    assert "about 20 s of" in few  # 10 s, and a page on which as many cells are drawn
    assert "about 60 s of" in many  # and a row for each of the others
    long = work_sentence(left, page_cells=2, again_samples=10 * PAGE_SAMPLES)
    assert int(long.split("about ")[1].split()[0]) > 20 * PAGE_OF_CELL_S + 10
    assert "100 runs of motion in this shard; about 10 s" in work_sentence(left, Job(1, 4))
    tested = left._replace(further_runs=40, further_s=20.0)
    assert "100 runs of motion and 40 runs to test beliefs and faults; about 30 s" in work_sentence(tested)
    assert work_sentence(tested._replace(runs=0)).startswith("To do: 40 runs to test")
    assert work_sentence(Expected(0, 0.0, 0), page_cells=1) == "Nothing to do: all runs exist."
    assert work_sentence(Expected(0, 0.0, 0), Job(2, 4)) == "Nothing to do: no run of this shard is missing."


SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5", "--runs", "3"]


def test_detection_asks_for_a_share_and_names_its_strategy(capsys):
    line = ["detect", *SHORT, "--more-than", "30%", "--robots", "2", "--strategy", "totals"]
    said = output_of(capsys, *line)
    assert "Does more than 30 % vibrate?" in said
    assert said.startswith("Too few runs to say: 3 runs cannot show at most 5 % misses")
    assert "Strategy totals" in said
    assert "--more-than: is also set by --set decision.decision_boundary" in refusal_of(
        capsys, *line, "--set", "decision.decision_boundary=0.2"
    )


def test_a_detection_of_few_runs_has_no_later_ends():
    """They are tried only where there are enough runs to show something."""
    scenario = preset("paper").with_values({"run.t_end_s": 20.0, "swarm.robots": 2})
    assert detection.sizes_of(scenario) == (2, 4, 8)
    few = detection.detect(scenario, robots=[2], fills=[0.4, 0.6], runs=4)
    assert few.scenario.run.t_end_s == 20.0
    assert not few.finds_nothing, "4 runs cannot show 5 %"
