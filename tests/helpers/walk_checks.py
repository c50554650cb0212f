"""What any source of motion must keep, as check functions that take the source and fail by assertion.

Every source is held to ``MOTION_CHECKS``, which come with the package. What stands here are ``WALK_CHECKS``, for
engines, whose robots walk as the scenario says. Rays are worked out with formulas of their own, so that no engine is
its own judge.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations

import numpy as np
import polars as pl
import pytest

from helpers.motion_runs import RunRows, begun, poses_at_ticks, rows_of
from vibroswarm.core.arrays import Floats
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.pose import poses_of
from vibroswarm.motion.source import Source, moved
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import widest_veer_shift
from vibroswarm.testing.motion import MOTION_CHECKS
from vibroswarm.testing.motion_cases import CASES, Case, Check, motion_of, ticks_of

NEAR = 1e-6


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


def runs_of(source: Source) -> Iterator[tuple[str, Scenario, Floats, pl.DataFrame]]:
    """Each run of all cases: exact poses at all ticks, (robots, ticks, 3), and the poses from its moves."""
    for case in CASES:
        s, motion = case.scenario, motion_of(source, case)
        assert motion.moves is not None
        poses = poses_of(motion.moves, motion.ends, s.run.control_period_ms)
        for run in case.runs:
            exact = poses_at_ticks(source.start, s, case.seed, run)
            yield (
                case.name,
                s,
                exact,
                poses.filter(pl.col("run") == run, pl.col("time_s") < s.ticks * s.tick_s - 1e-9),
            )


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
    """No wheel turns faster than it can, and a robot that stands does not move; every kind of move is there."""
    seen: set[str] = set()
    for case in CASES:
        s, moves = case.scenario, motion_of(source, case).moves
        assert moves is not None
        full = s.robot.full_speed_m_s * s.robot.speed_factor_max * (1 + 1e-9)
        uneven = max(abs(s.robot.misalignment_min), abs(s.robot.misalignment_max)) + widest_veer_shift(s)
        limits = {
            "drive": (full, 2 * uneven * full / s.robot.drive_track_m),
            "turn": (uneven * full, 2 * full / s.robot.turn_track_m),
            "avoid": (uneven * full, 2 * full / s.robot.turn_track_m),
            "stop": (0.0, 0.0),
        }
        for (kind,), rows in moves.group_by("kind"):
            speed, rate = limits[str(kind)]
            assert rows["speed_m_s"].abs().max() <= speed, f"{case.name}: {kind} is too fast"  # type: ignore[operator]
            assert rows["turn_rate_rad_s"].abs().max() <= rate, f"{case.name}: {kind} turns too fast"  # type: ignore[operator]
        seen |= set(moves["kind"].unique())
    assert seen == {"drive", "turn", "avoid", "stop"}, f"there are only moves of {seen}"


def check_rays(source: Source) -> None:
    """Nobody drives on with a ray shorter than the threshold, and nobody avoids what no ray sees."""
    avoidances = 0
    for name, s, poses, table in runs_of(source):
        threshold_m = s.walk.avoidance_threshold_mm / 1000
        kinds = table["kind"].cast(pl.String).to_numpy().reshape(poses.shape[:2])
        shortest = shortest_rays_m(s, poses)
        late = (kinds == "drive") & (shortest < threshold_m - 1e-7)
        assert not late.any(), f"{name}: {late.sum()} periods driven with a thing in sight"
        begins = (kinds[:, 1:] == "avoid") & np.isin(kinds[:, :-1], ["drive", "turn"])
        avoidances += int(begins.sum())
        early = begins & (shortest[:, 1:] > threshold_m + 1e-7)
        assert not early.any(), f"{name}: {early.sum()} avoidances of nothing"
    assert avoidances > 100, f"only {avoidances} avoidances begin"


def check_the_walk_matters(source: Source) -> None:
    """Robots walk as the scenario says."""
    s = CASES[0].scenario.with_values({"run.t_end_s": 40.0})
    other = s.with_values({"walk.walk_duration_location_ms": 100.0})
    assert not moved(source, other, 4, [1]).samples.equals(moved(source, s, 4, [1]).samples)


def check_exact_poses(source: Source) -> None:
    """No two bodies overlap; poses from moves are exact but in turns, and there within the turn's circle."""
    far = 0.0
    for name, s, poses, table in runs_of(source):
        for one, other in combinations(poses[..., :2], 2):
            assert np.hypot(*(other - one).T).min() > 2 * s.robot.body_radius_m - NEAR, name
        uneven = max(abs(s.robot.misalignment_min), abs(s.robot.misalignment_max)) + widest_veer_shift(s)
        off = np.hypot(*(table.select("x_m", "y_m").to_numpy() - poses[..., :2].reshape(-1, 2)).T)
        turns = table["kind"].is_in(["turn", "avoid"]).to_numpy()
        assert off[~turns].max() < NEAR, name
        assert off.max() <= uneven * s.robot.turn_track_m + NEAR, name
        far = max(far, off[turns].max(initial=0.0))
    assert far > 1e-5, "turns at constant rates"


def check_rays_of_avoidances(source: Source) -> None:
    """The ray of a move is the shortest when an avoidance begins, and null else."""
    seen = 0
    for case in CASES:
        s, moves = case.scenario, motion_of(source, case).moves
        assert moves is not None
        for run in case.runs:
            shortest = shortest_rays_m(s, poses_at_ticks(source.start, s, case.seed, run))
            onsets = moves.filter(pl.col("ray_m").is_not_null(), run=run)
            found = shortest[onsets["robot"], ticks_of(onsets["start_s"], s)]
            assert np.abs(found - onsets["ray_m"].to_numpy()).max(initial=0.0) < NEAR, case.name
            assert (found < s.walk.avoidance_threshold_mm / 1000 + 1e-7).all(), case.name
            seen += onsets.height
    assert seen > 100, f"only {seen} avoidances"


WALK_CHECKS: tuple[Check, ...] = (
    check_stops,
    check_speeds,
    check_rays,
    check_the_walk_matters,
    check_exact_poses,
    check_rays_of_avoidances,
)
"""For engines."""
CHECKS = MOTION_CHECKS + WALK_CHECKS
FOUR_RAYS = next(case for case in CASES if len(case.scenario.rays.side_m) == 4)
"""The one case for which engines are compiled again, since their kernels are made for a number of rays."""
OF_THREE_RAYS = tuple(case for case in CASES if case is not FOUR_RAYS)


def check_in(cases: tuple[Case, ...], check: Check, source: Source) -> None:
    """Run a check in these cases instead of all."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("helpers.walk_checks", "vibroswarm.testing.motion"):
            patch.setattr(f"{module}.CASES", cases)
        check(source)


def assert_same_rows(one: RunRows, other: RunRows) -> None:
    """The same events at the same ticks; places, angles, speeds and rays to a micrometre and the like."""
    for part in ("samples", "moves", "ends"):
        mine, theirs = getattr(one, part), getattr(other, part)
        assert mine.size == theirs.size, part
        for name in mine.dtype.names:
            a, b = (
                np.exp(1j * rows[name]) if name == "heading_rad" else rows[name] for rows in (mine, theirs)
            )
            micro = 0.0 if a.dtype.kind in "iu" else 1e-6
            np.testing.assert_allclose(a, b, rtol=0, atol=micro, err_msg=f"{part}: {name}")


def assert_engines_agree(scenario: Scenario, seed: int, runs: Iterable[int] = (0,)) -> None:
    """The event engine's runs are those of the fixed-step engine, to the end."""
    for run in runs:
        assert_same_rows(
            *(rows_of(begun(engine, scenario, seed, run, moves=True)) for engine in (FixedStepRun, EventRun))
        )
