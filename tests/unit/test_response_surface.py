"""Response surfaces of candidates, where there is little or nothing to fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from vibroswarm.optimize.response_surface import optima


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
