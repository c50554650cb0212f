"""Patches and values of tiles: areas against Monte Carlo, readings against their law, kinds bit by bit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.special import ndtr

from vibroswarm import Scenario, preset, simulate
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.surfaces import Patch, mixed, named_patches
from vibroswarm.observation.decision_boundary import expected_ones_on
from vibroswarm.observation.energy_model import energies_of, energy_of, rates
from vibroswarm.observation.observe import observe

PAPER = preset("paper").with_values({"run.t_end_s": 300.0, "decision.min_observations": 30})
UNIT = (0.0, 0.0, 1.0, 1.0)


def on(source: str, **more: Any) -> Scenario:
    return PAPER.with_values({"floor.source": source, "floor.rows": 10, "floor.columns": 10, **more})


# Areas


@pytest.mark.parametrize(
    "source",
    ["patch:0.4", "patch:disc0.3@0.5", "patch:0.5x0.04", "patch:2*0.1..0.3@0.2..1+disc0.2", "patch:none"],
)  # fmt: skip
@pytest.mark.parametrize("size", [(1.0, 1.0), (0.83, 0.71)])
def test_fill_ratios_are_those_of_random_points(source: str, size: tuple[float, float]) -> None:
    arena = {
        "arena.width_m": size[0],
        "arena.height_m": size[1],
        "floor.tile_width_m": 0.1,
        "floor.tile_height_m": 0.1,
    }
    floor = on(source, **arena).floor_for(seed=3, run=1)
    count = 400_000
    x, y = np.random.default_rng(1).random((2, count)) * np.array(size)[:, None]
    contrast = floor.contrast_at(x, y)
    error = 4 * contrast.std() / math.sqrt(count) + 1e-12
    assert floor.fill_ratio_within(*size) == pytest.approx(contrast.mean(), abs=error)
    assert floor.share_within(0, *size) == pytest.approx(1.0 - floor.fill_ratio_within(*size), abs=1e-12)
    levels, shares = floor.level_shares(*size)
    for level in np.unique(np.round(levels, 6))[:5]:
        found = shares[np.isclose(levels, level)].sum()
        assert found == pytest.approx(np.isclose(contrast, level).mean(), abs=4 * 0.5 / math.sqrt(count))


def test_distances_are_those_to_the_nearest_point_of_the_edge() -> None:
    random = np.random.default_rng(2)
    angle = np.linspace(0.0, 2.0 * np.pi, 20_001)
    side = np.linspace(-0.5, 0.5, 20_001)
    for disc in (False, True):
        patch = Patch(0.4, 0.6, 0.3, 0.3 if disc else 0.05, 1.0, disc)
        if disc:
            edge = np.stack([0.4 + 0.15 * np.cos(angle), 0.6 + 0.15 * np.sin(angle)])
        else:
            across, up = 0.4 + 0.3 * side, 0.6 + 0.05 * side
            ends = [(across, np.full_like(side, 0.6 + e * 0.025)) for e in (-1, 1)]
            ends += [(np.full_like(side, 0.4 + e * 0.15), up) for e in (-1, 1)]
            edge = np.concatenate([np.stack(part) for part in ends], axis=1)
        for x, y in random.random((200, 2)):
            nearest = np.hypot(edge[0] - x, edge[1] - y).min()
            assert abs(patch.distance_m(x, y)) == pytest.approx(nearest, abs=1e-4)
    assert Patch(0.4, 0.6, 0.3, 0.05, 1.0).distance_m(0.4, 0.6) == -0.025


# Readings


def readings(floor: Floor, scenario: Scenario) -> pl.DataFrame:
    """What 40,000 samples at random places read."""
    count = 40_000
    random = np.random.default_rng(5)
    motion = pl.DataFrame(
        {
            "run": np.zeros(count, np.uint32),
            "robot": np.zeros(count, np.uint16),
            "sample": np.arange(count, dtype=np.uint32),
            "time_s": np.arange(count) * 1.0,
            "x_m": random.random(count),
            "y_m": random.random(count),
        }
    )
    return motion.join(observe(scenario, 1, motion, {0: floor}), on=["run", "robot", "sample"])


@pytest.mark.parametrize("spread", [{}, {"sensor.tile_spread": 0.2, "sensor.robot_spread": 0.1}])
def test_values_of_0_and_1_are_kinds_bit_by_bit(spread: dict[str, float]) -> None:
    rows = ["0110100110", "1111100000"] * 5
    kinds = PAPER.with_values({"floor.tiles": rows, **spread})
    values = PAPER.with_values({"floor.values": [[float(c) for c in row] for row in rows], **spread})
    of_values, of_kinds = values.floor_for(1, 0), kinds.floor_for(1, 0)
    assert of_values == of_kinds
    mine, theirs = simulate(values, 1, 5), simulate(kinds, 1, 5)
    for name in ("observations", "inference", "robots", "runs", "floors"):
        table, other = (getattr(one, name) for one in (mine, theirs))
        assert table.equals(other), name
    half = values.with_values({"floor.values": [[0.6 * float(c) for c in row] for row in rows]})  # a control
    assert not simulate(half, 1, 5).observations.equals(theirs.observations)


def test_a_patch_of_the_size_of_a_tile_is_that_tile() -> None:
    tiles = np.zeros((5, 5), dtype=np.uint8)
    still = Floor.filling(tiles)
    tiles[1, 3] = 1
    patch = Patch(0.7, 0.7, 0.2, 0.2, 1.0)
    patched = replace(still, patches=(patch,))
    both = [readings(floor, PAPER) for floor in (patched, Floor.filling(tiles))]
    assert both[0].select("energy", "observation").equals(both[1].select("energy", "observation"))
    assert not readings(still, PAPER).equals(both[0])  # a control


def test_readings_on_a_patch_follow_its_contrast() -> None:
    law = PAPER.sensor
    u = np.random.default_rng(4).random(1_000_000)
    still, vibrating = (energy_of(law, kind, u).astype(np.float64) for kind in (0, 1))
    for contrast in (0.25, 0.5, 0.9):
        drawn = (mixed(still, vibrating, contrast) > law.rms_threshold).mean()
        share = rates(law, levels=np.array([0.0, contrast]))[1, 1]
        assert share == pytest.approx(drawn, abs=4 * 0.5 / 1000)
    floor = replace(Floor.filling(np.zeros((5, 5))), patches=(Patch(0.5, 0.5, 0.6, 0.6, 0.5, True),))
    rows = readings(floor, PAPER)
    inside = np.hypot(rows["x_m"] - 0.5, rows["y_m"] - 0.5) < 0.3
    ones = rows["observation"].to_numpy()
    for where, level in ((inside, 0.5), (~inside, 0.0)):
        expected = rates(law, levels=np.array([0.0, level]))[1, 1]
        assert ones[where].mean() == pytest.approx(expected, abs=4 * 0.5 / math.sqrt(where.sum()))
    assert ones.mean() == pytest.approx(expected_ones_on(law, floor, (1.0, 1.0)), abs=4 * 0.5 / 200)
    small = Floor(np.zeros((5, 5)), 0.1, 0.2, patches=(Patch(0.25, 0.5, 0.4, 0.4, 0.5),))
    half, still_too = rates(law, levels=np.array([0.0, 0.5]))[::-1, 1]
    assert expected_ones_on(law, small, (1.0, 1.0)) == pytest.approx(0.16 * half + 0.84 * still_too)
    above = rows["energy"].to_numpy() > law.rms_threshold  # energies and bits agree
    assert (above == (ones == 1)).all()


def test_kinds_between_have_energies_between() -> None:
    u = np.random.default_rng(7).random(1000)
    kinds = np.full(1000, 2, dtype=np.uint8)
    found = energies_of(PAPER.sensor, kinds, u, levels=np.array([0.0, 1.0, 0.5]))
    ends = [energies_of(PAPER.sensor, np.full(1000, kind, np.uint8), u).astype(np.float64) for kind in (0, 1)]
    np.testing.assert_allclose(found, 0.5 * (ends[0] + ends[1]), rtol=1e-6)


def test_edges_of_patches_are_felt_as_those_of_tiles() -> None:
    scenario = PAPER.with_values(
        {"sensor.edge_reach_m": 0.01, "sensor.edge_blur_m": 0.02, "sensor.rms_threshold": 1.2}
    )
    patch = Patch(0.5, 0.5, 0.4, 0.4, 1.0)
    floor = replace(Floor.filling(np.zeros((5, 5))), patches=(patch,))
    rows = readings(floor, scenario)
    beyond = patch.distance_m(rows["x_m"].to_numpy(), rows["y_m"].to_numpy())
    rate = rates(scenario.sensor)[:, 1]
    sensed = ndtr((0.01 - beyond) / 0.02)
    expected = sensed * rate[1] + (1.0 - sensed) * rate[0]
    ones = rows["observation"].to_numpy()
    for low, high in ((-0.2, -0.05), (-0.05, -0.01), (-0.01, 0.02), (0.02, 0.05), (0.05, 0.5)):
        near = (beyond >= low) & (beyond < high)
        assert ones[near].mean() == pytest.approx(expected[near].mean(), abs=4 * 0.5 / math.sqrt(near.sum()))


# Runs


def test_patches_are_drawn_for_each_run_do_not_overlap_and_stay_when_more_are_added() -> None:
    places = {run: named_patches("patch:5*0.1+disc0.3", UNIT, 1, run) for run in range(50)}
    assert len({patches[0].x_m for patches in places.values()}) == 50
    for patches in places.values():
        assert not any(one.overlaps(other) for one in patches for other in patches if one is not other)
        assert all(one.x_m >= one.width_m / 2 and one.x_m <= 1 - one.width_m / 2 for one in patches)
    assert named_patches("patch:3*0.1", UNIT, 1, 7) == places[7][:3]
    x = np.array([named_patches("patch:0.2", UNIT, 1, run)[0].x_m for run in range(2000)])
    assert x.mean() == pytest.approx(0.5, abs=4 * 0.8 / math.sqrt(12 * 2000))
    drawn = [named_patches("patch:0.05..0.2@0.5..1", UNIT, 1, run)[0] for run in range(2000)]
    assert np.mean([one.width_m for one in drawn]) == pytest.approx(
        0.125, abs=4 * 0.15 / math.sqrt(12 * 2000)
    )
    assert min(one.contrast for one in drawn) >= 0.5
    assert all(one.width_m == one.height_m for one in drawn)
    sides = [named_patches("patch:0.1..0.2x0.1..0.2", UNIT, 1, run)[0][2:4] for run in range(500)]
    assert abs(np.corrcoef(np.transpose(sides))[0, 1]) < 4 / math.sqrt(500)


# Bad input


# Files, and the mean
