"""What any source of Motion must keep, as check functions that take the source and fail by assertion.

Every source is held to ``TABLE_CHECKS``, by ``for check in TABLE_CHECKS: check(source)``; one that gives segments also
to ``SEGMENT_CHECKS``, and one that gives moves as well to ``MOVE_CHECKS``: these come with the package. What stands
here are ``WALK_CHECKS``, for engines, whose robots walk as the scenario says. Poses and rays are worked out from the
segment table alone, with formulas of their own, so that no engine is its own judge.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import polars as pl
import pytest

from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.pose import place_from_moves
from vibroswarm.motion.recorder import Rows
from vibroswarm.motion.source import Source
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import widest_veer_shift
from vibroswarm.testing.motion import (
    MOVE_CHECKS,
    NEAR_M,
    SEGMENT_CHECKS,
    Floats,
    Track,
    at_all_ticks,
    robots_of,
    tracks,
)
from vibroswarm.testing.motion_cases import CASES, Case, Check, motion_of, ticks_of
from vibroswarm.testing.motion_tables import TABLE_CHECKS


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


def check_speeds(source: Source) -> None:
    """No wheel turns faster than it can, and a robot that stands does not move; every kind of segment is there."""
    seen: set[str] = set()
    for case in CASES:
        s, segments = case.scenario, motion_of(source, case).segments
        assert segments is not None
        full = s.robot.full_speed_m_s * s.robot.speed_factor_max * (1 + 1e-9)
        uneven = max(abs(s.robot.misalignment_min), abs(s.robot.misalignment_max)) + widest_veer_shift(s)
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


def check_the_walk_matters(source: Source) -> None:
    """Robots walk as the scenario says."""
    s = CASES[0].scenario.with_values({"run.t_end_s": 40.0})
    other = s.with_values({"walk.walk_duration_location_ms": 100.0})
    assert not source.batch(other, 4, [1]).samples.equals(source.batch(s, 4, [1]).samples)


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


def check_moves_begin_where_segments_change(source: Source) -> None:
    """A move begins wherever a robot begins to do another thing, is blocked or is no longer; and nowhere else."""
    followed = 0
    for one in robots_of(source):
        moves, where = one.motion.moves.filter(one.own), one.label
        by_segments, by_moves = changes(one.track, moves)
        assert by_segments.size == by_moves.size, f"{where}: {by_moves.size} moves, not {by_segments.size}"
        assert (by_segments == by_moves).all(), where
        kind = np.array(moves["kind"].to_list())
        followers = kind[~np.isin(moves["start_s"].to_numpy(), by_moves)]
        assert np.isin(followers, ["turn", "avoid"]).all(), f"{where} begins a move that was under way"
        followed += followers.size
    assert followed > 10, "no turn follows a turn at once"


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
                moves = motion.moves.filter((pl.col("run") == run) & (pl.col("robot") == robot))
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
        uneven = max(abs(s.robot.misalignment_min), abs(s.robot.misalignment_max)) + widest_veer_shift(s)
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
FOUR_RAYS = next(case for case in CASES if len(case.scenario.rays.side_m) == 4)
"""The one case for which engines are compiled again, since their kernels are made for a number of rays."""
OF_THREE_RAYS = tuple(case for case in CASES if case is not FOUR_RAYS)
MODULES_OF_CASES = ("helpers.walk_checks", "vibroswarm.testing.motion", "vibroswarm.testing.motion_tables")
"""Modules whose checks go through ``CASES``."""


def check_in(cases: tuple[Case, ...], check: Check, source: Source) -> None:
    """Run a check in these cases instead of all."""
    with pytest.MonkeyPatch.context() as patch:
        for module in MODULES_OF_CASES:
            patch.setattr(f"{module}.CASES", cases)
        check(source)


def assert_same_rows(one: Rows, other: Rows) -> None:
    """The same events at the same ticks; places, angles, speeds and rays to a micrometre and the like."""
    for part in ("samples", "segments", "moves", "ends"):
        mine, theirs = getattr(one, part), getattr(other, part)
        assert (mine is None) == (theirs is None)
        if mine is None:
            continue
        assert mine.size == theirs.size, part
        for name in mine.dtype.names:
            a, b = (
                np.exp(1j * rows[name]) if name == "heading_rad" else rows[name] for rows in (mine, theirs)
            )
            micro = 0.0 if a.dtype.kind in "iu" else 1e-6
            np.testing.assert_allclose(a, b, rtol=0, atol=micro, err_msg=f"{part}: {name}")


def assert_engines_agree(
    scenario: Scenario, seed: int, runs: Iterable[int] = (0,), *, segments: bool = False
) -> None:
    """The event engine's runs are those of the fixed-step engine, to the end."""
    for run in runs:
        stepped, jumped = (
            engine(scenario, seed, run, segments=segments, moves=True).rows(scenario.run.t_end_s)
            for engine in (FixedStepRun, EventRun)
        )
        assert_same_rows(stepped, jumped)
