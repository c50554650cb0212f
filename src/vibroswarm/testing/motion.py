"""Checks of every motion source: those of its tables (``motion_tables``), of its segments and of its moves."""

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
from vibroswarm.motion.source import Motion, Source
from vibroswarm.motion.source import source as source_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion_cases import CASES, SHORT_CASE, Check, motion_of, ticks_of
from vibroswarm.testing.motion_tables import KINDS, TABLE_CHECKS, check_runs_differ
from vibroswarm.testing.runs import Finding, require, run_check

Floats = NDArray[np.float64]

NEAR_M: Final = 1e-9
"""Tolerance between poses from segments and from other tables, for rounding; ``Source.tolerance`` comes on top."""


@dataclass(frozen=True)
class Track:
    """One robot's segments as arrays."""

    start_s: Floats
    pose: Floats
    """(segments, 3): x, y, heading."""
    speed: Floats
    rate: Floats
    kind: NDArray[np.str_]

    def at(self, time_s: Floats) -> tuple[Floats, NDArray[np.str_]]:
        """Return poses (times, 3), and what the robot does from then on. A segment reaches to the next one's
        start.

        Raises:
            AssertionError: a time lies before the first segment.
        """
        k = np.searchsorted(self.start_s, time_s + 1e-9, side="right") - 1
        require((k >= 0).all(), "a time lies before the first segment")
        return self.after(k, time_s - self.start_s[k]), self.kind[k]

    def after(self, k: NDArray[np.intp], dt_s: Floats) -> Floats:
        """Return the pose ``dt_s`` after the start of segments ``k``: the integral of v (cos, sin)(h + w t)."""
        x, y, heading = self.pose[k].T
        v, w = self.speed[k], self.rate[k]
        turned = heading + w * dt_s
        slow = np.abs(w * dt_s) < 1e-7
        radius = v / np.where(slow, 1.0, w)
        along_x = np.where(
            slow, v * dt_s * np.cos(heading + w * dt_s / 2), radius * (np.sin(turned) - np.sin(heading))
        )
        along_y = np.where(
            slow, v * dt_s * np.sin(heading + w * dt_s / 2), radius * (np.cos(heading) - np.cos(turned))
        )
        return np.stack([x + along_x, y + along_y, turned], axis=1)


def tracks(motion: Motion, run: int) -> dict[int, Track]:
    """Return the tracks of a run, by robot.

    Raises:
        AssertionError: the motion has no segments.
    """
    if motion.segments is None:
        raise AssertionError(f"there are no segments of run {run}")
    by_robot = {}
    for (robot,), rows in motion.segments.filter(pl.col("run") == run).group_by("robot", maintain_order=True):
        column = {name: rows[name].to_numpy() for name in rows.columns if name != "kind"}
        pose = np.stack([column["x_m"], column["y_m"], column["heading_rad"]], axis=1)
        kind = np.array(rows["kind"].to_list())
        by_robot[int(robot)] = Track(
            column["start_s"], pose, column["speed_m_s"], column["turn_rate_rad_s"], kind
        )
    return by_robot


def at_all_ticks(motion: Motion, scenario: Scenario, run: int) -> tuple[Floats, NDArray[np.str_]]:
    """Return poses (robots, ticks, 3) and kinds (robots, ticks) at each control period of a run."""
    times: Floats = np.arange(scenario.ticks, dtype=np.float64) * scenario.tick_s
    by_robot = tracks(motion, run)
    require(sorted(by_robot) == list(range(scenario.swarm.robots)), f"a robot of run {run} has no segments")
    sampled = [by_robot[robot].at(times) for robot in sorted(by_robot)]
    return np.stack([pose for pose, _ in sampled]), np.stack([kind for _, kind in sampled])


def gap_of(poses: Floats, others: Floats) -> Floats:
    """Return differences of poses, (..., 3), in m and rad, wrapped."""
    gap: Floats = poses - others
    gap[..., 2] = np.remainder(gap[..., 2] + math.pi, math.tau) - math.pi
    return gap


def check_time_accounts(source: Source) -> None:
    """drive_s, turn_s, avoid_s and stop_s are what the segments say."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                label = f"{case.name}: run {run}, robot {robot}"
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                ends = ticks_of(rows["time_s"], s)
                spent = {kind: ticks_of(rows[f"{kind}_s"], s) for kind in KINDS}
                require(
                    np.array_equal(sum(spent.values()), np.diff(ends, prepend=0)), f"{label}: time is lost"
                )
                times: Floats = np.arange(s.ticks, dtype=np.float64) * s.tick_s
                kinds = track.at(times)[1]
                for kind, ticks in spent.items():
                    till = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
                    alike = (np.diff(till, prepend=0) == ticks).all()
                    require(alike, f"{label}: {kind}_s is another than by the segments")


def check_segments_join(source: Source) -> None:
    """Each segment ends where the next begins: nobody jumps."""
    for case in CASES:
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
    """The segments put a robot where its sample is, and it stands there since the stop began."""
    for case in CASES:
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                label = f"{case.name}: run {run}, robot {robot}"
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                expected = rows.select("x_m", "y_m", "heading_rad").to_numpy()
                around = np.abs(expected[:, 2]).max(initial=0.0) <= math.pi + 1e-12
                require(around, f"{label}: a heading is not from -pi to pi")
                allowed_m = NEAR_M + source.tolerance.arc
                moved = np.array(
                    [source.tolerance.stop_m, source.tolerance.stop_m, source.tolerance.stop_rad]
                )
                for column, more in (("time_s", np.zeros(3)), ("stop_start_s", moved)):
                    pose, kind = track.at(rows[column].to_numpy())
                    gap = np.abs(gap_of(pose, expected))
                    require(
                        (gap < allowed_m + more).all(),
                        f"{label}: a sample is {gap.max(initial=0.0):.2g} m or rad from its segment, at {column}",
                    )
                    require((kind == "stop").all(), f"{label} does not stand at {column}")
                before = track.at(rows["stop_start_s"].to_numpy() - case.scenario.tick_s)[1]
                require((before != "stop").all(), f"{label} stood before its stop")


def check_bodies(source: Source) -> None:
    """No two bodies overlap and none leaves the arena, at every control period."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        radius, allowed_m = s.robot.body_radius_m, NEAR_M + source.tolerance.overlap_m
        for run in case.runs:
            poses, _ = at_all_ticks(motion, s, run)
            x, y = poses[..., 0], poses[..., 1]
            for low, high, size in (
                (x.min(), x.max(), s.arena.width_m),
                (y.min(), y.max(), s.arena.height_m),
            ):
                beyond = max(radius - low, high - (size - radius))
                require(beyond < allowed_m, f"{case.name}: a body is {beyond:.2g} m beyond a wall")
            for i in range(s.swarm.robots - 1):
                over = 2 * radius - np.hypot(x[i + 1 :] - x[i], y[i + 1 :] - y[i]).min()
                require(over < allowed_m, f"{case.name}: bodies overlap by {over:.2g} m")


def check_ends(source: Source) -> None:
    """The ends are where and when the segments end, and say which stop is under way."""
    for case in CASES:
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
                walked = np.flatnonzero(
                    track.kind != "stop"
                )  # a stop may have several arcs: a robot rolls on
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
"""For sources that give segments."""


def of_robot(moves: pl.DataFrame | None, run: int, robot: int) -> pl.DataFrame:
    """Return the moves of a robot in a run.

    Raises:
        AssertionError: there is none.
    """
    if moves is None:
        raise AssertionError(f"there are no moves of run {run}")
    own = moves.filter((pl.col("run") == run) & (pl.col("robot") == robot))
    require(own.height > 0, f"robot {robot} of run {run} has no moves")
    return own


def check_moves_lead_to_the_next(source: Source) -> None:
    """The arc of a move ends where the next begins, and turned_rad is what was turned, whole turns included."""
    for case in CASES:
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                moves = of_robot(motion.moves, run, robot)
                own = pl.col("robot") == robot
                (end,) = motion.ends.filter((pl.col("run") == run) & own).to_dicts()
                start = np.append(moves["start_s"].to_numpy(), end["end_s"])
                pose = moves.select("x_m", "y_m", "heading_rad").to_numpy()
                last = [end["x_m"], end["y_m"], end["heading_rad"]]
                speed, rate = (moves[name].to_numpy() for name in ("speed_m_s", "turn_rate_rad_s"))
                along = Track(start, pose, speed, rate, np.array(moves["kind"].to_list()))
                arrived = along.after(np.arange(moves.height), np.diff(start))
                gap_m = np.abs(gap_of(arrived, np.concatenate([pose[1:], [last]]))).max()
                label = f"{case.name}: run {run}, robot {robot}"
                require(
                    gap_m < NEAR_M + source.tolerance.arc,
                    f"{label}: a move ends {gap_m:.2g} m or rad from where the next begins",
                )
                turned = moves["turned_rad"].to_numpy()
                # By the segments' turn rates, independent of the moves.
                sums = np.concatenate([[0.0], np.cumsum(track.rate[:-1] * np.diff(track.start_s))])
                k = np.searchsorted(track.start_s, start, side="right") - 1
                off = np.abs(np.diff(sums[k] + track.rate[k] * (start - track.start_s[k])) - turned)
                allowed = 1e-8 + source.tolerance.arc * (1 + np.diff(k))  # each segment may miss by so much
                worst = off.max()
                require(
                    (off < allowed).all(),
                    f"{label}: turned_rad is {worst:.2g} rad from what the segments turn",
                )


def check_moves_account_for_time(source: Source) -> None:
    """The moves between two samples last as long as drive_s, turn_s, avoid_s and stop_s say."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            for robot in range(s.swarm.robots):
                label = f"{case.name}: run {run}, robot {robot}"
                moves = of_robot(motion.moves, run, robot)
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                start = np.append(ticks_of(moves["start_s"], s), s.ticks)
                require(start[0] == 0, f"{label}: its first move does not begin at 0 s")
                kinds = np.repeat(np.array(moves["kind"].to_list()), np.diff(start))
                ends = ticks_of(rows["time_s"], s)
                for kind in KINDS:
                    till = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
                    spent = ticks_of(rows[f"{kind}_s"], s)
                    alike = (np.diff(till, prepend=0) == spent).all()
                    require(alike, f"{label}: {kind}_s is another than by the moves")


MOVE_CHECKS: Final[tuple[Check, ...]] = (
    check_moves_lead_to_the_next,
    check_moves_account_for_time,
)
"""For sources that give segments and moves."""

WARNINGS_ONLY: Final = (check_runs_differ,)
"""Checks whose failure is not an error: a recording is the same in every run."""


def check_motion(name: str) -> list[Finding]:
    """Run all checks of a registered motion source; those of segments and moves only if it gives them.

    Args:
        name: by which it is known.
    Raises:
        InputError: there is no such source.
    """
    source = source_of(name)  # once, as tables are cached by source
    return [
        run_check(words_of(check), lambda check=check: check(source), check in WARNINGS_ONLY)  # type: ignore[misc]
        for check in _applicable(source)
    ]


def words_of(check: Check) -> str:
    """Return what a check checks: the first line of its docstring."""
    return (inspect.getdoc(check) or check.__name__).splitlines()[0].rstrip(".")


def _applicable(source: Source) -> Iterator[Check]:
    """Yield the checks for the tables that this source can fill."""
    yield from TABLE_CHECKS
    try:
        motion = motion_of(source, SHORT_CASE)
    except (InputError, RunError):  # the first check reports it
        return
    if motion.segments is not None:
        yield from SEGMENT_CHECKS
        if motion.moves is not None:
            yield from MOVE_CHECKS
