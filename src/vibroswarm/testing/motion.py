"""Checks of every motion source: those of its tables (``motion_tables``), of its segments and of its moves.

A check takes a source, runs it in all cases of ``motion_cases``, and raises ``AssertionError`` if the source fails. The
first line of its docstring states what must hold; ``vibroswarm check`` prints this line.

A segment is an arc of constant speed and turn rate; its row has the start (time and pose), and it lasts until the
robot's next segment starts. A track is all segments of one robot. A move is a whole drive, turn, avoidance or stop of
one robot, as one row. An end is a robot's state at the end of a run.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import number
from vibroswarm.motion.footprint import half_extents, overlap
from vibroswarm.motion.source import Motion, Source, Tolerance
from vibroswarm.motion.source import source as source_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion_cases import CASES, SHORT_CASE, Case, Check, fitted, motion_of, ticks_of
from vibroswarm.testing.motion_tables import KINDS, TABLE_CHECKS, check_runs_differ
from vibroswarm.testing.runs import Finding, require, run_check

Floats = NDArray[np.float64]
"""An array of floating-point numbers."""

NEAR_M: Final = 1e-9
"""Difference allowed between poses from segments and from other tables because of rounding, m or rad. What
``Source.tolerance`` allows is added to it."""


@dataclass(frozen=True)
class Track:
    """One robot's segments as arrays of one element, or row, per segment."""

    start_s: Floats
    """Start of each segment, s; ascending."""
    pose: Floats
    """(segments, 3): x and y in m, heading in rad, at the start."""
    speed: Floats
    """m/s."""
    rate: Floats
    """Turn rate, rad/s."""
    kind: NDArray[np.str_]
    """What the robot does: one of ``KINDS``."""

    def at(self, time_s: Floats) -> tuple[Floats, NDArray[np.str_]]:
        """Return poses (times, 3), and kinds of the segments (times,), at some times.

        A segment holds from its start, included, to the start of the next one.

        Args:
            time_s: (times,).
        Raises:
            AssertionError: a time lies before the first segment.
        """
        # k: the last segment that has started; the margin is for rounding of times.
        k = np.searchsorted(self.start_s, time_s + 1e-9, side="right") - 1
        require((k >= 0).all(), "a time lies before the first segment")
        return self.after(k, time_s - self.start_s[k]), self.kind[k]

    def after(self, k: NDArray[np.intp], dt_s: Floats) -> Floats:
        """Return the poses (n, 3) at times ``dt_s`` (n,) after the start of the segments ``k`` (n,).

        They are the start plus the integral of v (cos, sin)(h + w t), with speed v, heading h and turn rate w: a chord
        of length v t sin(w t / 2) / (w t / 2), along the mean heading.
        """
        x, y, heading = self.pose[k].T
        half = self.rate[k] * dt_s / 2
        chord = self.speed[k] * dt_s * np.sinc(half / math.pi)
        ahead = heading + half
        return np.stack([x + chord * np.cos(ahead), y + chord * np.sin(ahead), heading + 2 * half], axis=1)


def tracks(motion: Motion, run: int) -> dict[int, Track]:
    """Return the tracks of a run, by robot; a robot without segments is left out.

    Raises:
        AssertionError: the motion has no table of segments.
    """
    require(motion.segments is not None, f"there are no segments of run {run}")
    by_robot = {}
    own = motion.segments.filter(pl.col("run") == run)  # type: ignore[union-attr]
    # Segments are sorted by time, and group_by keeps this order within each robot.
    for (robot,), rows in own.group_by("robot", maintain_order=True):
        columns = (rows[name].to_numpy() for name in ("start_s", "speed_m_s", "turn_rate_rad_s"))
        start_s, speed, rate = columns
        pose = rows.select("x_m", "y_m", "heading_rad").to_numpy()
        by_robot[int(robot)] = Track(start_s, pose, speed, rate, np.array(rows["kind"].to_list()))
    return by_robot


def at_all_ticks(motion: Motion, scenario: Scenario, run: int) -> tuple[Floats, NDArray[np.str_]]:
    """Return poses (robots, ticks, 3) and kinds of segments (robots, ticks) at each tick of a run.

    Raises:
        AssertionError: a robot has no segments, or none at time 0.
    """
    times: Floats = np.arange(scenario.ticks, dtype=np.float64) * scenario.tick_s
    by_robot = tracks(motion, run)
    require(sorted(by_robot) == list(range(scenario.swarm.robots)), f"a robot of run {run} has no segments")
    poses, kinds = zip(*(by_robot[robot].at(times) for robot in sorted(by_robot)), strict=True)
    return np.stack(poses), np.stack(kinds)


def gap_of(poses: Floats, others: Floats) -> Floats:
    """Return ``poses`` minus ``others``, both (..., 3), in m and rad; differences of headings are from -pi to pi."""
    gap: Floats = poses - others
    gap[..., 2] = np.remainder(gap[..., 2] + math.pi, math.tau) - math.pi
    return gap


class RobotOfRun(NamedTuple):
    """What a motion source made of one robot in one run of a case."""

    case: Case
    label: str
    """Names case, run and robot in messages."""
    motion: Motion
    own: pl.Expr
    """Chooses the rows of the robot in the run, in any table."""
    samples: pl.DataFrame
    track: Track
    tolerance: Tolerance


def robots_of(source: Source) -> Iterator[RobotOfRun]:
    """Yield each robot of each run of all cases.

    Raises:
        AssertionError: there are no segments.
    """
    for case in fitted(CASES, source):
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                label = f"{case.name}: run {run}, robot {robot}"
                own = (pl.col("run") == run) & (pl.col("robot") == robot)
                yield RobotOfRun(
                    case, label, motion, own, motion.samples.filter(own), track, source.tolerance
                )


def check_time_accounts(source: Source) -> None:
    """drive_s, turn_s, avoid_s and stop_s are the times spent in segments of these kinds.

    These columns of a sample are the times that the robot has spent in each kind of segment since its last sample.
    """
    for one in robots_of(source):
        s = one.case.scenario
        times: Floats = np.arange(s.ticks, dtype=np.float64) * s.tick_s
        kinds = one.track.at(times)[1]
        ends = ticks_of(one.samples["time_s"], s)
        for kind in KINDS:
            # Ticks that the robot has spent in movement of this kind from the start up to each sample.
            total = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
            is_equal = (np.diff(total, prepend=0) == ticks_of(one.samples[f"{kind}_s"], s)).all()
            require(is_equal, f"{one.label}: {kind}_s differs from the time in such segments")


def _require_near(one: RobotOfRun, poses: Floats, others: Floats, extra: Floats | float, words: str) -> None:
    """Require that poses (n, 3) are equal, but for rounding and what the source allows."""
    gap = np.abs(gap_of(poses, others))
    is_near = (gap < NEAR_M + one.tolerance.arc + extra).all()
    require(is_near, f"{one.label} {words}, by {number(gap.max(initial=0.0), digits=2)} m or rad")


def check_segments_join(source: Source) -> None:
    """Each segment ends where the next begins: nobody jumps. The first segment begins at time 0."""
    for one in robots_of(source):
        track = one.track
        arrived = track.after(np.arange(track.start_s.size - 1), np.diff(track.start_s))
        _require_near(one, arrived, track.pose[1:], 0.0, "jumps")
        require(track.start_s[0] == 0.0, f"{one.label}: its first segment does not begin at 0 s")


def check_poses_at_samples(source: Source) -> None:
    """The segments put a robot where its sample is, and it stands there since the stop began."""
    for one in robots_of(source):
        places = one.samples.select("x_m", "y_m", "heading_rad").to_numpy()
        # Between the start of a stop and its sample the robot may roll or be pushed: x, y, heading.
        rolled = np.array([one.tolerance.stop_m, one.tolerance.stop_m, one.tolerance.stop_rad])
        for column, extra in (("time_s", np.zeros(3)), ("stop_start_s", rolled)):
            pose, kind = one.track.at(one.samples[column].to_numpy())
            _require_near(one, pose, places, extra, f"is not where its sample is at {column}")
            # Also at ``time_s``: a robot walks on only one control period after it has sampled.
            require((kind == "stop").all(), f"{one.label} does not stand at {column}")


def check_bodies(source: Source) -> None:
    """No two bodies overlap and none leaves the arena, at every control period.

    Bodies are discs of ``robot.body_radius_m``, or rectangles if the source gives its robots' footprint, within which
    all their parts are; ``Tolerance.overlap_m`` is allowed.
    """
    allowed_m = NEAR_M + source.tolerance.overlap_m
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        arena, radius_m = np.array([s.arena.width_m, s.arena.height_m]), s.robot.body_radius_m
        for run in case.runs:
            poses, _ = at_all_ticks(motion, s, run)  # (robots, ticks, 3)
            size_m = source.footprint_m
            reach_m = radius_m if size_m is None else half_extents(poses[..., 2], size_m)
            beyond_m = np.maximum(reach_m - poses[..., :2], poses[..., :2] + reach_m - arena).max()
            require(
                beyond_m < allowed_m, f"{case.name}: a body is {number(beyond_m, digits=2)} m beyond a wall"
            )
            for one, other in combinations(poses, 2):
                apart_m = np.hypot(*(other - one)[:, :2].T)
                over_m = (2 * radius_m - apart_m).max()
                if size_m is not None:
                    near = apart_m < math.hypot(*size_m)  # farther apart they cannot touch
                    over_m = overlap(one[near], other[near], size_m)[0].max(initial=0.0)
                require(over_m < allowed_m, f"{case.name}: bodies overlap by {number(over_m, digits=2)} m")


def check_ends(source: Source) -> None:
    """The ends are where the segments end, and say when a stop began that is under way."""
    for one in robots_of(source):
        track, (row,) = one.track, one.motion.ends.filter(one.own).to_dicts()
        place = np.array([[row["x_m"], row["y_m"], row["heading_rad"]]])
        last = np.array([track.start_s.size - 1])
        _require_near(
            one, track.after(last, row["end_s"] - track.start_s[last]), place, 0.0, "ends elsewhere"
        )
        # A stop may have several segments, because a robot may roll on: find the first after the last move.
        walked = np.flatnonzero(track.kind != "stop")
        first = int(walked[-1]) + 1 if walked.size else 0
        began_s = track.start_s[first] if first < track.start_s.size else None
        require(row["stop_start_s"] == began_s, f"{one.label}: the ends do not say whether it stands")


def check_moves(source: Source) -> None:
    """Moves begin where the segments put the robot, are of their kind, and have turned as far."""
    for one in robots_of(source):
        require(one.motion.moves is not None, f"{one.label}: there are no moves")
        moves, track = one.motion.moves.filter(one.own), one.track  # type: ignore[union-attr]
        start = moves["start_s"].to_numpy()
        pose, kind = track.at(start)
        places = moves.select("x_m", "y_m", "heading_rad").to_numpy()
        _require_near(one, pose, places, 0.0, "begins a move elsewhere")
        require((kind == np.array(moves["kind"].to_list())).all(), f"{one.label}: a move is of another kind")
        # Angle turned from time 0 to the start of each move: up to the start of segment k, then within it.
        before = np.concatenate([[0.0], np.cumsum(track.rate[:-1] * np.diff(track.start_s))])
        k = np.searchsorted(track.start_s, start, side="right") - 1
        turned = np.diff(before[k] + track.rate[k] * (start - track.start_s[k]))
        error = np.abs(turned - moves["turned_rad"].to_numpy()[:-1])
        allowed = 1e-8 + one.tolerance.arc * (1 + np.diff(k))  # once for each segment that the move overlaps
        require((error < allowed).all(), f"{one.label}: turned_rad is not what the segments turn")


SEGMENT_CHECKS: Final[tuple[Check, ...]] = (
    check_time_accounts,
    check_segments_join,
    check_poses_at_samples,
    check_bodies,
    check_ends,
)
"""Checks of sources that give segments."""


MOVE_CHECKS: Final[tuple[Check, ...]] = (check_moves,)
"""Checks of sources that give segments and moves."""

WARNINGS_ONLY: Final = (check_runs_differ,)
"""Checks whose failure is not an error: a recording is the same in every run."""


def check_motion(name: str) -> list[Finding]:
    """Run all checks of a registered motion source, and return their findings in order.

    Checks of segments are run only if the source gives segments, and checks of moves only if it gives both.

    Args:
        name: of the source.
    Raises:
        InputError: there is no such source.
    """
    source = source_of(name)  # one object for all checks, because ``motion_of`` caches motion by source
    findings = [_finding(check, source) for check in TABLE_CHECKS]
    if findings[0].holds:  # else its tables cannot be read
        motion = motion_of(source, SHORT_CASE)
        more = SEGMENT_CHECKS if motion.segments is not None else ()
        more += MOVE_CHECKS if motion.segments is not None and motion.moves is not None else ()
        findings += [_finding(check, source) for check in more]
    return findings


def _finding(check: Check, source: Source) -> Finding:
    """Return the finding of a check, which requires what the first line of its docstring says."""
    what = (inspect.getdoc(check) or check.__name__).splitlines()[0].rstrip(".")
    return run_check(what, lambda: check(source), is_warning=check in WARNINGS_ONLY)
