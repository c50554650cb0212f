"""What Python may be given: NumPy's whole numbers are taken, everything else is refused in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vibroswarm.analysis.verdict import verdict
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import check_runs, simulate
from vibroswarm.study.spec import Study

SHORT = {"run.t_end_s": 20.0, "swarm.robots": 2}


def str_of(value: Any) -> str:
    return type(value).__name__


HUGE = 10**5000
"""More digits than Python turns into text."""


@pytest.fixture(scope="module")
def short() -> Scenario:
    return preset("paper").with_values(SHORT)


@pytest.mark.parametrize("seed", [1.5, "1", None, True, -1, 2**63, HUGE, [1], np.float64(1.0)], ids=str_of)
def test_a_seed_is_a_whole_number(short: Scenario, seed: Any) -> None:
    with pytest.raises(InputError, match=r"^seed: ") as caught:
        simulate(short, seed)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("runs", [0, -1, 1.5, "2", None, True, [], [1, 1], [0.5], ["a"], [-1], [2**32], HUGE, [HUGE],
                                  10**12, {1: 2}.items()], ids=str_of)  # fmt: skip
def test_runs_are_whole_numbers(short: Scenario, runs: Any) -> None:
    with pytest.raises(InputError, match=r"^runs: ") as caught:
        simulate(short, 1, runs)
    assert len(str(caught.value)) < 200


def test_whole_numbers_of_numpy_are_taken(short: Scenario) -> None:
    assert check_runs(np.uint64(2**62), np.int64(2)) == [0, 1]  # type: ignore[arg-type]
    assert check_runs(1, np.array([3, 1])) == [1, 3]  # type: ignore[arg-type]
    one, other = simulate(short, np.int64(3), np.int64(2)), simulate(short, 3, 2)  # type: ignore[arg-type]
    assert one == other
    assert Study(short, {}, np.int64(5)).runs == 5  # type: ignore[arg-type]


@pytest.mark.parametrize("scenario", ["paper", None, {}, 5])
def test_a_scenario_is_one(scenario: Any) -> None:
    with pytest.raises(InputError, match=r"^scenario: "):
        simulate(scenario)


@pytest.mark.parametrize("motion", [None, 5, ["event"]])
def test_a_source_of_motion_is_a_name(short: Scenario, motion: Any) -> None:
    with pytest.raises(InputError, match=r"^motion: "):
        simulate(short, motion=motion)


def test_the_verdict_is_on_the_run_that_there_is(short: Scenario) -> None:
    result = simulate(short, 1, [5])
    assert verdict(result) == verdict(result, 5)
    for run in (0, "x", 10**5000):
        with pytest.raises(InputError, match=r"^run: there is no run"):
            verdict(result, run)  # type: ignore[arg-type]


@pytest.mark.parametrize("field", ["swarm.robots", "run.t_end_s", "floor.source", "rays.side_m"])
def test_numbers_of_thousands_of_digits_are_refused_in_a_scenario(field: str) -> None:
    with pytest.raises(InputError, match=field.replace(".", r"\."), check=lambda e: len(str(e)) < 300):
        preset("paper").with_values({field: HUGE})


@pytest.mark.parametrize(
    "text",
    ["keep = [1]", "keep = [[1]]", "runs = 1.5", "seed = true", f"runs = {'9' * 5000}", "name = 1", "motion = 5",
     "format = []", "floors = 3", "[floors]\na = [1]", 'scenario = ["a"]', "[scenario]\npreset = 1"],
)  # fmt: skip
def test_wrong_types_in_a_study_are_refused(text: str) -> None:
    with pytest.raises(InputError) as caught:
        Study.from_toml(text)
    assert len(str(caught.value)) < 300
