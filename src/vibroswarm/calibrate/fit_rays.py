"""Fit the angles of the rays and their start ahead of the centre, from where robots turned away from walls.

A ray is the line along which a distance sensor looks; its length is the distance to the first obstacle. A robot that
approaches a wall at incidence i (its course minus the wall's outward normal: 0 head-on, positive with the wall to the
right) turns when one of its rays is shorter than theta_c. Its distance from the wall is then

    d(i) = F cos i + max over rays of (R cos b_k cos i - (s_k + R sin b_k) sin i)

with R = theta_c (the value that the robots were programmed with), b_k and s_k the angle (anticlockwise positive) and
the lateral offset (to the left positive) of ray k, and F how far ahead of the robot's centre its rays start
(``rays.forward_each_m``). For given angles, the F of least absolute error is a weighted median. The outermost angle is
found on a grid; the ratios between the rays' angles are those of the base scenario.

Turns are found on the paths between samples, as a camera sees them (``dataset.track_of``). A robot drives in the steps
whose speed exceeds ``DRIVES`` times its usual speed; the others are a standstill. In an interval with avoidance, the
first standstill after a drive is the turn away from a wall; its position is the median of the positions until the robot
moves again, its course that of the drive's last steps.

Turns at the end of a leg (a straight walk) are uniform up to a largest angle A, of which robots leave out the tolerance
T (``walk.turn_tolerance_deg``). Those beyond a_0 (``LEAST_TURN``) have the mean (a_0 + A - T) / 2, so A is estimated by
2 mean - a_0 + T.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.calibrate.dataset import Dataset, track_of
from vibroswarm.calibrate.samples import ROUNDING_S, wall_distance
from vibroswarm.core.arrays import Bools, Floats, Ints, wrapped
from vibroswarm.recordings.assemble_recording import STANDING_M
from vibroswarm.scenario.scenario import Scenario

GRID_DEG: Final = np.arange(5.0, 76.0, 1.0)
"""Outermost angles that are tried first."""
DRIVES: Final = 0.62
"""Share of the usual speed above which a step is driving: between the speeds seen in turns and in drives."""
COURSE_STEPS: Final = 4
"""Most steps at the end of a drive that determine the course; the very last one is left out."""
LONGEST_GAP_S: Final = 0.5
"""Longest time between two positions of a path without a gap."""
LEAST_TURN: Final = np.radians(15.0)
"""Smaller turns at the ends of legs cannot be distinguished from veer."""


class Path(NamedTuple):
    """A robot's path in one run, with what it did."""

    run: int
    robot: int
    samples: pl.DataFrame
    track: Floats
    """Time, s, x and y, m, by position."""
    driving: Bools
    """Whether the robot drives in each step, (positions - 1,)."""
    bend_per_m: float
    """Usual change of the course per distance driven."""


def fit_rays(found: Dataset, base: Scenario) -> dict[str, object]:
    """Fit the angles and starts of the rays, and the largest turn at the end of a leg; return the scenario's fields.

    A robot's number is taken to mean the same sensors in all sessions. (In the study's recordings the starts of the
    rays belong to the number, but speed and veer do not, so ``fit_drive`` matches robots instead.) The rays are left
    out if a robot has fewer than 20 approaches, the largest turn with fewer than 30 turns.
    """
    paths = paths_of(found)
    robot, distance_m, incidence_rad = approaches_of(paths, found, base)
    robots = int(found.samples["robot"].max() or 0) + 1  # type: ignore[arg-type]  # to polars these may be of dates
    fields: dict[str, object] = {"rays.forward_each_m": None}
    if np.bincount(robot, minlength=robots).min() >= 20:

        def best_of(angles_deg: Floats) -> tuple[float, Floats]:
            """Return the angle of smallest error, and F of each robot at this angle."""
            fits = [
                _fit_forward(robot, distance_m, incidence_rad, base, angle_deg)
                for angle_deg in angles_deg.tolist()
            ]
            best = int(np.argmin([error for _, error in fits]))
            return float(angles_deg[best]), fits[best][0]

        nearly_deg = best_of(GRID_DEG)[0]
        # In whole degrees alone, an angle is up to half a degree off.
        ray_deg, forward_m = best_of(
            np.clip(nearly_deg + np.arange(-1.0, 1.05, 0.1), GRID_DEG[0], GRID_DEG[-1])
        )
        fields["rays.angle_deg"] = scaled_angles(base, ray_deg)
        fields["rays.forward_m"] = round(float(forward_m.mean()), 4)
        fields["rays.forward_each_m"] = [round(float(forward), 4) for forward in forward_m]
    turned = np.abs([turn for path in paths for turn in _leg_turns(path, found.arena_m)])
    if turned.size >= 30:
        # Twice a_0 at least: with a smaller largest turn fewer than half of the turns would be observed.
        largest = 2 * turned.mean() - LEAST_TURN + np.radians(base.walk.turn_tolerance_deg)
        fields["walk.turn_max_deg"] = round(float(np.degrees(np.clip(largest, 2 * LEAST_TURN, np.pi))), 1)
    return fields


def scaled_angles(base: Scenario, ray_deg: float) -> list[float]:
    """Return the angles of the base's rays, deg, multiplied by one factor so that the largest is ``ray_deg``."""
    # If all rays point straight ahead, all angles are 0 and stay 0; 1.0 avoids a division by 0.
    largest = max(abs(angle_deg) for angle_deg in base.rays.angle_deg) or 1.0
    return [round(angle_deg / largest * ray_deg, 2) for angle_deg in base.rays.angle_deg]


def _fit_forward(
    robot: Ints, distance: Floats, incidence: Floats, base: Scenario, ray_deg: float
) -> tuple[Floats, float]:
    """Return F of each robot, m, (robots,), given the outermost angle; and the mean absolute error of distances, m.

    Let M be the maximum over rays in the equation of d(i). The errors |d - M - F cos i| are smallest in total if F is
    the median of (d - M) / cos i with the weights cos i.
    """
    reach = base.walk.avoidance_threshold_mm / 1000.0  # R = theta_c, m
    angle = np.radians(scaled_angles(base, ray_deg))[:, None]
    side = np.array(base.rays.side_m)[:, None]
    rays = reach * np.cos(angle) * np.cos(incidence) - (side + reach * np.sin(angle)) * np.sin(incidence)
    rest, weight = distance - rays.max(axis=0), np.maximum(np.cos(incidence), 1e-3)  # d - M; cos i, above 0
    medians = [
        np.quantile(rest[own] / weight[own], 0.5, weights=weight[own], method="inverted_cdf")
        for own in (robot == number for number in range(int(robot.max()) + 1))
    ]
    # Between 0 and 0.5 m, far more than the size of a robot.
    forward = np.clip(medians, 0.0, 0.5)
    # A turn at a distance with an error above 3 cm had another cause than the wall.
    return forward, float(np.minimum(np.abs(rest - forward[robot] * weight), 0.03).mean())


def paths_of(found: Dataset) -> list[Path]:
    """Return the paths of all robots in all sessions, by session and robot; of 100 positions (22 s) or more."""
    runs = [(result, int(run)) for result in found.results for run in result.runs["run"].to_list()]
    paths = []
    for (session, robot), own in found.samples.group_by("run", "robot", maintain_order=True):
        track = track_of(*runs[int(session)], int(robot))
        if track is not None and len(track) >= 100:
            paths.append(Path(int(session), int(robot), own, track, *_driving(track)))
    return paths


def approaches_of(paths: Sequence[Path], found: Dataset, base: Scenario) -> tuple[Ints, Floats, Floats]:
    """Return robot, distance (m) and incidence (rad) of the turns away from walls of robots that were alone."""
    rows = []
    for path in paths:
        others = [other.track for other in paths if other.run == path.run and other.robot != path.robot]
        avoided = path.samples.filter(pl.col("avoid_s") > ROUNDING_S)
        for end_s, spacing_s in avoided.select("time_s", "spacing_s").iter_rows():
            # From the last 0.3 s of the stop for the previous sample, so that the whole drive is included, to about the
            # beginning of the stop (1 s) for this sample.
            first, last = np.searchsorted(path.track[:, 0], [end_s - spacing_s - 0.3, end_s - 0.9])
            driving = path.driving[first : max(last - 1, first)]
            turn = _first_turn(path.track[first:last], driving, path.bend_per_m)
            # If another robot was within 20 cm, the robot may have avoided it instead of the wall.
            if turn is not None and min((_apart_m(other, turn) for other in others), default=math.inf) > 0.2:
                rows.append((path.robot, *_to_wall(*turn[1:], found.arena_m)))
    robot, distance, incidence = np.array(rows).reshape(-1, 3).T
    # A robot farther from the wall than 20 cm did not turn because of it, and one beyond 90 degrees does not approach
    # it; 5 degrees more allow for errors of courses.
    near = (distance < 0.2) & (np.abs(incidence) < np.radians(95.0))
    # A ray is read once a control period: robots drive on for half of one, in the mean, before they turn.
    speed_m_s = float(found.drives["speed_m_s"].mean() or 0.0)  # type: ignore[arg-type]  # to polars these may be of dates
    late_m = 0.5 * speed_m_s * base.run.control_period_ms / 1000.0 * np.cos(incidence)
    return robot[near].astype(np.int64), (distance + late_m)[near], incidence[near]


def _apart_m(track: Floats, turn: tuple[float, float, float, float]) -> float:
    x, y = (np.interp(turn[0], track[:, 0], track[:, axis]) for axis in (1, 2))
    return math.hypot(x - turn[1], y - turn[2])


def _leg_turns(path: Path, size: tuple[float, float]) -> Iterator[float]:
    """Yield the turns at the ends of legs, rad: turns between two drives, far from walls and without avoidance."""
    sample_s, avoid_s = path.samples.select("time_s", "avoid_s").to_numpy().T
    time, x, y = path.track.T
    # Positions at which drives begin and end, alternately.
    limits = np.flatnonzero(np.diff(np.r_[0, path.driving.astype(np.int8), 0]))
    drives = [(a, b) for a, b in zip(limits[::2], limits[1::2], strict=True) if b - a >= COURSE_STEPS]
    for (before, stop), (start, after) in pairwise(drives):
        is_later = sample_s > time[stop]
        # A robot that stands for a sample seldom turns too; times in a log are late by 0.25 s at most. Avoidance is
        # known per interval between samples, so a turn may be avoidance if there is any before one of the first two
        # samples up to 3 s after its end.
        sampled = (is_later & (sample_s < time[start] + 0.25)).any()
        avoided = np.nansum(avoid_s[is_later & (sample_s < time[start] + 3.0)][:2]) > ROUNDING_S
        is_near = wall_distance(x[stop], y[stop], size) < 0.12
        is_turn = time[start] - time[stop] <= 3.2 and not is_near and not sampled and not avoided
        turned = _course(x, y, start, after, 0) - _course(x, y, before, stop, -1)
        angle = float(wrapped(np.array(turned)))
        if is_turn and abs(angle) > LEAST_TURN:
            yield angle


def _course(x: Floats, y: Floats, first: int, last: int, end: int) -> float:
    """Return the course (rad) at the beginning (0) or end (-1) of a drive, from the five steps next to it.

    The course of the outermost step is that in its middle, and is extrapolated by half a step.
    """
    part = slice(first, min(last, first + 5) + 1) if end == 0 else slice(max(first, last - 5), last + 1)
    courses = np.unwrap(np.arctan2(np.diff(y[part]), np.diff(x[part])))
    change_per_step = (courses[-1] - courses[0]) / (courses.size - 1)
    return float(courses[end] + (0.5 if end else -0.5) * change_per_step)


def _driving(track: Floats) -> tuple[Bools, float]:
    """Return whether the robot drives in each step, and its usual change of the course per distance, 1/m."""
    time, x, y = track.T
    step_s, step_m = np.maximum(np.diff(time), 1e-6), np.hypot(np.diff(x), np.diff(y))
    speed = step_m / step_s
    moving = speed[speed > 0.02]  # m/s; slower steps are standstills
    usual = float(np.median(moving)) if moving.size else 0.0
    driving = (speed > DRIVES * usual) & (step_s < LONGEST_GAP_S)
    # The robot starts or stops in the first and last step of a drive, so neither of two steps is one of these.
    amid = np.flatnonzero(driving[:-3] & driving[1:-2] & driving[2:-1] & driving[3:]) + 1
    if not amid.size:
        return driving, 0.0
    course = np.arctan2(np.diff(y), np.diff(x))
    between_m = (step_m[amid] + step_m[amid + 1]) / 2  # from the middle of a step to that of the next
    return driving, float(np.median(wrapped(course[amid + 1] - course[amid]) / between_m))


def _first_turn(path: Floats, driving: Bools, bend_per_m: float) -> tuple[float, float, float, float] | None:
    """Return the first standstill after a drive: its time (s), its x and y (m), and the course before it (rad).

    None if there is no such standstill, if the drive before it is too short, or if the path has a gap.
    """
    changes = np.flatnonzero(
        np.diff(np.r_[False, driving, False])
    )  # steps at which drives begin and end, alternately
    if len(path) < 6 or changes.size == 0 or np.diff(path[:, 0]).max() > LONGEST_GAP_S:
        return None
    # Step k leads from position k to position k + 1. The standstill is from ``end`` to before ``over``.
    begin, end, over = (*changes[:3].tolist(), driving.size)[:3]
    if end == driving.size or end - begin < 3:
        return None
    time, x, y = path.T
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
    return float(time[end]), at_x, at_y, course + bend_per_m * driven_m


def _to_wall(x: float, y: float, course: float, size: tuple[float, float]) -> tuple[float, float]:
    """Return the distance (m) and incidence (rad) of the nearest wall that the robot does not move away from.

    It moves away if its course is more than 107 degrees from the outward normal, as measured courses have errors.
    """
    distances = np.array([x, size[0] - x, y, size[1] - y])  # left, right, bottom, top
    incidences = wrapped(course - np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2]))
    ahead = np.flatnonzero(np.abs(incidences) < np.radians(107.0))
    wall = ahead[np.argmin(distances[ahead])]
    return float(distances[wall]), float(incidences[wall])
