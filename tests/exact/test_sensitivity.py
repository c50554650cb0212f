"""Sobol indices against functions whose shares are known, with and without noise of the runs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from vibroswarm.search import sensitivity
from vibroswarm.search.sensitivity import indices, saltelli

pytest.importorskip("SALib")

NAMES = ["a", "b", "c"]


def by_name(found: sensitivity.Sensitivity) -> dict[str, dict[str, float]]:
    return {row["field"]: row for row in found.table.iter_rows(named=True)}


def linear(u: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Shares 0.8, 0.2 and 0, no interaction."""
    return np.asarray(2.0 * u[:, 0] + 1.0 * u[:, 1])


def ishigami(u: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    x = np.pi * (2 * u - 1)
    return np.asarray(np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]))


@pytest.fixture
def no_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Almost no bootstrap, which takes nearly all of the time, for tests that read no limits."""
    monkeypatch.setattr(sensitivity, "DRAWS", 2)


@pytest.mark.usefixtures("no_limits")
def test_shares_of_a_function_that_is_known() -> None:
    """Ishigami's: S = 0.314, 0.442, 0; S_T = 0.558, 0.442, 0.244."""
    u = saltelli(3, 5 * 4096, 1)
    found = by_name(indices(NAMES, ishigami(u)[:, None]))
    for name, first, total in (("a", 0.314, 0.558), ("b", 0.442, 0.442), ("c", 0.0, 0.244)):
        assert found[name]["first"] == pytest.approx(first, abs=0.03)
        assert found[name]["total"] == pytest.approx(total, abs=0.03)


def test_the_noise_of_the_runs_is_taken_out() -> None:
    """Twice as much of the variance is noise as is not."""
    shares, held = {"a": 0.8, "b": 0.2, "c": 0.0}, 0
    totals: dict[str, list[float]] = {name: [] for name in shares}
    for seed in range(8):
        found = indices(NAMES, noisy_costs(seed))
        assert found.noise_share == pytest.approx(0.9 / (0.9 + 5 / 12), abs=0.06)
        for name, one in by_name(found).items():
            totals[name].append(one["total"])
            held += one["total_low"] <= shares[name] <= one["total_high"]
            held += one["first_low"] <= shares[name] <= one["first_high"]
    for name, share in shares.items():
        assert float(np.mean(totals[name])) == pytest.approx(share, abs=0.1)
    assert held >= 41  # of 48, 95 % each


def test_limits_of_few_blocks_hold_about_as_often_as_they_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """In 60 designs of 8 blocks; percentiles of the bootstrap hold .88."""
    monkeypatch.setattr(sensitivity, "DRAWS", 300)
    held = []
    for seed in range(60):
        u = saltelli(3, 5 * 8, seed)
        noise = np.random.default_rng(seed).normal(size=(u.shape[0], 10))
        found = by_name(indices(NAMES, linear(u)[:, None] + noise, seed))
        for name, share in (("a", 0.8), ("b", 0.2), ("c", 0.0)):
            one = found[name]
            held += [
                one["first_low"] <= share <= one["first_high"],
                one["total_low"] <= share <= one["total_high"],
            ]
    assert np.mean(held) > 0.91


@pytest.mark.usefixtures("no_limits")
def test_noise_that_stays_in_is_taken_for_an_effect() -> None:
    """The control: the same means, as if each were of one run."""
    means = [noisy_costs(seed).mean(axis=1, keepdims=True) for seed in range(8)]
    assert min(float(indices(NAMES, costs).table["total"].min()) for costs in means)  # type: ignore[arg-type]
    assert 1 > 0.5


def noisy_costs(seed: int) -> NDArray[np.float64]:
    u = saltelli(3, 5 * 1024, seed)
    random = np.random.default_rng(1000 + seed)
    return np.asarray(linear(u)[:, None] + 3.0 * random.normal(size=(u.shape[0], 10)))
