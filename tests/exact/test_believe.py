"""The Beta posterior and the belief, against the regularised incomplete beta function."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fractions import Fraction
from itertools import chain, repeat
from math import comb, nextafter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betainc

from vibroswarm.robot.belief import SURE, belief_below, variance
from vibroswarm.strategies.world import MAX_COUNTS, belief_of, beliefs

BOUNDARIES = (0.5, 0.03, 0.97)
TOLERANCE = 1e-9
CLOSE = 1e-12
"""What it really holds to."""

Belief = Callable[[int, int, float], float]


def largest_error(bits: Iterable[int], boundary: float, belief: Belief = belief_below) -> float:
    """The largest absolute error of the belief on the way through ``bits``."""
    steps = np.array(list(bits), dtype=np.int64)
    alpha = 1 + np.append(0, np.cumsum(steps))
    beta = 1 + np.append(0, np.cumsum(1 - steps))
    found = np.array([belief(a, b, boundary) for a, b in zip(alpha.tolist(), beta.tolist(), strict=True)])
    assert found.min() >= 0.0
    assert found.max() <= 1.0
    return float(np.abs(found - betainc(alpha, beta, boundary)).max())


RUNS = {
    "zeros": [0] * 5000,
    "turning twice": [0] * 2000 + [1] * 4000 + [0] * 2000,
    "alternating": [0, 1] * 2500,
    "random": np.random.default_rng(1).integers(0, 2, 6000).tolist(),
    "random, few ones": (np.random.default_rng(2).random(6000) < 0.04).astype(int).tolist(),
}


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", RUNS)
def test_belief_is_the_incomplete_beta_function(name: str, boundary: float) -> None:
    error = largest_error(RUNS[name], boundary)
    assert error < TOLERANCE, f"{error:.3g}"


def test_a_run_that_turns_round_comes_back_to_one_half() -> None:
    assert belief_below(1101, 1101, 0.5) == 0.5
    assert belief_below(1101, 1101, nextafter(0.5, 1)) == pytest.approx(0.5, abs=CLOSE)


def test_a_slightly_wrong_boundary_fails() -> None:
    """Negative control: a boundary that is off by a millionth."""

    def off(alpha: int, beta: int, boundary: float) -> float:
        return belief_below(alpha, beta, boundary + 1e-6)

    assert largest_error(RUNS["random"], 0.5, off) > TOLERANCE


def test_a_sum_cut_short_fails() -> None:
    """Negative control: the check sees it where terms below 1e-6 of the sum are left out."""

    def short(alpha: int, beta: int, boundary: float) -> float:
        k = np.arange(alpha, alpha + beta)
        terms = stats.binom.pmf(k, alpha + beta - 1, boundary)
        return min(float(terms[terms > 1e-6 * terms.max()].sum()), 1.0)

    assert largest_error(RUNS["alternating"][:300], 0.5, short) > TOLERANCE


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 1), st.integers(1, 400)), max_size=12),
    st.lists(st.integers(0, 1), max_size=60),
    st.one_of(st.sampled_from(BOUNDARIES), st.floats(0.01, 0.99)),
)
def test_any_sequence_of_bits(runs: list[tuple[int, int]], bits: list[int], boundary: float) -> None:
    sequence = chain(bits, *(repeat(bit, length) for bit, length in runs), bits)
    assert largest_error(sequence, boundary) < TOLERANCE


@settings(deadline=None, max_examples=150)
@given(st.integers(1, 60), st.integers(1, 60), st.integers(1, 99))
def test_it_is_the_binomial_tail_in_whole_numbers(alpha: int, beta: int, percent: int) -> None:
    """Against the exact fraction."""
    x, n = Fraction(percent, 100), alpha + beta - 1
    exact = sum(comb(n, k) * x**k * (1 - x) ** (n - k) for k in range(alpha, n + 1))
    assert belief_below(alpha, beta, percent / 100) == pytest.approx(float(exact), abs=1e-14)


@settings(deadline=None, max_examples=200)
@given(st.integers(2, 3_000_000), st.floats(-9, 9), st.one_of(st.just(0.5), st.floats(0.001, 0.999)))
def test_many_counts(counts: int, deviations: float, boundary: float) -> None:
    """Thousands of robots, or a prior of a million: as near the boundary as far from it."""
    wanted = boundary * counts + deviations * (counts * boundary * (1 - boundary)) ** 0.5
    alpha = min(max(round(wanted), 1), counts - 1)
    belief = belief_below(alpha, counts - alpha, boundary)
    assert belief == pytest.approx(float(betainc(alpha, counts - alpha, boundary)), abs=CLOSE)


@pytest.mark.parametrize("boundary", [0.5, 0.2, 0.001, 0.97])
@pytest.mark.parametrize("counts", [44, 1000, 10**6])
def test_where_it_is_called_sure_it_is(counts: int, boundary: float) -> None:
    """The first counts at which the sum is not made: what is left out is less than the last digit of 1."""
    reach = (SURE * counts) ** 0.5
    for alpha, sure in (
        (int(boundary * counts + reach) + 1, 0.0),
        (int(np.ceil(boundary * counts - reach)) - 1, 1.0),
    ):
        if 1 <= alpha < counts:
            assert belief_below(alpha, counts - alpha, boundary) == sure
            assert abs(float(betainc(alpha, counts - alpha, boundary)) - sure) < 2.0**-53
            nearer = alpha - 1 if sure == 0.0 else alpha + 1
            if 1 <= nearer < counts:
                doubt = abs(belief_below(nearer, counts - nearer, boundary) - sure)
                assert doubt < 1e-15  # no step


def test_the_belief_falls_with_ones_and_rises_with_zeros() -> None:
    for boundary in (0.5, 0.3, 0.9):
        for counts in (2, 3, 10, 97, 1000, 4001):
            found = [belief_below(a, counts - a, boundary) for a in range(1, counts)]
            assert all(np.diff(found) <= 0.0)


# The table of beliefs


@settings(deadline=None, max_examples=100)
@given(
    st.integers(1, 9000), st.integers(1, 9000), st.sampled_from([0.5, 0.03, 0.97, 1 / 3]),
    st.sampled_from([0, 1024, 5000, MAX_COUNTS, 10**7]),
)  # fmt: skip
def test_the_table_says_what_the_function_says(alpha: int, beta: int, boundary: float, counts: int) -> None:
    """In the table and beyond it, bit by bit, the first time and later."""
    table = beliefs(boundary, counts)
    for near in (beta, max(1, round(alpha / boundary) - alpha)):
        expected = belief_below(alpha, near, boundary)
        assert belief_of(table, alpha, near) == expected
        assert belief_of(table, alpha, near) == expected


@pytest.mark.parametrize(("alpha", "beta"), [(1, 1), (381, 402), (10**6, 10**6)])
def test_variance_is_that_of_the_beta_distribution(alpha: int, beta: int) -> None:
    assert variance(alpha, beta) == pytest.approx(float(stats.beta.var(alpha, beta)), rel=1e-12)
