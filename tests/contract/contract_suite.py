"""What any source of Motion must keep, as check functions that take the source and fail by assertion.

Every source is held to ``TABLE_CHECKS``, by ``for check in TABLE_CHECKS: check(source)``; one that gives segments also
to ``SEGMENT_CHECKS``, and one that gives moves as well to ``MOVE_CHECKS``. ``WALK_CHECKS`` are for engines, whose
robots walk as the scenario says. Poses and rays are worked out here from the segment table alone, with formulas of
their own, so that no engine is its own judge.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from polars.testing import assert_frame_equal

from vibroswarm.motion.contract import ENDS, MOTION, MOVES, SEGMENTS, Motion, Source, join
from vibroswarm.motion.pose import place_from_moves
from vibroswarm.scenario import Scenario

Floats = NDArray[np.float64]
Check = Callable[[Source], None]

NEAR_M = 1e-9
"""Poses from segments agree with the other tables to this."""


@dataclass(frozen=True)
class Case:
    """A scenario and its runs."""

    name: str
    values: dict[str, Any] = field(hash=False)
    runs: tuple[int, ...] = (0, 1)
    seed: int = 11

    @property
    def scenario(self) -> Scenario:
        return Scenario().with_values(self.values)


CASES = (
    Case("paper", {"run.t_end_s": 150.0}, (0, 3)),
    Case("one robot", {"swarm.robots": 1, "run.t_end_s": 200.0}, (5,)),
    Case(
        "crowd",
        {
            "arena.width_m": 0.4,
            "arena.height_m": 0.4,
            "swarm.robots": 20,
            "swarm.start_margin_m": 0.0,
            "run.t_end_s": 60.0,
        },
    ),
    Case(
        "corridor",
        {
            "arena.width_m": 0.3,
            "arena.height_m": 2.0,
            "swarm.robots": 8,
            "sample.timer": "always",
            "run.t_end_s": 100.0,
        },
    ),
    Case("hundred robots", {"swarm.robots": 100, "run.t_end_s": 15.0}, (0,)),
    Case(
        "cell",
        {
            "arena.width_m": 0.032,
            "arena.height_m": 0.04,
            "swarm.robots": 1,
            "swarm.start_margin_m": 0.0,
            "walk.avoidance_threshold_mm": 10.0,
            "run.t_end_s": 40.0,
        },
    ),
    Case(
        "two in a cell",
        {
            "arena.width_m": 0.065,
            "arena.height_m": 0.05,
            "swarm.robots": 2,
            "swarm.start_margin_m": 0.0,
            "walk.avoidance_threshold_mm": 8.0,
            "run.t_end_s": 40.0,
        },
    ),
    Case(
        "odd periods",
        {
            "run.control_period_ms": 13,
            "run.t_end_s": 60.005,
            "sample.stop_ms": 70.0,
            "sample.sample_interval_ms": 777.0,
            "sample.timer": "hold_in_turn",
            "sample.interrupts_avoidance": False,
            "robot.speed_redraw": "robot",
            "robot.misalignment_min": -0.4,
            "robot.misalignment_max": 0.4,
            "walk.leg_min_ms": 0.0,
        },
    ),
    Case(
        "wide eyes",
        {
            "run.t_end_s": 80.0,
            "sample.timer": "frozen_in_avoidance",
            "walk.avoidance_threshold_mm": 120.0,
            "rays.side_m": [0.01, 0.0, -0.005, 0.0],
            "rays.angle_deg": [60.0, 0.0, -10.0, -90.0],
            "rays.forward_m": 0.0,
            "rays.disc_radius_m": 0.015,
        },
    ),
)
"""Few and short; together they hold every mode, crowds, corridors, and arenas little larger than a robot."""


@lru_cache(maxsize=64)
def motion_of(source: Source, case: Case) -> Motion:
    """The case's runs, made once for all checks."""
    return source.batch(case.scenario, case.seed, case.runs, segments=True, moves=True)


def same(one: Motion, other: Motion) -> None:
    """Every table equal, bit by bit."""
    for name in ("samples", "ends", "segments", "moves"):
        mine, theirs = getattr(one, name), getattr(other, name)
        assert (mine is None) == (theirs is None), f"{name} are missing from one"
        if mine is not None:
            assert_frame_equal(mine, theirs, check_exact=True)


def part_of(motion: Motion, run: int) -> Motion:
    """One run of a motion."""
    here = pl.col("run") == run
    tables = (motion.samples, motion.ends, motion.segments, motion.moves)
    return Motion(*(table.filter(here) if table is not None else None for table in tables))  # type: ignore[arg-type]


# Poses and rays, from the segment table


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
        """Poses (times, 3), and what the robot does from then on. A segment reaches to the next one's start."""
        k = np.searchsorted(self.start_s, time_s + 1e-9, side="right") - 1
        assert (k >= 0).all(), "a time before the first segment"
        return self.after(k, time_s - self.start_s[k]), self.kind[k]

    def after(self, k: NDArray[np.intp], dt_s: Floats) -> Floats:
        """Pose ``dt_s`` after the beginning of segments ``k``: the integral of v (cos, sin)(h + w t)."""
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
    """The tracks of a run, by robot."""
    assert motion.segments is not None
    found = {}
    for (robot,), rows in motion.segments.filter(pl.col("run") == run).group_by("robot", maintain_order=True):
        column = {name: rows[name].to_numpy() for name in rows.columns if name != "kind"}
        pose = np.stack([column["x_m"], column["y_m"], column["heading_rad"]], axis=1)
        kind = np.array(rows["kind"].to_list())
        found[int(robot)] = Track(  # type: ignore[call-overload]
            column["start_s"], pose, column["speed_m_s"], column["turn_rate_rad_s"], kind
        )
    return found


def at_all_ticks(motion: Motion, scenario: Scenario, run: int) -> tuple[Floats, NDArray[np.str_]]:
    """Poses (robots, ticks, 3) and kinds (robots, ticks) at each control period of a run."""
    times = np.arange(scenario.ticks) * scenario.tick_s
    here = tracks(motion, run)
    assert sorted(here) == list(range(scenario.swarm.robots)), "a robot without segments"
    found = [here[robot].at(times) for robot in sorted(here)]
    return np.stack([pose for pose, _ in found]), np.stack([kind for _, kind in found])


def shortest_rays_m(scenario: Scenario, poses: Floats) -> Floats:
    """The shortest ray of each robot at each tick, (robots, ticks); infinite beyond their range."""
    rays, arena = scenario.rays, scenario.arena
    x, y, heading = np.moveaxis(poses, 2, 0)
    shortest = np.full(x.shape, math.inf)
    for side, angle in zip(rays.side_m, rays.angle_deg, strict=True):
        origin = (x + 1j * y) + np.exp(1j * heading) * (rays.forward_m + 1j * side)
        ray = np.exp(1j * (heading + math.radians(angle)))
        for distance, normal in (
            (arena.width_m - origin.real, ray.real),
            (origin.real, -ray.real),
            (arena.height_m - origin.imag, ray.imag),
            (origin.imag, -ray.imag),
        ):
            with np.errstate(divide="ignore", invalid="ignore"):
                shortest = np.minimum(shortest, np.where(normal > 0, distance / normal, math.inf))
        for other in range(x.shape[0]):
            # In the ray's own frame the disc's centre lies ahead by the real and aside by the imaginary part.
            place = ((x[other] + 1j * y[other]) - origin) * ray.conj()
            room = rays.disc_radius_m**2 - place.imag**2
            with np.errstate(invalid="ignore"):
                hit = np.where((room >= 0) & (place.real > 0), place.real - np.sqrt(room), math.inf)
            hit[other] = math.inf
            shortest = np.minimum(shortest, hit)
    return np.where(shortest <= rays.range_m, shortest, math.inf)


def ticks_of(values: pl.Series, scenario: Scenario) -> NDArray[np.int64]:
    """Times as whole control periods; fails where they are not."""
    ticks = values.to_numpy().astype(float) / scenario.tick_s
    whole = np.rint(ticks)
    # Columns of 32 bits hold 24: a millionth of a long time is still far from half a period.
    assert np.abs(ticks - whole).max(initial=0.0) < 1e-3, f"{values.name} is not on the control period"
    return whole.astype(np.int64)


# The checks


def check_schema(source: Source) -> None:
    """Columns, types, and no null but where it means something."""
    for case in CASES[:3]:
        motion = motion_of(source, case)
        for frame, schema, nullable in (
            (motion.samples, MOTION, []),
            (motion.ends, ENDS, ["stop_start_s"]),
            (motion.segments, SEGMENTS, []),
            (motion.moves, MOVES, ["ray_m"]),
        ):
            if frame is None:
                continue
            assert dict(frame.schema) == schema
            assert frame.height > 0
            numbers = frame.select(pl.selectors.float())
            assert all(numbers.select(pl.all().is_finite().fill_null(True).all()).row(0)), "not finite"
            assert frame.drop(nullable).null_count().sum_horizontal().item() == 0
        plain = source.batch(case.scenario, case.seed, case.runs[:1])
        assert plain.segments is None
        assert plain.moves is None


def check_order(source: Source) -> None:
    """Sorted by run, time, robot; one row at most of a robot at a time."""
    for case in CASES:
        motion = motion_of(source, case)
        for frame, by in (
            (motion.samples, ["run", "time_s", "robot"]),
            (motion.segments, ["run", "start_s", "robot"]),
            (motion.moves, ["run", "start_s", "robot"]),
            (motion.ends, ["run", "robot"]),
        ):
            if frame is None:
                continue
            assert frame.select(by).equals(frame.select(by).sort(by)), f"{case.name}: not sorted by {by}"
            assert not frame.select(by).is_duplicated().any(), f"{case.name}: twice the same {by}"


def check_sample_numbers(source: Source) -> None:
    """0, 1, 2, ... for each run and robot, in the order of time."""
    for case in CASES:
        samples = motion_of(source, case).samples
        expected = samples.select(pl.int_range(pl.len(), dtype=pl.UInt32).over("run", "robot")).to_series()
        assert samples["sample"].equals(expected), case.name


def check_stops(source: Source) -> None:
    """A stop lasts as long as the scenario says, in whole periods; samples come no closer than they can."""
    for case in CASES:
        s, samples = case.scenario, motion_of(source, case).samples
        lasting = ticks_of(samples["time_s"], s) - ticks_of(samples["stop_start_s"], s)
        expected = max(math.ceil(s.sample.stop_ms / s.run.control_period_ms), 1)
        assert (lasting == expected).all(), f"{case.name}: stops of {sorted(set(lasting))}, not {expected}"
        spacing = samples.select(pl.col("time_s").diff().over("run", "robot"))["time_s"].drop_nulls()
        least = (s.sample.sample_interval_ms + s.sample.stop_ms) / 1000
        assert spacing.len() == 0 or float(spacing.min()) > least, case.name  # type: ignore[arg-type]


def check_accounts_add_up(source: Source) -> None:
    """drive + turn + avoid + stop is all the time since the robot's last sample, or the start."""
    for case in CASES:
        s = case.scenario
        for _, rows in motion_of(source, case).samples.group_by("run", "robot"):
            spent = sum(ticks_of(rows[f"{kind}_s"], s) for kind in ("drive", "turn", "avoid", "stop"))
            assert (spent == np.diff(ticks_of(rows["time_s"], s), prepend=0)).all(), case.name
            assert (rows["stop_start_s"] <= rows["time_s"]).all(), case.name


def check_whole_runs(source: Source) -> None:
    """A row of ends for each robot, at the scenario's end; samples before it; robots numbered from 0."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            ends = motion.ends.filter(pl.col("run") == run)
            assert ends["robot"].to_list() == list(range(s.swarm.robots)), case.name
            assert (ticks_of(ends["end_s"], s) == s.ticks).all(), case.name
        assert (ticks_of(motion.samples["time_s"], s) < s.ticks).all(), case.name
        assert (motion.samples["robot"] < s.swarm.robots).all(), case.name
        assert motion.samples["run"].is_in(case.runs).all(), case.name


def check_time_accounts(source: Source) -> None:
    """drive + turn + avoid + stop is all the time since the last sample, and is what the segments say."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                ends = ticks_of(rows["time_s"], s)
                spent = {kind: ticks_of(rows[f"{kind}_s"], s) for kind in ("drive", "turn", "avoid", "stop")}
                whole = np.diff(ends, prepend=0)
                assert (sum(spent.values()) == whole).all(), f"{case.name}: time is lost"
                kinds = track.at(np.arange(s.ticks) * s.tick_s)[1]
                for kind, ticks in spent.items():
                    till = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
                    assert (np.diff(till, prepend=0) == ticks).all(), f"{case.name}: {kind}_s, robot {robot}"


def check_segments_join(source: Source) -> None:
    """Each segment ends where the next begins: nobody jumps."""
    for case in CASES:
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                k = np.arange(track.start_s.size - 1)
                gap = track.after(k, np.diff(track.start_s)) - track.pose[1:]
                gap[:, 2] = np.remainder(gap[:, 2] + math.pi, math.tau) - math.pi
                assert np.abs(gap).max(initial=0.0) < NEAR_M, f"{case.name}: robot {robot} jumps"
                assert track.start_s[0] == 0.0


def check_poses_at_samples(source: Source) -> None:
    """The segments put a robot where its sample is, and it stands there since the stop began."""
    for case in CASES:
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                expected = rows.select("x_m", "y_m", "heading_rad").to_numpy()
                assert np.abs(expected[:, 2]).max(initial=0.0) <= math.pi + 1e-12
                for column in ("time_s", "stop_start_s"):
                    pose, kind = track.at(rows[column].to_numpy())
                    gap = pose - expected
                    gap[:, 2] = np.remainder(gap[:, 2] + math.pi, math.tau) - math.pi
                    assert np.abs(gap).max(initial=0.0) < NEAR_M, f"{case.name}: robot {robot}, {column}"
                    assert (kind == "stop").all(), f"{case.name}: robot {robot} does not stand at {column}"
                before = track.at(rows["stop_start_s"].to_numpy() - case.scenario.tick_s)[1]
                assert (before != "stop").all(), f"{case.name}: robot {robot} stood before its stop"


def check_bodies(source: Source) -> None:
    """No two bodies overlap and none leaves the arena, at every control period."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        radius = s.robot.body_radius_m
        for run in case.runs:
            poses, _ = at_all_ticks(motion, s, run)
            x, y = poses[..., 0], poses[..., 1]
            for low, high, size in (
                (x.min(), x.max(), s.arena.width_m),
                (y.min(), y.max(), s.arena.height_m),
            ):
                assert low > radius - NEAR_M, f"{case.name}: a body is {radius - low:.2g} m beyond a wall"
                assert high < size - radius + NEAR_M, f"{case.name}: a body is beyond a wall"
            for i in range(s.swarm.robots - 1):
                apart = np.hypot(x[i + 1 :] - x[i], y[i + 1 :] - y[i]).min()
                assert apart > 2 * radius - NEAR_M, (
                    f"{case.name}: bodies overlap by {2 * radius - apart:.2g} m"
                )


def check_speeds(source: Source) -> None:
    """No wheel turns faster than it can, and a robot that stands does not move; every kind of segment is there."""
    seen: set[str] = set()
    for case in CASES:
        s, segments = case.scenario, motion_of(source, case).segments
        assert segments is not None
        full = s.robot.full_speed_m_s * s.robot.speed_factor_max * (1 + 1e-9)
        uneven = max(abs(s.robot.misalignment_min), abs(s.robot.misalignment_max))
        limits = {
            "drive": (full, 2 * uneven * full / s.robot.drive_track_m),
            "turn": (uneven * full, 2 * full / s.robot.turn_track_m),
            "avoid": (uneven * full, 2 * full / s.robot.turn_track_m),
            "stop": (0.0, 0.0),
        }
        for (kind,), rows in segments.group_by("kind"):
            speed, rate = limits[str(kind)]
            assert rows["speed_m_s"].abs().max() <= speed, f"{case.name}: {kind} is too fast"  # type: ignore[operator]
            assert rows["turn_rate_rad_s"].abs().max() <= rate, f"{case.name}: {kind} turns too fast"  # type: ignore[operator]
        assert segments.filter((pl.col("kind") == "drive") & (pl.col("speed_m_s") < 0.0)).height == 0
        seen |= set(segments["kind"].unique())
    assert seen == {"drive", "turn", "avoid", "stop"}, f"there are only segments of {seen}"


def check_rays(source: Source) -> None:
    """Nobody drives on with a ray shorter than the threshold, and nobody avoids what no ray sees."""
    avoidances = 0
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        threshold_m = s.walk.avoidance_threshold_mm / 1000
        for run in case.runs:
            poses, kinds = at_all_ticks(motion, s, run)
            shortest = shortest_rays_m(s, poses)
            drives = kinds == "drive"
            late = drives & (shortest < threshold_m - 1e-7)
            assert not late.any(), f"{case.name}: {late.sum()} periods driven with a thing in sight"
            begins = (kinds[:, 1:] == "avoid") & np.isin(kinds[:, :-1], ["drive", "turn"])
            avoidances += int(begins.sum())
            early = begins & (shortest[:, 1:] > threshold_m + 1e-7)
            assert not early.any(), f"{case.name}: {early.sum()} avoidances of nothing"
    assert avoidances > 100, f"only {avoidances} avoidances begin"


def check_ends(source: Source) -> None:
    """One row a run and robot, at the scenario's end, where the segments put it; the stop under way."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        assert motion.ends.height == len(case.runs) * s.swarm.robots
        for run in case.runs:
            here = tracks(motion, run)
            for row in motion.ends.filter(pl.col("run") == run).to_dicts():
                where = f"{case.name}: run {run}, robot {row['robot']}"
                assert abs(row["end_s"] - s.ticks * s.tick_s) < 1e-9, where
                track, end = here[row["robot"]], np.array([row["end_s"]])
                last = np.array([track.start_s.size - 1])
                gap = track.after(last, end - track.start_s[last])[0]
                gap -= [row["x_m"], row["y_m"], row["heading_rad"]]
                gap[2] = math.remainder(gap[2], math.tau)
                assert np.abs(gap).max() < NEAR_M, where
                kind, began = track.kind[-1], track.start_s[-1]
                if kind == "stop":
                    assert row["stop_start_s"] is not None, f"{where} stands"
                    assert abs(row["stop_start_s"] - began) < 1e-9, where
                else:
                    assert row["stop_start_s"] is None, f"{where} walks"


def pieces(end_s: float) -> list[float]:
    """Times at which to halt: odd ones, one twice, and between two periods."""
    shares = (0.0, 1e-4, 0.013, 0.013, 0.3001, 0.31, 0.77777, 1.0)
    return [share * end_s for share in shares]


def check_pieces(source: Source) -> None:
    """A run that is advanced in odd pieces is the run of a batch."""
    for case in CASES:
        s = case.scenario
        for run in case.runs:
            state = source.init(s, case.seed, run, segments=True, moves=True)
            assert state.time_s == 0.0
            parts = []
            for until_s in pieces(s.run.t_end_s):
                parts.append(state.advance(until_s))
                assert until_s - 1e-9 <= state.time_s < until_s + s.tick_s
                assert (parts[-1].ends["end_s"] - state.time_s).abs().max() < 1e-9  # type: ignore[operator]
            same(join(parts), part_of(motion_of(source, case), run))


def check_copies(source: Source) -> None:
    """A branch goes on in the same way, whichever goes first, and neither changes the other."""
    case = CASES[2]
    s, run = case.scenario, case.runs[0]
    whole = part_of(motion_of(source, case), run)
    state = source.init(s, case.seed, run, segments=True, moves=True)
    first = state.advance(0.4 * s.run.t_end_s)
    branch = state.copy()
    second_branch = [branch.advance(0.5 * s.run.t_end_s), branch.advance(s.run.t_end_s)]
    assert state.time_s < 0.5 * s.run.t_end_s
    third = state.copy()
    same(join([first, state.advance(s.run.t_end_s)]), whole)
    same(join([first, *second_branch]), whole)
    same(join([first, third.advance(s.run.t_end_s)]), whole)


def check_runs_are_their_own(source: Source) -> None:
    """A run is the same alone, in a batch, and in whatever order; other runs and seeds are different."""
    s = CASES[0].scenario.with_values({"run.t_end_s": 40.0})
    alone = source.batch(s, 4, [7], True)
    for runs in ([7, 2], [2, 7], [0, 1, 2, 7, 9]):
        batch = source.batch(s, 4, runs, True)
        assert sorted(batch.ends["run"].unique()) == sorted(runs)
        same(part_of(batch, 7), alone)
    other_run = source.batch(s, 4, [2], True).samples.drop("run")
    assert not other_run.equals(alone.samples.drop("run")), "two runs are alike"
    assert not source.batch(s, 5, [7], True).samples.equals(alone.samples), "two seeds are alike"
    same(source.batch(s, 4, [7], True), alone)


FOREIGN: dict[str, Any] = {
    "floor.source": "diagonal:0.46",
    "sensor.rms_threshold": 1.55,
    "sensor.still_shape": 3.0,
    "strategy.name": "soft",
    "strategy.soft.eta": 10.0,
    "strategy.soft.kappa": 0.5,
    "decision.decision_boundary": 0.4,
    "decision.credible_threshold": 0.6,
    "decision.min_observations": 3,
    "decision.gate": "own",
    "decision.gate_counts_current": True,
    "decision.revise": True,
    "decision.prior_alpha": 9,
    "network.name": "loss",
    "network.loss.share": 0.4,
    "run.stop": "all_decided",
}
"""Nothing of floor, sensor, messages and decisions; a source moves to the end of the run, whatever is decided."""


def check_nothing_foreign_matters(source: Source) -> None:
    """Motion depends on no field of floor, sensor, strategy, decision or network."""
    s = CASES[0].scenario.with_values({"run.t_end_s": 40.0})
    base = source.batch(s, 4, [1], True)
    for name, value in FOREIGN.items():
        moved = source.batch(s.with_values({name: value}), 4, [1], True)
        try:
            same(moved, base)
        except AssertionError as error:
            raise AssertionError(f"motion depends on {name}: {error}") from None


def check_the_walk_matters(source: Source) -> None:
    """Robots walk as the scenario says."""
    s = CASES[0].scenario.with_values({"run.t_end_s": 40.0})
    other = s.with_values({"walk.walk_duration_location_ms": 100.0})
    assert not source.batch(other, 4, [1]).samples.equals(source.batch(s, 4, [1]).samples)


def check_segments_and_moves_are_only_written_down(source: Source) -> None:
    """Whether they are wanted changes nothing else."""
    case = CASES[2]
    both = motion_of(source, case)
    for segments in (False, True):
        for moves in (False, True):
            some = source.batch(case.scenario, case.seed, case.runs, segments=segments, moves=moves)
            wanted = (both.segments if segments else None, both.moves if moves else None)
            same(some, Motion(both.samples, both.ends, *wanted))


def changes(track: Track, moves: pl.DataFrame) -> tuple[Floats, Floats]:
    """Where a robot begins to do another thing by its segments, s, and where its moves begin.

    By segments alone a turn that follows a turn at once is one with it, and so it is here.
    """
    still = (track.speed == 0.0) & (track.kind != "stop")
    does = np.char.add(track.kind, np.where(still, "-", "+"))
    begins = track.start_s[np.concatenate([[True], does[1:] != does[:-1]])]
    kind, still = np.array(moves["kind"].to_list()), (moves["speed_m_s"] == 0.0).to_numpy()
    does = np.char.add(kind, np.where(still & (kind != "stop"), "-", "+"))
    return begins, moves["start_s"].to_numpy()[np.concatenate([[True], does[1:] != does[:-1]])]


def of_robot(moves: pl.DataFrame | None, run: int, robot: int) -> pl.DataFrame:
    """The moves of a robot in a run."""
    assert moves is not None
    return moves.filter((pl.col("run") == run) & (pl.col("robot") == robot))


def check_moves_begin_where_segments_change(source: Source) -> None:
    """A move begins wherever a robot begins to do another thing, is blocked or is no longer; and nowhere else."""
    followed = 0
    for case in CASES:
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                moves = of_robot(motion.moves, run, robot)
                by_segments, by_moves = changes(track, moves)
                where = f"{case.name}: robot {robot}"
                assert by_segments.size == by_moves.size, (
                    f"{where}: {by_moves.size} moves, not {by_segments.size}"
                )
                assert (by_segments == by_moves).all(), where
                pose, kind = track.at(moves["start_s"].to_numpy())
                gap = pose - moves.select("x_m", "y_m", "heading_rad").to_numpy()
                gap[:, 2] = np.remainder(gap[:, 2] + math.pi, math.tau) - math.pi
                assert np.abs(gap).max() < NEAR_M, f"{where} begins a move elsewhere"
                assert (kind == np.array(moves["kind"].to_list())).all(), where
                followers = kind[~np.isin(moves["start_s"].to_numpy(), by_moves)]
                assert np.isin(followers, ["turn", "avoid"]).all(), (
                    f"{where} begins a move that was under way"
                )
                followed += followers.size
    assert followed > 10, "no turn follows a turn at once"


def check_moves_lead_to_the_next(source: Source) -> None:
    """The arc of a move ends where the next begins, and turned_rad is what was turned, whole turns included."""
    for case in CASES:
        motion = motion_of(source, case)
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                moves = of_robot(motion.moves, run, robot)
                here = pl.col("robot") == robot
                (end,) = motion.ends.filter((pl.col("run") == run) & here).to_dicts()
                start = np.append(moves["start_s"].to_numpy(), end["end_s"])
                pose = moves.select("x_m", "y_m", "heading_rad").to_numpy()
                last = [end["x_m"], end["y_m"], end["heading_rad"]]
                speed, rate = (moves[name].to_numpy() for name in ("speed_m_s", "turn_rate_rad_s"))
                along = Track(start, pose, speed, rate, np.array(moves["kind"].to_list()))
                arrived = along.after(np.arange(moves.height), np.diff(start))
                gap = arrived - np.concatenate([pose[1:], [last]])
                gap[:, 2] = np.remainder(gap[:, 2] + math.pi, math.tau) - math.pi
                where = f"{case.name}: robot {robot}"
                assert np.abs(gap).max() < NEAR_M, f"{where}: a move does not lead to the next"
                turned = moves["turned_rad"].to_numpy()
                # By each segment's own turn rate, which the moves know nothing of.
                sums = np.concatenate([[0.0], np.cumsum(track.rate[:-1] * np.diff(track.start_s))])
                k = np.searchsorted(track.start_s, start, side="right") - 1
                off = np.abs(np.diff(sums[k] + track.rate[k] * (start - track.start_s[k])) - turned)
                assert off.max() < 1e-8, f"{where}: turned {off.max():.2g} rad otherwise"


def check_moves_account_for_time(source: Source) -> None:
    """The moves between two samples last as long as drive_s, turn_s, avoid_s and stop_s say."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        for run in case.runs:
            for robot in range(s.swarm.robots):
                moves = of_robot(motion.moves, run, robot)
                rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
                start = np.append(ticks_of(moves["start_s"], s), s.ticks)
                kinds = np.repeat(np.array(moves["kind"].to_list()), np.diff(start))
                ends = ticks_of(rows["time_s"], s)
                for kind in ("drive", "turn", "avoid", "stop"):
                    till = np.concatenate([[0], np.cumsum(kinds == kind)])[ends]
                    spent = ticks_of(rows[f"{kind}_s"], s)
                    assert (np.diff(till, prepend=0) == spent).all(), f"{case.name}: {kind}_s, robot {robot}"


def check_rays_of_avoidances(source: Source) -> None:
    """The ray of a move is the shortest when an avoidance begins, and null else."""
    seen = 0
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        assert motion.moves is not None
        assert (
            motion.moves.filter(pl.col("kind") != "avoid")["ray_m"].null_count()
            == motion.moves.filter(pl.col("kind") != "avoid").height
        ), case.name
        for run in case.runs:
            shortest = shortest_rays_m(s, at_all_ticks(motion, s, run)[0])
            for robot in range(s.swarm.robots):
                moves = of_robot(motion.moves, run, robot)
                before = moves.select(pl.col("kind").shift(1)).to_series()
                begun = (moves["kind"] == "avoid") & before.is_in(["drive", "turn"])
                assert moves.filter(begun)["ray_m"].null_count() == 0, f"{case.name}: an avoidance of nothing"
                onsets = moves.filter(pl.col("ray_m").is_not_null())
                found = shortest[robot, ticks_of(onsets["start_s"], s)]
                assert np.abs(found - onsets["ray_m"].to_numpy()).max(initial=0.0) < NEAR_M, case.name
                assert (found < s.walk.avoidance_threshold_mm / 1000 + 1e-7).all(), case.name
                seen += onsets.height
    assert seen > 100, f"only {seen} avoidances"


def check_places_from_moves(source: Source) -> None:
    """``place_from_moves`` is exact but in turns, and there within the circle that the centre goes round."""
    far = 0.0
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        uneven = max(abs(s.robot.misalignment_min), abs(s.robot.misalignment_max))
        for run in case.runs:
            for robot, track in tracks(motion, run).items():
                times = np.arange(s.ticks) * s.tick_s
                pose, kinds = track.at(times)
                assert motion.moves is not None
                off = np.hypot(*(place_from_moves(motion.moves, run, robot, times) - pose[:, :2]).T)
                turns = np.isin(kinds, ["turn", "avoid"])
                assert off[~turns].max() < NEAR_M, f"{case.name}: robot {robot}"
                assert off.max() <= uneven * s.robot.turn_track_m + NEAR_M, f"{case.name}: robot {robot}"
                far = max(far, off[turns].max(initial=0.0))
    assert far > 1e-5, "turns at constant rates"


TABLE_CHECKS: tuple[Check, ...] = (
    check_schema,
    check_order,
    check_sample_numbers,
    check_accounts_add_up,
    check_whole_runs,
    check_pieces,
    check_copies,
    check_runs_are_their_own,
    check_nothing_foreign_matters,
    check_segments_and_moves_are_only_written_down,
)
"""For every source."""
SEGMENT_CHECKS: tuple[Check, ...] = (
    check_time_accounts,
    check_segments_join,
    check_poses_at_samples,
    check_bodies,
    check_ends,
)
"""For sources that give segments."""
MOVE_CHECKS: tuple[Check, ...] = (
    check_moves_lead_to_the_next,
    check_moves_account_for_time,
)
"""For sources that give segments and moves."""
WALK_CHECKS: tuple[Check, ...] = (
    check_stops,
    check_speeds,
    check_rays,
    check_the_walk_matters,
    check_moves_begin_where_segments_change,
    check_rays_of_avoidances,
    check_places_from_moves,
)
"""For engines."""
CHECKS = TABLE_CHECKS + SEGMENT_CHECKS + MOVE_CHECKS + WALK_CHECKS
