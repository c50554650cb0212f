"""The fitted probability of detection against a second implementation, an isotonic fit, and known truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize
from scipy.special import expit, logit

from vibroswarm.errors import InputError
from vibroswarm.inspection.missed import Trials
from vibroswarm.inspection.pod import Pod, fit_pod

SIDES_M = np.linspace(0.01, 0.2, 10)
FALSE = 0.1
TRUE_A90_M = float((logit((0.9 - FALSE) / (1 - FALSE)) + 6.0) / 60.0)


def drawn(seed: int, each: int) -> Trials:
    """Inspections with PoD(a) = .1 + .9 logit^-1(-6 + 60 a)."""
    random = np.random.default_rng(seed)
    size_m = np.repeat(SIDES_M, each)
    found = random.random(size_m.size) < FALSE + (1 - FALSE) * expit(-6.0 + 60.0 * size_m)
    return Trials(size_m, found.astype(float), int(random.binomial(2000, FALSE)), 2000)


def test_the_fit_is_that_of_a_second_implementation() -> None:
    trials = drawn(1, 100)

    def loss(at: np.ndarray) -> float:
        p_f = expit(at[2])
        p = p_f + (1 - p_f) * expit(at[0] + at[1] * trials.size_m)
        of_damaged = np.where(trials.found == 1, np.log(p), np.log1p(-p)).sum()
        return -float(
            of_damaged + trials.false * np.log(p_f) + (trials.intact - trials.false) * np.log1p(-p_f)
        )

    second = optimize.minimize(loss, [-5.0, 50.0, -2.0], method="BFGS").x
    found = trials.fit()
    assert found.scale == "size"
    assert [found.b0, found.b1, logit(found.false_calls)] == pytest.approx(list(second), rel=2e-3)


def test_a90_is_that_of_an_isotonic_fit_to_many_inspections() -> None:
    fitted = drawn(2, 800).fit()
    trials = drawn(3, 800)
    rate = np.array([trials.found[trials.size_m == side].mean() for side in SIDES_M])
    steps = optimize.isotonic_regression(rate).x
    isotonic_m = np.interp(0.9, steps, SIDES_M)
    assert fitted.a90_m == pytest.approx(isotonic_m, rel=0.08)
    assert fitted.a90_m == pytest.approx(TRUE_A90_M, rel=0.03)


def test_the_limit_covers_the_truth_and_a_fit_without_false_calls_does_not_fit() -> None:
    trials = [drawn(100 + k, 15) for k in range(200)]
    with_floor, without = [one.fit() for one in trials], [one.fit(floor=False) for one in trials[:60]]
    assert np.mean([fit.a90_95_m >= TRUE_A90_M for fit in with_floor]) >= 0.92
    assert np.mean([fit.a90_m for fit in with_floor]) == pytest.approx(TRUE_A90_M, rel=0.02)

    def error_at_small_sizes(fit: Pod) -> float:
        return float(fit.at(0.06)) - (FALSE + (1 - FALSE) * expit(-6.0 + 60.0 * 0.06))

    # The control: false calls are taken for detections, and the curve is too flat.
    assert abs(np.mean([error_at_small_sizes(fit) for fit in with_floor])) < 0.01
    assert np.mean([error_at_small_sizes(fit) for fit in without]) > 0.01
    assert np.mean([fit.a90_m for fit in without]) > np.mean([fit.a90_m for fit in with_floor]) * 1.02


def test_a_size_that_is_never_found_does_not_exist() -> None:
    found = fit_pod(np.repeat(SIDES_M, 20), np.zeros(200), 0, 2000)
    assert np.isnan(found.a90_m)
    assert np.isnan(found.a90_95_m)


def test_too_few_inspections_are_refused() -> None:
    with pytest.raises(InputError, match="at least 20"):
        fit_pod(np.repeat(SIDES_M[:2], 20), np.zeros(40), 0, 2000)
    with pytest.raises(InputError, match="intact"):
        fit_pod(np.repeat(SIDES_M, 20), np.zeros(200), 0, 0)


def test_places_that_are_not_visited_are_an_asymptote_below_one() -> None:
    random = np.random.default_rng(9)
    size_m = np.repeat(SIDES_M, 100)
    found = random.random(size_m.size) < FALSE + (0.8 - FALSE) * expit(-6.0 + 80.0 * size_m)
    trials = Trials(size_m, found.astype(float), 200, 2000)
    fit = trials.fit(asymptote=True)
    assert fit.top == pytest.approx(0.8, abs=0.03)
    assert np.isnan(fit.a90_m)
    assert np.isnan(fit.a90_95_m)
    assert fit.a50_m == pytest.approx((logit(0.4 / 0.7) + 6.0) / 80.0, rel=0.06)
    # The control: a curve that must end at 1 promises what no size reaches.
    assert trials.fit().at(0.3) > 0.9
    # Where all places are visited, the asymptote is not taken, or is 1 as nearly as can be told.
    whole = drawn(2, 200)
    assert whole.fit(asymptote=True).a90_m == pytest.approx(whole.fit().a90_m, rel=0.05)
