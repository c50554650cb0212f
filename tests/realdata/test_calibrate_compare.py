"""The authors' six similarities from their own logs, and what stands beside them.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import pytest

from vibroswarm.calibrate.compare import Comparison, compare
from vibroswarm.recordings.recording import Recording

pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install 'vibroswarm[lab]'")

AUTHORS = {
    "avoidance": 0.930,
    "vibrating": 0.977,
    "still": 0.987,
    "places": 0.919,
    "distances": 0.920,
    "steps": 0.897,
}


@pytest.fixture(scope="module")
def found(real: Recording, simulated: Recording) -> Comparison:
    return compare(real, simulated)


def test_the_authors_figures_come_out(found: Comparison) -> None:
    assert {one.feature: round(one.as_published, 3) for one in found.likenesses} == AUTHORS


def test_places_score_less_than_evenly_spread_points_would(found: Comparison) -> None:
    """The readings: as many uniform points score 0.94, a perfect simulator 0.962."""
    places = next(one for one in found.likenesses if one.feature == "places")
    assert places.null == pytest.approx(0.94, abs=0.01)
    assert places.ceiling == pytest.approx(0.962, abs=0.002)
    assert places.at_equal_counts < places.null


def test_real_sessions_are_nearer_each_other_than_the_simulator_is(found: Comparison) -> None:
    for one in found.likenesses:
        if one.feature in ("avoidance", "vibrating", "still"):
            assert one.real_distance is not None
            assert one.distance.estimate > one.real_distance.high, one.feature
    assert found.recognised is not None
    assert found.recognised.low > 0.5
