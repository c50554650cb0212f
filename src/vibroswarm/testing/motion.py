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
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError, RunError
from vibroswarm.motion.footprint import half_extents, overlap
from vibroswarm.motion.source import Motion, Source
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


def check_time_accounts(source: Source) -> None:
    """drive_s, turn_s, avoid_s and stop_s are the times spent in segments of these kinds.

    These columns of a sample are the times that the robot has spent in each kind of segment since its last sample.
    """
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                label = f"{case.name}: run {run}, robot {robot}"
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                ends = ticks_of(rows["time_s"], s)  # tick of each sample
                spent = {kind: ticks_of(rows[f"{kind}_s"], s) for kind in KINDS}
                require(
                    np.array_equal(sum(spent.values()), np.diff(ends, prepend=0)),
                    f"{label}: the times do not add up to that since the last sample",
                )
                times: Floats = np.arange(s.ticks, dtype=np.float64) * s.tick_s
                kinds = track.at(times)[1]  # in the control period that begins at each tick
                for kind, ticks in spent.items():
                    # Ticks that the robot has spent in this kind of segment from the start up to each sample.
                    total = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
                    is_equal = (np.diff(total, prepend=0) == ticks).all()
                    require(is_equal, f"{label}: {kind}_s differs from the time in such segments")


def check_segments_join(source: Source) -> None:
    """Each segment ends where the next begins: nobody jumps.

    The first segment begins at time 0.
    """
    for case in fitted(CASES, source):
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                label = f"{case.name}: run {run}, robot {robot}"
                k = np.arange(track.start_s.size - 1)
                gap = gap_of(track.after(k, np.diff(track.start_s)), track.pose[1:])
                gap_m = np.abs(gap).max(initial=0.0)
                require(gap_m < NEAR_M + source.tolerance.arc, f"{label} jumps, by {gap_m:.2g} m or rad")
                require(
                    track.start_s[0] == 0.0, f"{label}: its first segment begins at {track.start_s[0]:g} s"
                )


def check_poses_at_samples(source: Source) -> None:
    """The segments put a robot where its sample is, and it stands there since the stop began.

    One tick before the stop it does not stand: the sample timer must exceed the interval between samples, and does not
    run in stops, so that a robot moves before each of them. Headings of samples are from -pi to pi.
    """
    for case in fitted(CASES, source):
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                label = f"{case.name}: run {run}, robot {robot}"
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                expected = rows.select("x_m", "y_m", "heading_rad").to_numpy()
                is_wrapped = np.abs(expected[:, 2]).max(initial=0.0) <= math.pi + 1e-12
                require(is_wrapped, f"{label}: a heading is not from -pi to pi")
                allowed_m = NEAR_M + source.tolerance.arc
                # Between the start of a stop and its sample the robot may roll or be pushed: x, y, heading.
                rolled = np.array(
                    [source.tolerance.stop_m, source.tolerance.stop_m, source.tolerance.stop_rad]
                )
                for column, extra in (("time_s", np.zeros(3)), ("stop_start_s", rolled)):
                    pose, kind = track.at(rows[column].to_numpy())
                    gap = np.abs(gap_of(pose, expected))
                    require(
                        (gap < allowed_m + extra).all(),
                        f"{label}: a sample is {gap.max(initial=0.0):.2g} m or rad from its segment, at {column}",
                    )
                    # Also at ``time_s``: a robot walks on only one control period after it has sampled.
                    require((kind == "stop").all(), f"{label} does not stand at {column}")
                before = track.at(rows["stop_start_s"].to_numpy() - case.scenario.tick_s)[1]
                require((before != "stop").all(), f"{label} stood before its stop")


def check_bodies(source: Source) -> None:
    """No two bodies overlap and none leaves the arena, at every control period.

    Bodies are discs of ``robot.body_radius_m``, or rectangles if the source gives its robots' footprint, within which
    all their parts are; ``Tolerance.overlap_m`` is allowed.
    """
    if source.footprint_m is not None:
        for case in fitted(CASES, source):
            for run in case.runs:
                _check_rectangles(
                    case, motion_of(source, case), run, source.footprint_m, source.tolerance.overlap_m
                )
        return
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        radius, allowed_m = s.robot.body_radius_m, NEAR_M + source.tolerance.overlap_m
        for run in case.runs:
            poses, _ = at_all_ticks(motion, s, run)
            x, y = poses[..., 0], poses[..., 1]
            for low, high, size in (
                (x.min(), x.max(), s.arena.width_m),
                (y.min(), y.max(), s.arena.height_m),
            ):
                # How far the body farthest out reaches beyond the wall at 0, or beyond the one opposite.
                beyond = max(radius - low, high - (size - radius))
                require(beyond < allowed_m, f"{case.name}: a body is {beyond:.2g} m beyond a wall")
            for i in range(s.swarm.robots - 1):
                over = 2 * radius - np.hypot(x[i + 1 :] - x[i], y[i + 1 :] - y[i]).min()
                require(over < allowed_m, f"{case.name}: bodies overlap by {over:.2g} m")


def _check_rectangles(
    case: Case, motion: Motion, run: int, size_m: tuple[float, float], allowed_m: float
) -> None:
    """Require that robots of a run, rectangles of a size, overlap neither walls nor each other by more than allowed."""
    s = case.scenario
    poses, _ = at_all_ticks(motion, s, run)  # (robots, ticks, 3)
    reach, arena = half_extents(poses[..., 2], size_m), np.array([s.arena.width_m, s.arena.height_m])
    beyond = float(np.maximum(reach - poses[..., :2], poses[..., :2] + reach - arena).max())
    require(beyond < NEAR_M + allowed_m, f"{case.name}: a body is {beyond:.2g} m beyond a wall")
    for i in range(s.swarm.robots - 1):
        for other in poses[i + 1 :]:
            near = np.hypot(*(other - poses[i])[:, :2].T) < math.hypot(
                *size_m
            )  # farther apart they cannot touch
            depth, _ = overlap(poses[i][near], other[near], size_m)
            over = float(depth.max(initial=0.0))
            require(over < NEAR_M + allowed_m, f"{case.name}: bodies overlap by {over:.2g} m")


def check_ends(source: Source) -> None:
    """The ends are where and when the segments end, and say which stop is under way.

    ``stop_start_s`` of an end is when the robot's last stop began, or null if the robot does not stand at the end.
    """
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        expected = len(case.runs) * s.swarm.robots
        require(
            motion.ends.height == expected,
            f"{case.name}: there are {motion.ends.height} ends, not {expected}",
        )
        for run in case.runs:
            by_robot = tracks(motion, run)
            for row in motion.ends.filter(pl.col("run") == run).to_dicts():
                label = f"{case.name}: run {run}, robot {row['robot']}"
                require(abs(row["end_s"] - s.ticks * s.tick_s) < 1e-9, f"{label} ends at {row['end_s']:g} s")
                require(row["robot"] in by_robot, f"{label} has no segments")
                track, end = by_robot[row["robot"]], np.array([row["end_s"]])
                last = np.array([track.start_s.size - 1])
                place = np.array([[row["x_m"], row["y_m"], row["heading_rad"]]])
                gap_m = np.abs(gap_of(track.after(last, end - track.start_s[last]), place)).max()
                require(
                    gap_m < NEAR_M + source.tolerance.arc,
                    f"{label} ends {gap_m:.2g} m or rad from its last segment",
                )
                if track.kind[-1] != "stop":
                    require(
                        row["stop_start_s"] is None, f"{label} walks at the end, and the ends say it stands"
                    )
                    continue
                require(
                    row["stop_start_s"] is not None, f"{label} stands at the end, but the ends do not say so"
                )
                # A stop may have several segments, because a robot may roll on: find the first after the last move.
                walked = np.flatnonzero(track.kind != "stop")
                first = int(walked[-1]) + 1 if walked.size else 0
                began = abs(row["stop_start_s"] - track.start_s[first]) < 1e-9
                require(began, f"{label}: its last stop began at another time than the ends say")


SEGMENT_CHECKS: Final[tuple[Check, ...]] = (
    check_time_accounts,
    check_segments_join,
    check_poses_at_samples,
    check_bodies,
    check_ends,
)
"""Checks of sources that give segments."""


def of_robot(moves: pl.DataFrame | None, run: int, robot: int) -> pl.DataFrame:
    """Return the rows of a robot's moves in a run, in their order in the table, which should be that of time.

    Raises:
        AssertionError: there is no table of moves, or the robot has none in it.
    """
    if moves is None:
        raise AssertionError(f"there are no moves of run {run}")
    own = moves.filter((pl.col("run") == run) & (pl.col("robot") == robot))
    require(own.height > 0, f"robot {robot} of run {run} has no moves")
    return own


def check_moves_lead_to_the_next(source: Source) -> None:
    """The arc of a move ends where the next begins, and turned_rad is what was turned, whole turns included.

    The last move ends where the table of ends puts the robot. ``turned_rad`` of a move is compared with the angle that
    the robot's segments turn during the move.
    """
    for case in fitted(CASES, source):
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                moves = of_robot(motion.moves, run, robot)
                own = pl.col("robot") == robot
                (end,) = motion.ends.filter((pl.col("run") == run) & own).to_dicts()
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
                label = f"{case.name}: run {run}, robot {robot}"
                require(
                    gap_m < NEAR_M + source.tolerance.arc,
                    f"{label}: a move ends {gap_m:.2g} m or rad from where the next begins",
                )
                turned = moves["turned_rad"].to_numpy()
                # Angle (rad) that the robot has turned from time 0 to the start of each segment, (segments,).
                turned_to_segment = np.concatenate(
                    [[0.0], np.cumsum(track.rate[:-1] * np.diff(track.start_s))]
                )
                # k: the last segment that has started at the start of each move, and at the end of the last move.
                k = np.searchsorted(track.start_s, start, side="right") - 1
                # Angle turned from time 0 to each time in ``start``: up to the start of segment k, then within it.
                # Differences of successive elements are what the segments turn during each move.
                turned_before = turned_to_segment[k] + track.rate[k] * (start - track.start_s[k])
                error = np.abs(np.diff(turned_before) - turned)
                # In rad: 1e-8 for rounding, and the source's tolerance once for each segment that the move overlaps.
                # There are 1 + diff(k) of them, from the segment at the start of the move to the one at its end.
                allowed = 1e-8 + source.tolerance.arc * (1 + np.diff(k))
                require(
                    (error < allowed).all(),
                    f"{label}: turned_rad is {error.max():.2g} rad from what the segments turn",
                )


def check_moves_account_for_time(source: Source) -> None:
    """The moves between two samples last as long as drive_s, turn_s, avoid_s and stop_s say.

    The first move begins at time 0, and the last move lasts until the end of the run.
    """
    for case in fitted(CASES, source):
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            for robot in range(s.swarm.robots):
                label = f"{case.name}: run {run}, robot {robot}"
                moves = of_robot(motion.moves, run, robot)
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                start = np.append(ticks_of(moves["start_s"], s), s.ticks)
                require(start[0] == 0, f"{label}: its first move does not begin at 0 s")
                # What the robot does at each tick.
                kinds = np.repeat(np.array(moves["kind"].to_list()), np.diff(start))
                ends = ticks_of(rows["time_s"], s)
                for kind in KINDS:
                    # Ticks that the robot has spent in this kind of move from the start up to each sample.
                    total = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
                    spent = ticks_of(rows[f"{kind}_s"], s)
                    is_equal = (np.diff(total, prepend=0) == spent).all()
                    require(is_equal, f"{label}: {kind}_s differs from the time in such moves")


MOVE_CHECKS: Final[tuple[Check, ...]] = (
    check_moves_lead_to_the_next,
    check_moves_account_for_time,
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
    return [
        run_check(words_of(check), lambda check=check: check(source), check in WARNINGS_ONLY)  # type: ignore[misc]
        for check in _applicable(source)
    ]


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
