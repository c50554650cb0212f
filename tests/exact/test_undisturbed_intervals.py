"""Undisturbed intervals: turns are measured as they were made, and disturbed intervals are left out."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from scipy.stats import triang

from vibroswarm.calibrate.drive import course_of, undisturbed


def session(seed: int, veers: list[float], wander: float = 0.03) -> pl.DataFrame:
    """Robots that drive without interruption: arcs of 0.1 m, turned by their veers, in steps of 3 s."""
    random = np.random.default_rng(seed)
    frames = []
    for robot, veer in enumerate(veers):
        turns = veer + wander * random.normal(size=300)
        heading = np.cumsum(turns) - turns / 2.0
        distance = 0.1 + 0.004 * random.normal(size=300)
        dx, dy = distance * np.cos(heading), distance * np.sin(heading)
        frames.append(
            pl.DataFrame(
                {"run": 0, "robot": robot, "time_s": 3.0 * np.arange(1, 301), "dx_m": dx, "dy_m": dy,
                 "distance_m": distance, "spacing_s": 3.0, "avoid_s": 0.0}
            )
        )  # fmt: skip
    return pl.concat(frames)


def test_turns_of_a_robot_are_measured_as_they_were_made() -> None:
    own = undisturbed(session(5, [0.3], wander=0.05))
    course = course_of(own)
    assert course is not None
    assert course.turn_rad == pytest.approx(0.3, abs=0.01)
    assert course.bend_per_m == pytest.approx(3.0, rel=0.04)
    assert course.slow_share < 0.1
    # The turn is the mean of two intervals' turns.
    assert course.spread_per_m * 0.1 == pytest.approx(0.05 / np.sqrt(2.0), rel=0.12)
    law = triang(0.5, -(6.0**0.5), 2.0 * 6.0**0.5)  # of variance 1, as ``robot.speed_wander`` is drawn
    quantiles = law.ppf(np.random.default_rng(2).permutation((np.arange(own.height) + 0.5) / own.height))
    drawn = course_of(own.with_columns(distance_m=0.1 + 0.004 * pl.Series(quantiles)))
    assert drawn is not None
    assert drawn.distance_spread == pytest.approx(0.04, rel=0.03)


def test_disturbed_intervals_are_left_out() -> None:
    whole = session(6, [0.1])
    hit = (pl.col("time_s") > 300) & (pl.col("time_s") <= 600)
    avoided = whole.with_columns(avoid_s=pl.when(hit).then(1.0).otherwise(0.0))
    longer = whole.with_columns(spacing_s=pl.when(hit).then(4.0).otherwise(3.0))
    for disturbed in (avoided, longer):
        found = undisturbed(disturbed)
        assert found.height == undisturbed(whole).height - 101, "the first after them follows none"
        assert found.filter(hit).is_empty()
