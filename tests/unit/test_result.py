"""Results on disk: written and read without loss, whole or not at all, and refused when damaged."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from vibroswarm import strategies
from vibroswarm.errors import InputError
from vibroswarm.inference.reports import REPORTS
from vibroswarm.motion.motion_tables import FAILURES
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate, versions

SHORT: dict[str, Any] = {
    "run.t_end_s": 60.0,
    "decision.min_observations": 10,
    "decision.credible_threshold": 0.7,
    "change.at_s": 30,
    "change.to": "invert",
}


@pytest.fixture(scope="module")
def result() -> Result:
    """Two runs out of order, with everything."""
    scenario = Scenario().with_values({**SHORT, "faults.stuck_at_1": [2], "localisation.method": "mixture"})
    simulated = simulate(scenario, 2**62 + 1, [4, 2**31], poses=True, moves=True)
    assert simulated.failures is None  # only simulators of physics fail
    return replace(
        simulated,
        failures=pl.DataFrame([(4, 59.0, "for a test")], schema=FAILURES, orient="row"),
        reports=pl.DataFrame(
            [(4, 0, 0, "trust", 0, 0.5), (4, 0, 1, "trust", 0, math.inf)], schema=REPORTS, orient="row"
        ),
    )


@pytest.fixture(scope="module")
def other() -> Result:
    """One run, with less."""
    return simulate(Scenario().with_values(SHORT), 9)


@pytest.fixture(scope="module")
def written(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result on disk, in a folder whose name is not a plain word."""
    path = tmp_path_factory.mktemp("written") / "two runs, über 60 s"
    result.write(path)
    return path


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    """A copy of the folder."""
    return Path(shutil.copytree(written, tmp_path / written.name))


def without_leftovers(path: Path) -> bool:
    """Whether nothing but ``path`` itself stands in its folder."""
    return [p for p in path.parent.iterdir() if p != path] == []


def test_reading_gives_back_an_equal_result(result: Result, written: Path) -> None:
    again = Result.read(written)
    assert again == result
    assert again.same_tables(result)
    assert (again.seed, again.scenario.hash, again.source) == (2**62 + 1, result.scenario.hash, result.source)
    assert dict(again.versions) == versions()
    assert Result.read(str(written)) == result
    assert without_leftovers(written)


QUICK = ("places", "dc")
"""Strategies whose messages, posteriors or beliefs are not those of the study; all others take longer to compile."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in strategies.known()]
)
def test_a_result_of_every_strategy_is_read_back(name: str, tmp_path: Path) -> None:
    """Many have no posterior, no belief, or messages without a bit: their columns are null."""
    simulated = simulate(Scenario().with_values({"strategy.name": name, "run.t_end_s": 40.0}), 1, 1)
    simulated.write(tmp_path / "one")
    assert Result.read(tmp_path / "one").same_tables(simulated)


def test_the_floor_of_each_run_comes_back(result: Result, written: Path) -> None:
    again = Result.read(written)
    for run in (4, 2**31):
        floor = result.scenario.floor_for(result.seed, run)
        assert again.floor(run) == floor
        assert again.floor(run).name == floor.name
    assert again.floor(4) != again.floor(2**31)
    with pytest.raises(InputError, match="no run 5"):
        again.floor(5)


# What is there already


# Failure in the middle


# Damage
