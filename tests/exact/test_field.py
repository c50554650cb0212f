"""Kriging block by block, reading by reading, against the posterior of all readings at once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from helpers.example_strategies import module_of
from vibroswarm.strategies.base import Array

field = module_of("field")

FALSE_POSITIVE, FALSE_NEGATIVE = 0.1, 0.2
CONTRAST = 1.0 - FALSE_POSITIVE - FALSE_NEGATIVE
WORLD: Any = SimpleNamespace(
    width_m=1.0, height_m=0.8, false_positive=FALSE_POSITIVE, false_negative=FALSE_NEGATIVE, decision_boundary=0.5,
    credible_threshold=0.95,
)  # fmt: skip
PARAMS: Any = SimpleNamespace(variance_factor=2.0, min_samples=25, length_m=0.12)


def begun() -> tuple[Any, Any]:
    s = SimpleNamespace(bits=0, heard=0, needed=0.0, share=0.0, variance=0.0, decision=0)
    sizes: dict[str, int] = {}
    arrays = {n: v for n, v in vars(field.Arrays).items() if isinstance(v, Array)}
    a = SimpleNamespace(**{n: np.zeros(v.size(sizes), v.kind) for n, v in arrays.items()})
    field.begin(s, a, None, PARAMS, WORLD)
    return s, a


def covariance_of(a: Any) -> np.ndarray:
    full = np.zeros((field.BLOCKS, field.BLOCKS))
    full[np.tril_indices(field.BLOCKS)] = a.covariance
    return full + np.tril(full, -1).T


def test_blocks_begin_with_the_mean_covariance_of_their_points() -> None:
    """Against points drawn at random in two blocks; and the share's variance is the mean of all covariances."""
    s, a = begun()
    rng, full = np.random.default_rng(3), covariance_of(a)
    for b, c in ((0, 0), (0, 1), (9, 27), (0, 63)):
        x, y = (
            (rng.random((200_000, 2)) + np.array([k % 8, k // 8])) * [WORLD.width_m / 8, WORLD.height_m / 8]
            for k in (b, c)
        )
        expected = 1 / 12 + 0.25 * np.exp(-np.hypot(*(x - y).T) / PARAMS.length_m).mean()
        assert full[b, c] == pytest.approx(expected, rel=0.04)
    assert np.linalg.eigvalsh(full).min() > 0.0
    assert s.variance == pytest.approx(full.mean(), rel=1e-4)


def test_the_estimate_is_the_posterior_of_all_readings() -> None:
    """In information form, from the start each time: P = (P0^-1 + sum q q' / r)^-1, m = 1/2 + P sum q (y - 1/2) / r."""
    s, a = begun()
    start = np.linalg.inv(covariance_of(a))
    information, weighted, mean = np.zeros_like(start), np.zeros(field.BLOCKS), np.full(field.BLOCKS, 0.5)
    rng = np.random.default_rng(4)
    for _ in range(40):
        bit, x_m, y_m = int(rng.integers(2)), rng.uniform(0.0, 1.0), rng.uniform(0.0, 0.8)
        of_x_m, of_y_m = rng.uniform(0.005, 0.1, 2)
        column = np.diff(norm.cdf(np.arange(9) * 0.125, x_m, of_x_m))
        row = np.diff(norm.cdf(np.arange(9) * 0.1, y_m, of_y_m))
        q = np.outer(row / row.sum(), column / column.sum()).ravel()
        ones = FALSE_POSITIVE + CONTRAST * (0.1 + 0.8 * np.clip(q @ mean, 0.0, 1.0))
        noise = ones * (1.0 - ones) / CONTRAST**2
        information += np.outer(q, q) / noise
        weighted += q * ((bit - FALSE_POSITIVE) / CONTRAST - 0.5) / noise
        covariance = np.linalg.inv(start + information)
        mean = 0.5 + covariance @ weighted
        field.add_sample(s, a, bit, x_m, y_m, of_x_m, of_y_m, WORLD)
        assert a.mean == pytest.approx(mean, abs=2e-3)  # blocks of a share below 1e-4 are left out
        assert (s.share, s.variance) == pytest.approx((mean.mean(), covariance.mean()), rel=2e-3)
    z = (0.5 - mean.mean()) / np.sqrt(2.0 * covariance.mean())
    assert field.belief(s, a, PARAMS, WORLD) == pytest.approx(norm.cdf(z), abs=1e-3)
    before = s.share
    field.add_sample(s, a, 1, 3.0, 3.0, 0.01, 0.01, WORLD)
    assert (s.share, s.heard) == (before, 41)  # beyond the arena: no reading of it
