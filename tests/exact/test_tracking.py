"""Geometry of the tracking of markers against OpenCV's projection and positions that are known; stops and clocks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.lab.tracking.camera import (
    Camera,
    Lens,
    fit_camera,
    matrix_of,
    outwards,
)
from vibroswarm.lab.tracking.markers import corners_at, read_markers, usual_markers
from vibroswarm.lab.tracking.stops import clock_offset, stops_of
from vibroswarm.lab.tracking.track import PLACES_M

cv2 = pytest.importorskip("cv2")
SIZE = (1280, 960)
MARKERS = usual_markers(5, 1.0, 1.0)
FLOOR_M = np.concatenate([MARKERS.floor_corners(marker) for marker in MARKERS.floor])
LENS = Lens(matrix_of(1100.0, np.array([651.0, 470.0])), np.array([-0.28, 0.09, 0.001, -0.001, 0.0]), 0.0)
TURN, SHIFT = np.array([np.pi - 0.08, 0.03, 0.02]), np.array([-0.5, 0.48, 1.4])


def camera() -> Camera:
    rotation, _ = cv2.Rodrigues(TURN)
    return Camera(LENS, rotation, -rotation.T @ SHIFT, 0.0, True)


def seen(points_m: np.ndarray) -> np.ndarray:
    """Pixels by OpenCV's own projection."""
    found, _ = cv2.projectPoints(points_m.reshape(-1, 1, 3), TURN, SHIFT, LENS.matrix, LENS.distortion)
    return found.reshape(*points_m.shape[:-1], 2)


@settings(deadline=None, max_examples=50)
@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 0.2))
def test_a_point_at_a_height_is_where_it_was(x_m: float, y_m: float, z_m: float) -> None:
    assert camera().at_height(seen(np.array([[x_m, y_m, z_m]])), z_m)[0] == pytest.approx(
        [x_m, y_m], abs=1e-6
    )


def robots_anywhere(count: int, chance: np.random.Generator) -> np.ndarray:
    """Corners of robots' markers 30 mm above the floor, (count, 4, 3), m."""
    return np.stack(
        [
            corners_at(*chance.uniform(0.05, 0.95, 2), chance.uniform(-3, 3), MARKERS.size_m, 0.03)
            for _ in range(count)
        ]
    )


def test_a_camera_is_found_from_markers_with_its_lens_and_without() -> None:
    """Noise-free corners of four floor markers, and 60 robots' markers anywhere."""
    chance = np.random.default_rng(4)
    robots = robots_anywhere(60, chance)
    test = np.column_stack([chance.uniform(0, 1, (50, 2)), np.full(50, 0.03)])
    for lens, most_m in ((LENS, 1e-6), (None, 3e-3)):
        found = fit_camera(SIZE, FLOOR_M, seen(FLOOR_M), seen(robots), MARKERS.size_m, 0.03, lens)
        error = np.hypot(*(found.at_height(seen(test), 0.03) - test[:, :2]).T)
        assert error.max() < most_m
        assert found.calibrated == (lens is not None)
    flat = Lens(LENS.matrix, np.zeros(5), 0.0)  # a lens without distortion must fail that bar
    wrong = fit_camera(SIZE, FLOOR_M, seen(FLOOR_M), seen(robots), MARKERS.size_m, 0.03, flat)
    assert np.hypot(*(wrong.at_height(seen(test), 0.03) - test[:, :2]).T).max() > 6e-3


@pytest.mark.parametrize(("wider_px", "lens"), [(0.4, LENS), (0.0, None), (-0.3, None)])
def test_how_far_outwards_edges_are_seen_is_found(wider_px: float, lens: Lens | None) -> None:
    """Corners that blur and thresholds move along their diagonals; the control is 0."""
    robots_px = seen(robots_anywhere(60, np.random.default_rng(4)))
    floor_px = seen(FLOOR_M).reshape(-1, 4, 2)
    found = fit_camera(
        SIZE,
        FLOOR_M,
        (floor_px + wider_px * outwards(floor_px)).reshape(-1, 2),
        robots_px + wider_px * outwards(robots_px),
        MARKERS.size_m,
        0.03,
        lens,
    )
    assert found.edge_px == pytest.approx(wider_px, abs=0.03)


def test_how_far_places_may_be_off_is_known() -> None:
    """From straight above only the sizes of markers determine the height; a tilt, the height or a lens do it better."""
    robots = robots_anywhere(40, np.random.default_rng(4))
    lens = Lens(LENS.matrix, np.zeros(5), 0.0)
    straight = Camera(lens, np.diag([1.0, -1.0, -1.0]), np.array([0.5, 0.5, 1.5]), 0.0, True)
    tilted = replace(straight, rotation=cv2.Rodrigues(np.array([0.18, 0.0, 0.0]))[0] @ straight.rotation)

    def fit_of(true: Camera, wider_px: float = 0.0, **options: Any) -> tuple[float, float]:
        """How far places may be off, and are at most, if robots' markers alone are seen wider."""
        robots_px = true.project(robots.reshape(-1, 3)).reshape(-1, 4, 2)
        seen_px = robots_px + wider_px * outwards(robots_px)
        fit = fit_camera(SIZE, FLOOR_M, true.project(FLOOR_M), seen_px, MARKERS.size_m, 0.03, **options)
        away_m = fit.at_height(robots_px.mean(axis=1), 0.03) - robots[:, :, :2].mean(axis=1)
        return fit.place_error_m, float(np.linalg.norm(away_m, axis=1).max())

    assert min(fit_of(straight, wider_px=0.1)) > PLACES_M
    assert max(fit_of(tilted)) < PLACES_M
    assert max(fit_of(straight, wider_px=0.1, camera_height_m=1.5)) < PLACES_M
    assert max(fit_of(straight, wider_px=0.1, lens=lens)) < 0.2 * PLACES_M


@pytest.mark.parametrize(("corners_seen", "lens"), [(4, LENS), (8, LENS), (16, LENS), (4, None)])
def test_places_are_as_good_as_the_floor_markers_let_them_be(corners_seen: int, lens: Lens | None) -> None:
    """With one marker of the floor a chessboard does not help: errors of corners turn and shift the camera."""
    floor_m = FLOOR_M[:corners_seen]
    chance = np.random.default_rng(8)
    robots = robots_anywhere(40, chance)
    robots_px = seen(robots.reshape(-1, 3)).reshape(-1, 4, 2)
    stated_m, off_m = [], []
    for _ in range(3 if lens else 1):
        floor_px, own_px = (px + chance.normal(0.0, 0.2, px.shape) for px in (seen(floor_m), robots_px))
        fit = fit_camera(SIZE, floor_m, floor_px, own_px, MARKERS.size_m, 0.03, lens)
        away_m = fit.at_height(robots_px.mean(axis=1), 0.03) - robots[:, :, :2].mean(axis=1)
        stated_m.append(fit.place_error_m)
        off_m.append(np.linalg.norm(away_m, axis=1).max())
    assert max(off_m) < np.median(stated_m)
    assert (np.median(stated_m) > PLACES_M) == (corners_seen < 16)


def test_a_camera_exactly_above_is_found() -> None:
    """OpenCV's pose from points in a plane (IPPE) is wrong there: the markers' places were said not to fit."""
    lens = Lens(matrix_of(1100.0, (np.array(SIZE) - 1) / 2), np.zeros(5), 0.0)
    for height_m in (1.3, 1.5, 2.0):
        at_m = np.array([0.5, 0.45, height_m])
        above = Camera(lens, np.diag([-1.0, 1.0, -1.0]), at_m, 0.0, True)
        found = fit_camera(SIZE, FLOOR_M, above.project(FLOOR_M), np.empty((0, 4, 2)), 0.022, 0.03, lens)
        assert found.position_m == pytest.approx(at_m, abs=1e-6)


def path_with_stops() -> tuple[np.ndarray, ...]:
    """A robot at 15 frames/s that drives at 4 cm/s and stands from 4 to 7 s and from 11 to 13.5 s."""
    time_s = np.arange(0.0, 18.0, 1 / 15)
    driven_s = time_s - np.clip(time_s - 4, 0, 3) - np.clip(time_s - 11, 0, 2.5)
    noise = np.random.default_rng(1).normal(0, 2e-4, (2, time_s.size))
    return time_s, 0.1 + 0.04 * driven_s + noise[0], 0.5 + noise[1], np.zeros(time_s.size)


def test_stops_are_found_and_their_ends_between_frames() -> None:
    time_s, x_m, y_m, heading = path_with_stops()
    found = stops_of(3, time_s, x_m, y_m, heading)
    assert found["robot"].to_list() == [3, 3]
    assert found["end_s"].to_list() == pytest.approx([7.0, 13.5], abs=0.02)
    assert found["start_s"].to_list() == pytest.approx([4.0, 11.0], abs=0.15)
    assert stops_of(3, time_s, 0.1 + 0.04 * time_s, y_m, heading).is_empty()
    assert found["end_seen"].all()
    turning = stops_of(3, time_s, np.full(time_s.size, 0.5), y_m, 0.5 * time_s)
    assert turning.is_empty()  # turns in place


def test_clocks_are_matched_in_spite_of_missing_stops_and_other_clocks_are_refused() -> None:
    chance = np.random.default_rng(7)
    ends = np.cumsum(chance.uniform(4, 12, (4, 25)), axis=1)
    stops = pl.DataFrame(
        {"robot": np.repeat(np.arange(4), 25), "end_s": (ends + chance.normal(0, 0.02, ends.shape)).ravel()}
    ).with_columns(start_s=pl.col("end_s") - 2, end_seen=True, x_m=0.0, y_m=0.0)
    log = pl.DataFrame({"robot": np.repeat(np.arange(4), 25), "time_s": ends.ravel() + 87.25})
    found = clock_offset(stops.sample(fraction=0.8, seed=1), log)
    assert found.offset_s == pytest.approx(87.25, abs=0.015)
    assert abs(found.offset_s - 87.25) < 4 * found.error_s < 0.05
    assert found.pairs >= 78
    assert clock_offset(stops, log, 0.02).offset_s == pytest.approx(clock_offset(stops, log).offset_s + 0.02)
    unseen = stops.with_columns(end_seen=False)
    with pytest.raises(InputError, match="stops in the video"):
        clock_offset(unseen, log)
    other = log.with_columns(time_s=pl.Series(np.sort(chance.uniform(0, 4000, 100))))
    with pytest.raises(InputError, match="match a stop"):
        clock_offset(stops, other)


def test_a_file_of_markers_is_read_as_it_was_written(tmp_path: Path) -> None:
    markers = usual_markers([7, 3, 9], 1.2, 0.8, size_mm=25, height_mm=31.5)
    path = tmp_path / "my markers.toml"
    path.write_text(markers.to_toml(), encoding="utf-8")
    assert read_markers(path) == markers
    for wrong in ("height_mm = 31.5", "at_mm = {"):
        text = "\n".join(line for line in markers.to_toml().splitlines() if not line.startswith(wrong))
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match="required"):
            read_markers(path)
