"""The camera of the recordings: kept with a scenario, and applied to simulated positions when they are compared."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.calibrate.camera import RIGHT, Camera, seen_through
from vibroswarm.calibrate.compare import camera_between, compare
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset

pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install 'vibroswarm[lab]'")

CAMERA = Camera(1.05, 0.004, -0.006)


@pytest.fixture(scope="module")
def seen(logs: list[Path], told: Scenario, ground: Floor) -> Recording:
    """The log of a simulation, with positions as a camera would have seen them."""
    log = recording_of([read_log(path) for path in logs], ground, told)
    x, y = CAMERA.seen(log.motion["x_m"].to_numpy(), log.motion["y_m"].to_numpy(), (1.0, 1.0))
    return replace(log, motion=log.motion.with_columns(x_m=pl.Series(x), y_m=pl.Series(y)))


def test_true_positions_are_found_again_from_where_they_were_seen() -> None:
    x, y = np.random.default_rng(3).uniform(0.1, 0.9, (2, 50))
    back = CAMERA.true(*CAMERA.seen(x, y, (1.0, 1.0)), (1.0, 1.0))
    np.testing.assert_allclose(back, (x, y), atol=1e-12)
    assert np.abs(np.subtract(CAMERA.seen(x, y, (1.0, 1.0)), (x, y))).max() > 0.02
    corners = CAMERA.seen(np.array([0.0, 1.0]), np.array([0.0, 1.0]), (1.0, 1.0))  # are seen in the arena
    assert np.array(corners).tolist() == [[0.0, 1.0], [0.0, 1.0]]


def test_it_is_that_of_a_scenarios_fields() -> None:
    assert Camera.of(Scenario().with_values(CAMERA.fields())) == CAMERA
    assert RIGHT.fields() == {}
    assert Camera.of(preset("paper")) == RIGHT
    assert Camera.of(preset("calibrated")).magnification == pytest.approx(1.0353, abs=0.002)


def test_a_simulation_is_compared_as_the_camera_would_have_seen_it(
    made: Result, seen: Recording, logs: list[Path], told: Scenario, ground: Floor
) -> None:
    with_camera = replace(made, scenario=made.scenario.with_values(CAMERA.fields()))
    found = compare(seen, with_camera)
    assert found.camera == CAMERA
    log = recording_of([read_log(path) for path in logs], ground, told)
    exact = {one.feature: one.as_published for one in compare(log, made).likenesses}
    through = {one.feature: one.as_published for one in found.likenesses}
    plain = compare(seen, made)
    without = {one.feature: one.as_published for one in plain.likenesses}
    for feature in ("distances", "steps"):
        # The log rounds times, and has a robot's first position; one without a camera is as similar.
        assert through[feature] == pytest.approx(exact[feature], abs=0.005), feature
        assert without[feature] < through[feature] - 0.03, feature
    assert without["places"] == pytest.approx(through["places"]), "its bins span the data's own range"


def test_a_camera_stands_between_a_recording_and_a_simulation_only(made: Result, seen: Recording) -> None:
    """Places of a tracked video are right already."""
    with_camera = replace(made, scenario=made.scenario.with_values(CAMERA.fields()))
    tracked = replace(seen, sessions=tuple({**session, "reader": "camera"} for session in seen.sessions))
    assert tracked.places_corrected
    assert not seen.places_corrected
    assert camera_between(seen, with_camera) == CAMERA
    assert camera_between(tracked, with_camera) == RIGHT
    assert seen_through(seen, CAMERA) is seen
    assert camera_between(seen, seen) == RIGHT
    assert camera_between(made, with_camera) == RIGHT
    assert camera_between(seen, made) == RIGHT
