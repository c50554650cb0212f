"""The robot's program, by hand-made steps, and on one robot with no wall near."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.typing import NDArray
from scipy import stats

from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.robot_params import walk_program
from vibroswarm.motion.source import moved as simulated
from vibroswarm.robot.walk import (
    ALWAYS,
    AVOID,
    DRIVE,
    FROZEN_IN_AVOIDANCE,
    HELD_AT_AVOIDANCE,
    HOLD_IN_TURN,
    RESET_AFTER_TURN,
    RESET_AT_AVOIDANCE,
    STOP,
    TURN,
    Dice,
    WalkState,
    begin_walk,
    leg_duration_ms,
    turn_angle_deg,
    turn_command_percent,
    walk_step,
    wheel_commands_percent,
)
from vibroswarm.scenario.scenario import Scenario

PROGRAM = walk_program(Scenario())
DICE = Dice(0.5, 0.75, 0.25)
WALKING = WalkState(
    mode=DRIVE,
    resume=DRIVE,
    sampled=False,
    leg_ms=10_000.0,
    driven_ms=2000,
    timer_ms=1000,
    stopped_ms=1000,
    error_deg=0.0,
    integral_deg_s=0.0,
    legs=3,
    avoidances=2,
    samples=7,
    next_leg_ms=math.nan,
)
FAR = math.inf
MODES = (RESET_AFTER_TURN, HOLD_IN_TURN, ALWAYS, FROZEN_IN_AVOIDANCE, RESET_AT_AVOIDANCE, HELD_AT_AVOIDANCE)

OPEN: dict[str, Any] = {
    "arena.width_m": 1000.0,
    "arena.height_m": 1000.0,
    "swarm.start_margin_m": 499.0,
    "swarm.robots": 1,
    "robot.speed_factor_min": 1.0,
    "robot.speed_factor_max": 1.0,
    "robot.misalignment_min": 0.0,
    "robot.misalignment_max": 0.0,
    "robot.battery_life_s": 1e12,
}
"""One even robot with no wall within 400 m."""


def moved(runs: int = 1, seed: int = 2, **changes: Any) -> Motion:
    values = OPEN | {name.replace("__", "."): value for name, value in changes.items()}
    return simulated(FIXED_STEP, Scenario().with_values(values), seed, range(runs), moves=True)


# Steps by hand


def test_it_stands_at_the_start_and_then_drives() -> None:
    state = begin_walk(PROGRAM, DICE)
    assert (state.mode, state.sampled, state.samples, state.legs) == (STOP, True, 0, 1)
    assert state.leg_ms == pytest.approx(7860.0)
    after = walk_step(state, PROGRAM, 0.0, FAR, DICE)
    assert (after.mode, after.timer_ms, after.driven_ms) == (DRIVE, 20, 20)


def test_driving_counts_leg_and_timer() -> None:
    after = walk_step(WALKING, PROGRAM, 0.3, FAR, DICE)
    assert after == WALKING._replace(driven_ms=2020, timer_ms=1020)


def test_a_leg_ends_when_its_time_is_driven() -> None:
    short = WALKING._replace(driven_ms=9980)
    assert walk_step(short, PROGRAM, 0.0, FAR, DICE).mode == DRIVE
    after = walk_step(short._replace(driven_ms=10_000), PROGRAM, 0.0, FAR, DICE)
    assert (after.mode, after.error_deg, after.driven_ms) == (TURN, 90.0, 10_000)
    assert after.integral_deg_s == pytest.approx(1.8)
    assert (after.legs, after.timer_ms) == (3, 1000)


def test_the_end_of_a_leg_goes_before_an_obstacle() -> None:
    after = walk_step(WALKING._replace(driven_ms=10_000), PROGRAM, 0.0, 1.0, DICE)
    assert (after.mode, after.avoidances) == (TURN, 2)


def test_an_obstacle_nearer_than_the_threshold_is_avoided() -> None:
    assert walk_step(WALKING, PROGRAM, 0.0, 55.0, DICE).mode == DRIVE
    after = walk_step(WALKING, PROGRAM, 0.0, float(np.nextafter(55.0, 0)), DICE)
    assert (after.mode, after.error_deg, after.avoidances) == (AVOID, -90.0, 3)
    assert (after.leg_ms, after.driven_ms, after.legs) == (10_000.0, 2000, 3)
    assert after.timer_ms == 1020


def test_after_avoiding_the_same_leg_goes_on() -> None:
    avoiding = WALKING._replace(mode=AVOID, error_deg=4.0, integral_deg_s=1.0)
    after = walk_step(avoiding, PROGRAM, 1.5, FAR, DICE)  # 2.5 degrees are left: done
    assert (after.mode, after.leg_ms, after.driven_ms, after.legs) == (DRIVE, 10_000.0, 2020, 3)
    still = walk_step(avoiding, PROGRAM, 1.4, FAR, DICE)
    assert still.mode == AVOID
    assert still.error_deg == pytest.approx(2.6)
    blocked = walk_step(avoiding, PROGRAM, 1.5, 10.0, DICE)  # turned, and again something is there
    assert (blocked.mode, blocked.avoidances) == (AVOID, 3)


def test_after_a_turn_a_new_leg_begins() -> None:
    turning = WALKING._replace(mode=TURN, error_deg=-2.0, driven_ms=10_000)
    after = walk_step(turning, PROGRAM, 0.0, FAR, DICE)
    assert (after.mode, after.leg_ms, after.driven_ms, after.legs) == (DRIVE, pytest.approx(7860.0), 20, 4)


@pytest.mark.parametrize("timer", MODES)
def test_the_timer(timer: int) -> None:
    """By its mode: in a turn, at the end of one, in an avoidance, at the end of one."""
    program = PROGRAM._replace(timer=timer)

    def timer_after(mode: int, error_deg: float) -> int:
        return walk_step(WALKING._replace(mode=mode, error_deg=error_deg), program, 2.0, FAR, DICE).timer_ms

    in_turn, turned = timer_after(TURN, 90.0), timer_after(TURN, 3.0)
    avoiding, avoided = timer_after(AVOID, 90.0), timer_after(AVOID, 3.0)
    expected = {
        RESET_AFTER_TURN: (1000, 20, 1020, 1020),
        HOLD_IN_TURN: (1000, 1020, 1020, 1020),
        ALWAYS: (1020, 1020, 1020, 1020),
        FROZEN_IN_AVOIDANCE: (1000, 20, 1000, 1020),
        RESET_AT_AVOIDANCE: (1000, 20, 1020, 1020),
        # In an avoidance that has begun by this rule the timer is at 0 already (the next two tests).
        HELD_AT_AVOIDANCE: (1000, 20, 1000, 1020),
    }
    assert (in_turn, turned, avoiding, avoided) == expected[timer]


def test_a_sample_is_due_when_the_timer_is_past_the_interval() -> None:
    program = PROGRAM._replace(sample_interval_ms=2000.0)
    assert walk_step(WALKING._replace(timer_ms=2000), program, 0.0, FAR, DICE).mode == DRIVE
    stopped = walk_step(WALKING._replace(timer_ms=2020), program, 0.0, FAR, DICE)
    assert (stopped.mode, stopped.sampled, stopped.stopped_ms, stopped.resume) == (STOP, False, 0, DRIVE)
    steps, state = 0, stopped
    while not state.sampled:
        state = walk_step(state, program, 0.0, 0.0, DICE)
        assert wheel_commands_percent(state, program) == (0.0, 0.0)
        steps += 1
    assert (steps, state.samples) == (50, 8)
    after = walk_step(state, program, 0.0, FAR, DICE)
    assert (after.mode, after.timer_ms, after.driven_ms) == (DRIVE, 20, 2020)


def test_a_sample_interrupts_an_avoidance_that_goes_on_after_it() -> None:
    avoiding = WALKING._replace(mode=AVOID, error_deg=80.0, integral_deg_s=3.0, timer_ms=4000)
    state = walk_step(avoiding, PROGRAM, 2.0, FAR, DICE)
    assert (state.mode, state.resume, state.error_deg) == (STOP, AVOID, 78.0)
    while not state.sampled:
        state = walk_step(state, PROGRAM, 0.0, FAR, DICE)
    after = walk_step(state, PROGRAM, 0.0, FAR, DICE)
    assert (after.mode, after.error_deg, after.avoidances) == (AVOID, 78.0, 2)
    assert after.integral_deg_s == pytest.approx(3.0 + 78.0 * 0.02)


def test_the_turn_command() -> None:
    def command(error: float, integral: float) -> float:
        state = WALKING._replace(mode=TURN, error_deg=error, integral_deg_s=integral)
        left, right = wheel_commands_percent(state, PROGRAM)
        assert right == -left == turn_command_percent(state, PROGRAM)
        return float(right)

    assert command(10.0, 4.0) == pytest.approx(25.6)
    assert command(-10.0, -4.0) == pytest.approx(-25.6)
    assert command(41.0, 0.0) == 100.0
    assert command(-170.0, -9.0) == -100.0
    assert wheel_commands_percent(WALKING, PROGRAM) == (100.0, 100.0)


# Times and angles against scipy


def test_exponential_leg_times_are_quantiles_of_a_clipped_exponential() -> None:
    program = PROGRAM._replace(is_exponential=True)
    for u in np.r_[2.0**-53, np.linspace(0.0005, 0.9995, 400), 1 - 2.0**-53]:
        expected = float(np.clip(stats.expon.ppf(u, 7860.0, 10725.0), 1000.0, 30_000.0))
        assert leg_duration_ms(program, float(u)) == pytest.approx(expected, rel=1e-11)


def test_turns_are_even_between_the_ends() -> None:
    for u in (0.0, 0.25, 0.5, 0.9, 1.0):
        assert turn_angle_deg(PROGRAM, u) == pytest.approx(float(stats.uniform.ppf(u, -180.0, 360.0)))
        assert turn_angle_deg(PROGRAM._replace(turn_max_deg=90.0), u) == pytest.approx(180 * u - 90)


# One robot, no walls


@pytest.mark.parametrize(
    ("interval_ms", "stop_ms", "spacing_s"),
    [
        (2000.0, 1000.0, 3.04),
        (3778.0, 1000.0, 4.80),
        (500.0, 1000.0, 1.54),
        (2000.0, 0.0, 2.06),
        (10.0, 990.0, 1.04),
    ],
)
def test_undisturbed_samples_are_evenly_spaced(interval_ms: float, stop_ms: float, spacing_s: float) -> None:
    """The timer passes tau at the next full period, the stop begins one later: 3.04 s for tau = 2 s."""
    motion = moved(
        walk__leg_min_ms=1e9,
        walk__leg_max_ms=1e9,
        sample__sample_interval_ms=interval_ms,
        sample__stop_ms=stop_ms,
        run__t_end_s=200.0,
    )
    times = np.r_[0.0, motion.samples["time_s"].to_numpy()]
    np.testing.assert_allclose(np.diff(times), spacing_s, atol=1e-9)
    assert times.size == 1 + math.floor((200.0 - 0.02) / spacing_s + 1e-9)
    stops = (motion.samples["time_s"] - motion.samples["stop_start_s"]).to_numpy()
    np.testing.assert_allclose(stops, max(math.ceil(stop_ms / 20), 1) * 0.02, atol=1e-9)


def legs_and_turns(motion: Motion, run: int) -> list[tuple[str, float, float, float]]:
    """(kind, duration s, angle turned rad, displacement m) of each leg and each turn that is complete."""
    assert motion.moves is not None
    rows = motion.moves.filter((pl.col("run") == run) & (pl.col("kind") != "stop")).with_columns(
        group=pl.col("kind").rle_id()
    )
    columns = [rows[name].to_numpy() for name in ("start_s", "x_m", "y_m", "heading_rad")]
    starts = np.flatnonzero(np.r_[True, np.diff(rows["group"].to_numpy()) != 0])
    kinds = rows["kind"].to_list()
    found = []
    for one, two in pairwise(starts):
        start_s, x, y, heading = ([c[one], c[two]] for c in columns)
        headings = np.unwrap(columns[3][one : two + 1])
        turned = float(headings[-1] - headings[0])
        away = math.hypot(x[1] - x[0], y[1] - y[0])
        found.append((kinds[one], float(start_s[1] - start_s[0]), turned, away))
        assert abs(math.remainder(heading[1] - heading[0] - turned, math.tau)) < 1e-9
    return found


@pytest.fixture(scope="module")
def undisturbed() -> Motion:
    return moved(runs=40, sample__sample_interval_ms=1e9, run__t_end_s=600.0)


def expected_leg_ticks(run: int, count: int, seed: int = 2) -> NDArray[np.float64]:
    """Whole periods of the clipped Cauchy's quantiles at the numbers of this run."""
    u = uniforms(seed, run, 0, Purpose.WALK, 2 * count)[0::2]
    return np.ceil(np.clip(stats.cauchy.ppf(u, 7860.0, 10725.0), 1000.0, 30_000.0) / 20 - 1e-9)


def test_each_leg_lasts_its_number(undisturbed: Motion) -> None:
    total = 0
    for run in range(40):
        driven = [d for kind, d, _, _ in legs_and_turns(undisturbed, run) if kind == "drive"]
        ticks = np.rint(np.array(driven) / 0.02)
        assert ticks.tolist() == expected_leg_ticks(run, len(driven)).tolist()
        total += len(driven)
    assert total > 1000


def test_turns_end_within_the_tolerance(undisturbed: Motion) -> None:
    residues = []
    for run in range(40):
        turns = [turned for kind, _, turned, _ in legs_and_turns(undisturbed, run) if kind == "turn"]
        wanted = 360.0 * uniforms(2, run, 0, Purpose.WALK, 2 * len(turns))[1::2] - 180.0
        residues.extend(wanted - np.degrees(turns))
    # One period of a full turn is 2.7 degrees: an angle may be within the tolerance only after it.
    assert max(abs(r) for r in residues) <= 2.5 + 1e-9
    assert max(abs(r) for r in residues) > 2.0  # and not nearer than it must be


def test_misalignment_speed_and_battery_scale_a_turn_too() -> None:
    motion = moved(
        robot__misalignment_min=0.08, robot__misalignment_max=0.08, robot__speed_factor_min=1.2,
        robot__speed_factor_max=1.2, robot__battery_life_s=8400.0, sample__sample_interval_ms=3000.0,
        run__t_end_s=600.0,
    )  # fmt: skip
    assert motion.moves is not None
    samples = np.r_[0.0, motion.samples["time_s"].to_numpy()]
    rows = motion.moves.filter(pl.col("kind") != "stop")
    # Read at the latest sample before (a period begun at a sample's own tick is the first with the new one).
    latest = samples[np.searchsorted(samples, rows["start_s"].to_numpy() + 1e-9) - 1]
    full = 0.0549 * 1.2 * (1 - latest / 8400.0)
    drive = (rows["kind"] == "drive").to_numpy()
    np.testing.assert_allclose(rows["speed_m_s"].to_numpy()[drive], full[drive], rtol=1e-12)
    turning = rows["turn_rate_rad_s"].to_numpy()
    np.testing.assert_allclose(turning[drive], 2 * 0.08 * full[drive] / 0.0394, rtol=1e-12)
    share = turning * 0.046 / (2 * full)  # mean command of the turn, 1 at most
    assert 0.8 < np.abs(share[~drive]).max() < 1.0
    np.testing.assert_allclose(
        rows["speed_m_s"].to_numpy()[~drive], (0.08 * share * full)[~drive], rtol=1e-9, atol=1e-15
    )
