"""Fit the angles of the rays and their start ahead of the centre, from where robots turned away from walls.

A ray is the line along which a distance sensor looks; its length is the distance to the first obstacle. A robot that
approaches a wall at incidence i (its course minus the wall's outward normal: 0 head-on, positive with the wall to the
right) turns when one of its rays is shorter than theta_c. Its distance from the wall is then

    d(i) = F cos i + max over rays of (R cos b_k cos i - (s_k + R sin b_k) sin i)

with R = theta_c (the value that the robots were programmed with), b_k and s_k the angle (anticlockwise positive) and
the lateral offset (to the left positive) of ray k, and F how far ahead of the robot's centre its rays start
(``rays.forward_each_m``). For given angles, the F of least absolute error is a weighted median. The outermost angle is
found on a grid; the ratios between the rays' angles are those of the base scenario.

Turns are found on the paths between samples, as a camera sees them (``drive.track_of``). A robot drives in the steps
whose speed exceeds ``DRIVES`` times its usual speed; the others are a standstill. In an interval with avoidance, the
first standstill after a drive is the turn away from a wall; its position is the median of the positions until the robot
moves again, its course that of the drive's last steps.

Turns at the end of a leg (a straight walk) are uniform up to a largest angle A, of which robots leave out the tolerance
T (``walk.turn_tolerance_deg``). Those beyond a_0 (``LEAST_TURN``) have the mean (a_0 + A - T) / 2, so A is estimated by
2 mean - a_0 + T.

Standard errors are of bootstraps: of the approaches of each robot for the rays, of all turns for A. Limits of how far
robots differ hold for other robots too: chi-square of so many robots.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats, Ints, wrapped
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.lab.calibrate.dataset import Dataset
from vibroswarm.lab.calibrate.drive import track_of
from vibroswarm.lab.calibrate.few_groups import drawn_variances, evenly_drawn
from vibroswarm.lab.calibrate.samples import ROUNDING_S, wall_distance
from vibroswarm.lab.recordings.assemble_recording import STANDING_M
from vibroswarm.scenario.scenario import Scenario

LEAST_APPROACHES: Final = 20
"""Fewest approaches of each robot."""
ALONE_M: Final = 0.2
"""If another robot was closer, the robot may have avoided it instead of the wall."""
MOST_M: Final = 0.2
"""A robot farther from the wall did not turn because of it."""
GRID_DEG: Final = np.arange(5.0, 76.0, 1.0)
"""Outermost angles that are tried first."""
NEAR_DEG: Final = np.arange(-1.0, 1.05, 0.1)
"""Differences of those that are tried next from the best one. In whole degrees alone, an angle is off by more than its
limits allow."""
CLIP_M: Final = 0.03
"""Errors are clipped to this: a turn at a distance with a larger error had another cause than the wall."""
DRIVES: Final = 0.62
"""Share of the usual speed above which a step is driving: between the speeds seen in turns and in drives."""
LEAST_STEPS: Final = 3
"""Fewest steps of a drive before a turn away from a wall."""
COURSE_STEPS: Final = 4
"""Most steps at the end of a drive that determine the course; the very last one is left out."""
LONGEST_GAP_S: Final = 0.5
"""Longest time between two positions of a path without a gap."""
LEAST_TURNS: Final = 30
"""Fewest turns at the ends of legs, of all robots."""
LEAST_TURN: Final = np.radians(15.0)
"""Smaller turns at the ends of legs cannot be distinguished from veer."""
LONGEST_TURN_S: Final = 3.2
"""Longest standstill that is a turn at the end of a leg."""
FAR_M: Final = 0.12
"""Turns at the ends of legs count only farther from walls than this."""
LATE_S: Final = 0.25
"""Times of samples in a log are late by this at most."""
DRAWS: Final = 60
"""Bootstrap resamples."""
_SEED: Final = 35


@dataclass(frozen=True)
class RaysFit:
    """Estimates of the rays and of the largest turn, as far as the paths determine them."""

    values: dict[str, float]
    """Estimates by name: ray_deg (outermost angle), forward_m (mean F), forward_between_m (standard deviation of F
    between robots), turn_max_deg."""
    draws: dict[str, Floats]
    """Draws by the same names, (draws,) each."""
    forward_m: Floats
    """F of each robot, by its number; empty if undetermined."""

    def fields(self, base: Scenario) -> dict[str, object]:
        """Return the scenario's fields for these estimates, by dotted name; None: each robot has none of its own."""
        fields: dict[str, object] = {"rays.forward_each_m": None}
        if self.forward_m.size:
            fields["rays.angle_deg"] = scaled_angles(base, self.values["ray_deg"])
            fields["rays.forward_m"] = round(float(self.forward_m.mean()), 4)
            fields["rays.forward_each_m"] = [round(float(forward_m), 4) for forward_m in self.forward_m]
        if "turn_max_deg" in self.values:
            fields["walk.turn_max_deg"] = round(self.values["turn_max_deg"], 1)
        return fields


@dataclass(frozen=True, eq=False)
class Path:
    """A robot's path in one run, with what it did."""

    run: int
    robot: int
    track: Floats
    """Time, s, x and y, m, by position."""
    driving: Bools
    """Whether the robot drives in each step, (positions - 1,)."""
    bend_per_m: float
    """Usual change of the course per distance driven."""
    samples: pl.DataFrame


def fit_rays(found: Dataset, base: Scenario, draws: int = DRAWS) -> RaysFit:
    """Fit the angles and starts of the rays, and the largest turn at the end of a leg.

    A robot's number is taken to mean the same sensors in all sessions. (In the study's recordings the starts of the
    rays belong to the number, but speed and veer do not, so ``fit_drive`` matches robots instead.) The rays are left
    out if a robot has fewer than ``LEAST_APPROACHES`` approaches, the largest turn with fewer than ``LEAST_TURNS``.

    Args:
        found: sessions, with positions corrected for the camera.
        base: scenario with theta_c, the lateral offsets and the ratios of the rays' angles.
        draws: number of draws.
    """
    paths = paths_of(found)
    values, drawn, forward_m = _rays(found, approaches_of(paths, found.arena_m), base, draws)
    turned = np.abs([turn for path in paths for turn in _leg_turns(path, found.arena_m)])
    if turned.size >= LEAST_TURNS:
        u = uniforms(_SEED, run=0, robot=1, purpose=Purpose.BOOTSTRAP, count=draws * turned.size)
        picked = turned[(u * turned.size).astype(int)].reshape(draws, turned.size)
        # Twice a_0 at least: with a smaller largest turn fewer than half of the turns would be observed.
        tolerance = np.radians(base.walk.turn_tolerance_deg)
        values["turn_max_deg"], drawn["turn_max_deg"] = (
            np.degrees(np.clip(2 * mean - LEAST_TURN + tolerance, 2 * LEAST_TURN, np.pi))
            for mean in (turned.mean(), picked.mean(axis=1))
        )
    return RaysFit({name: float(value) for name, value in values.items()}, drawn, forward_m)


def _rays(
    found: Dataset, approaches: pl.DataFrame, base: Scenario, draws: int
) -> tuple[dict[str, float], dict[str, Floats], Floats]:
    """Return the estimates of the rays, their draws, and F of each robot."""
    robot = approaches["robot"].to_numpy().astype(np.int64)
    robots = int(found.samples["robot"].max() or 0) + 1  # type: ignore[arg-type]
    if not robot.size or np.bincount(robot, minlength=robots).min() < LEAST_APPROACHES:
        return {}, {}, np.zeros(0)
    incidence = approaches["incidence_rad"].to_numpy()
    # A ray is read once a control period: robots drive on for half of one, in the mean, before they turn.
    speed_m_s = float(found.drives["speed_m_s"].mean() or 0.0)  # type: ignore[arg-type]
    late_m = 0.5 * speed_m_s * base.run.control_period_ms / 1000.0 * np.cos(incidence)
    distance = approaches["distance_m"].to_numpy() + late_m
    ray_deg, forward_m = _fit(distance, incidence, robot, base)
    fits = [
        _fit(distance[rows], incidence[rows], robot[rows], base)
        for rows in (_resampled(robot, draw) for draw in range(draws))
    ]
    values = {"ray_deg": ray_deg, "forward_m": float(forward_m.mean())}
    drawn = {
        "ray_deg": np.array([angle_deg for angle_deg, _ in fits]),
        "forward_m": np.array([forward.mean() for _, forward in fits]),
    }
    if robots > 1:
        variance = float(forward_m.var(ddof=1))
        u = evenly_drawn(draws, _SEED, "forward_between_m")
        values["forward_between_m"] = math.sqrt(variance)
        drawn["forward_between_m"] = np.sqrt(drawn_variances(variance, robots - 1, u))
    return values, drawn, forward_m


def scaled_angles(base: Scenario, ray_deg: float) -> list[float]:
    """Return the angles of the base's rays, deg, multiplied by one factor so that the largest is ``ray_deg``."""
    # If all rays point straight ahead, all angles are 0 and stay 0; 1.0 avoids a division by 0.
    largest = max(abs(angle_deg) for angle_deg in base.rays.angle_deg) or 1.0
    return [round(angle_deg / largest * ray_deg, 2) for angle_deg in base.rays.angle_deg]


def _resampled(robot: Ints, draw: int) -> Ints:
    """Return the numbers of the rows in a bootstrap draw, (rows,): each row is replaced by a row of the same robot."""
    u = uniforms(_SEED, run=draw, robot=0, purpose=Purpose.BOOTSTRAP, count=robot.size)
    picked = np.empty(robot.size, dtype=np.int64)
    for number in np.unique(robot):
        own = np.flatnonzero(robot == number)
        picked[own] = own[(u[own] * own.size).astype(np.int64)]
    return picked


def _fit(distance: Floats, incidence: Floats, robot: Ints, base: Scenario) -> tuple[float, Floats]:
    """Return the outermost angle of smallest error, deg, and F of each robot at this angle, m, (robots,)."""

    def best_of(angles_deg: Floats) -> float:
        errors = [_fit_forward(distance, incidence, robot, base, angle)[1] for angle in angles_deg.tolist()]
        return float(angles_deg[int(np.argmin(errors))])

    best_deg = best_of(np.clip(best_of(GRID_DEG) + NEAR_DEG, GRID_DEG[0], GRID_DEG[-1]))
    return best_deg, _fit_forward(distance, incidence, robot, base, best_deg)[0]


def _fit_forward(
    distance: Floats, incidence: Floats, robot: Ints, base: Scenario, ray_deg: float
) -> tuple[Floats, float]:
    """Return F of each robot, m, (robots,), given the outermost angle; and the mean absolute error of distances, m.

    Let M be the maximum over rays in the equation of d(i). The errors |d - M - F cos i| are smallest in total if F is
    the median of (d - M) / cos i with the weights cos i. In the mean, errors above ``CLIP_M`` count as ``CLIP_M``.
    """
    reach = base.walk.avoidance_threshold_mm / 1000.0  # R = theta_c, m
    angle = np.radians(scaled_angles(base, ray_deg))[:, None]
    side = np.array(base.rays.side_m)[:, None]
    rays = reach * np.cos(angle) * np.cos(incidence) - (side + reach * np.sin(angle)) * np.sin(incidence)
    rest, weight = distance - rays.max(axis=0), np.maximum(np.cos(incidence), 1e-3)  # d - M; cos i, above 0
    own_rows = [robot == number for number in range(int(robot.max()) + 1)]
    # Between 0 and 0.5 m, far more than the size of a robot.
    forward = np.clip([_weighted_median(rest[own] / weight[own], weight[own]) for own in own_rows], 0.0, 0.5)
    error = np.abs(rest - forward[robot] * weight)
    return forward, float(np.minimum(error, CLIP_M).mean())


def _weighted_median(values: Floats, weights: Floats) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, 0.5 * total[-1])])


def paths_of(found: Dataset) -> list[Path]:
    """Return the paths of all robots in all sessions, by session and robot.

    Paths of fewer than 100 positions are left out; the camera of the study sees a robot so often in 22 s.
    """
    runs = [(result, int(run)) for result in found.results for run in result.runs["run"].to_list()]
    paths = []
    for (session, robot), own in found.samples.group_by("run", "robot", maintain_order=True):
        result, run = runs[int(session)]
        track = track_of(result, run, int(robot))
        if track is not None and len(track) >= 100:
            paths.append(Path(int(session), int(robot), track, *_driving(track), own))
    return paths


def approaches_of(paths: Sequence[Path], size: tuple[float, float]) -> pl.DataFrame:
    """Return the turns away from walls of robots that were alone: run, robot, distance_m and incidence_rad."""
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
            if turn is None:
                continue
            turn_s, x, y, course = turn
            apart_m = [
                math.hypot(
                    np.interp(turn_s, track[:, 0], track[:, 1]) - x,
                    np.interp(turn_s, track[:, 0], track[:, 2]) - y,
                )
                for track in others
            ]
            if min(apart_m, default=math.inf) > ALONE_M:
                rows.append((path.run, path.robot, *_to_wall(x, y, course, size)))
    schema = {"run": pl.UInt32, "robot": pl.UInt16, "distance_m": pl.Float64, "incidence_rad": pl.Float64}
    frame = pl.DataFrame(rows, schema=schema, orient="row")
    # A robot beyond 90 degrees does not approach the wall; 5 degrees more allow for errors of courses.
    near = (pl.col("distance_m") < MOST_M) & (pl.col("incidence_rad").abs() < np.radians(95.0))
    return frame.filter(near)


def _leg_turns(path: Path, size: tuple[float, float]) -> Iterator[float]:
    """Yield the turns at the ends of legs, rad: turns between two drives, far from walls and without avoidance."""
    samples = path.samples.select("time_s", "avoid_s").to_numpy()
    time, x, y = path.track.T
    # Positions at which drives begin and end, alternately.
    limits = np.flatnonzero(np.diff(np.r_[0, path.driving.astype(np.int8), 0]))
    drives = [(a, b) for a, b in zip(limits[::2], limits[1::2], strict=True) if b - a >= COURSE_STEPS]
    for (before, stop), (start, after) in pairwise(drives):
        wall_m = wall_distance(x[stop], y[stop], size)
        since = samples[samples[:, 0] > time[stop]]
        # A robot that stands for a sample seldom turns too. Avoidance is known per interval between samples, so a turn
        # may be avoidance if there is any before one of the first two samples up to 3 s after its end.
        sampled = (since[:, 0] < time[start] + LATE_S).any()
        avoided = np.nansum(since[since[:, 0] < time[start] + 3.0, 1][:2]) > ROUNDING_S
        if time[start] - time[stop] > LONGEST_TURN_S or wall_m < FAR_M or sampled or avoided:
            continue
        turned = _course(x, y, start, after, 0) - _course(x, y, before, stop, -1)
        angle = float(wrapped(np.array(turned)))
        if abs(angle) > LEAST_TURN:
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
    starts = np.flatnonzero(driving)
    if len(path) < 6 or starts.size == 0 or np.diff(path[:, 0]).max() > LONGEST_GAP_S:
        return None
    begin = int(starts[0])  # first step of the drive; step k leads from position k to position k + 1
    stops = np.flatnonzero(~driving[begin:])
    if stops.size == 0 or stops[0] < LEAST_STEPS:
        return None
    end = begin + int(stops[0])  # first step of the standstill
    later_drive = np.flatnonzero(driving[end:])
    over = end + int(later_drive[0]) if later_drive.size else driving.size  # first step after the standstill
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

    A robot moves away from a wall if its course is more than 107 degrees from the wall's outward normal: somewhat more
    than a right angle, because measured courses have errors.
    """
    distances = np.array([x, size[0] - x, y, size[1] - y])  # left, right, bottom, top
    incidences = wrapped(course - np.array([np.pi, 0.0, -np.pi / 2, np.pi / 2]))
    ahead = np.flatnonzero(np.abs(incidences) < np.radians(107.0))
    wall = ahead[np.argmin(distances[ahead])]
    return float(distances[wall]), float(incidences[wall])
