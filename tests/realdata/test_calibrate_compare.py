"""The authors' six similarities from their own logs, and what stands beside them.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from vibroswarm.calibrate.real_vs_simulated import Comparison, compare
from vibroswarm.calibrate.session_statistics import figures_of
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import read_tiles
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.scenario.scenario import preset

pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install 'vibroswarm[lab]'")

FOLDER = os.environ.get("VIBROSWARM_RUGBOT", "")
pytestmark = pytest.mark.skipif(
    not FOLDER, reason="VIBROSWARM_RUGBOT does not name the folder of the recordings"
)

AUTHORS = {
    "avoidance": 0.930,
    "vibrating": 0.977,
    "still": 0.987,
    "places": 0.919,
    "distances": 0.920,
    "steps": 0.897,
}


@pytest.fixture(scope="module")
def found() -> Comparison:
    floor = Floor.filling(read_tiles(Path(FOLDER) / "world.txt", (5, 5)), name="world.txt")
    real = [read_log(Path(FOLDER) / f"CAL_{k}.csv") for k in (1, 2, 3)]
    simulated = [read_log(Path(FOLDER) / f"webots_log_{k}.txt") for k in (0, 1, 2)]
    return compare(*(recording_of(logs, floor, preset("paper")) for logs in (real, simulated)))


def test_the_authors_figures_come_out(found: Comparison) -> None:
    assert {one.feature: round(one.as_published, 3) for one in found.similarities} == AUTHORS


def test_places_score_less_than_evenly_spread_points_would(found: Comparison) -> None:
    """The readings: as many uniform points score 0.94, a perfect simulator 0.962."""
    places = next(one for one in found.similarities if one.feature == "places")
    assert places.null == pytest.approx(0.94, abs=0.01)
    assert places.ceiling == pytest.approx(0.962, abs=0.002)
    assert places.at_equal_counts < places.null


def test_real_sessions_are_nearer_each_other_than_the_simulator_is(found: Comparison) -> None:
    for one in found.similarities:
        assert one.real_by_session is not None
        assert one.real_by_session.mean > one.by_session.mean, one.feature
    for one in found.distances:
        if one.feature in ("avoidance", "vibrating", "still"):
            assert one.real is not None
            assert one.effect.low > one.real.estimate, one.feature
            assert one.effect.low > one.real.high or one.feature == "vibrating"


def test_a_classifier_tells_the_simulator_from_the_robots(found: Comparison) -> None:
    assert found.classifier.simulated.estimate > 0.7
    assert found.classifier.simulated_by_robot.low > 0.7
    assert found.classifier.real is not None
    assert found.classifier.real.estimate < 0.45  # of three pairs, so that its limits are wide
    assert found.classifier.real.low < 0.5


def test_the_figures_are_those_of_the_readings() -> None:
    """Section 6: what the real robots do that the simulator does not."""
    floor = Floor.filling(read_tiles(Path(FOLDER) / "world.txt", (5, 5)), name="world.txt")
    found = []
    for names in ([f"CAL_{k}.csv" for k in (1, 2, 3)], [f"webots_log_{k}.txt" for k in (0, 1, 2)]):
        logs = [read_log(Path(FOLDER) / name) for name in names]
        figures = figures_of(recording_of(logs, floor, preset("paper")), 1.33)
        found.append({one.name: one.interval.estimate for one in figures if one.interval is not None})
    real, simulated = found
    assert real["speed_m_s"] == pytest.approx(0.0567, abs=0.0015)
    assert real["start_speed_m_s"] == pytest.approx(0.0602, abs=0.0015)
    assert real["between_m_s"] == pytest.approx(0.0081, abs=0.0007)
    assert real["share_between"] == pytest.approx(0.79, abs=0.06)
    assert real["lag_one"] == pytest.approx(0.18, abs=0.03)
    assert real["drop"] == pytest.approx(0.103, abs=0.01)
    assert real["veer_rad_s"] == pytest.approx(np.radians(-5.7), abs=np.radians(0.5))
    assert real["veer_between_rad_s"] == pytest.approx(np.radians(2.8), abs=np.radians(0.4))
    assert real["avoid_s"] == pytest.approx(0.423, abs=0.003)
    assert real["avoid_none"] == pytest.approx(0.66, abs=0.01)
    assert real["density_corners"] == pytest.approx(1.14, abs=0.01)
    assert real["density_inside"] == pytest.approx(0.92, abs=0.01)
    assert real["off_walls"] == pytest.approx(1.71, abs=0.01)
    assert real["near_walls"] == pytest.approx(0.21, abs=0.01)
    assert real["lag_one_bits"] == pytest.approx(0.24, abs=0.02)
    assert simulated["drop"] == pytest.approx(0.142, abs=0.01)
    assert simulated["share_between"] < 0.05  # it redraws speeds at every sample
