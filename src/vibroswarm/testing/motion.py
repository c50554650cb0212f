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
from functools import partial
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import number, stated
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, RunError
from vibroswarm.motion.footprint import half_extents, overlap
from vibroswarm.motion.source import Motion, Source
from vibroswarm.motion.source import source as source_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion_cases import CASES, SHORT_CASE, Case, Check, fitted, motion_of, ticks_of
from vibroswarm.testing.motion_tables import KINDS, TABLE_CHECKS, check_runs_differ
from vibroswarm.testing.runs import Finding, Pieces, require, run_check, run_checks, same_elsewhere

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

        They are the start plus the integral of v (cos, sin)(h + w t), with speed v, heading h and turn rate w. For an
        angle w t of almost 0, the integral is that along a straight line of the mean heading.
        """
        x, y, heading = self.pose[k].T
        v, w = self.speed[k], self.rate[k]
        turned = heading + w * dt_s
        slow = np.abs(w * dt_s) < 1e-7
        radius = v / np.where(slow, 1.0, w)  # 1.0: no division by 0 where the radius is not used
        along_x = np.where(
            slow, v * dt_s * np.cos(heading + w * dt_s / 2), radius * (np.sin(turned) - np.sin(heading))
        )
        along_y = np.where(
            slow, v * dt_s * np.sin(heading + w * dt_s / 2), radius * (np.cos(heading) - np.cos(turned))
        )
        return np.stack([x + along_x, y + along_y, turned], axis=1)


def tracks(motion: Motion, run: int) -> dict[int, Track]:
    """Return the tracks of a run, by robot; a robot without segments is left out.

    Raises:
        AssertionError: the motion has no table of segments.
    """
    if motion.segments is None:
        raise AssertionError(f"there are no segments of run {run}")
    by_robot = {}
    # Segments are sorted by time, and group_by keeps this order within each robot.
    for (robot,), rows in motion.segments.filter(pl.col("run") == run).group_by("robot", maintain_order=True):
        column = {name: rows[name].to_numpy() for name in rows.columns if name != "kind"}
        pose = np.stack([column["x_m"], column["y_m"], column["heading_rad"]], axis=1)
        kind = np.array(rows["kind"].to_list())  # as texts: the column is an enumeration
        by_robot[int(robot)] = Track(
            start_s=column["start_s"],
            pose=pose,
            speed=column["speed_m_s"],
            rate=column["turn_rate_rad_s"],
            kind=kind,
        )
    return by_robot


def at_all_ticks(motion: Motion, scenario: Scenario, run: int) -> tuple[Floats, NDArray[np.str_]]:
    """Return poses (robots, ticks, 3) and kinds of segments (robots, ticks) at each tick of a run.

    Raises:
        AssertionError: a robot has no segments, or none at time 0.
    """
    times: Floats = np.arange(scenario.ticks, dtype=np.float64) * scenario.tick_s
    by_robot = tracks(motion, run)
    require(sorted(by_robot) == list(range(scenario.swarm.robots)), f"a robot of run {run} has no segments")
    sampled = [by_robot[robot].at(times) for robot in sorted(by_robot)]
    return np.stack([pose for pose, _ in sampled]), np.stack([kind for _, kind in sampled])


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
                yield RobotOfRun(case, label, motion, own, motion.samples.filter(own), track)


def _check_spent(one: RobotOfRun, kinds: NDArray[np.str_], words: str) -> None:
    """Require that drive_s, turn_s, avoid_s and stop_s of all samples are the times spent in these kinds of movement.

    Args:
        kinds: what the robot does in the control period that begins at each tick, (ticks,). words: for messages, what
            states the kinds.
    """
    ends = ticks_of(one.samples["time_s"], one.case.scenario)
    for kind in KINDS:
        # Ticks that the robot has spent in movement of this kind from the start up to each sample.
        total = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
        spent = ticks_of(one.samples[f"{kind}_s"], one.case.scenario)
        is_equal = (np.diff(total, prepend=0) == spent).all()
        require(is_equal, f"{one.label}: {kind}_s differs from the time in such {words}")


def check_time_accounts(source: Source) -> None:
    """drive_s, turn_s, avoid_s and stop_s are the times spent in segments of these kinds.

    These columns of a sample are the times that the robot has spent in each kind of segment since its last sample.
    """
    for one in robots_of(source):
        s = one.case.scenario
        times: Floats = np.arange(s.ticks, dtype=np.float64) * s.tick_s
        _check_spent(one, one.track.at(times)[1], "segments")


def check_segments_join(source: Source) -> None:
    """Each segment ends where the next begins: nobody jumps.

    The first segment begins at time 0.
    """
    for one in robots_of(source):
        track = one.track
        k = np.arange(track.start_s.size - 1)
        gap = gap_of(track.after(k, np.diff(track.start_s)), track.pose[1:])
        gap_m = np.abs(gap).max(initial=0.0)
        require(
            gap_m < NEAR_M + source.tolerance.arc, f"{one.label} jumps, by {number(gap_m, digits=2)} m or rad"
        )
        require(
            track.start_s[0] == 0.0, f"{one.label}: its first segment begins at {stated(track.start_s[0])} s"
        )


def check_poses_at_samples(source: Source) -> None:
    """The segments put a robot where its sample is, and it stands there since the stop began.

    One tick before the stop it does not stand: the sample timer must exceed the interval between samples, and does not
    run in stops, so that a robot moves before each of them.
    """
    allowed_m = NEAR_M + source.tolerance.arc
    # Between the start of a stop and its sample the robot may roll or be pushed: x, y, heading.
    rolled = np.array([source.tolerance.stop_m, source.tolerance.stop_m, source.tolerance.stop_rad])
    for one in robots_of(source):
        expected = one.samples.select("x_m", "y_m", "heading_rad").to_numpy()
        for column, extra in (("time_s", np.zeros(3)), ("stop_start_s", rolled)):
            pose, kind = one.track.at(one.samples[column].to_numpy())
            gap = np.abs(gap_of(pose, expected))
            require(
                (gap < allowed_m + extra).all(),
                f"{one.label}: a sample is {number(gap.max(initial=0.0), digits=2)} m or rad from its segment, at "
                f"{column}",
            )
            # Also at ``time_s``: a robot walks on only one control period after it has sampled.
            require((kind == "stop").all(), f"{one.label} does not stand at {column}")
        before = one.track.at(one.samples["stop_start_s"].to_numpy() - one.case.scenario.tick_s)[1]
        require((before != "stop").all(), f"{one.label} stood before its stop")


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
    """The ends are where and when the segments end, and say which stop is under way.

    ``stop_start_s`` of an end is when the robot's last stop began, or null if the robot does not stand at the end.
    """
    for case in fitted(CASES, source):
        ends, expected = motion_of(source, case).ends.height, len(case.runs) * case.scenario.swarm.robots
        require(ends == expected, f"{case.name}: there are {ends} ends, not {expected}")
    for one in robots_of(source):
        track, s = one.track, one.case.scenario
        (row,) = one.motion.ends.filter(one.own).to_dicts()
        require(
            abs(row["end_s"] - s.ticks * s.tick_s) < 1e-9, f"{one.label} ends at {stated(row['end_s'])} s"
        )
        last, end = np.array([track.start_s.size - 1]), np.array([row["end_s"]])
        place = np.array([[row["x_m"], row["y_m"], row["heading_rad"]]])
        gap_m = np.abs(gap_of(track.after(last, end - track.start_s[last]), place)).max()
        require(
            gap_m < NEAR_M + source.tolerance.arc,
            f"{one.label} ends {number(gap_m, digits=2)} m or rad from its last segment",
        )
        began_s = row["stop_start_s"]
        if track.kind[-1] != "stop":
            require(began_s is None, f"{one.label} walks at the end, and the ends say it stands")
            continue
        require(began_s is not None, f"{one.label} stands at the end, but the ends do not say so")
        # A stop may have several segments, because a robot may roll on: find the first after the last move.
        walked = np.flatnonzero(track.kind != "stop")
        first = int(walked[-1]) + 1 if walked.size else 0
        began = abs(began_s - track.start_s[first]) < 1e-9
        require(began, f"{one.label}: its last stop began at another time than the ends say")


SEGMENT_CHECKS: Final[tuple[Check, ...]] = (
    check_time_accounts,
    check_segments_join,
    check_poses_at_samples,
    check_bodies,
    check_ends,
)
"""Checks of sources that give segments."""


def moves_of(one: RobotOfRun) -> pl.DataFrame:
    """Return the rows of a robot's moves in a run, in their order in the table, which should be that of time.

    Raises:
        AssertionError: there is no table of moves, or the robot has none in it.
    """
    if one.motion.moves is None:
        raise AssertionError(f"{one.label}: there are no moves")
    own = one.motion.moves.filter(one.own)
    require(own.height > 0, f"{one.label} has no moves")
    return own


def check_moves_lead_to_the_next(source: Source) -> None:
    """The arc of a move ends where the next begins, and turned_rad is what was turned, whole turns included.

    The last move ends where the table of ends puts the robot. ``turned_rad`` of a move is compared with the angle that
    the robot's segments turn during the move.
    """
    for one in robots_of(source):
        moves, track = moves_of(one), one.track
        (end,) = one.motion.ends.filter(one.own).to_dicts()
        # (moves + 1,): start of each move, s, then the end of the last move. Differences are the durations.
        start = np.append(moves["start_s"].to_numpy(), end["end_s"])
        pose = moves.select("x_m", "y_m", "heading_rad").to_numpy()
        last = [end["x_m"], end["y_m"], end["heading_rad"]]
        speed, rate = (moves[name].to_numpy() for name in ("speed_m_s", "turn_rate_rad_s"))
        # A move is an arc, as a segment is. So a ``Track`` whose rows are moves computes where each move ends.
        # ``after`` only reads the rows of ``pose``, ``speed`` and ``rate``, so that the additional last element
        # of ``start`` does not matter.
        along = Track(start, pose, speed, rate, kind=np.array(moves["kind"].to_list()))
        arrived = along.after(np.arange(moves.height), np.diff(start))
        # Each move has to end at the start of the next move, and the last move at the robot's last pose.
        gap_m = np.abs(gap_of(arrived, np.concatenate([pose[1:], [last]]))).max()
        require(
            gap_m < NEAR_M + source.tolerance.arc,
            f"{one.label}: a move ends {number(gap_m, digits=2)} m or rad from where the next begins",
        )
        # Angle (rad) that the robot has turned from time 0 to the start of each segment, (segments,).
        turned_to_segment = np.concatenate([[0.0], np.cumsum(track.rate[:-1] * np.diff(track.start_s))])
        # k: the last segment that has started at the start of each move, and at the end of the last move.
        k = np.searchsorted(track.start_s, start, side="right") - 1
        # Angle turned from time 0 to each time in ``start``: up to the start of segment k, then within it.
        # Differences of successive elements are what the segments turn during each move.
        turned_before = turned_to_segment[k] + track.rate[k] * (start - track.start_s[k])
        error = np.abs(np.diff(turned_before) - moves["turned_rad"].to_numpy())
        # In rad: 1e-8 for rounding, and the source's tolerance once for each segment that the move overlaps.
        # There are 1 + diff(k) of them, from the segment at the start of the move to the one at its end.
        allowed = 1e-8 + source.tolerance.arc * (1 + np.diff(k))
        require(
            (error < allowed).all(),
            f"{one.label}: turned_rad is {number(error.max(), digits=2)} rad from what the segments turn",
        )


def check_moves_account_for_time(source: Source) -> None:
    """The moves between two samples last as long as drive_s, turn_s, avoid_s and stop_s say.

    The first move begins at time 0, and the last move lasts until the end of the run.
    """
    for one in robots_of(source):
        moves, s = moves_of(one), one.case.scenario
        start = np.append(ticks_of(moves["start_s"], s), s.ticks)
        require(start[0] == 0, f"{one.label}: its first move does not begin at 0 s")
        _check_spent(one, np.repeat(np.array(moves["kind"].to_list()), np.diff(start)), "moves")


def check_rays_of_moves(source: Source) -> None:
    """ray_m is given where an avoidance begins, and for no other kind of move.

    An avoidance that follows a stop, or another one, may be the rest of one that began before.
    """
    for one in robots_of(source):
        moves, is_avoid = moves_of(one), pl.col("kind") == "avoid"
        follows = pl.col("kind").shift(1).cast(pl.String).fill_null("drive")  # the kind of the move before
        is_given, begins = pl.col("ray_m").is_not_null(), is_avoid & follows.is_in(["drive", "turn"])
        strange = moves.filter(is_given & ~is_avoid)["kind"].cast(pl.String).unique().to_list()
        require(not strange, f"{one.label}: a move has ray_m, and is no avoidance but: {', '.join(strange)}")
        require(
            moves.filter(begins & ~is_given).is_empty(), f"{one.label}: an avoidance begins without ray_m"
        )


MOVE_CHECKS: Final[tuple[Check, ...]] = (
    check_moves_lead_to_the_next,
    check_moves_account_for_time,
    check_rays_of_moves,
)
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
    findings = [
        run_check(words_of(check), lambda check=check: check(source), check in WARNINGS_ONLY)  # type: ignore[misc]
        for check in _applicable(source)
    ]
    elsewhere = run_checks({"The same in another process": partial(same_elsewhere, "motion", _pieces)}, name)
    return findings + elsewhere


def _pieces(name: str) -> Pieces:
    return {f"run {run}": partial(_text_of, name, run) for run in (2, 7)}


def _text_of(name: str, run: int) -> bytes:
    return csv_bytes(source_of(name).batch(SHORT_CASE.scenario, SHORT_CASE.seed, [run]).samples)


def words_of(check: Check) -> str:
    """Return what a check requires: the first line of its docstring, without its full stop."""
    return (inspect.getdoc(check) or check.__name__).splitlines()[0].rstrip(".")


def _applicable(source: Source) -> Iterator[Check]:
    """Yield the checks for the tables that this source gives; only ``TABLE_CHECKS`` if it cannot be simulated."""
    yield from TABLE_CHECKS
    try:
        motion = motion_of(source, SHORT_CASE)
    except (InputError, RunError):  # the first of TABLE_CHECKS meets the same error, and reports it
        return
    if motion.segments is not None:
        yield from SEGMENT_CHECKS
        if motion.moves is not None:
            yield from MOVE_CHECKS
