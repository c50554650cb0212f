"""The boundary that readings are held against: by enumerating floors, by sampling, and by false alarms."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import polars as pl
import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.motion.motion_tables import MOTION
from vibroswarm.observation.decision_boundary import (
    expected_ones,
    expected_ones_on,
    mean_sensed_shares,
    readings_boundary,
    sensed_shares_on,
)
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import preset
from vibroswarm.statistics.decidability import decidability

PAPER, CALIBRATED = preset("paper"), preset("calibrated")
TILES = {"decision.boundary_of": "tiles"}


@pytest.mark.parametrize(
    ("reach_m", "blur_m", "left_m", "width_m"),
    [(0.02, None, 0.0, 0.2), (-0.03, 0.01, 0.1, 0.2), (0.25, 0.05, 0.0, 0.2), (0.03, 0.03, -0.1, 0.3)],
)
def test_the_mean_over_all_floors_of_a_grid(
    reach_m: float, blur_m: float | None, left_m: float, width_m: float
) -> None:
    """Every floor of 2 x 3 tiles with so many that vibrate, one by one; arenas that cut tiles, and bare ones."""
    sensor, size = Sensor(edge_reach_m=reach_m, edge_blur_m=blur_m), (0.6, 0.5)
    for vibrating in range(1, 6):
        found = []
        for which in combinations(range(6), vibrating):
            tiles = np.zeros(6, dtype=np.uint8)
            tiles[list(which)] = 1
            floor = Floor(tiles.reshape(2, 3), width_m, 0.2, left_m, 0.05)
            felt = sensed_shares_on(sensor, floor, size, grid=12)
            found.append(felt.detected + felt.spillover)
        mean = mean_sensed_shares(sensor, floor.geometry, size, vibrating / 6, grid=12)
        assert mean.detected + mean.spillover == pytest.approx(np.mean(found), abs=1e-12)


@pytest.mark.parametrize("width_m", [0.05, 0.2, 30.0])
@pytest.mark.parametrize(("reach_m", "blur_m"), [(-0.01, None), (0.01, 0.008)])
def test_one_straight_edge_by_theory(width_m: float, reach_m: float, blur_m: float | None) -> None:
    """A floor of two halves: the vibrating one is larger by the reach, whatever the blur and the size of the tiles."""
    sensor, floor = (
        Sensor(edge_reach_m=reach_m, edge_blur_m=blur_m),
        Floor.filling([[1, 0]], 2 * width_m, 1.0),
    )
    felt = sensed_shares_on(sensor, floor, (2 * width_m, 1.0))
    assert felt.detected + felt.spillover == pytest.approx(0.5 + reach_m / (2 * width_m), abs=2e-5 / width_m)
    edges = mean_sensed_shares(sensor, floor.geometry, (2 * width_m, 1.0), 0.5)
    assert edges.detected + edges.spillover == pytest.approx(felt.detected + felt.spillover, abs=1e-12)


def test_what_is_expected_of_a_floor_is_what_samples_read() -> None:
    """By the sensor itself, at uniformly random places; part of the arena is bare, and vibration reaches onto it."""
    values = {"floor.source": "diagonal:0.48", "floor.tile_width_m": 0.06, "floor.left_m": 0.2}
    edges = {"sensor.edge_reach_m": 0.02, "sensor.edge_blur_m": 0.01}
    scenario = PAPER.with_values({**values, **edges})
    count, numbers = 200_000, np.random.default_rng(5)
    places = pl.DataFrame(
        {
            "run": np.zeros(count, dtype=np.uint32),
            "robot": np.zeros(count, dtype=np.uint16),
            "sample": np.arange(count, dtype=np.uint32),
            "x_m": numbers.random(count),
            "y_m": numbers.random(count),
        }
    ).with_columns(
        pl.lit(None, kind).alias(name)
        for name, kind in MOTION.items()
        if name not in ("run", "robot", "sample", "x_m", "y_m")
    )
    floor = scenario.floor_for(0, 0)
    read = observe(scenario, 1, places.select(list(MOTION)), {0: floor}, energies=False)["observation"]
    expected = expected_ones_on(scenario.sensor, floor, (1.0, 1.0))
    error = np.sqrt(expected * (1 - expected) / count)
    assert abs(float(read.cast(pl.Float64).mean()) - expected) < 3.5 * error  # type: ignore[arg-type]
    without = expected_ones_on(PAPER.sensor, floor, (1.0, 1.0))
    assert abs(without - expected) > 3.5 * error  # edges left out would be seen


def test_the_simple_formula_would_put_calibrated_robots_on_the_wrong_side() -> None:
    a, b = error_rates(CALIBRATED.sensor)
    simple = 0.5 * (1 - b) + 0.5 * a
    share = decidability(CALIBRATED).share
    assert simple == pytest.approx(0.460, abs=5e-4)
    assert share == pytest.approx(0.476, abs=5e-4)
    tested = readings_boundary(CALIBRATED.with_values(TILES))
    assert tested == pytest.approx(expected_ones(CALIBRATED, 0.5))  # by rates that robots work out themselves
    assert simple < share < tested < 0.5
    assert decidability(CALIBRATED.with_values(TILES)).verdict == "decidable"


def test_soft_feedback_is_neutral_where_its_bits_are_as_likely_as_the_boundary() -> None:
    """Hence the refusal: an undecided robot sends ones with probability 1/2, whatever q is."""
    symmetric = {
        "sensor.still_shape": PAPER.sensor.vibrating_shape, "sensor.still_scale": PAPER.sensor.vibrating_scale,
        "decision.assumed_false_positive": 0.1, "decision.assumed_false_negative": 0.1,
    }  # fmt: skip
    assert readings_boundary(PAPER.with_values({**TILES, **symmetric, "strategy.name": "soft"})) == 0.5
