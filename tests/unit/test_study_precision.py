"""Runs until a precision: the looks, their correction, and that the last interval is honest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.statistics.figures import interval
from vibroswarm.statistics.intervals import mean_interval
from vibroswarm.study.precision import Precision


def test_the_errors_of_all_looks_sum_to_that_of_the_level() -> None:
    precision, level = Precision(0.02), 0.95
    errors = np.array([1 - precision.level_at(look) for look in range(20_000)])
    assert errors[0] == pytest.approx((1 - level) * 6 / math.pi**2)
    assert np.all(np.diff(errors) < 0)
    assert 0.9999 * (1 - level) < errors.sum() < 1 - level


@pytest.mark.parametrize(
    ("figure", "usual", "late"), [("decision_time_s", 300.0, 1200.0), ("belief_in_truth", 0.99, 0.01)]
)
def test_a_study_does_not_stop_before_rare_runs_can_have_occurred(
    figure: str, usual: float, late: float
) -> None:
    """Of runs that end within 50 s of each other 1 % are late: of 100, four studies in ten have none of these, and
    stopped there with an interval of some seconds (the control)."""
    precision, truth = Precision(0.05 if late > 1.0 else 0.02, figure, 3200), usual + 0.01 * (late - usual)
    random = np.random.default_rng(3)
    held, held_at_first = [], []
    for _ in range(300):
        scatter = random.uniform(-0.01, 0.01, 3200) * usual
        values = np.where(random.random(3200) < 0.01, late, usual + scatter)
        for look, runs in enumerate(precision.looks()):
            found = interval(figure, {figure: values[:runs]}, precision.level_at(look), t_end_s=1200.0)
            held_at_first += [not found.excludes(truth)] if look == 0 else []
            if precision.reached(found, 1200.0):
                break
        held.append(not found.excludes(truth))
    assert np.mean(held) > 0.95
    assert np.mean(held_at_first) < 0.7


LONG_S, SHORT_S, SHARE = 1200.0, 300.0, 0.1
TRUTH_S = SHARE * LONG_S + (1 - SHARE) * SHORT_S


def stopped(times_s: NDArray[np.float64], precision: Precision, *, corrected: bool) -> bool:
    """Whether the interval at which a study stops holds the truth."""
    for look, runs in enumerate(precision.looks()):
        level = precision.level_at(look) if corrected else 0.95
        found = mean_interval(times_s[:runs], level)
        if precision.reached(found, LONG_S):
            break
    return found.low <= TRUTH_S <= found.high


def test_the_interval_at_which_a_study_stops_holds_the_truth_often_enough():
    """One run in ten is long. A study that stops at the first narrow interval stops where by luck few were long: with
    95 % at each look its last interval holds the truth too seldom (the negative control), corrected often enough."""
    precision, studies = Precision(0.1, max_runs=6400), 1000
    dice = np.random.default_rng(1)
    times_s = np.where(dice.random((studies, 6400)) < SHARE, LONG_S, SHORT_S)
    honest = np.mean([stopped(row, precision, corrected=True) for row in times_s])
    naive = np.mean([stopped(row, precision, corrected=False) for row in times_s])
    standard_error = math.sqrt(0.95 * 0.05 / studies)
    assert naive < 0.95 - 3 * standard_error
    assert honest > 0.95
