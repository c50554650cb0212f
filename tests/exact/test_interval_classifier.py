"""Boosted trees on undisturbed intervals: what must be told apart is, and what must not be is not."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from scipy.stats import triang

from vibroswarm.calibrate.classifier import mean_accuracy
from vibroswarm.calibrate.drive import course_of, undisturbed
from vibroswarm.calibrate.interval_classifier import (
    boosted_trees,
    interval_accuracy,
    other_robots,
    same_robots,
)

pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install 'vibroswarm[lab]'")


def rows(seed: int, count: int = 1500) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 2))


def boosted_accuracy(train: tuple[np.ndarray, np.ndarray], test: tuple[np.ndarray, np.ndarray]) -> float:
    """Of boosted trees, trained on rows of two classes and tested on others."""
    parts = [*train, *test]
    label = np.repeat([0, 1, 0, 1], [len(part) for part in parts])
    trained = len(train[0]) + len(train[1])
    split = np.arange(trained), np.arange(trained, label.size)
    return mean_accuracy(boosted_trees(), np.concatenate(parts), label, [split])


def test_trees_reach_the_best_rule_where_it_is_known() -> None:
    """Shifted normal variables: the best rule is right for Phi(shift / 2) of the rows."""
    shift = np.array([1.0, 0.0])
    found = boosted_accuracy((rows(1), rows(2) + shift), (rows(3), rows(4) + shift))
    assert found == pytest.approx(0.6915, abs=0.03)


def test_they_see_what_a_line_cannot_and_nothing_where_there_is_nothing() -> None:
    wider = boosted_accuracy((rows(1), 2.0 * rows(2)), (rows(3), 2.0 * rows(4)))
    # Two normal variables of twice the spread: the best rule cuts at r^2 = 8 ln 4 / 3.
    cut = 8.0 * np.log(4.0) / 3.0
    assert wider == pytest.approx(0.5 * (1.0 - np.exp(-cut / 2.0) + np.exp(-cut / 8.0)), abs=0.03)
    assert boosted_accuracy((rows(1), rows(2)), (rows(3), rows(4))) == pytest.approx(0.5, abs=0.03)


def session(seed: int, veers: list[float], wander: float = 0.03, shift: float = 0.0) -> pl.DataFrame:
    """Robots that drive without interruption: arcs of 0.1 m, turned by their veers, in steps of 3 s."""
    random = np.random.default_rng(seed)
    frames = []
    for robot, veer in enumerate(veers):
        turns = veer + shift + wander * random.normal(size=300)
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


VEERS = [-0.2, -0.1, 0.05, 0.1]


def test_robots_that_keep_their_veer_are_told_where_the_same_robots_were_trained_on() -> None:
    real, rigid = undisturbed(session(1, VEERS)), undisturbed(session(2, VEERS, wander=0.001))
    again = undisturbed(session(3, VEERS))
    assert same_robots(real, rigid) > 0.8
    assert same_robots(real, again) == pytest.approx(0.5, abs=0.05)
    assert other_robots(real, again) == pytest.approx(0.5, abs=0.06)


def test_the_feature_that_tells_is_named() -> None:
    real = [session(seed, VEERS) for seed in (1, 2)]
    shifted = [session(seed, VEERS, shift=0.1) for seed in (3, 4)]
    found = interval_accuracy(real, shifted)
    assert found is not None
    assert len(found.simulated.same_robots) == 4
    assert len(found.real.same_robots) == 1
    assert found.by_feature["turn_rad"] > 0.65
    assert found.by_feature["distance_m"] == pytest.approx(0.5, abs=0.04)
    assert interval_accuracy([real[0].head(50)], shifted) is None


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
