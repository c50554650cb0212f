"""Cells compared by run: by hand, against an unpaired interval, and false alarms under no difference."""

from __future__ import annotations

import math

import numpy as np
import polars as pl
import pytest
from scipy.stats import binom, norm, t

from vibroswarm.statistics.intervals import (
    generator,
    jackknife_error,
    student_test,
    wilson_limits,
)
from vibroswarm.statistics.paired import (
    compare,
    difference,
    differences,
    drawn_interval,
    drawn_means,
    holm,
)


def figures(times: list[float], right: list[float | None], first_run: int = 0) -> pl.DataFrame:
    n = len(times)
    return pl.DataFrame(
        {
            "run": range(first_run, first_run + n),
            "decision_time_s": times,
            "right_share": right,
            "belief_in_truth": [0.5] * n,
            "wrong_share": [0.0] * n,
            "undecided_share": [0.2] * n,
            "forced_error": [0.1] * n,
        },
        schema_overrides={"right_share": pl.Float64},
    )


def test_student_by_hand() -> None:
    """Differences 1, 2, 3, 4: t = 2.5 / (1.2910 / 2) = 3.873 with 3 degrees of freedom, t_0.975 = 3.1824."""
    interval, p_value = student_test([1.0, 2.0, 3.0, 4.0, math.nan])
    assert p_value == pytest.approx(0.0304662, abs=1e-7)
    assert (interval.low, interval.high) == pytest.approx((2.5 - 2.05426, 2.5 + 2.05426), abs=1e-5)
    assert [student_test(d).p_value for d in ([0.0, 0.0], [3.0, 3.0])] == [1.0, 0.5]
    but_for_rounding = [0.6 - 0.4, 0.8 - 0.6, 1.0 - 0.8]
    assert student_test(but_for_rounding).p_value == 0.25
    assert math.isnan(student_test([3.0]).p_value)
    first, second = figures([2.0, 4.0, 6.0, 8.0], [0.0] * 4), figures([1.0, 2.0, 3.0, 4.0], [0.0] * 4)
    assert compare(first, second, ["decision_time_s"])[0].p_value == p_value


@pytest.mark.parametrize(("runs", "upwards"), [(40, 0.8), (200, 1.0)])
def test_limits_hold_rare_differences_as_often_as_they_say(runs: int, upwards: float) -> None:
    """In few runs one to five of five robots decide otherwise."""
    differing = 0.01
    random, truth = generator(5, "test"), differing * (2 * upwards - 1) * 0.6
    held = held_alone = 0
    for _ in range(300):
        side = np.where(random.random(runs) < upwards, 1.0, -1.0) * (random.random(runs) < differing)
        first = np.full(runs, 0.4)
        second = first - side * random.integers(1, 6, runs) / 5
        held += not difference(first, second, most=1.0).interval.excludes(truth)
        held_alone += not student_test(first - second).interval.excludes(truth)
    least = binom.ppf(1e-4, 300, 0.93)  # measured: .93 or more
    assert held >= least
    assert held_alone < least  # the control


def test_the_same_in_all_runs_is_not_shown_to_be_the_same() -> None:
    same = figures([float(k) for k in range(300, 500)], [0.8] * 200)
    time_s, belief, right, *_ = compare(same, same)
    most = float(wilson_limits(0, 200)[1])
    # Robots of a run may all decide otherwise.
    assert right.difference[:3] == pytest.approx((0.0, -most, most))
    assert belief.difference[:3] == pytest.approx((0.0, -most, most))
    # Times may be as far apart as 0 and the latest here.
    assert time_s.difference[:3] == pytest.approx((0.0, -499 * most, 499 * most))
    assert right.p_value == 1.0
    later = same.with_columns(pl.col("decision_time_s") + 20.0)
    assert compare(later, same)[0].difference.low == pytest.approx(20.0 - 519 * most)


def test_limits_of_differences_stay_within_what_runs_can_differ_by() -> None:
    """Always right against always wrong was 100.0 points [67.6, 132.4] in 8 runs."""
    found = difference(np.ones(8), np.zeros(8), most=1.0).interval
    assert found[:3] == (1.0, pytest.approx(0.676, abs=5e-4), 1.0)
    assert math.isinf(difference([1.0], [0.0], most=1.0).interval.high), "no limits are none"


def test_rounding_is_no_difference() -> None:
    assert differences([0.1 + 0.2, 1.0, math.nan], [0.3, 0.5, 1.0])[:2].tolist() == [0.0, 0.5]
    assert difference([0.1 + 0.2] * 8, [0.3] * 8).p_value == 1.0


def test_rows_are_drawn_together() -> None:
    values = generator(1, "test").normal(size=(2, 400))
    values[1] = values[0] + 5.0
    drawn = drawn_means(values, 0, "test")
    assert drawn[:, 0].tolist() == values.mean(axis=1).tolist()
    assert np.ptp(drawn[1] - drawn[0]) < 1e-12
    assert drawn[0, 1:].std() == pytest.approx(values[0].std() / 20, rel=0.1)
    assert not np.array_equal(drawn, drawn_means(values, 0, "other"))  # control


def test_limits_of_draws_need_nearly_all() -> None:
    drawn = np.append(10.0, np.linspace(0.0, 1.0, 1001))
    found = drawn_interval(drawn, 7, "how")
    reach = 0.475 * math.sqrt(7 / 6) * t.ppf(0.975, 6) / norm.ppf(0.975)
    assert found == (10.0, pytest.approx(0.5 - reach), pytest.approx(0.5 + reach), 0.95, 7, "how")
    assert drawn_interval(drawn, 1, "how")[1:3] == (-math.inf, math.inf)
    drawn[1:50] = math.nan
    assert not math.isnan(drawn_interval(drawn, 7, "how").low)
    drawn[1:60] = math.nan
    assert math.isnan(drawn_interval(drawn, 7, "how").low)


@pytest.mark.parametrize("runs", [6, 20])
def test_limits_of_draws_of_few_runs_hold_the_mean_as_often_as_they_say(runs: int) -> None:
    random, held = generator(3, "test"), 0
    for k in range(400):
        drawn = drawn_means(random.normal(size=(1, runs)), k, "test")[0]
        held += not drawn_interval(drawn, runs, "how").excludes(0.0)
    assert held >= binom.ppf(1e-4, 400, 0.95)  # without Student's factor 85 of 100 with 6 runs


def test_the_jackknife_of_a_mean_is_its_standard_error() -> None:
    values = generator(2, "test").normal(size=30)
    without = (values.sum() - values) / 29
    assert jackknife_error(without) == pytest.approx(values.std(ddof=1) / math.sqrt(30))


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, math.nan]) == pytest.approx([0.03, 0.06, 0.06, math.nan], nan_ok=True)
    assert holm([0.6, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


def test_false_alarms_and_what_holm_does_to_them() -> None:
    random = generator(4, "alarms")
    plain_alarms = family_alarms = 0
    for _ in range(200):
        p = [student_test(np.subtract(*random.exponential(1.0, (2, 30)))).p_value for _ in range(5)]
        plain_alarms += min(p) < 0.05
        family_alarms += min(holm(p)) < 0.05
    assert family_alarms / 200 < 0.08
    assert plain_alarms / 200 > 0.15  # five looks without correction
