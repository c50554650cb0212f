"""Response surfaces of candidates, where there is little or nothing to fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vibroswarm.optimize import response_surface
from vibroswarm.optimize.response_surface import features, fit, optima


class Scored:
    """What ``optima`` reads of an archive: candidates of two fields with given scores."""

    space = SimpleNamespace(size=2)

    def __init__(self, scores: list[float]) -> None:
        self.scores = scores
        self.points = np.random.default_rng(1).uniform(0, 1, (len(scores), 2))

    def estimate(self, key: int) -> tuple[float, float]:
        return self.scores[key], 0.1

    def count(self, key: int) -> int:
        return 3

    def __getitem__(self, key: int) -> Any:
        return SimpleNamespace(point=tuple(self.points[key]))


def test_candidates_that_all_failed_have_no_optimum() -> None:
    archive: Any = Scored([float("inf")] * 40)
    assert optima(archive, range(40), 1) == []


def test_a_bowl_has_its_optimum_where_it_is_lowest() -> None:
    """The control: candidates that did not fail."""
    archive: Any = Scored([0.0] * 60)
    archive.scores = (1.0 + ((archive.points - [0.3, 0.6]) ** 2).sum(axis=1)).tolist()
    found = optima(archive, range(60), 1)
    assert found
    np.testing.assert_allclose(found[-1], [0.3, 0.6], atol=0.05)


def test_candidates_weigh_as_their_runs_and_their_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Residuals of four points on a line are orthogonal to quadratics: 1, -3, 3, -1 over runs / s^2."""
    monkeypatch.setattr(response_surface, "RIDGE", 0.0)
    points, runs = np.linspace(0.0, 1.0, 4)[:, None], np.array([10.0, 20.0, 10.0, 40.0])
    scores = np.array([4.0, 3.0, 2.0, 8.0])
    fitted = features(points) @ fit(points, scores, runs)
    expected = np.array([1.0, -3.0, 3.0, -1.0]) * fitted**2 / runs
    residuals = scores - fitted
    assert residuals / residuals[0] == pytest.approx(expected / expected[0], rel=0.05)
