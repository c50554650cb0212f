"""Limits of rare events: they hold as often as they say, where a mean with its standard error does not."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from scipy import stats

from vibroswarm import simulate
from vibroswarm.paper.claim_values import exact, mean, row, share
from vibroswarm.paper.claims import UNBOUNDED, all_claims, interval, mean_limits, share_limits
from vibroswarm.paper.columns import real_floor, scenario_of
from vibroswarm.paper.items.experiments import FITTED, REAL_EXPERIMENTS, T_END_S

N, REPEATS = 100, 3000


def test_no_event_in_100_runs_is_not_0() -> None:
    low, high = interval(share("a", "paper", "x", np.zeros(100)), 0.95)
    assert low == -high
    assert 0.03 < high < 0.08
    assert interval(row("a", "paper", "x", 0.0, 0.0, 100), 0.95) == UNBOUNDED
    assert interval(exact("a", "paper", "x", 0.0), 0.95) == (0.0, 0.0)


def test_all_runs_with_the_event_are_not_1() -> None:
    low, high = interval(share("a", "paper", "x", np.ones(100)), 0.95)
    assert 0.9 < low < 0.97
    assert high >= 1.0


@pytest.mark.parametrize("events", [0, 1, 7, 99, 100])
def test_limits_of_whole_counts_are_those_of_the_binomial(events: int) -> None:
    low, high = share_limits(events / N, N, 0.01)
    if events > 0:
        assert np.e * stats.binom.sf(events - 1, N, low) == pytest.approx(0.01)
    if events < N:
        assert np.e * stats.binom.cdf(events, N, high) == pytest.approx(0.01)


def _drawn(kind: str, random: np.random.Generator) -> NDArray[np.float64]:
    """(REPEATS, N) values between -1 and 1 whose mean is that of the first of the truths."""
    sign = np.where(random.random((REPEATS, N)) < 0.5, 1.0, -1.0)
    rare = random.random((REPEATS, N)) < 0.02
    if kind == "rare, one way":
        return rare * 1.0
    if kind == "rare, both ways":
        return rare * sign
    if kind == "rare beside small":
        return np.where(rare, -0.95, random.normal(0.0, 0.001, (REPEATS, N)))
    return (
        np.where(random.random((REPEATS, N)) < 0.3, random.choice([0.2, 0.6, 1.0], (REPEATS, N)), 0.0) * sign
    )


TRUE = {"rare, one way": 0.02, "rare, both ways": 0.0, "rare beside small": -0.019, "frequent": 0.0}


@pytest.mark.parametrize("kind", list(TRUE))
def test_limits_hold_the_truth_at_least_as_often_as_they_say(kind: str) -> None:
    values = _drawn(kind, np.random.default_rng(5))
    makes = (
        (lambda v: mean("a", "paper", "x", v, bounded=True))
        if "small" in kind
        else (lambda v: share("a", "paper", "x", v))
    )
    limits = np.array([interval(makes(each), 0.95) for each in values])
    missed = np.mean((TRUE[kind] < limits[:, 0]) | (TRUE[kind] > limits[:, 1]))
    assert missed <= 0.05
    assert np.isfinite(limits).all()
    assert np.median(limits[:, 1] - limits[:, 0]) < 0.35


@pytest.mark.parametrize("n", [100, 1000])
@pytest.mark.parametrize(
    "pair", [(0.005, 0.0), (0.02, 0.0), (0.02, 0.01), (0.05, 0.05), (0.3, 0.25), (0.98, 0.01)]
)
def test_so_they_do_at_the_levels_of_many_claims(pair: tuple[float, float], n: int) -> None:
    """At 99.9 %, where Student's limits are up to hundreds of times too seldom right; each sample counts once."""
    plus, minus = pair
    counts = np.random.default_rng(4).multinomial(n, [plus, minus, 1 - plus - minus], 20_000)
    distinct, times = np.unique(counts[:, :2], axis=0, return_counts=True)
    ends = np.array([mean_limits(up / n, down / n, n, 0.999) for up, down in distinct])
    missed = times @ ((ends[:, 0] > plus - minus) | (ends[:, 1] < plus - minus)) / times.sum()
    assert missed <= 0.001 + 3 * np.sqrt(0.001 / times.sum())


def test_students_limits_do_not() -> None:
    """The control: with events in 2 % of the runs they miss the truth in every seventh case and more."""
    values = _drawn("rare beside small", np.random.default_rng(5))
    ends = np.array([interval(mean("a", "paper", "x", each), 0.95) for each in values])
    assert np.mean((TRUE["rare beside small"] < ends[:, 0]) | (TRUE["rare beside small"] > ends[:, 1])) > 0.1


def test_what_is_frequent_keeps_students_limits() -> None:
    values = np.random.default_rng(6).choice([-0.9, 0.0, 0.9], 1000)
    assert interval(mean("a", "paper", "x", values, bounded=True), 0.95) == interval(
        mean("a", "paper", "x", values), 0.95
    )


def test_a_published_mean_brings_its_own_error() -> None:
    """Ours and theirs drawn from one distribution: the difference is inside as often as it says, and not without."""
    random = np.random.default_rng(9)
    missed = {15: 0, None: 0}
    for _ in range(REPEATS):
        ours, theirs = random.normal(600.0, 250.0, 400), float(random.normal(600.0, 250.0, 15).mean())
        for runs in missed:
            low, high = interval(mean("a", "paper", "x", ours, theirs, published_runs=runs), 0.95)
            missed[runs] += not low <= 0.0 <= high
    assert missed[15] / REPEATS == pytest.approx(0.05, abs=0.015)
    assert missed[None] / REPEATS > 0.5
    known = mean("a", "paper", "x", ours, published_runs=15, published_sd=500.0)
    assert known["standard_error"] == pytest.approx(np.hypot(ours.std(ddof=1) / 20, 500 / 15**0.5))


@pytest.mark.parametrize("robots", [5, 10])
def test_published_times_alone_are_less_certain_than_the_margin_of_the_claim_about_them(robots: int) -> None:
    """``robots-times`` cannot be asked; with ten times as many experiments (negative control) it could."""
    (claim,) = (claim for claim in all_claims() if claim.cannot)
    fields = real_floor() | {
        "run.t_end_s": T_END_S,
        "swarm.robots": robots,
        "sensor.rms_threshold": FITTED[0],
        "strategy.name": "none",
    }
    result = simulate(scenario_of("calibrated", fields), 1, 60, energies=False)
    of_runs = result.robots.group_by("run").agg(pl.col("decision_time_s").fill_null(T_END_S).mean())
    sd_s = float(of_runs["decision_time_s"].to_numpy().std(ddof=1))
    assert claim.margin is not None
    assert sd_s / np.sqrt(REAL_EXPERIMENTS) > claim.margin
    assert sd_s / np.sqrt(10 * REAL_EXPERIMENTS) < claim.margin / 1.96
