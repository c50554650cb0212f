"""Detect where robots turn away from walls, and how far they turn at the ends of legs, from the paths between samples.

| name | symbol | unit | equation |
|---|---|---|---|
| distance | d | m | from the position at which a robot turned to the wall it approached |
| incidence | i | rad | its course minus the wall's outward normal: 0 head-on, positive with the wall to the right |
| turned | - | rad | course after a turn minus that before it, in [-pi, pi) |

A robot drives while the steps of its path exceed ``DRIVES`` times its usual speed. A turn away from a wall is the
first
standstill after a drive in an interval with avoidance; its position is the median of those seen during the turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.drive import track_of
from vibroswarm.result import Result

Floats = NDArray[np.float64]

DRIVES: Final = 0.62
"""Share of the usual speed above which a step is driving: between that of a turn and that of a drive."""
LEAST_STEPS: Final = 3
"""Fewest steps of a drive before a turn away from a wall."""
COURSE_STEPS: Final = 4
"""Steps from which a course is computed."""
LONGEST_GAP_S: Final = 0.5
LONGEST_TURN_S: Final = 3.2
FAR_M: Final = 0.12
"""Turns at the ends of legs count only farther from walls than this."""
LEAST_TURN: Final = np.radians(15.0)
"""Smaller turns cannot be distinguished from veer."""

APPROACHES: Final = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "distance_m": pl.Float64,
    "incidence_rad": pl.Float64,
    "nearest_robot_m": pl.Float64,
}
TURNS: Final = {"run": pl.UInt32, "robot": pl.UInt16, "turned_rad": pl.Float64}


@dataclass(frozen=True)
class _Path:
    time_s: Floats
    x_m: Floats
    y_m: Floats
    driving: NDArray[np.bool_]
    """Of each step."""


def approach_tables(result: Result, samples: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return turns away from walls (``APPROACHES``) and at the ends of legs (``TURNS``); both empty without paths.

    Args:
        samples: ``features.sample_table``.
    """
    size = (result.scenario.arena.width_m, result.scenario.arena.height_m)
    approaches: list[tuple[int, int, float, float, float]] = []
    turns: list[tuple[int, int, float]] = []
    for (run,), of_run in samples.group_by("run", maintain_order=True):
        robots = [int(robot) for robot in of_run["robot"].unique(maintain_order=True)]
        paths = {robot: _path(result, int(run), robot) for robot in robots}
        for robot in robots:
            path = paths[robot]
            if path is None:
                continue
            others = [other for name, other in paths.items() if name != robot and other is not None]
            own = of_run.filter(pl.col("robot") == robot).select("time_s", "avoid_s").to_numpy()
            approaches += [(int(run), robot, *approach) for approach in _approaches(path, own, others, size)]
            turns += [(int(run), robot, turn_rad) for turn_rad in _leg_turns(path, own, size)]
    return (
        pl.DataFrame(approaches, schema=APPROACHES, orient="row"),
        pl.DataFrame(turns, schema=TURNS, orient="row"),
    )


def _path(result: Result, run: int, robot: int) -> _Path | None:
    """Return a robot's path with its driving steps; None if it is unknown or too short."""
    track = track_of(result, run, robot)
    if track is None or len(track) < 100:
        return None
    time, x, y = track.T
    span = np.maximum(np.diff(time), 1e-6)
    speed = np.hypot(np.diff(x), np.diff(y)) / span
    moving = speed[speed > 0.02]
    usual = float(np.median(moving)) if moving.size else 0.0
    return _Path(time, x, y, (speed > DRIVES * usual) & (span < LONGEST_GAP_S))


def _approaches(
    path: _Path, samples: Floats, others: list[_Path], size: tuple[float, float]
) -> list[tuple[float, float, float]]:
    """Return the distance, m, and incidence, rad, of each turn away from a wall, and the distance of the nearest robot.

    Without other robots that distance is inf.

    Args:
        samples: (samples, 2): time, and avoidance since the sample before, s.
    """
    approaches = []
    for before, (until_s, avoid_s) in zip(samples[:-1, 0], samples[1:], strict=True):
        if not avoid_s > 1e-9:
            continue
        first, last = np.searchsorted(path.time_s, [before - 0.3, until_s - 0.9])
        place = _first_turn(path, int(first), int(last))
        if place is None:
            continue
        at, x, y, course = place
        distances_m = [
            float(
                np.hypot(
                    np.interp(at, other_path.time_s, other_path.x_m) - x,
                    np.interp(at, other_path.time_s, other_path.y_m) - y,
                )
            )
            for other_path in others
        ]
        distance, incidence = _to_wall(x, y, course, size)
        approaches.append((distance, incidence, min(distances_m, default=np.inf)))
    return approaches


def _first_turn(path: _Path, first: int, last: int) -> tuple[float, float, float, float] | None:
    """Return the time, position and course of the first standstill after a drive among the positions first..last-1.

    None if there is no such standstill, the drive before it is too short, or the path has a gap.
    """
    driving = path.driving[first : max(last - 1, first)]
    starts = np.flatnonzero(driving)
    if last - first < 6 or starts.size == 0 or np.diff(path.time_s[first:last]).max() > LONGEST_GAP_S:
        return None
    begin = int(starts[0])
    stops = np.flatnonzero(~driving[begin:])
    if stops.size == 0 or stops[0] < LEAST_STEPS:
        return None
    end = begin + int(stops[0])
    again = np.flatnonzero(driving[end:])
    over = end + int(again[0]) if again.size else driving.size
    x, y = path.x_m[first:last], path.y_m[first:last]
    back = max(begin, end - COURSE_STEPS)
    course = float(np.arctan2(y[end - 1] - y[back], x[end - 1] - x[back]))
    still = slice(end + 1, over + 1)
    return (
        float(path.time_s[first + end]), float(np.median(x[still])), float(np.median(y[still])), course,
    )  # fmt: skip


def _to_wall(x: float, y: float, course: float, size: tuple[float, float]) -> tuple[float, float]:
    """Return the distance to the nearest wall that the robot does not move away from, and the incidence on it."""
    distances = np.array([x, size[0] - x, y, size[1] - y])
    normals = np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2])
    incidences = _wrapped(course - normals)
    ahead = np.flatnonzero(np.abs(incidences) < np.radians(107.0))
    wall = ahead[np.argmin(distances[ahead])]
    return float(distances[wall]), float(incidences[wall])


def _leg_turns(path: _Path, samples: Floats, size: tuple[float, float]) -> list[float]:
    """Return the turns between two drives, rad, far from walls and without avoidance nearby.

    Args:
        samples: (samples, 2): time, and avoidance since the sample before, s.
    """
    steps = np.flatnonzero(np.diff(np.r_[0, path.driving.astype(np.int8), 0]))
    drives = [(a, b) for a, b in zip(steps[::2], steps[1::2], strict=True) if b - a >= COURSE_STEPS]
    turns_rad = []
    for (before, stop), (start, after) in pairwise(drives):
        x, y = path.x_m[stop], path.y_m[stop]
        if (
            path.time_s[start] - path.time_s[stop] > LONGEST_TURN_S
            or min(x, size[0] - x, y, size[1] - y) < FAR_M
        ):
            continue
        nearby = (samples[:, 0] > path.time_s[stop]) & (samples[:, 0] < path.time_s[start] + 3.0)
        if np.nansum(samples[nearby, 1][:2]) > 1e-9:
            continue
        turned = _course(path, start, after, 0) - _course(path, before, stop, -1)
        angle = float(_wrapped(np.array([turned]))[0])
        if abs(angle) > LEAST_TURN:
            turns_rad.append(angle)
    return turns_rad


def _course(path: _Path, first: int, last: int, end: int) -> float:
    """Return the course at the beginning (0) or the end (-1) of a drive, from its first or last five steps."""
    some = slice(first, min(last, first + 5) + 1) if end == 0 else slice(max(first, last - 5), last + 1)
    courses = np.unwrap(np.arctan2(np.diff(path.y_m[some]), np.diff(path.x_m[some])))
    bend = (courses[-1] - courses[0]) / (courses.size - 1)
    return float(courses[end] + (0.5 if end else -0.5) * bend)


def _wrapped(angle: Floats) -> Floats:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
