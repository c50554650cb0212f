"""Each source of Motion keeps the contract, and the suite rejects engines that do not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import polars as pl
import pytest

import helpers.walk_checks as suite
from helpers.walk_checks import (
    CASES,
    CHECKS,
    FOUR_RAYS,
    OF_THREE_RAYS,
    TABLE_CHECKS,
    Check,
    check_in,
    motion_of,
)
from vibroswarm.motion.event.event_run import EVENT
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.source import Motion, MotionState, Source
from vibroswarm.robot.walk import TIMERS
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion_cases import same

SOURCES = (FIXED_STEP, EVENT)
"""Every engine that is a source goes here."""
GOOD = FIXED_STEP


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("engine", SOURCES, ids=lambda engine: engine.name)
def test_source_keeps_the_contract(engine: Source, check: Check) -> None:
    check_in(OF_THREE_RAYS, check, engine)


@pytest.mark.slow
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("engine", SOURCES, ids=lambda engine: engine.name)
def test_source_keeps_the_contract_with_four_rays(engine: Source, check: Check) -> None:
    """Slow, as both engines are compiled for four rays."""
    check_in((CASES[0], FOUR_RAYS), check, engine)


@pytest.mark.slow
def test_the_cases_hold_what_they_should() -> None:
    """Every kind of segment, blocked moves, interrupted avoidances: else a check might look at nothing."""
    kinds, blocked = set(), 0
    for case in CASES:
        segments = motion_of(GOOD, case).segments
        assert segments is not None
        kinds |= set(segments["kind"].unique())
        blocked += segments.filter((pl.col("kind") == "drive") & (pl.col("speed_m_s") == 0.0)).height
    assert kinds == {"drive", "turn", "avoid", "stop"}
    assert blocked > 20
    assert {case.scenario.sample.timer for case in CASES} == set(TIMERS)


# Broken engines: the real one, with one thing spoilt.

Spoil = Callable[[Motion], Motion]
Twist = Callable[[Scenario], Scenario]


@dataclass
class SpoiltState:
    """A run of a broken engine."""

    state: MotionState
    spoil: Spoil

    @property
    def time_s(self) -> float:
        return self.state.time_s

    def advance(self, until_s: float) -> Motion:
        return self.spoil(self.state.advance(until_s))

    def copy(self) -> MotionState:
        return SpoiltState(self.state.copy(), self.spoil)


def broken(name: str, spoil: Spoil = lambda m: m, twist: Twist = lambda s: s) -> Source:
    """The real engine under another scenario, or with its tables spoilt."""
    real = GOOD

    def init(scenario: Scenario, seed: int, run: int, **wanted: bool) -> MotionState:
        return SpoiltState(real.init(twist(scenario), seed, run, **wanted), spoil)

    def batch(scenario: Scenario, seed: int, runs: Sequence[int], *some: bool, **wanted: bool) -> Motion:
        return spoil(real.batch(twist(scenario), seed, runs, *some, **wanted))

    return Source(name, init, batch)


def changed(**values: Any) -> Twist:
    return lambda scenario: scenario.with_values({k.replace("__", "."): v for k, v in values.items()})


def samples(*columns: pl.Expr) -> Spoil:
    return lambda motion: replace(motion, samples=motion.samples.with_columns(*columns))


def shifted_late(motion: Motion) -> Motion:
    """Everybody ten micrometres to the right from 20 s on, in all tables alike."""

    def shift(frame: pl.DataFrame, time: str) -> pl.DataFrame:
        return frame.with_columns(x_m=pl.col("x_m") + pl.when(pl.col(time) > 20).then(1e-5).otherwise(0.0))

    segments, moves = (
        shift(frame, "start_s") if frame is not None else None for frame in (motion.segments, motion.moves)
    )
    return Motion(shift(motion.samples, "time_s"), shift(motion.ends, "end_s"), segments, moves)


def numbered_by_place() -> Source:
    """Draws follow the place in the batch, not the number of the run."""
    real = GOOD

    def batch(scenario: Scenario, seed: int, runs: Sequence[int], *some: bool, **wanted: bool) -> Motion:
        moved = real.batch(scenario, seed, range(len(runs)), *some, **wanted)
        names = pl.col("run").replace_strict(dict(enumerate(runs)), return_dtype=pl.UInt32)
        tables = (moved.samples, moved.ends, moved.segments, moved.moves)
        return Motion(*(t.with_columns(names) if t is not None else None for t in tables))  # type: ignore[arg-type]

    return Source("draws by place in the batch", real.init, batch)


def swayed_by_the_strategy() -> Source:
    real = GOOD

    def batch(scenario: Scenario, seed: int, runs: Sequence[int], *some: bool, **wanted: bool) -> Motion:
        return real.batch(scenario, seed + (scenario.strategy.name == "soft"), runs, *some, **wanted)

    return Source("swayed by the strategy", real.init, batch)


def paced_by_the_end(scenario: Scenario) -> Scenario:
    """Drives the slower the longer the run is."""
    share = 50.0 / (50.0 + scenario.run.t_end_s)
    return scenario.with_values({"robot.speed_factor_location": share * scenario.robot.speed_factor_location})


@dataclass
class Shared:
    """A run whose copies are itself."""

    state: MotionState

    @property
    def time_s(self) -> float:
        return self.state.time_s

    def advance(self, until_s: float) -> Motion:
        return self.state.advance(until_s)

    def copy(self) -> MotionState:
        return self


def sharing() -> Source:
    real = GOOD
    return Source("copies that share", lambda *args, **more: Shared(real.init(*args, **more)), real.batch)


def fresh_pieces() -> Source:
    """Forgets which samples it has given: gives the whole past with every piece."""
    real = GOOD

    @dataclass
    class Forgetful:
        args: tuple[Scenario, int, int]
        wanted: dict[str, bool]
        time_s: float = 0.0

        def advance(self, until_s: float) -> Motion:
            state = real.init(*self.args, **self.wanted)
            moved = state.advance(until_s)
            self.time_s = state.time_s
            return moved

        def copy(self) -> MotionState:
            return Forgetful(self.args, self.wanted, self.time_s)

    return Source("gives the past again", lambda *args, **wanted: Forgetful(args, wanted), real.batch)


def late_eyes(scenario: Scenario) -> Scenario:
    """Sees a thing about one period later than it should: half a millimetre nearer."""
    return scenario.with_values({"walk.avoidance_threshold_mm": scenario.walk.avoidance_threshold_mm - 0.5})


def keen_eyes(scenario: Scenario) -> Scenario:
    return scenario.with_values({"walk.avoidance_threshold_mm": scenario.walk.avoidance_threshold_mm + 0.5})


def slim(scenario: Scenario) -> Scenario:
    return scenario.with_values({"robot.body_radius_m": 0.0145})


def segments(*columns: pl.Expr) -> Spoil:
    def spoil(motion: Motion) -> Motion:
        return replace(
            motion, segments=motion.segments.with_columns(*columns) if motion.segments is not None else None
        )

    return spoil


def moves(*columns: pl.Expr) -> Spoil:
    def spoil(motion: Motion) -> Motion:
        return replace(
            motion, moves=motion.moves.with_columns(*columns) if motion.moves is not None else None
        )

    return spoil


def without_a_move(motion: Motion) -> Motion:
    """Each robot's twentieth move is lacking."""
    if motion.moves is None:
        return motion
    number = pl.int_range(pl.len()).over("run", "robot")
    return replace(motion, moves=motion.moves.filter(number != 19))


def without_some_samples(motion: Motion) -> Motion:
    return replace(motion, samples=motion.samples.filter(pl.col("sample") != 3))


def unsorted(motion: Motion) -> Motion:
    return replace(motion, samples=motion.samples.sort("run", "robot", "sample"))


def restless(motion: Motion) -> Motion:
    """Ends that know of no stop."""
    return replace(motion, ends=motion.ends.with_columns(stop_start_s=pl.lit(None, pl.Float64)))


def renamed(motion: Motion) -> Motion:
    return replace(motion, samples=motion.samples.cast({"sample": pl.UInt64}))


def crossed_eyes(scenario: Scenario) -> Scenario:
    return scenario.with_values({"rays.angle_deg": [-angle for angle in scenario.rays.angle_deg]})


def hasty_stops(scenario: Scenario) -> Scenario:
    return scenario.with_values({"sample.stop_ms": scenario.sample.stop_ms - scenario.run.control_period_ms})


def early_end(scenario: Scenario) -> Scenario:
    return scenario.with_values({"run.t_end_s": scenario.run.t_end_s - scenario.tick_s})


LOST = pl.when(pl.col("sample") == 2).then(0.02).otherwise(0.0).cast(pl.Float32)
EXCHANGED = (pl.col("turn_s").alias("avoid_s"), pl.col("avoid_s").alias("turn_s"))
RACING = changed(robot__speed_factor_max=1.6, robot__speed_factor_location=1.2)

BROKEN: list[tuple[Source, Check]] = [
    (broken("bodies overlap", twist=slim), suite.check_bodies),
    (broken("rays see late", twist=late_eyes), suite.check_rays),
    (broken("rays see early", twist=keen_eyes), suite.check_rays),
    (broken("eyes crossed", twist=crossed_eyes), suite.check_rays),
    (numbered_by_place(), suite.check_runs_are_their_own),
    (swayed_by_the_strategy(), suite.check_nothing_foreign_matters),
    (sharing(), suite.check_copies),
    (fresh_pieces(), suite.check_pieces),
    (broken("paced by the end", twist=paced_by_the_end), suite.check_beginnings),
    (broken("teleports", shifted_late), suite.check_segments_join),
    (broken("drifts", segments(pl.col("turn_rate_rad_s") + 1e-4)), suite.check_segments_join),
    (broken("hasty stops", twist=hasty_stops), suite.check_stops),
    (broken("hasty timer", twist=changed(sample__sample_interval_ms=100.0)), suite.check_stops),
    (broken("races", twist=RACING), suite.check_speeds),
    (broken("lost time", samples(pl.col("drive_s") + LOST)), suite.check_time_accounts),
    (broken("confused time", samples(*EXCHANGED)), suite.check_time_accounts),
    (
        broken("avoids as turns", segments(pl.col("kind").replace({"avoid": "turn"}))),
        suite.check_time_accounts,
    ),
    (broken("a move lacks", without_a_move), suite.check_moves_begin_where_segments_change),
    (broken("a move lacks too", without_a_move), suite.check_moves_lead_to_the_next),
    (broken("a move lacks again", without_a_move), suite.check_moves_account_for_time),
    (broken("turned less", moves(pl.col("turned_rad") * (1 - 1e-6))), suite.check_moves_lead_to_the_next),
    (broken("faster moves", moves(pl.col("speed_m_s") * (1 + 1e-5))), suite.check_moves_lead_to_the_next),
    (broken("rays by the way", moves(pl.col("ray_m") + 1e-6)), suite.check_rays_of_avoidances),
    (broken("rays of all moves", moves(pl.col("ray_m").fill_null(0.1))), suite.check_rays_of_moves),
    (broken("no rays", moves(pl.lit(None, pl.Float64).alias("ray_m"))), suite.check_rays_of_moves),
    (broken("never blocked", moves(pl.lit(0.05).alias("speed_m_s"))), suite.check_places_from_moves),
    (broken("misplaced samples", samples(pl.col("x_m") + 1e-8)), suite.check_poses_at_samples),
    (broken("turned round", samples(pl.col("heading_rad") + 7.0)), suite.check_places),
    (broken("stood for ever", samples(pl.col("stop_start_s") - 1e6)), suite.check_places),
    (broken("misnumbered", samples(pl.col("sample") + 1)), suite.check_sample_numbers),
    (broken("lost samples", without_some_samples), suite.check_sample_numbers),
    (broken("unsorted", unsorted), suite.check_order),
    (broken("other types", renamed), suite.check_schema),
    (broken("no stop at the end", restless), suite.check_ends),
    (broken("ends a period early", twist=early_end), suite.check_ends),
]


@pytest.mark.parametrize(("engine", "check"), BROKEN, ids=[engine.name for engine, _ in BROKEN])
def test_the_suite_rejects_a_broken_engine(engine: Source, check: Check) -> None:
    with pytest.raises(AssertionError):
        check_in(OF_THREE_RAYS, check, engine)


@pytest.mark.slow
def test_the_wrapper_alone_breaks_nothing() -> None:
    """Its tables are the engine's, of which all checks hold; those that run it in other ways are made of it too."""
    unbroken = broken("unbroken")
    for case in CASES:
        same(motion_of(unbroken, case), motion_of(GOOD, case), case.name)
    for check in (*TABLE_CHECKS, suite.check_the_walk_matters):
        check(unbroken)
