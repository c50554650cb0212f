"""What a sample feels near edges, and where tiles and robots differ: against exact shares, and off in the paper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import stats

from vibroswarm.floors.floor import Floor, Place
from vibroswarm.motion.motion_tables import MOTION
from vibroswarm.observation.decision_boundary import sensed_shares_on
from vibroswarm.observation.edge_response import nearest_of_kind, response_of
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario, preset

HALVES = Floor.filling([[1, 0]])  # vibrates left of x = 0.5
CERTAIN: dict[str, Any] = {"model": "energies", "vibrating_energies": (5.0,), "still_energies": (0.1,)}


def samples_at(x_m: Any, y_m: Any = 0.5, robots: int = 1, runs: int = 1) -> pl.DataFrame:
    """A motion table of samples at these places, by as many robots and in as many runs, in turn."""
    x = np.atleast_1d(np.asarray(x_m, dtype=float))
    number = np.arange(x.size)
    frame = pl.DataFrame(
        {
            "run": np.sort(number % runs).astype(np.uint32),
            "robot": (number % robots).astype(np.uint16),
            "sample": number.astype(np.uint32),
            "x_m": x,
            "y_m": np.broadcast_to(np.asarray(y_m, dtype=float), x.shape).copy(),
        }
    )
    return frame.with_columns(
        **{name: pl.lit(None, kind) for name, kind in MOTION.items() if name not in frame.columns}
    ).select(list(MOTION))


def share_of_ones(sensor: Sensor, x_m: float, count: int = 4000) -> float:
    table = observe(Scenario(sensor=sensor), 3, samples_at(np.full(count, x_m)), {0: HALVES})
    return float(table["observation"].mean())  # type: ignore[arg-type]


def test_without_blur_vibrating_tiles_are_larger_by_the_reach() -> None:
    sensor = Sensor(edge_reach_m=0.02, **CERTAIN)
    assert [share_of_ones(sensor, x, 20) for x in (0.49, 0.519, 0.521)] == [1.0, 1.0, 0.0]
    smaller = Sensor(edge_reach_m=-0.02, **CERTAIN)
    assert [share_of_ones(smaller, x, 20) for x in (0.479, 0.481, 0.51)] == [1.0, 0.0, 0.0]


def test_the_nearest_tile_of_a_kind() -> None:
    rng = np.random.default_rng(4)
    tiles = rng.integers(0, 2, (6, 4), dtype=np.uint8)
    floor = Floor(tiles, 0.07, 0.05, 0.1, 0.2)
    place = Place(6, 4, 0.07, 0.05, 0.1, 0.2 + 6 * 0.05)
    for x, y in rng.random((300, 2)) * 0.7:
        for kind in (0, 1):
            distances = np.full(24, np.inf)
            for k in np.flatnonzero(tiles.ravel() == kind):
                left, top = 0.1 + (k % 4) * 0.07, 0.5 - (k // 4) * 0.05
                nearest_x, nearest_y = np.clip(x, left, left + 0.07), np.clip(y, top - 0.05, top)
                distances[k] = np.hypot(x - nearest_x, y - nearest_y)
            index, distance = nearest_of_kind(x, y, kind, 0.08, place, floor.tiles.ravel())
            if distances.min() > 0.08:
                assert (index, distance) == (-1, np.inf)
            else:
                assert distance == pytest.approx(distances.min(), abs=1e-12)
                assert distances[index] == pytest.approx(distances.min(), abs=1e-12)


def test_tiles_differ_and_keep_what_they_are() -> None:
    """Energies of one size multiplied by the tile's factor: the factor itself is read off."""
    floor = Floor.filling(np.ones((20, 20)))
    centres = (np.arange(20) + 0.5) / 20
    x, y = (one.ravel() for one in np.meshgrid(centres, centres))
    sensor = Sensor(tile_spread=0.3, **CERTAIN)
    scenario = Scenario(sensor=sensor)

    def energies(run: int, seed: int = 3) -> Any:
        places = samples_at(x, y).with_columns(run=pl.lit(run, pl.UInt32))
        return observe(scenario, seed, places, {run: floor})["energy"].to_numpy() / 5.0

    logs = np.log(energies(0))
    assert stats.kstest(logs, stats.norm(-0.045, 0.3).cdf).pvalue > 1e-3
    assert stats.kstest(logs, stats.norm(0.045, 0.3).cdf).pvalue < 1e-3  # negative control: of mean above 1
    assert np.array_equal(energies(0), energies(0))
    assert not np.allclose(energies(0), energies(1))
    still = observe(scenario, 3, samples_at(x, y), {0: Floor.filling(np.zeros((20, 20)))})
    assert still["energy"].to_numpy() / 0.1 == pytest.approx(
        energies(0), rel=1e-6
    )  # the tile's, whatever it does


def test_robots_differ_on_every_tile_alike() -> None:
    sensor = Sensor(robot_spread=0.2, tile_spread=0.3, **CERTAIN)
    floor = Floor.filling([[1, 1]])
    places = samples_at(np.repeat([0.25, 0.75], 5), robots=5)
    energy = observe(Scenario(sensor=sensor), 3, places, {0: floor})["energy"].to_numpy().reshape(2, 5)
    ratio = energy[0] / energy[1]
    assert ratio == pytest.approx(np.full(5, ratio[0]), rel=1e-6)
    assert len({round(float(one), 6) for one in energy[0]}) == 5


def test_error_rates_on_a_floor_are_those_of_samples_all_over_it() -> None:
    sensor = Sensor(edge_reach_m=0.01, edge_blur_m=0.015)
    floor = Floor.filling(
        [[1, 0, 1, 0, 0], [0, 1, 0, 0, 1], [1, 0, 0, 1, 0], [0, 0, 1, 1, 0], [1, 0, 1, 0, 0]]
    )
    rng = np.random.default_rng(5)
    table = observe(
        Scenario(sensor=sensor), 3, samples_at(rng.random(60_000), rng.random(60_000)), {0: floor}
    )
    kind = floor.tiles.ravel()[table["tile"].to_numpy()]
    bit = table["observation"].to_numpy()
    felt, (a, b) = sensed_shares_on(sensor, floor, (1.0, 1.0)), error_rates(sensor)
    of_still = felt.spillover / (1 - felt.vibrating)
    of_vibrating = felt.detected / felt.vibrating
    positive = of_still * (1 - b) + (1 - of_still) * a
    negative = of_vibrating * b + (1 - of_vibrating) * (1 - a)
    assert bit[kind == 0].mean() == pytest.approx(positive, abs=0.008)
    assert 1 - bit[kind == 1].mean() == pytest.approx(negative, abs=0.008)
    assert positive > error_rates(sensor)[0] + 0.05  # negative control: the edges count
    assert sensed_shares_on(Sensor(), floor, (1.0, 1.0)) == pytest.approx(
        (floor.fill_ratio, floor.fill_ratio, 0.0)
    )


SIDE_M = 0.5
PLAIN = dict.fromkeys(
    ("sensor.edge_reach_m", "sensor.edge_blur_m", "sensor.tile_spread", "sensor.robot_spread")
)


def chance_of_one(
    s: Sensor, tiles: np.ndarray, x: float, y: float, tile_factors: np.ndarray, robot_factor: float
) -> float:
    """P(1), computed independently: distances to rectangles, scipy's distributions; tile factors as the tiles lie."""
    rows = tiles.shape[0]
    below = (rows - 1 - math.floor(y / SIDE_M), math.floor(x / SIDE_M))
    kind = int(tiles[below])
    others = []
    for (i, j), other in np.ndenumerate(tiles):
        dx = max(j * SIDE_M - x, x - (j + 1) * SIDE_M, 0.0)
        dy = max((rows - 1 - i) * SIDE_M - y, y - (rows - i) * SIDE_M, 0.0)
        if other != kind:
            others.append((math.hypot(dx, dy), (i, j)))

    def reads_one(of: int, factor: float) -> float:
        shape, scale, location = (
            (s.vibrating_shape, s.vibrating_scale, s.vibrating_location)
            if of
            else (s.still_shape, s.still_scale, s.still_location)
        )
        return float(stats.gamma.sf(s.rms_threshold / factor, shape, loc=location, scale=scale))

    own = tile_factors[below] * robot_factor
    reach, blur = s.edge_reach_m, s.edge_blur_m
    if reach is None or blur is None:
        return reads_one(kind, own)
    distance, nearest = min(others)
    past = reach + distance if kind else reach - distance
    vibrates = stats.norm.cdf(past / blur)
    of_kind = {kind: own, 1 - kind: tile_factors[nearest] * robot_factor}
    return float(vibrates * reads_one(1, of_kind[1]) + (1 - vibrates) * reads_one(0, of_kind[0]))


def test_bits_are_drawn_as_often_as_edges_and_factors_say() -> None:
    """At 30 places, of two robots: shares of ones by chi-squared; the same shares without edges fail."""
    scenario = preset("calibrated").with_values(
        {"floor.rows": 2, "floor.columns": 2, "floor.source": "random:0.5", "swarm.robots": 2}
    )
    floor = Floor(np.array([[1, 0], [0, 1]], dtype=np.uint8), SIDE_M, SIDE_M)
    random, each, count = np.random.default_rng(2), 2000, 30
    x, y = 0.5 + random.uniform(-0.05, 0.05, count), random.uniform(0.0, 1.0, count)
    robot = random.integers(0, 2, count)
    samples = samples_at(np.repeat(x, each), np.repeat(y, each)).with_columns(
        robot=pl.Series(np.repeat(robot, each).astype(np.uint16))
    )
    bits = observe(scenario, 3, samples, {0: floor}, energies=False)["observation"].to_numpy()
    ones = bits.reshape(count, each).sum(axis=1)
    factors = response_of(scenario, 3, 0, floor, np.arange(2.0)).factors.reshape(2, 5)
    of_robot, of_tile = factors[:, 0], (factors[0] / factors[0, 0])[1:].reshape(2, 2)

    def p_value(sensor: Sensor) -> float:
        share = np.array(
            [
                chance_of_one(sensor, floor.tiles, x[k], y[k], of_tile, of_robot[robot[k]])
                for k in range(count)
            ]
        )
        z = (ones - each * share) / np.sqrt(each * share * (1 - share))
        return float(stats.chi2.sf(z @ z, count))

    assert p_value(scenario.sensor) > 0.005
    assert p_value(scenario.with_values(PLAIN).sensor) < 1e-6
