"""Strategies that read places get estimates unless true places are asked for, which every answer then says first."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from helpers.commands import json_of, output_of
from vibroswarm import Study, preset, simulate, strategies
from vibroswarm.analysis.robot_knowledge import true_places_notes
from vibroswarm.analysis.verdict import confidence, presumed, verdict
from vibroswarm.cli import main
from vibroswarm.documents.notebook import html_of
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.static_analysis import PLACE, fields_read, reads_places

READERS = {"places", "explore", "field", "fading"}
NOTE = "places with true places: an upper bound"
TRUE = ["--set", "localisation.method=true"]
SHORT = ["--set", "run.t_end_s=30", "--robots", "2"]


def of(strategy: str, **values: Any) -> Scenario:
    more = {name.replace("__", "."): value for name, value in values.items()}
    return preset("paper").with_values({"strategy.name": strategy, "run.t_end_s": 30.0, **more})


def test_who_reads_places_is_found_by_name_as_by_parsing() -> None:
    by_parsing = {name for name, one in strategies.known().items() if fields_read(one) & set(PLACE)}
    assert {name for name, one in strategies.known().items() if reads_places(one)} == by_parsing == READERS


@pytest.mark.parametrize("strategy", sorted(strategies.known()))
def test_the_default_is_estimated_places_for_those_who_read_them(strategy: str) -> None:
    """And it has the hash of what it means, so that hashes of all other strategies stay."""
    default, mixture, true = (
        of(strategy, localisation__method=method) for method in ("auto", "mixture", "true")
    )
    assert of(strategy) == default
    same, other = (mixture, true) if strategy in READERS else (true, mixture)
    assert default.hash == same.hash != other.hash
    assert default.place_method == same.place_method
    assert not default.reads_true_places
    assert true.reads_true_places == (strategy in READERS)


def test_presets_leave_it_to_the_strategy() -> None:
    for name in preset_names():
        for strategy in READERS:
            assert preset(name).with_values({"strategy.name": strategy}).place_method == "mixture", name


def test_the_default_decides_as_estimated_places_do() -> None:
    default, mixture, true = (
        simulate(of("places", localisation__method=method, run__t_end_s=120.0), 3, 1)
        for method in ("auto", "mixture", "true")
    )
    assert default.places is not None
    assert default.inference.equals(mixture.inference)
    assert not default.inference.equals(true.inference)
    assert default.motion.equals(true.motion)
    assert simulate(of("soft"), 3, 1).places is None


def test_only_true_places_that_are_read_have_a_note() -> None:
    assert true_places_notes([of("places"), of("soft", localisation__method="true")]) == []
    both = [of(name, localisation__method="true") for name in ("places", "none", "field", "places")]
    assert true_places_notes(both)[0].startswith("places, field with true places: an upper bound")


def test_what_robots_presume_is_said_of_what_they_do() -> None:
    """Robots that map the floor do not treat all bits as independent; the errors of their places are not."""
    bits = "Robots treat all bits as independent; those of neighbouring samples are not."
    places = "Robots treat errors of their places as independent; those of neighbouring samples are not."
    for strategy in strategies.known():
        assert presumed(of(strategy)) == (places if strategy in READERS else bits)
        assert presumed(of(strategy, localisation__method="true")) == ("" if strategy in READERS else bits)
    for method, note in (("auto", f" {places}"), ("true", "")):
        found = verdict(simulate(of("places", localisation__method=method), 3, 1))
        assert confidence(found).endswith(f"%.{note}")


COMMANDS = {
    "run": ["run"],
    "evaluate": ["evaluate", "--runs", "2", "--no-confirm"],
    "detect": ["detect", "--runs", "2", "--fills", "0.4,0.6"],
    "tradeoff": ["evaluate", "tradeoff", "--runs", "2", "--thresholds", "0.9", "--observations", "10"],
    "league": [
        "league", "--runs", "2", "--patterns", "random", "--fills", "0.4", "--belief-runs", "0", "--fault-runs", "0",
    ],
}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_the_first_lines_say_it(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    robots = ["--strategy", "none,places"] if command in ("evaluate", "league") else ["--strategy", "places"]
    line = [*COMMANDS[command], *SHORT, *robots, "--quiet"]
    assert NOTE in output_of(capsys, *line, *TRUE).partition("\n\n")[0]
    assert "upper bound" not in output_of(capsys, *line).partition("\n\n")[0]


def test_folders_and_pages_say_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    places = [*SHORT, "--strategy", "places", *TRUE, "--quiet"]
    for name, command in (("one", ["run"]), ("many", ["evaluate", "--runs", "2", "--no-pictures"])):
        assert main([*command, *places, "--out", str(tmp_path / name)]) == 0
        assert NOTE in output_of(capsys, "show", str(tmp_path / name))
    assert NOTE in (tmp_path / "one" / "run.html").read_text(encoding="utf-8")
    assert json_of(capsys, "show", str(tmp_path / "one"), "--json")["robots_were_told"][0].startswith(NOTE)


def test_notebooks_and_reports_say_it() -> None:
    true = of("places", localisation__method="true", swarm__robots=2)
    assert NOTE in html_of(simulate(true, 3, 2))
    compared = Study.of(true, runs=2, strategy__name=["none", "places"]).run().compare(confirm=False)
    assert str(compared).startswith(NOTE)
    assert NOTE in html_of(compared)
