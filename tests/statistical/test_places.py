"""Robots that estimate their places: how well, and what a map is worth; with controls that must fail."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.special import logit

from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import infer
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.source import moved as motion_of
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import floors_of, simulate
from vibroswarm.simulation import places_of as located
from vibroswarm.statistics.map_figures import floor_maps, maps_over_time

SEED, RUNS = 20_261, 24
PAPER = Scenario().with_values({"strategy.name": "places", "localisation.method": "true"})
GOOD = PAPER.with_values({"localisation.method": "mixture"})


@cache
def moved() -> Motion:
    return motion_of("event", PAPER, SEED, range(RUNS), True)


@cache
def places_of(**values: Any) -> pl.DataFrame:
    """Places with the true ones of the samples that they are of."""
    places = located(
        GOOD.with_values({name.replace("__", "."): v for name, v in values.items()}),
        SEED,
        timeline_of(GOOD, moved()),
    )
    true = moved().samples.select("run", "robot", pl.col("sample").alias("lagged_sample"), "x_m", "y_m")
    return places.join(true, on=["run", "robot", "lagged_sample"], how="left", suffix="_true")


def errors_of(places: pl.DataFrame) -> tuple[np.ndarray, np.ndarray]:
    """Distance of smoothed places from the true ones, m; errors in x in units of their stated spread."""
    known = places.drop_nulls("lagged_sample")
    x = (known["lagged_x_m"] - known["x_m_true"]).to_numpy()
    y = (known["lagged_y_m"] - known["y_m_true"]).to_numpy()
    return np.hypot(x, y), x / np.hypot(known["lagged_spread_x_m"].to_numpy(), 0.002)


def test_places_are_as_near_as_stated() -> None:
    """The paper's robots, whose speed is redrawn at every sample: 3.2 cm in 60 runs; dead reckoning 29 cm."""
    error, z = errors_of(places_of())
    assert np.median(error) < 0.04
    assert 0.5 < np.sqrt(np.mean(np.sort(z**2)[: int(0.98 * z.size)])) < 1.3
    dead, _ = errors_of(places_of(localisation__method="dead_reckoning"))
    assert np.median(dead) > 0.2
    one, _ = errors_of(places_of(localisation__method="kalman"))
    assert np.median(error) < np.median(one) < np.median(dead)
    assert np.quantile(one, 0.9) > 0.2  # and sure of it


def test_starts_are_told_with_an_error_in_each_direction() -> None:
    told = {"localisation__method": "dead_reckoning", "localisation__start_spread_m": 0.1}
    first = (
        places_of(**told).filter(sample=0).join(moved().samples, on=["run", "robot", "sample"], suffix="_now")
    )
    errors = np.array([first[name] - first[f"{name}_now"] for name in ("x_m", "y_m")])
    assert errors.std(axis=1) == pytest.approx([0.1, 0.1], rel=0.2)
    assert np.corrcoef(errors)[0, 1] == pytest.approx(0.0, abs=0.25)


def test_each_robot_is_located_with_its_own_ray() -> None:
    own = located(GOOD.with_values({"rays.forward_each_m": (0.0, 0.05)}), SEED, timeline_of(GOOD, moved()))
    for k, forward_m in enumerate((0.0, 0.05)):
        alike = located(GOOD.with_values({"rays.forward_m": forward_m}), SEED, timeline_of(GOOD, moved()))
        rows = pl.col("robot") % 2 == k
        assert own.filter(rows).equals(alike.filter(rows))


def test_a_gyro_that_lies_is_seen_in_the_spread() -> None:
    """Errors of a poor gyro that robots take for a good one are larger than they say."""
    honest = errors_of(places_of(odometry__level="poor"))[1]
    told_good = errors_of(places_of(odometry__level="poor", localisation__assumed_level="good"))[1]
    assert np.mean(abs(told_good) > 3.0) > 2.0 * np.mean(abs(honest) > 3.0)


def test_places_of_a_run_depend_on_no_other_run() -> None:
    one = Motion(
        *(table.filter(pl.col("run") == 3) for table in (moved().samples, moved().ends)),
        moved().moves.filter(pl.col("run") == 3),  # type: ignore[union-attr]
    )
    among = located(GOOD, SEED, timeline_of(GOOD, moved()))
    assert located(GOOD, SEED, timeline_of(GOOD, one)).equals(among.filter(pl.col("run") == 3))


def decided(scenario: Scenario, timeline: Timeline) -> tuple[float, float]:
    """Mean decision time (s, T_end if undecided), and share of robots that are wrong, on floors of 12 and 13 of 25."""
    times, wrong = [], []
    for source_name, truth in (("random:0.48", 0), ("random:0.52", 1)):
        floor = scenario.with_values({"floor.source": source_name})
        floors = floors_of(floor, SEED, list(range(RUNS)))
        observations = observe(floor, SEED, moved().samples, floors, energies=False)
        finals = infer(floor, SEED, timeline, observations)[1]
        times.append(finals["decision_time_s"].fill_null(1200.0).mean())
        wrong.append((finals["decision"] == 1 - truth).mean())
    return float(np.mean(times)), float(np.mean(wrong))


def test_a_map_decides_sooner_and_shuffled_places_lose_the_gain() -> None:
    """Shuffled: samples keep their readings and exchange their places (37 % wrong in 300 runs, against 9 %)."""
    timeline = timeline_of(PAPER, moved())
    true_s, true_wrong = decided(PAPER, timeline)
    good_s, good_wrong = decided(GOOD, timeline)
    assert 150.0 < true_s < 300.0  # 230 s in 1000 runs
    assert true_s < good_s < 450.0  # 338 s
    assert max(true_wrong, good_wrong) < 0.25  # 9 % and 12 %
    order = np.random.default_rng(1).permutation(timeline.rows.robot.size)
    shuffled = replace(timeline, x_m=timeline.x_m[order].copy(), y_m=timeline.y_m[order].copy())
    for column in (shuffled.x_m, shuffled.y_m):
        column.flags.writeable = False
    assert decided(PAPER, shuffled)[1] > max(0.2, 1.5 * true_wrong)


def test_a_map_of_true_places_is_the_sum_of_its_readings() -> None:
    """Pooled, nobody doubted: each reading counts on the tile of its place, to 1 mm, by its likelihood ratio."""
    trusting = {
        "strategy.places.broken_prior": 0.0, "strategy.places.trust_limit": 1000.0, "run.t_end_s": 100.0
    }  # fmt: skip
    result = simulate(PAPER.with_values(trusting), SEED, 1)
    false_positive, false_negative = error_rates(PAPER.sensor)
    x, y = (np.floor(result.motion[name].to_numpy() / 0.001 + 0.5) * 0.001 for name in ("x_m", "y_m"))
    tile = np.floor((1.0 - y) * 5.0).astype(int) * 5 + np.floor(x * 5.0).astype(int)
    one = result.observations["observation"].to_numpy() == 1
    ratio = np.where(one, (1.0 - false_negative) / false_positive, false_negative / (1.0 - false_positive))
    clear = (np.abs(x * 5.0 - np.round(x * 5.0)) > 0.01) & (np.abs(y * 5.0 - np.round(y * 5.0)) > 0.01)
    assert clear.mean() > 0.9
    odds = np.bincount(tile, np.log(ratio), 25)
    unsure = np.bincount(tile[~clear], minlength=25) > 0
    pooled = floor_maps(result).filter(pl.col("robot").is_null())["vibrating"].to_numpy()
    assert (~unsure).sum() >= 2
    assert logit(pooled[~unsure]) == pytest.approx(odds[~unsure], abs=1e-3)
    assert np.abs(logit(pooled) - odds).max() < 4.0  # a few samples lie on edges


def test_maps_show_the_floor_and_scores_come_from_them() -> None:
    """After 20 minutes of five robots nearly all of 25 tiles are as they are; beliefs follow from the robots' maps."""
    result = simulate(GOOD, SEED, 2)
    maps = floor_maps(result)
    assert maps.height == 2 * 6 * 25
    right = (maps["vibrating"] > 0.5).cast(pl.UInt8) == maps["vibrates"]
    assert right.mean() > 0.9  # type: ignore[operator]
    robot = maps.filter((pl.col("run") == 1) & (pl.col("robot") == 2))
    p = robot["vibrating"].to_numpy()
    assert robot["spread"].to_numpy() == pytest.approx(np.sqrt(p * (1.0 - p)))
    growing = maps_over_time(result, 1, np.array([0.0, 300.0, 1200.0]))
    assert growing.shape == (3, 6, 25)
    assert np.all(growing[0] == 0.5)  # nothing is known yet
    assert growing[2, 2] == pytest.approx(p, abs=1e-12)  # what they end with
    true = result.floor(1).tiles.ravel() == 1
    right = np.where(true, growing, 1.0 - growing).mean(axis=(1, 2))
    assert 0.5 < right[1] < right[2]


def test_maps_at_no_time() -> None:
    result = simulate(PAPER.with_values({"run.t_end_s": 20.0}), SEED, [3])
    assert maps_over_time(result, 3, np.array([])).shape == (0, 6, 25)
