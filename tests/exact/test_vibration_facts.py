"""Facts of energies by which the physics of vibration is judged, on energies whose law is known."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest

from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.vibration_facts import _spread, fact_samples, facts, robot_spread, tile_spread
from vibroswarm.floors.floor import Floor

SESSIONS, ROBOTS, ROWS = 12, 20, 6000
TILES = np.arange(25).reshape(5, 5) % 2 == 0


def dataset() -> Dataset:
    """Robots that sample every 3 s, three times on a tile of a chessboard, then on another one."""
    rng = np.random.default_rng(7)
    stays = rng.integers(0, 25, (SESSIONS, ROBOTS, ROWS // SESSIONS // ROBOTS // 3 + 1)).repeat(3, axis=2)
    session, robot, sample = (axis.ravel() for axis in np.indices(stays.shape))
    tile = stays.ravel()
    x_m, y_m = (0.2 * (along + rng.uniform(0.16, 0.84, tile.size)) for along in (tile % 5, 4 - tile // 5))
    columns = {
        "run": session.astype(np.uint32), "robot": robot.astype(np.uint16), "sample": sample.astype(np.uint32),
        "time_s": 3.0 * sample + rng.random(tile.size), "x_m": x_m, "y_m": y_m, "tile": tile,
        "edge_m": np.where(TILES.ravel()[tile], -0.032, 0.032), "vibrating": TILES.ravel()[tile],
    }  # fmt: skip
    floor = Floor(TILES.astype(np.uint8), 0.2, 0.2, 0.0, 0.0)
    frame, empty = pl.DataFrame(columns), pl.DataFrame()
    return Dataset(frame, empty, empty, (floor,) * SESSIONS, (1.0, 1.0), (), lambda: (empty, empty))


def energies(found: Dataset, tiles: float, robots: float, held_s: float) -> np.ndarray:
    """Energies whose logarithm has the standard deviation 0.5 in time, and others between tiles and robots."""
    rng, frame = np.random.default_rng(3), found.samples
    session, robot, tile, time_s = (frame[name].to_numpy() for name in ("run", "robot", "tile", "time_s"))
    slots = rng.normal(0.0, 0.5, (SESSIONS, 25, int(time_s.max() / held_s) + 1))
    of_tile, of_robot = rng.normal(0.0, tiles, (SESSIONS, 25)), rng.normal(0.0, robots, (SESSIONS, ROBOTS))
    in_time = slots[session, tile, (time_s / held_s).astype(np.int64)]
    return np.exp(of_tile[session, tile] + of_robot[session, robot] + in_time)


def test_correlations_tell_what_energies_share() -> None:
    found = dataset()
    samples = fact_samples(found)
    assert len(samples.successive) > 3000
    assert len(samples.together) > 300

    def correlations(**law: float) -> tuple[float, float]:
        of = facts(samples, energies(found, tiles=0.2, **law), 1.33)
        return (
            of["vibrating: correlation of successive samples of a robot"],
            of["vibrating: correlation of two robots within 5 s"],
        )

    by_itself = correlations(robots=0.0, held_s=0.01)
    of_robots = correlations(robots=0.5, held_s=0.01)
    in_time = correlations(robots=0.0, held_s=60.0)
    assert by_itself == (pytest.approx(0.0, abs=0.1), pytest.approx(0.0, abs=0.15))
    assert of_robots == (pytest.approx(0.5, abs=0.1), pytest.approx(0.0, abs=0.15))
    assert min(in_time) > 0.75


def test_spreads_are_those_of_tiles_and_robots_and_of_few_samples() -> None:
    found = dataset()
    samples, rows = fact_samples(found), np.arange(found.samples.height)
    lone = energies(found, tiles=0.0, robots=0.0, held_s=0.01)
    both = energies(found, tiles=0.3, robots=0.2, held_s=0.01)
    for spread, true in ((tile_spread, 0.3), (robot_spread, 0.2)):
        without = spread(samples, lone, rows)
        assert 0.05 < without < 0.2  # means of few samples scatter by themselves
        found_spread = math.sqrt(spread(samples, both, rows) ** 2 - without**2)
        assert found_spread == pytest.approx(true, rel=0.2)
    by_hand = _spread(np.array([0, 0, 1, 1]), np.arange(4), np.array([0.0, 2.0, 10.0, 14.0]))
    assert by_hand == pytest.approx(math.sqrt((1 + 1 + 4 + 4) / (4 - 2)))
