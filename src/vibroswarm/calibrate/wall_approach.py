"""Detect where robots turn away from walls, and how far they turn at the ends of legs, from the paths between samples.

| name | symbol | unit | equation |
|---|---|---|---|
| distance | d | m | from the position at which a robot turned to the wall it approached |
| incidence | i | rad | course minus the wall's outward normal: 0 head-on, positive with the wall to the right |
| turned | - | rad | course after a turn minus course before it, in [-pi, pi) |

A path is a sequence of positions as a camera sees them (``drive.track_of``); a step leads from one position to the
next. A robot drives in the steps whose speed exceeds ``DRIVES`` times its usual speed; the other steps are a
standstill, in which the robot stops or turns on the spot. A turn away from a wall is found in an interval (between two
samples) with avoidance: it is the first standstill after a drive. Its position is the median of the positions until the
robot moves again; its course is that of the drive's last steps, carried on with the usual bend of the robot. A leg is a
straight walk, which ends with a turn on the spot by a random angle.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.drive import track_of
from vibroswarm.core.angles import wrapped
from vibroswarm.core.arrays import Bools, Floats
from vibroswarm.recordings.assemble_recording import STANDING_M
from vibroswarm.result import Result

DRIVES: Final = 0.62
"""Share of the usual speed above which a step is driving: between the speeds seen in turns and in drives."""
LEAST_STEPS: Final = 3
"""Fewest steps of a drive before a turn away from a wall."""
COURSE_STEPS: Final = 4
"""Most steps at the end of a drive that determine the course before a turn away from a wall; the very last of these
steps is left out. A drive before or after a turn at the end of a leg has at least this many steps."""
LONGEST_GAP_S: Final = 0.5
"""Longest time between two positions of a path without a gap."""
LATE_S: Final = 0.25
"""Times of samples in a log are late by this at most."""
LONGEST_TURN_S: Final = 3.2
"""Longest standstill that is a turn at the end of a leg."""
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
"""Columns of the table of turns away from walls: distance and incidence as above, and the distance of the nearest other
robot at that time."""
TURNS: Final = {"run": pl.UInt32, "robot": pl.UInt16, "turned_rad": pl.Float64}
"""Columns of the table of turns at the ends of legs; turned_rad is the angle of the turn."""


@dataclass(frozen=True)
class _Path:
    """A robot's path in one run: time (s), x and y (m) of each position, (positions,) each."""

    time_s: Floats
    """Time of each position."""
    x_m: Floats
    """x of each position."""
    y_m: Floats
    """y of each position."""
    driving: Bools
    """Whether the robot drives in each step, (positions - 1,)."""
    bend_per_m: float
    """Usual change of the course per distance driven."""


def approach_tables(result: Result, samples: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the turns away from walls (table ``APPROACHES``) and the turns at the ends of legs (table ``TURNS``).

    Robots without a path are left out. Rows are ordered by run, robot and time.

    Args:
        samples: table ``features.sample_table`` of the result.
    """
    size = result.scenario.arena.size_m
    approaches: list[tuple[int, int, float, float, float]] = []
    turns: list[tuple[int, int, float]] = []
    for (run,), of_run in samples.group_by("run", maintain_order=True):
        robots = [int(robot) for robot in of_run["robot"].unique(maintain_order=True)]
        paths = {robot: _path(result, int(run), robot) for robot in robots}
        for robot in robots:
            path = paths[robot]
            if path is None:
                continue
            others = [other for number, other in paths.items() if number != robot and other is not None]
            own = of_run.filter(pl.col("robot") == robot).select("time_s", "avoid_s").to_numpy()
            approaches += [(int(run), robot, *approach) for approach in _approaches(path, own, others, size)]
            turns += [(int(run), robot, turn_rad) for turn_rad in _leg_turns(path, own, size)]
    return (
        pl.DataFrame(approaches, schema=APPROACHES, orient="row"),
        pl.DataFrame(turns, schema=TURNS, orient="row"),
    )


def _path(result: Result, run: int, robot: int) -> _Path | None:
    """Return a robot's path with its driving steps; None if it is unknown or has fewer than 100 positions.

    (The camera of the study sees a robot 100 times in 22 s or more.) A step across a gap of the path does not count as
    driving.
    """
    track = track_of(result, run, robot)
    if track is None or len(track) < 100:
        return None
    time, x, y = track.T
    step_s = np.maximum(np.diff(time), 1e-6)  # above 0 also where two positions have the same time
    step_m = np.hypot(np.diff(x), np.diff(y))
    speed = step_m / step_s
    moving = speed[speed > 0.02]  # m/s; slower steps are standstills
    usual = float(np.median(moving)) if moving.size else 0.0
    driving = (speed > DRIVES * usual) & (step_s < LONGEST_GAP_S)
    return _Path(time, x, y, driving, _bend_per_m(x, y, step_m, driving))


def _bend_per_m(x: Floats, y: Floats, step_m: Floats, driving: Bools) -> float:
    """Return the median change of the course per distance, 1/m, from step to step amid drives; 0 without such steps.

    Args:
        x, y: positions, m, (positions,). step_m, driving: length of each step, and whether the robot drives in it,
            (positions - 1,).
    """
    # The robot starts or stops in the first and last step of a drive, so neither of two steps is one of these.
    amid = np.flatnonzero(driving[:-3] & driving[1:-2] & driving[2:-1] & driving[3:]) + 1
    if not amid.size:
        return 0.0
    course = np.arctan2(np.diff(y), np.diff(x))
    between_m = (step_m[amid] + step_m[amid + 1]) / 2  # from the middle of a step to that of the next
    return float(np.median(wrapped(course[amid + 1] - course[amid]) / between_m))


def _approaches(
    path: _Path, samples: Floats, others: list[_Path], size: tuple[float, float]
) -> Iterator[tuple[float, float, float]]:
    """Yield the turns away from walls: distance from the wall (m), incidence (rad), distance of the nearest robot (m).

    The distance of the nearest robot is infinite without other robots.

    Args:
        path: the robot's path. others: paths of the other robots.
        samples: time of each sample, and time spent avoiding since the previous sample, s, (samples, 2).
        size: width and height of the arena, m.
    """
    # Each interval: the time of its previous sample; the time of its sample, and the time spent avoiding in between.
    for previous_s, (sample_s, avoid_s) in zip(samples[:-1, 0], samples[1:], strict=True):
        if not avoid_s > 1e-9:  # also if it is NaN
            continue
        # From the last 0.3 s of the stop for the previous sample, so that the whole drive is included, to about the
        # beginning of the stop (1 s) for this sample.
        first, last = np.searchsorted(path.time_s, [previous_s - 0.3, sample_s - 0.9])
        turn = _first_turn(path, int(first), int(last))
        if turn is None:
            continue
        turn_s, x, y, course = turn
        distances_m = [
            float(
                np.hypot(
                    np.interp(turn_s, other_path.time_s, other_path.x_m) - x,
                    np.interp(turn_s, other_path.time_s, other_path.y_m) - y,
                )
            )
            for other_path in others
        ]
        distance, incidence = _to_wall(x, y, course, size)
        yield (distance, incidence, min(distances_m, default=np.inf))


def _first_turn(path: _Path, first: int, last: int) -> tuple[float, float, float, float] | None:
    """Return the first standstill after a drive: its time (s), its x and y (m), and the course before it (rad).

    None if there is no such standstill, if the drive before it is too short, or if the path has a gap.

    Args:
        first, last: the positions of the path from ``first`` to ``last`` - 1 are searched.
    """
    # All indices below count steps or positions from ``first``; step k leads from position k to position k + 1.
    driving = path.driving[first : max(last - 1, first)]  # one step fewer than positions
    starts = np.flatnonzero(driving)
    # Fewer than six positions are too short for a drive and a standstill.
    if last - first < 6 or starts.size == 0 or np.diff(path.time_s[first:last]).max() > LONGEST_GAP_S:
        return None
    begin = int(starts[0])  # first step of the drive
    stops = np.flatnonzero(~driving[begin:])
    if stops.size == 0 or stops[0] < LEAST_STEPS:
        return None
    end = begin + int(stops[0])  # first step of the standstill
    later_drive = np.flatnonzero(driving[end:])
    over = end + int(later_drive[0]) if later_drive.size else driving.size  # first step after the standstill
    x, y = path.x_m[first:last], path.y_m[first:last]
    # Positions during the standstill, without the one at its beginning: in the next step the robot may still brake.
    # Those after it moved again are left out: it then turned twice, and drove a little in between.
    moved = np.hypot(x[end + 2 : over + 1] - x[end + 1], y[end + 2 : over + 1] - y[end + 1]) > STANDING_M
    still = slice(end + 1, end + 2 + int(np.argmax(np.append(moved, True))))
    at_x, at_y = float(np.median(x[still])), float(np.median(y[still]))
    # The direction from position ``back`` to position ``end`` - 1 leaves out the last step of the drive, in which the
    # robot may begin to stop. It is the course midway between the two; the robot veers from there to the standstill.
    back = max(begin, end - COURSE_STEPS)
    course = float(np.arctan2(y[end - 1] - y[back], x[end - 1] - x[back]))
    driven_m = float(np.hypot(at_x - (x[back] + x[end - 1]) / 2, at_y - (y[back] + y[end - 1]) / 2))
    return float(path.time_s[first + end]), at_x, at_y, course + path.bend_per_m * driven_m


def _to_wall(x: float, y: float, course: float, size: tuple[float, float]) -> tuple[float, float]:
    """Return the distance (m) and incidence (rad) of the nearest wall that the robot does not move away from.

    A robot moves away from a wall if its course is more than 107 degrees from the wall's outward normal: somewhat more
    than a right angle, because measured courses have errors. There is always a wall ahead, because the four normals
    point in all four directions.

    Args:
        x, y: position of the robot, m. course: direction in which it drove, rad.
        size: width and height of the arena, m.
    """
    distances = np.array([x, size[0] - x, y, size[1] - y])  # left, right, bottom, top
    normals = np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2])  # directions of the outward normals
    incidences = wrapped(course - normals)
    ahead = np.flatnonzero(np.abs(incidences) < np.radians(107.0))
    wall = ahead[np.argmin(distances[ahead])]
    return float(distances[wall]), float(incidences[wall])


def _leg_turns(path: _Path, samples: Floats, size: tuple[float, float]) -> Iterator[float]:
    """Yield the turns at the ends of legs, rad: turns between two drives, far from walls and without avoidance.

    Drives of fewer than ``COURSE_STEPS`` steps are ignored. Turns below ``LEAST_TURN`` are left out, because they
    cannot be distinguished from veer.

    Args:
        path: the robot's path.
        samples: time of each sample, and time spent avoiding since the previous sample, s, (samples, 2).
        size: width and height of the arena, m.
    """
    # Positions at which drives begin and end, alternately.
    limits = np.flatnonzero(np.diff(np.r_[0, path.driving.astype(np.int8), 0]))
    drives = [(a, b) for a, b in zip(limits[::2], limits[1::2], strict=True) if b - a >= COURSE_STEPS]
    for (before, stop), (start, after) in pairwise(drives):
        x, y = path.x_m[stop], path.y_m[stop]
        if (
            path.time_s[start] - path.time_s[stop] > LONGEST_TURN_S
            or min(x, size[0] - x, y, size[1] - y) < FAR_M
        ):
            continue
        # A robot that stands for a sample seldom turns too, but its course seems to change if positions are not exact.
        # Times of samples may be late.
        if ((samples[:, 0] > path.time_s[stop]) & (samples[:, 0] < path.time_s[start] + LATE_S)).any():
            continue
        # Avoidance is known per interval between samples, so this turn may be avoidance if there is any in the interval
        # before one of the first two samples that follow its beginning, up to 3 s after its end. Without such a sample
        # the turn counts: a turn at the end of a leg usually restarts the timer of the samples (``sample.timer``), so
        # that the next sample follows more than 3 s later.
        soon = (samples[:, 0] > path.time_s[stop]) & (samples[:, 0] < path.time_s[start] + 3.0)
        if np.nansum(samples[soon, 1][:2]) > 1e-9:
            continue
        turned = _course(path, start, after, 0) - _course(path, before, stop, -1)
        angle = float(wrapped(np.array([turned]))[0])
        if abs(angle) > LEAST_TURN:
            yield angle


def _course(path: _Path, first: int, last: int, end: int) -> float:
    """Return the course (rad) at one end of a drive, from the (at most) five steps next to this end.

    The course of the outermost step is the course in the middle of the step. It is extrapolated by half a step, to the
    end of the drive.

    Args:
        first, last: indices of the positions at the beginning and at the end of the drive, which has at least
            ``COURSE_STEPS`` steps.
        end: 0: return the course at the beginning; -1: return the course at the end. It is also the index of the
            outermost step among the steps that are used.
    """
    some = slice(first, min(last, first + 5) + 1) if end == 0 else slice(max(first, last - 5), last + 1)
    courses = np.unwrap(np.arctan2(np.diff(path.y_m[some]), np.diff(path.x_m[some])))
    change_per_step = (courses[-1] - courses[0]) / (courses.size - 1)
    return float(courses[end] + (0.5 if end else -0.5) * change_per_step)
