"""Clocks and places of cameras whose views overlap, against paths that are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.tracking.camera import Camera, Lens, matrix_of
from vibroswarm.tracking.marker_detection import Detections
from vibroswarm.tracking.markers import usual_markers
from vibroswarm.tracking.stitch import coarse_offset, fine_offset, stitch, weights_of
from vibroswarm.tracking.stops import stops_of
from vibroswarm.tracking.track import POSITIONS, Tracking

pytest.importorskip("cv2")
LENS = Lens(matrix_of(700.0, np.array([319.5, 239.5])), np.zeros(5), 0.1)
MARKERS = usual_markers(3, 1.0, 1.0)
OFFSET_S = -37.216


def place(robot: int, time_s: Any) -> np.ndarray[Any, Any]:
    """Where a robot is: it goes to and fro at some 4 cm/s, each its own way."""
    phase = 0.11 * time_s * (1 + 0.17 * robot) + robot
    return np.column_stack([0.5 + 0.38 * np.sin(phase), 0.5 + 0.2 * np.cos(0.7 * phase + robot)])


def camera(
    name: str,
    middle_m: float,
    clock_s: float,
    *,
    seed: int,
    where: Any = place,
    shift_m: float = 0.0,
    seconds: float = 120.0,
) -> Tracking:
    """What a camera 1.5 m above (middle, 0.5) sees, whose clock shows 0 at ``clock_s``; noise of 0.3 mm."""
    view = Camera(LENS, np.diag([1.0, -1.0, -1.0]), np.array([middle_m, 0.5, 1.5]), 0.2, True)
    chance = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 1 / 15)
    corners = np.full((time_s.size, 3, 4, 2), np.nan)
    tables, stops = [], []
    for robot in range(3):
        at = where(robot, time_s + clock_s)
        pixels = view.project(np.column_stack([at, np.full(time_s.size, MARKERS.height_m)]))
        seen = ((pixels > 12) & (pixels < np.array([640, 480]) - 12)).all(axis=1)
        corners[seen, robot] = pixels[seen, None] + np.array([[-8, -8], [8, -8], [8, 8], [-8, 8]])
        noisy = at[seen] + chance.normal(0, 3e-4, (int(seen.sum()), 2)) + np.array([shift_m, 0.0])
        columns = [np.full(seen.sum(), robot), time_s[seen], noisy[:, 0], noisy[:, 1], np.zeros(seen.sum())]
        tables.append(pl.DataFrame(dict(zip(POSITIONS, columns, strict=True)), schema=POSITIONS))
        stops.append(stops_of(robot, *columns[1:]))
    floor = {marker: view.project(MARKERS.floor_corners(marker)) for marker in MARKERS.floor}
    detections = Detections((640, 480), time_s, corners, floor, 5)
    return Tracking(Path(name), MARKERS, view, detections, pl.concat(tables), pl.concat(stops), 0)


def errors_m(positions: pl.DataFrame, clock_s: float = 0.0) -> np.ndarray[Any, Any]:
    parts = []
    for robot in range(3):
        own = positions.filter(pl.col("robot") == robot)
        true = place(robot, own["time_s"].to_numpy() + clock_s)
        parts.append(np.hypot(own["x_m"] - true[:, 0], own["y_m"] - true[:, 1]))
    return np.concatenate(parts)


@pytest.mark.parametrize("clock_s", [0.0, 2.031, 71.5, OFFSET_S])
def test_clocks_are_matched_whichever_camera_began_first(clock_s: float) -> None:
    left, right = camera("a.avi", 0.3, 100.0, seed=1), camera("b.avi", 0.7, 100.0 + clock_s, seed=2)
    found = stitch([left, right])
    overlap = found.overlaps[1]
    assert overlap is not None
    assert abs(overlap.offset_s - clock_s) < 4 * overlap.error_s < 0.01
    assert overlap.disagreement_m() < 0.001
    errors = errors_m(found.positions, 100.0)
    assert np.quantile(errors, 0.95) < 8e-4  # noise of 0.3 mm in x and in y: 0.73 mm
    assert found.positions.group_by("robot").len()["len"].min() > 1200  # type: ignore[operator]
    steps = found.positions.select(pl.col("time_s").diff().over("robot"))["time_s"].drop_nulls()
    assert steps.min() > 0.02  # type: ignore[operator]


def test_standard_errors_are_those_of_repeated_sessions() -> None:
    """Of 12 pairs of cameras, the errors over their standard errors have a spread of about 1."""
    scores = []
    for seed in range(12):
        left = camera("a.avi", 0.3, 0.0, seed=2 * seed, seconds=60)
        right = camera("b.avi", 0.7, 3.21, seed=2 * seed + 1, seconds=60)
        coarse = coarse_offset(left.positions, right.positions)
        assert coarse is not None
        found = fine_offset(left.positions, right.positions, coarse)
        assert found is not None
        scores.append((found.offset_s - 3.21) / found.error_s)
    assert 0.5 < np.std(scores) < 1.8


def test_a_shift_between_cameras_moves_no_clock_and_is_shown() -> None:
    left, right = camera("a.avi", 0.3, 0.0, seed=1), camera("b.avi", 0.7, 5.0, seed=2, shift_m=0.004)
    overlap = stitch([left, right]).overlaps[1]
    assert overlap is not None
    assert overlap.offset_s == pytest.approx(5.0, abs=0.005)
    assert np.median(overlap.apart_m, axis=0) == pytest.approx([0.004, 0.0], abs=2e-4)
    assert overlap.disagreement_m() == pytest.approx(0.004, abs=3e-4)


def test_three_cameras_in_a_row_are_joined_in_whatever_order() -> None:
    """The two at the ends have no view in common."""
    ends = camera("a.avi", -0.25, 0.0, seed=1), camera("c.avi", 1.25, 7.5, seed=3)
    middle = camera("b.avi", 0.5, -4.0, seed=2)
    found = stitch([ends[0], ends[1], middle])
    assert [found.offset_s(k) for k in range(3)] == pytest.approx([0.0, 7.5, -4.0], abs=0.01)
    assert np.quantile(errors_m(found.positions), 0.95) < 8e-4
    with pytest.raises(InputError, match=r"c\.avi: cannot be joined"):
        stitch(ends)


def standing(robot: int, time_s: Any) -> np.ndarray[Any, Any]:
    return np.column_stack([np.full(time_s.size, 0.4 + 0.1 * robot), np.full(time_s.size, 0.5)])


def other_session(robot: int, time_s: Any) -> np.ndarray[Any, Any]:
    return place(robot, 1.37 * time_s + 5000.0 + 800 * robot)


@pytest.mark.parametrize("wheres", [(standing, standing), (place, other_session)])
def test_cameras_that_cannot_be_joined_are_refused_by_name(wheres: Any) -> None:
    """Robots that stand all the time tell no clock; another session's robots are elsewhere."""
    cameras = [camera(f"{k}.avi", 0.3 + 0.4 * k, 0.0, seed=k, where=where) for k, where in enumerate(wheres)]
    with pytest.raises(InputError, match=r"1\.avi: cannot be joined with the other videos"):
        stitch(cameras)


def test_weights_fall_towards_the_edge_of_a_picture() -> None:
    seen = camera("a.avi", 0.5, 0.0, seed=1)
    table = pl.DataFrame({"x_m": [0.5, 1.17], "y_m": [0.5, 0.5]})
    middle, edge = weights_of(seen, table)
    assert edge < 0.1 * middle


def test_a_robot_that_one_camera_misses_is_taken_from_the_other() -> None:
    left, right = camera("a.avi", 0.5, 0.0, seed=1), camera("b.avi", 0.5, 1.0, seed=2)
    hidden = left.positions.filter((pl.col("robot") != 1) | ~pl.col("time_s").is_between(30, 40))
    object.__setattr__(left, "positions", hidden)
    assert left.gaps().height == 1
    found = stitch([left, right])
    assert found.gaps().filter(pl.col("start_s") > 5).height == 0
    assert np.quantile(errors_m(found.positions), 0.95) < 8e-4
