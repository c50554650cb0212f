"""The example that estimates a mean value from what is measured: by hand, and whether its spreads are right."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.plain_reference import equals_plain
from vibroswarm import load_code, preset, simulate
from vibroswarm.statistics.figures import run_figures
from vibroswarm.strategies import base

FILE = Path(__file__).parents[2] / "examples/kinds/mean_value.py"
VALUES = {
    "task.name": "mean",
    "floor.values": [[(column + 0.5) / 10 for column in range(10)]] * 10,
    "strategy.name": "level",
    "run.t_end_s": 600.0,
}


@pytest.fixture(autouse=True)
def loaded() -> Iterator[None]:
    assert FILE.read_text(encoding="utf-8").count("\n") <= 80
    load_code(f"{FILE}:level")
    yield
    base.forget("level")


def test_a_robot_alone_estimates_by_the_mean_of_what_it_measures() -> None:
    alone = preset("paper").with_values(VALUES | {"swarm.robots": 1, "strategy.level.batch": 1})
    result = simulate(alone, 3, 1)
    energy = result.observations["energy"].to_numpy().astype(float)
    levels = (energy - 0.862) / (2.538 - 0.862)
    assert result.robots["estimate"][0] == pytest.approx(levels.mean(), abs=1e-6)
    spread = levels.std(ddof=1) / np.sqrt(levels.size) * np.sqrt((levels.size - 1) / (levels.size - 3))
    assert result.robots["estimate_spread"][0] == pytest.approx(spread, rel=1e-5)


def test_all_ways_of_running_hand_over_the_same_values() -> None:
    short = preset("paper").with_values(VALUES | {"run.t_end_s": 60.0, "strategy.level.batch": 3})
    assert list(equals_plain(short)) == []


@pytest.mark.slow
def test_its_90_percent_intervals_hold_the_mean_in_about_90_percent() -> None:
    def judged(**fields: Any) -> tuple[float, float]:
        result = simulate(preset("paper").with_values(VALUES | fields), 11, 200)
        runs = run_figures(result.robots, result.runs, 600.0)
        return float(runs["estimate_error"].mean()), float(runs["estimate_coverage"].mean())  # type: ignore[arg-type]

    error, coverage = judged()
    assert error < 0.04
    assert abs(coverage - 0.9) < 0.09  # robots of a run share their batches: four standard errors of 200 runs
    # Controls: spreads as if successive samples were independent, and robots that count readings.
    assert judged(**{"strategy.level.batch": 1})[1] < coverage - 0.05
    counted = judged(**{"strategy.name": "none", "decision.boundary_of": "tiles"})
    assert counted[0] > 2.0 * error
    assert counted[1] < 0.5
