"""The random walk: drive, turn at the end of a leg, avoid what the rays see, stop to sample.

| name | symbol | unit | equation |
|---|---|---|---|
| leg | T_r | ms | Cauchy(gamma_0, gamma), clipped |
| turn | phi | deg | U(-turn_max, turn_max) |
| error | e | deg | angle still to turn, by the gyro |
| integral | - | deg s | sum of e dt |
| command | - | % of full | 2.5 e + 0.15 integral, clipped to +-100 |
| timer | t - t_s | ms | counts towards tau |

The clock counts whole control periods ("ticks"). A step is called once per tick and determines what the robot does
until the next one; a tick on which ``sampled`` is true is the one at which the sample is taken, and the
robot still stands.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vibroswarm.core.jit import inlined, kernel

DRIVE: Final = 0
TURN: Final = 1
AVOID: Final = 2
STOP: Final = 3
KINDS: Final = ("drive", "turn", "avoid", "stop")

RESET_AFTER_TURN: Final = 0
HOLD_IN_TURN: Final = 1
ALWAYS: Final = 2
FROZEN_IN_AVOIDANCE: Final = 3
RESET_AT_AVOIDANCE: Final = 4
TIMERS: Final = ("reset_after_turn", "hold_in_turn", "always", "frozen_in_avoidance", "reset_at_avoidance")


class WalkProgram(NamedTuple):
    """Parameters of the walk; units in the names."""

    tick_ms: int
    location_ms: float
    scale_ms: float
    leg_min_ms: float
    leg_max_ms: float
    turn_max_deg: float
    avoidance_threshold_mm: float
    gain: float
    integral_gain: float
    tolerance_deg: float
    sample_interval_ms: float
    stop_ms: float
    timer: int
    interrupts_avoidance: bool


class WalkState(NamedTuple):
    """What the walk remembers from one tick to the next."""

    mode: int
    """Activity until the next tick: DRIVE, TURN, AVOID or STOP."""
    resume: int
    """Activity after a stop."""
    sampled: bool
    """Whether the sample is taken at this tick."""
    leg_ms: float
    driven_ms: int
    timer_ms: int
    stopped_ms: int
    error_deg: float
    integral_deg_s: float
    legs: int
    """Legs begun: index of the next leg's random numbers."""
    avoidances: int
    samples: int
    next_leg_ms: float
    """Length of the leg after the current turn, if steered; nan: drawn."""


class Dice(NamedTuple):
    """Uniform numbers for the next leg, the turn at the end of this leg and the next avoidance."""

    leg: float
    turn: float
    avoid: float


@inlined
def leg_duration_ms(program: WalkProgram, u: float) -> float:
    """Return T_r ~ Cauchy(gamma_0, gamma), clipped to [leg_min, leg_max]: gamma_0 + gamma tan(pi (u - 1/2)), ms."""
    leg_ms = program.location_ms + program.scale_ms * math.tan(math.pi * (u - 0.5))  # Eq. 6
    return min(max(leg_ms, program.leg_min_ms), program.leg_max_ms)


@inlined
def turn_angle_deg(program: WalkProgram, u: float) -> float:
    """Return phi ~ U(-turn_max, turn_max), deg, anticlockwise positive."""
    return program.turn_max_deg * (2.0 * u - 1.0)  # Eq. 7


@kernel
def begin_walk(program: WalkProgram, dice: Dice) -> WalkState:
    """Return the state at tick 0, at which the robot stands; it walks from tick 1."""
    leg_ms = leg_duration_ms(program, dice.leg)
    return WalkState(STOP, DRIVE, True, leg_ms, 0, 0, 0, 0.0, 0.0, 1, 0, 0, math.nan)


@inlined
def steered(state: WalkState, turn_deg: float, drive_ms: float) -> WalkState:
    """Return the state of a robot that stands after a sample and is steered from there.

    * ``turn_deg``: it gives up what the stop interrupted (the rest of a leg, of a turn, of an avoidance), turns by so
      much, anticlockwise positive, and then drives a new leg: of ``drive_ms``, or with nan as long as drawn. That turn
      ends as any: ``legs`` grows by one, and the sample timer does what it does after turns.
    * ``turn_deg`` nan: it goes on with what was interrupted. The leg that it then drives, the one interrupted or, in a
      turn, the next, lasts ``drive_ms`` from then on.
    * Both nan: nothing changes.

    When the leg is over it turns and walks as drawn. The numbers of a leg are addressed by ``legs``, those of an
    avoidance by ``avoidances``, in whatever way the robot came to them: one that is steered shifts the numbers of no
    other robot, and those of its own avoidances only if it has more or fewer of them.
    """
    if not math.isnan(turn_deg):
        return WalkState(STOP, TURN, state.sampled, state.leg_ms, state.driven_ms, state.timer_ms, state.stopped_ms,
                         turn_deg, 0.0, state.legs, state.avoidances, state.samples, drive_ms)  # fmt: skip
    leg_ms, next_leg_ms = state.leg_ms, state.next_leg_ms
    if not math.isnan(drive_ms):
        if state.resume == TURN:
            next_leg_ms = drive_ms
        else:
            leg_ms = state.driven_ms + drive_ms
    return WalkState(STOP, state.resume, state.sampled, leg_ms, state.driven_ms, state.timer_ms, state.stopped_ms,
                     state.error_deg, state.integral_deg_s, state.legs, state.avoidances, state.samples,
                     next_leg_ms)  # fmt: skip


@inlined
def looks(state: WalkState, program: WalkProgram, gyro_deg: float) -> bool:
    """Return whether the step at this tick reads the rays: only when the robot is about to drive."""
    mode = state.mode
    if mode == STOP:
        if not state.sampled:
            return False
        mode = state.resume
    if mode == DRIVE:
        return True
    return abs(state.error_deg - gyro_deg) <= program.tolerance_deg


@inlined
def walk_step(
    state: WalkState, program: WalkProgram, gyro_deg: float, nearest_mm: float, dice: Dice
) -> WalkState:
    """Return the state for the next control period: what the robot does from this tick to the next.

    Args:
        gyro_deg: turned since the last tick. nearest_mm: the shortest ray (read only when ``looks``).
        dice: see ``Dice``; used up when ``legs`` or ``avoidances`` of the state grow.
    """
    mode, resume = state.mode, state.resume
    leg_ms, driven_ms, timer_ms, stopped_ms = state.leg_ms, state.driven_ms, state.timer_ms, state.stopped_ms
    error_deg, integral_deg_s = state.error_deg, state.integral_deg_s
    legs, avoidances, samples, next_leg_ms = state.legs, state.avoidances, state.samples, state.next_leg_ms

    if mode == STOP:
        if not state.sampled:
            stopped_ms += program.tick_ms
            sampled = stopped_ms >= program.stop_ms
            return WalkState(STOP, resume, sampled, leg_ms, driven_ms, timer_ms, stopped_ms,
                             error_deg, integral_deg_s, legs, avoidances, samples + sampled,
                             next_leg_ms)  # fmt: skip
        mode, timer_ms = resume, 0
    elif mode != DRIVE:
        error_deg -= gyro_deg

    due = timer_ms > program.sample_interval_ms
    if due and (mode != AVOID or program.interrupts_avoidance):
        return WalkState(STOP, mode, False, leg_ms, driven_ms, timer_ms, 0,
                         error_deg, integral_deg_s, legs, avoidances, samples, next_leg_ms)  # fmt: skip

    if mode != DRIVE and abs(error_deg) <= program.tolerance_deg:
        if mode == TURN:
            leg_ms = leg_duration_ms(program, dice.leg) if math.isnan(next_leg_ms) else next_leg_ms
            driven_ms, legs, next_leg_ms = 0, legs + 1, math.nan
            if program.timer != HOLD_IN_TURN and program.timer != ALWAYS:
                timer_ms = 0
        mode = DRIVE

    if mode == DRIVE:
        if driven_ms >= leg_ms:
            mode, error_deg, integral_deg_s = TURN, turn_angle_deg(program, dice.turn), 0.0
        elif nearest_mm < program.avoidance_threshold_mm:
            mode, error_deg, integral_deg_s = AVOID, turn_angle_deg(program, dice.avoid), 0.0
            avoidances += 1
            if program.timer == RESET_AT_AVOIDANCE:
                timer_ms = 0

    if mode == DRIVE:
        driven_ms += program.tick_ms
    else:
        integral_deg_s += error_deg * program.tick_ms / 1000.0
    if counts(mode, program.timer):
        timer_ms += program.tick_ms
    return WalkState(mode, resume, False, leg_ms, driven_ms, timer_ms, stopped_ms,
                     error_deg, integral_deg_s, legs, avoidances, samples, next_leg_ms)  # fmt: skip


@inlined
def counts(mode: int, timer: int) -> bool:
    """Return whether the sample timer runs in this mode."""
    if mode == DRIVE:
        return True
    if mode == AVOID:
        return timer != FROZEN_IN_AVOIDANCE
    return mode == TURN and timer == ALWAYS


@inlined
def turn_command_percent(state: WalkState, program: WalkProgram) -> float:
    """Return the wheel command of a turn in place, % of full, anticlockwise positive."""
    command = program.gain * state.error_deg + program.integral_gain * state.integral_deg_s
    return min(max(command, -100.0), 100.0)


@inlined
def wheel_commands_percent(state: WalkState, program: WalkProgram) -> tuple[float, float]:
    """Return the commands of the left and right wheel until the next tick, % of full speed."""
    if state.mode == DRIVE:
        return 100.0, 100.0
    if state.mode == STOP:
        return 0.0, 0.0
    turn = turn_command_percent(state, program)
    return -turn, turn
