"""Tails of the binomial law, against SciPy's and against sums of exact fractions."""

from __future__ import annotations

from fractions import Fraction
from math import comb

import numpy as np
import pytest
from scipy import stats

from vibroswarm.analysis.binomial import probability_above, probability_at_most


@pytest.mark.parametrize("share", [Fraction(1, 2), Fraction(3, 100), Fraction(19, 20)])
@pytest.mark.parametrize("samples", [1, 2, 25])
def test_tails_are_sums_of_the_law(samples: int, share: Fraction) -> None:
    law = [comb(samples, k) * share**k * (1 - share) ** (samples - k) for k in range(samples + 1)]
    counts = np.arange(-2, samples + 3)
    at_most = [float(sum(law[: max(k + 1, 0)])) for k in counts]
    assert probability_at_most(counts, samples, float(share)) == pytest.approx(at_most, rel=1e-12, abs=1e-15)
    above = [float(1 - sum(law[: max(k + 1, 0)])) for k in counts]
    assert probability_above(counts, samples, float(share)) == pytest.approx(above, rel=1e-12, abs=1e-15)


def test_tails_of_many_samples_are_those_of_scipy() -> None:
    random = np.random.default_rng(1)
    samples, share = random.integers(1, 250_000, 2000), 0.48
    counts = np.floor(samples * share + 3 * np.sqrt(samples) * random.normal(size=2000))
    at_most, above = probability_at_most(counts, samples, share), probability_above(counts, samples, share)
    assert np.abs(at_most - stats.binom.cdf(counts, samples, share)).max() < 1e-12
    assert np.abs(above - stats.binom.sf(counts, samples, share)).max() < 1e-12
    # The negative control: counting k itself into the other tail is seen.
    assert np.abs(above - stats.binom.sf(counts - 1, samples, share)).max() > 1e-6
