"""Intervals against scipy, by hand, and by how often they hold what is so; robots as the unit must fail."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from vibroswarm.statistics.figures import interval as interval_of_figure
from vibroswarm.statistics.intervals import (
    Interval,
    bounded_mean,
    cluster_share,
    generator,
    mean_interval,
    pseudo_values,
    quantile_interval,
    rate_interval,
    student_test,
    wilson,
    wilson_limits,
)


@pytest.mark.parametrize(("k", "n"), [(0, 7), (7, 7), (3, 10), (1, 1), (481, 1000)])
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_wilson_is_that_of_scipy(k: int, n: int, level: float) -> None:
    theirs = stats.binomtest(k, n).proportion_ci(level, method="wilson")
    mine = wilson(k, n, level)
    assert (mine.low, mine.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)
    assert mine.estimate == k / n


def test_wilson_of_no_runs_and_of_many_at_once() -> None:
    assert math.isnan(wilson(0, 0).low)
    low, high = wilson_limits([0, 3, 0], [7, 10, 0])
    assert low[1] == wilson(3, 10).low
    assert (low[0], high[0]) == (0.0, wilson(0, 7).high)
    assert np.isnan([low[2], high[2]]).all()


def test_student_is_that_of_scipy() -> None:
    values = [1.0, 4.0, 2.5, 8.0]
    low, high = stats.t.interval(0.95, 3, loc=np.mean(values), scale=stats.sem(values))
    mine = mean_interval([*values, math.nan])
    assert (mine.low, mine.high, mine.n) == pytest.approx((low, high, 4))
    assert mean_interval([2.0])[:3] == (2.0, -math.inf, math.inf)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_quantile_limits_are_those_of_binomial_sums(share: float) -> None:
    """The r-th of n values is the lower limit if at most r - 1 of n values lie below the quantile in 2.5 % of draws."""
    n = 60
    at_most = np.cumsum([math.comb(n, k) * share**k * (1 - share) ** (n - k) for k in range(n + 1)])
    lower = max(r for r in range(n + 1) if (at_most[r - 1] if r else 0.0) <= 0.025)
    upper = min(r for r in range(1, n + 2) if 1.0 - at_most[r - 1] <= 0.025)
    found = quantile_interval(np.arange(1.0, n + 1.0), share)
    assert (found.low, found.high) == (lower, upper)


def coverage(truth: float, intervals: list[Interval]) -> float:
    return float(np.mean([interval.low <= truth <= interval.high for interval in intervals]))


def alike(random: np.random.Generator, runs: int, share: float, same: float) -> np.ndarray:
    """Robots of a run: with probability ``same`` all as one, else each for itself; shape (runs,) of counts."""
    together = random.random(runs) < same
    return np.where(together, 5 * (random.random(runs) < share), random.binomial(5, share, runs))


@pytest.mark.parametrize(("runs", "share"), [(40, 0.5), (200, 0.02), (60, 0.05)])
def test_shares_of_robots_hold_the_truth_and_robots_as_units_do_not(runs: int, share: float) -> None:
    random = generator(runs, "coverage")
    counts = [alike(random, runs, share, 0.9) for _ in range(600)]
    by_run = coverage(share, [cluster_share(c, np.full(runs, 5)) for c in counts])
    by_robot = coverage(share, [wilson(int(c.sum()), 5 * runs) for c in counts])
    assert 0.90 <= by_run <= 0.99, by_run  # lowest where three runs of sixty carry all that is wrong
    assert by_robot < 0.75, by_robot  # the negative control


@pytest.mark.parametrize(("runs", "share", "same"), [(2, 0.5, 0.5), (3, 0.3, 0.7), (5, 0.5, 0.3)])
def test_shares_of_robots_of_few_runs_hold_the_truth(runs: int, share: float, same: float) -> None:
    """The share of each run is drawn from a beta distribution with this correlation within runs."""
    random = generator(runs, "few runs")
    a, b = share * (1.0 - same) / same, (1.0 - share) * (1.0 - same) / same
    counts = random.binomial(20, random.beta(a, b, (600, runs)))
    assert coverage(share, [cluster_share(count, np.full(runs, 20)) for count in counts]) >= 0.92


def test_pseudo_values_are_those_of_the_jackknife() -> None:
    pairs = np.random.default_rng(1).random((5, 5))
    pairs += pairs.T
    off = ~np.eye(5, dtype=bool)
    means = (pairs * off).sum(axis=1) / 4
    without = [np.delete(np.delete(pairs, k, 0), k, 1)[~np.eye(4, dtype=bool)].mean() for k in range(5)]
    assert pseudo_values(means) == pytest.approx(5 * pairs[off].mean() - 4 * np.array(without))
    assert pseudo_values([0.3, 0.3]).tolist() == [0.3]


def test_a_share_of_those_that_decided_holds_the_truth_though_their_number_varies() -> None:
    """In runs with many wrong robots more decide: the mean of the runs' shares is then another thing."""
    random = generator(11, "ratio")
    bad = np.array([False, True])
    truth = (0.7 * 0.1 * 2 + 0.3 * 0.6 * 5) / (0.7 * 2 + 0.3 * 5)
    held = held_by_means = 0.0
    for _ in range(600):
        worse = random.choice(bad, 150, p=[0.7, 0.3])
        of = np.where(worse, 5, 2)
        wrong = random.binomial(of, np.where(worse, 0.6, 0.1))
        interval, means = cluster_share(wrong, of), mean_interval(wrong / of)
        held += interval.low <= truth <= interval.high
        held_by_means += means.low <= truth <= means.high
    assert 0.92 <= held / 600 <= 0.98, held / 600
    assert held_by_means / 600 < 0.2


@pytest.mark.parametrize("draw", ["normal", "exponential", "lumpy"])
def test_paired_differences_hold_the_truth_skewed_ones_too(draw: str) -> None:
    random = generator(7, "pairs" + draw)
    means = {"normal": 0.0, "exponential": 1.0, "lumpy": 0.5}

    def sample() -> np.ndarray:
        if draw == "lumpy":  # most runs do not differ at all
            return np.where(random.random(60) < 0.5, 0.0, random.exponential(1.0, 60))
        return random.normal(0, 1, 60) if draw == "normal" else random.exponential(1.0, 60)

    drawn = [sample() for _ in range(600)]
    by_pair = coverage(means[draw], [student_test(d).interval for d in drawn])
    by_robot = coverage(means[draw], [mean_interval(np.repeat(d, 5)) for d in drawn])
    assert 0.91 <= by_pair <= 0.985, by_pair
    assert by_robot < 0.75, by_robot  # each run counted five times, as if its robots were runs


@pytest.mark.parametrize("wrong_in", [1, 3])
def test_shares_and_times_of_rare_runs_hold_the_truth(wrong_in: int) -> None:
    """Of 100 runs so many have wrong robots, or end before 1200 s, on average; Student's limits hold as few as 87 %."""
    random = generator(wrong_in, "rare")
    rare = random.random((1500, 100)) < wrong_in / 100
    shares = np.where(rare, random.integers(1, 6, rare.shape) / 5, 0.0)
    times_s = np.where(rare, random.uniform(100.0, 700.0, rare.shape), 1200.0)
    mean = wrong_in / 100 * 0.6
    assert coverage(mean, [bounded_mean(one) for one in shares]) > 0.925
    if wrong_in == 3:  # Student's clipped limits, as they were
        assert coverage(mean, [mean_interval(one) for one in shares]) < 0.9
    mean_s = 1200.0 - 8.0 * wrong_in
    assert coverage(mean_s, [bounded_mean(one, 0.0, 1200.0) for one in times_s]) > 0.925


@pytest.mark.parametrize(("late", "runs"), [(0.03, 100), (0.01, 300)])
def test_limits_allow_for_few_runs_far_from_others_that_are_nearly_alike(late: float, runs: int) -> None:
    """Robots decide near 300 s, or in few runs not at all; Student's limits, the control, hold 89 %."""
    random = generator(runs, "late")
    near_s = random.normal(300.0, 20.0, (1500, runs))
    times_s = np.where(random.random(near_s.shape) < late, 1200.0, near_s)
    mean_s = 300.0 + 900.0 * late
    assert coverage(mean_s, [bounded_mean(one, 0.0, 1200.0) for one in times_s]) > 0.93
    assert coverage(mean_s, [mean_interval(one) for one in times_s]) < 0.92
    assert bounded_mean(near_s[0], 0.0, 1200.0) == mean_interval(near_s[0]), "without late runs as before"


def test_a_mean_time_of_runs_that_all_last_to_the_end_may_be_earlier() -> None:
    """Of 20 runs up to 16.1 % may end earlier, at 0 s at the earliest; or at another time, if all end at one."""
    found = bounded_mean(np.full(20, 1000.1), 0.0, 1000.1)
    assert found[:3] == (1000.1, pytest.approx(1000.1 * (1.0 - wilson(0, 20).high)), 1000.1)
    rare_s = 1000.0 * wilson(0, 20).high
    assert bounded_mean(np.full(20, 300.0), 0.0, 1000.0)[:3] == pytest.approx(
        (300.0, 300.0 - rare_s, 300.0 + rare_s)
    )
    assert bounded_mean(np.full(20, 300.0), 0.0, math.nan)[:3] == (
        300.0,
        300.0,
        300.0,
    )  # the end is not known


def test_rates_of_events_have_limits_of_counts() -> None:
    """Garwood's limits for 3 events in 10 runs of a third of an hour, each with at most one."""
    found = rate_interval([3.0] * 3 + [0.0] * 7, 3.0)
    by_hand = stats.chi2.ppf([0.025, 0.975], [6, 8]) / 2 / 10 * 3.0
    assert (found.estimate, found.low, found.high) == pytest.approx((0.9, *by_hand))
    at_once = rate_interval(
        [6.0, 0.0, 0.0, 0.0]
    )  # one cluster of four events: the variance is six times the mean
    assert at_once[1:3] == pytest.approx(stats.chi2.ppf([0.025, 0.975], [2, 4]) / 2 * 1.5)
    none = rate_interval([0.0] * 10, 3.0)
    assert (none.low, none.high) == pytest.approx((0.0, -math.log(0.025) * 0.3))
    by_name = interval_of_figure("false_changes_per_h", {"false_changes_per_h": np.zeros(10)}, t_end_s=1200.0)
    assert by_name == none
    assert rate_interval([0.0] * 10).high == math.inf
    assert rate_interval([3.0] * 4) == (3.0, 3.0, 3.0, 0.95, 4, "quasi-Poisson")
    assert math.isnan(rate_interval([math.nan]).low)


@pytest.mark.parametrize("cluster", [1, 2])
def test_rates_of_rare_events_hold_the_truth_also_if_events_come_together(cluster: int) -> None:
    """1000 times 100 runs with .15 events on average; the control counts each event for itself over all runs."""
    held, held_alone, below = 0, 0, 0
    counts = cluster * np.random.default_rng(5).poisson(0.15 / cluster, size=(1000, 100)).astype(float)
    for runs in counts:
        found, k = rate_interval(runs, 1.0), runs.sum()
        low, high = stats.chi2.ppf([0.025, 0.975], [2 * k, 2 * k + 2]) / 200
        held += 0.0 <= found.low <= 0.15 <= found.high
        held_alone += np.nan_to_num(low) <= 0.15 <= high
        below += mean_interval(runs).low < 0.0
    assert held > 940
    assert (held_alone > 940) == (cluster == 1)
    assert (below > 0) == (cluster == 2), "Student's limits go below 0"
