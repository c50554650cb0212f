"""A prior that tiles share, against enumeration of all floors, exact fractions, and robots that presume coins."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import expit
from scipy.stats import betabinom, norm

from vibroswarm.strategies.place_map import (
    count_posterior,
    prior_shape,
    score_asked,
    score_of_tails,
    tiles_share,
)

FLOORS = np.array(list(product((0, 1), repeat=9)))


def world(side: int, boundary: float) -> Any:
    return SimpleNamespace(rows=side, columns=side, robots=2, decision_boundary=boundary)


def params(median: float = 0.0, v: float = 1.0) -> Any:
    return SimpleNamespace(prior_median=median, variance_factor=v)


def memory(odds: Any) -> Any:
    """A map in which the second of two senders, whose weight is 1/2, has twice the rest of the evidence."""
    odds = np.asarray(odds, dtype=float)
    return SimpleNamespace(
        odds=np.concatenate([0.25 * odds, 1.5 * odds]),
        weight=np.array([1.0, 0.5]),
        p=np.full(odds.size, 7.0),  # scratch: whatever it held
        prior_odds=np.zeros(1),
    )


def prior_of(tiles: int, median: float) -> Any:
    """Probability of each number of vibrating tiles."""
    numbers = np.arange(tiles + 1)
    if median <= 0.5:
        return betabinom.pmf(numbers, tiles, 1.0, math.log(2.0) / -math.log(1.0 - median))
    return betabinom.pmf(numbers, tiles, math.log(2.0) / -math.log(median), 1.0)


def enumerated(odds: Any, median: float) -> Any:
    """Posterior probability of each of the 512 floors."""
    number = FLOORS.sum(axis=1)
    prior = prior_of(9, median)[number] / np.array([math.comb(9, k) for k in number])
    posterior = prior * np.exp(FLOORS @ np.asarray(odds))
    return posterior / posterior.sum()


shares = st.sampled_from([0.03, 0.12, 0.3, 0.5, 0.6, 0.95])
maps = st.lists(st.floats(-12.0, 12.0), min_size=9, max_size=9)


@settings(max_examples=150, deadline=None)
@given(odds=maps, boundary=shares, median=shares)
def test_all_floors_of_nine_tiles(odds: list[float], boundary: float, median: float) -> None:
    p, w, a = params(median), world(3, boundary), memory(odds)
    posterior, number = enumerated(odds, median), FLOORS.sum(axis=1)
    below, above, mean = count_posterior(a, p, w)
    not_more = posterior[number <= boundary * 9 + 1e-9].sum()
    assert below == pytest.approx(not_more, rel=1e-9, abs=1e-300)
    assert above == pytest.approx(posterior[number > boundary * 9 + 1e-9].sum(), rel=1e-9, abs=1e-300)
    assert mean == pytest.approx(posterior @ number, rel=1e-9)
    assert norm.cdf(score_of_tails(below, above, p)) == pytest.approx(not_more, abs=1e-12)


def test_independent_coins_are_another_posterior() -> None:
    """Negative control: nine tiles of which nothing is known are no floor of which half vibrates."""
    odds = [0.0] * 9
    posterior = enumerated(odds, 0.12)
    coins = np.full(len(FLOORS), 1.0 / len(FLOORS))
    few = FLOORS.sum(axis=1) <= 1
    below, _, _ = count_posterior(memory(odds), params(0.12), world(3, 0.12))
    assert below == pytest.approx(posterior[few].sum(), rel=1e-9)
    assert below > 0.5 > 10.0 * coins[few].sum()


@pytest.mark.parametrize("side", [10, 20])
def test_many_tiles_equal_exact_fractions(side: int) -> None:
    """Likelihood ratios from 2^-400 to 2^400 among those of nothing: neither overflow nor cancellation."""
    rng, tiles, most = np.random.default_rng(side), side * side, 200
    powers = np.round(rng.normal(-5.0, 4.0, tiles) * rng.choice([0.0, 1.0, 20.0], tiles)).astype(int)
    exact = [1]  # e_K times a power of 2, up to K = most: more is far too improbable
    for power in powers.tolist():
        still, vibrating = 2 ** max(-power, 0), 2 ** max(power, 0)
        pairs = zip([*exact, 0], [0, *exact], strict=True)
        exact = [still * one + vibrating * less for one, less in pairs][: most + 1]
    weights = [Fraction(value, math.comb(tiles, k)) for k, value in enumerate(exact)]
    top = max(weights)
    prior = prior_of(tiles, 0.03)[: len(weights)]
    posterior = np.array([float(value / top) for value in weights]) * prior
    posterior /= posterior.sum()
    assert len(posterior) == tiles + 1 or posterior[-1] < 1e-12
    number = np.arange(len(posterior))
    limit = round(posterior @ number)  # in the middle of the posterior
    below, _, mean = count_posterior(memory(powers * math.log(2.0)), params(0.03), world(side, limit / tiles))
    assert below == pytest.approx(posterior[: limit + 1].sum(), rel=1e-9)
    assert mean == pytest.approx(posterior @ number, rel=1e-9)
    assert 0.05 < below < 0.999


@pytest.mark.parametrize("median", [0.01, 0.03, 0.3, 0.5])
def test_the_priors_median_is_the_boundary(median: float) -> None:
    share = np.random.default_rng(1).beta(1.0, prior_shape(median), 200_000)
    assert (share < median).mean() == pytest.approx(0.5, abs=0.005)
    assert prior_shape(1.0 - median) == pytest.approx(prior_shape(median))


def test_at_one_half_tiles_stay_independent() -> None:
    assert not tiles_share(params(), world(3, 0.5))
    assert not tiles_share(params(0.5), world(3, 0.5))
    assert tiles_share(params(), world(3, 0.03))
    assert tiles_share(params(0.3), world(3, 0.5))
    assert tiles_share(params(0.5), world(3, 0.3))
    a = memory([0.4, -1.0, 0.2, 2.0, -3.0, 0.0, 0.1, -0.3, 1.0])
    p = expit(a.odds[9:] * 0.5 + a.odds[:9])
    z = (4.5 - p.sum()) / math.sqrt((p * (1.0 - p)).sum())
    assert score_asked(a, params(), world(3, 0.5)) == pytest.approx(z)
