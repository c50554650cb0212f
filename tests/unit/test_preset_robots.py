"""Robots of the presets ``e-puck`` and ``kilobot`` drive, turn and see as their sources say."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from vibroswarm import preset, simulate

ALONE = {"swarm.robots": 1, "strategy.name": "none", "run.stop": "t_end", "run.t_end_s": 300.0}


def paths_of(name: str, motion: str = "event") -> pl.DataFrame:
    found = simulate(preset(name).with_values(ALONE), 1, 5, motion=motion, moves=True).moves
    assert found is not None
    return found


def wall_m(paths: pl.DataFrame) -> np.ndarray:
    """Distance of the centre from the nearest wall of an arena of 1 m."""
    places = paths.select("x_m", "y_m").to_numpy()
    return np.minimum(places, 1.0 - places).min(axis=1)


@pytest.mark.slow
def test_an_e_puck_is_that_of_its_source() -> None:
    paths = paths_of("e-puck", "fixed-step")  # a kernel of its own, for eight rays, of a smaller engine
    speeds = paths.filter(kind="drive")["speed_m_s"].to_numpy()
    np.testing.assert_allclose(speeds, 2.0 * np.pi * 0.0205, rtol=0.05)  # a turn of the wheels a second
    fastest_rad_s = paths["turn_rate_rad_s"].abs().max()
    np.testing.assert_allclose(fastest_rad_s, 2.0 * 0.1288 / 0.052, rtol=0.05)
    assert wall_m(paths).min() >= 0.0355 - 1e-9
    before = paths["kind"].shift(1)
    begun = paths.filter((pl.col("kind") == "avoid") & (before != "avoid"))
    assert begun.height > 50
    assert wall_m(begun).max() <= 0.065


def test_a_kilobot_is_that_of_its_source() -> None:
    paths = paths_of("kilobot")
    drives = paths.filter(kind="drive")["speed_m_s"].to_numpy()
    moving = drives[drives > 0.0]
    assert 0.009 < moving.mean() < 0.012  # about 1 cm/s
    fastest_deg_s = np.degrees(paths["turn_rate_rad_s"].abs().max())
    assert 45.0 < fastest_deg_s < 1.5 * 46.0  # speeds differ by up to the factor 1.5, as the paper's
    assert paths.filter(kind="avoid").height == 0
    assert 0.2 < np.mean(drives == 0.0) < 0.8  # at walls
    assert wall_m(paths).min() >= 0.0165 - 1e-9


def test_kilobots_hear_those_near_them_alone() -> None:
    few = {"swarm.robots": 5, "run.stop": "t_end", "run.t_end_s": 300.0}
    near = simulate(preset("kilobot").with_values(few), 1, 5).robots["messages_received"].sum()
    all_of_them = preset("kilobot").with_values({**few, "network.name": "ideal"})
    assert 0 < near < 0.2 * simulate(all_of_them, 1, 5).robots["messages_received"].sum()
