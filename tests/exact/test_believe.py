"""The Beta posterior and the belief, against the regularised incomplete beta function."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import chain, repeat
from math import log, log1p

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betainc

from vibroswarm.robot.believe import Posterior, observe, prior, variance

BOUNDARIES = (0.5, 0.03, 0.97)
TOLERANCE = 1e-9

Update = Callable[[Posterior, int, float], Posterior]


def largest_error(
    bits: Iterable[int], boundary: float, update: Update = observe, start: tuple[int, int] = (1, 1)
) -> float:
    """The largest absolute error of the belief on the way through ``bits``; also checks the counts."""
    posterior = prior(*start, boundary)
    visited = [posterior]
    ones = zeros = 0
    for bit in bits:
        posterior = update(posterior, bit, boundary)
        ones, zeros = ones + bit, zeros + 1 - bit
        assert (posterior.alpha, posterior.beta) == (start[0] + ones, start[1] + zeros)
        visited.append(posterior)
    alpha, beta, belief = (np.array([p[k] for p in visited], dtype=float) for k in range(3))
    assert belief.min() >= 0.0
    assert belief.max() <= 1.0
    return float(np.abs(belief - betainc(alpha, beta, boundary)).max())


def with_plain_term(posterior: Posterior, bit: int, boundary: float) -> Posterior:
    """The update that carries the term itself (in ``log_term``) instead of its logarithm."""
    alpha, beta, belief, term = posterior
    total = alpha + beta
    if posterior.alpha == posterior.beta == 1:
        term = boundary * (1.0 - boundary)
    if bit:
        belief -= term / alpha
        term *= boundary * total / alpha
        alpha += 1
    else:
        belief += term / beta
        term *= (1.0 - boundary) * total / beta
        beta += 1
    return Posterior(alpha, beta, min(max(belief, 0.0), 1.0), term)


RUNS = {
    "zeros": [0] * 5000,
    "ones": [1] * 5000,
    "turning to ones": [0] * 1100 + [1] * 1100,
    "turning to zeros": [1] * 1100 + [0] * 1100,
    "turning twice": [0] * 2000 + [1] * 4000 + [0] * 2000,
    "alternating": [0, 1] * 2500,
    "random": np.random.default_rng(1).integers(0, 2, 6000).tolist(),
    "random, few ones": (np.random.default_rng(2).random(6000) < 0.04).astype(int).tolist(),
    "random, many ones": (np.random.default_rng(3).random(6000) < 0.96).astype(int).tolist(),
}


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("name", RUNS)
def test_belief_is_the_incomplete_beta_function(name: str, boundary: float) -> None:
    error = largest_error(RUNS[name], boundary)
    assert error < TOLERANCE, f"{error:.3g}"


def test_a_run_that_turns_round_comes_back_to_one_half() -> None:
    posterior = prior(1, 1, 0.5)
    for bit in RUNS["turning to ones"]:
        posterior = observe(posterior, bit, 0.5)
    assert (posterior.alpha, posterior.beta) == (1101, 1101)
    assert posterior.belief == pytest.approx(0.5, abs=TOLERANCE)


def test_the_plain_term_fails_where_the_run_turns_round() -> None:
    """Negative control: the reason for the logarithm, and the check sees it."""
    assert largest_error(RUNS["alternating"], 0.5, with_plain_term) < TOLERANCE
    assert largest_error(RUNS["turning to ones"], 0.5, with_plain_term) > 0.4


def test_a_slightly_wrong_update_fails() -> None:
    """Negative control: a boundary that is off by a millionth."""

    def off(posterior: Posterior, bit: int, boundary: float) -> Posterior:
        return observe(posterior, bit, boundary + 1e-6)

    assert largest_error(RUNS["random"], 0.5, off) > TOLERANCE


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 1), st.integers(1, 400)), max_size=12),
    st.lists(st.integers(0, 1), max_size=60),
    st.one_of(st.sampled_from(BOUNDARIES), st.floats(0.01, 0.99)),
)
def test_any_sequence_of_bits(runs: list[tuple[int, int]], bits: list[int], boundary: float) -> None:
    sequence = chain(bits, *(repeat(bit, length) for bit, length in runs), bits)
    assert largest_error(sequence, boundary) < TOLERANCE


@settings(deadline=None, max_examples=40)
@given(
    st.integers(1, 600), st.integers(1, 600), st.floats(0.01, 0.99), st.lists(st.integers(0, 1), max_size=40)
)
def test_any_prior(alpha: int, beta: int, boundary: float, bits: list[int]) -> None:
    assert largest_error(bits, boundary, start=(alpha, beta)) < TOLERANCE


def test_the_prior_carries_the_logarithm_of_the_term() -> None:
    for alpha, beta, boundary in ((1, 1, 0.5), (3, 7, 0.4), (200, 150, 0.6)):
        got = prior(alpha, beta, boundary)
        # From the density at 1/2: ln B = (a + b - 2) ln(1/2) - ln density.
        expected = alpha * log(boundary) + beta * log1p(-boundary)
        expected -= (alpha + beta - 2) * log(0.5) - float(stats.beta.logpdf(0.5, alpha, beta))
        assert got.log_term == pytest.approx(expected, abs=1e-9)


def test_the_order_of_the_bits_does_not_matter() -> None:
    bits = RUNS["random"][:500]
    beliefs = []
    for order in (bits, bits[::-1], sorted(bits)):
        posterior = prior(1, 1, 0.5)
        for bit in order:
            posterior = observe(posterior, bit, 0.5)
        beliefs.append(posterior.belief)
    assert np.ptp(beliefs) < TOLERANCE


@pytest.mark.parametrize(
    ("alpha", "beta"), [(1, 1), (2, 1), (1, 900), (381, 402), (10**5, 3), (10**6, 10**6)]
)
def test_variance_is_that_of_the_beta_distribution(alpha: int, beta: int) -> None:
    assert variance(alpha, beta) == pytest.approx(float(stats.beta.var(alpha, beta)), rel=1e-12)


def test_compiled_equals_plain_python() -> None:
    plain = getattr(observe, "py_func", observe)
    one = two = prior(1, 1, 0.37)
    for bit in RUNS["random"][:300]:
        one, two = observe(one, bit, 0.37), plain(two, bit, 0.37)
    assert (one.alpha, one.beta) == (two.alpha, two.beta)
    assert one.belief == pytest.approx(two.belief, abs=1e-13)
