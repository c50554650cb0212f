"""The authors' six similarities from their own logs, and what stands beside them.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import numpy as np
import pytest

from vibroswarm.lab.calibrate.compare import Comparison, compare
from vibroswarm.lab.calibrate.session_statistics import figures_of
from vibroswarm.lab.recordings.recording import Recording

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


def test_the_figures_are_those_of_the_readings(real: Recording, simulated: Recording) -> None:
    """Section 6: what the real robots do that the simulator does not."""
    robots, simulator = (
        {one.name: one.interval.estimate for one in figures_of(log, 1.33) if one.interval is not None}
        for log in (real, simulated)
    )
    assert robots["speed_m_s"] == pytest.approx(0.0567, abs=0.0015)
    assert robots["start_speed_m_s"] == pytest.approx(0.0602, abs=0.0015)
    assert robots["between_m_s"] == pytest.approx(0.0081, abs=0.0007)
    assert robots["share_between"] == pytest.approx(0.79, abs=0.06)
    assert robots["lag_one"] == pytest.approx(0.18, abs=0.03)
    assert robots["drop"] == pytest.approx(0.103, abs=0.01)
    assert robots["veer_rad_s"] == pytest.approx(np.radians(-5.7), abs=np.radians(0.5))
    assert robots["veer_between_rad_s"] == pytest.approx(np.radians(2.8), abs=np.radians(0.4))
    assert robots["avoid_s"] == pytest.approx(0.423, abs=0.003)
    assert robots["avoid_none"] == pytest.approx(0.66, abs=0.01)
    assert robots["density_corners"] == pytest.approx(1.14, abs=0.01)
    assert robots["density_inside"] == pytest.approx(0.92, abs=0.01)
    assert robots["off_walls"] == pytest.approx(1.71, abs=0.01)
    assert robots["near_walls"] == pytest.approx(0.21, abs=0.01)
    assert robots["lag_one_bits"] == pytest.approx(0.24, abs=0.02)
    assert simulator["drop"] == pytest.approx(0.142, abs=0.01)
    assert simulator["share_between"] < 0.05  # it redraws speeds at every sample
