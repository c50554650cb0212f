"""The random walk: drive a leg, turn at its end, avoid what the rays see, stop to sample.

| name | symbol | unit | equation |
|---|---|---|---|
| leg | T_r | ms | Cauchy(gamma_0, gamma), or gamma_0 + Exp(gamma), clipped |
| turn | phi | deg | U(-turn_max, turn_max) |
| error | e | deg | angle still to turn, by the gyro |
| integral | - | deg s | sum of e dt |
| command | - | % of full | 2.5 e + 0.15 integral, clipped to +-100 |
| timer | t - t_s | ms | counts towards tau |

The clock counts whole control periods ("ticks"). ``walk_step`` is called once per tick and determines what the robot
does until the next tick. If ``sampled`` is true, the sample is taken at this tick, and the robot still stands.

The sample timer runs while the robot drives. Its rule (``TIMERS``) says what it does in turns and avoidances. By the
rule "reset_after_turn" it also runs in avoidances, pauses in turns, and is set to 0 at the end of a turn. The others
differ in one point: "hold_in_turn" does not set it to 0 after a turn; "always" lets it run in turns, and does not set
it to 0; "frozen_in_avoidance" pauses it in avoidances; "reset_at_avoidance" sets it to 0 when an avoidance begins too,
from where it runs on; "held_at_avoidance" sets it to 0 when an avoidance begins and holds it there until the robot
drives on.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vibroswarm.core.jit import inlined, kernel

DRIVE: Final = 0
"""Activity: drive straight on."""
TURN: Final = 1
"""Activity: turn in place at the end of a leg."""
AVOID: Final = 2
"""Activity: turn in place because a ray saw something."""
STOP: Final = 3
"""Activity: stand, to take a sample."""
KINDS: Final = ("drive", "turn", "avoid", "stop")
"""Names of the activities, by their number."""

RESET_AFTER_TURN: Final = 0
"""Rule: the sample timer is set to 0 after a turn."""
HOLD_IN_TURN: Final = 1
"""Rule: the sample timer pauses in a turn, and is not set to 0 after it."""
ALWAYS: Final = 2
"""Rule: the sample timer runs in turns too, and no turn sets it to 0."""
FROZEN_IN_AVOIDANCE: Final = 3
"""Rule: the sample timer also pauses in avoidances."""
RESET_AT_AVOIDANCE: Final = 4
"""Rule: the sample timer is set to 0 when an avoidance begins too, and runs in it."""
HELD_AT_AVOIDANCE: Final = 5
"""Rule: the sample timer is held at 0 in avoidances."""
TIMERS: Final = (
    "reset_after_turn", "hold_in_turn", "always", "frozen_in_avoidance", "reset_at_avoidance", "held_at_avoidance",
)  # fmt: skip
"""Names of the rules, by their number."""


class WalkProgram(NamedTuple):
    """Parameters of the walk; units are in the names. ``timer`` is an index into ``TIMERS``."""

    tick_ms: int
    """Control period."""
    location_ms: float
    """gamma_0 of the law of legs."""
    scale_ms: float
    """gamma of the law of legs."""
    is_exponential: bool
    """Whether legs are exponential, and not Cauchy."""
    leg_min_ms: float
    """Shortest leg."""
    leg_max_ms: float
    """Longest leg."""
    turn_max_deg: float
    """Largest turn in either direction."""
    avoidance_threshold_mm: float
    """Length of the shortest ray below which the robot avoids."""
    gain: float
    """Proportional gain of the controller of turns, % per deg."""
    integral_gain: float
    """Integral gain of the controller of turns, % per deg s."""
    tolerance_deg: float
    """A turn is finished when at most this angle is left."""
    sample_interval_ms: float
    """tau: the sample timer must exceed this for the next sample."""
    stop_ms: float
    """Duration of the stop for a sample."""
    timer: int
    """Rule of the sample timer in turns and avoidances, an index into ``TIMERS``."""
    interrupts_avoidance: bool
    """Whether a sample that is due interrupts an avoidance."""


class WalkState(NamedTuple):
    """State of the walk from one tick to the next.

    ``error_deg`` is the angle still to turn. ``driven_ms`` is the time driven in this leg, ``timer_ms`` the sample
    timer.
    """

    mode: int
    """Activity until the next tick: DRIVE, TURN, AVOID or STOP."""
    resume: int
    """Activity that the stop interrupts, and that is resumed after it."""
    sampled: bool
    """Whether the sample is taken at this tick."""
    leg_ms: float
    """Duration of the present leg."""
    driven_ms: int
    """Time driven in this leg."""
    timer_ms: int
    """The sample timer."""
    stopped_ms: int
    """Time for which the robot has stood in this stop."""
    error_deg: float
    """Angle still to turn."""
    integral_deg_s: float
    """Integral of that angle over the turn."""
    legs: int
    """Legs begun: index of the next leg's random numbers."""
    avoidances: int
    """Avoidances begun: index of the next avoidance's random number."""
    samples: int
    """Samples taken."""
    next_leg_ms: float
    """Length of the leg after the current turn, if steered; nan: drawn."""


class Dice(NamedTuple):
    """Uniform numbers for the next leg, the turn at the end of this leg and the next avoidance."""

    leg: float
    """Selects the duration of the next leg."""
    turn: float
    """Selects the angle of the turn at the end of this leg."""
    avoid: float
    """Selects the angle of the next avoidance."""


@inlined
def leg_duration_ms(program: WalkProgram, u: float) -> float:
    """Return the duration of a leg, clipped to [leg_min, leg_max], ms."""
    if program.is_exponential:
        leg_ms = program.location_ms - program.scale_ms * math.log(1.0 - u)
    else:
        leg_ms = program.location_ms + program.scale_ms * math.tan(math.pi * (u - 0.5))  # Eq. 6
    return min(max(leg_ms, program.leg_min_ms), program.leg_max_ms)


@inlined
def turn_angle_deg(program: WalkProgram, u: float) -> float:
    """Return phi ~ U(-turn_max, turn_max), deg, anticlockwise positive."""
    return program.turn_max_deg * (2.0 * u - 1.0)  # Eq. 7


@kernel
def begin_walk(program: WalkProgram, dice: Dice) -> WalkState:
    """Return the state at tick 0, at which the robot stands, without a sample; it walks from tick 1."""
    leg_ms = leg_duration_ms(program, dice.leg)
    return WalkState(STOP, DRIVE, True, leg_ms, 0, 0, 0, 0.0, 0.0, 1, 0, 0, math.nan)


@inlined
def steered(state: WalkState, turn_deg: float, drive_ms: float) -> WalkState:
    """Return the state of a robot whose strategy steers it at a sample, while it still stands.

    * ``turn_deg`` is a number: the robot gives up the leg, turn or avoidance that the stop interrupted. It turns by
      ``turn_deg``, anticlockwise positive, and then drives a new leg of ``drive_ms``, or of the drawn duration if
      ``drive_ms`` is nan. This turn ends as any other: ``legs`` grows by one, and the sample timer follows its rule.
    * ``turn_deg`` is nan: the robot resumes what was interrupted. The leg that it drives next (the interrupted leg or,
      after an interrupted turn, the new one) then takes ``drive_ms`` from its present point on.
    * Both are nan: nothing changes.

    After that leg the robot turns and walks as drawn. The random numbers of its n-th leg and of its n-th avoidance are
    addressed by n (``legs``, ``avoidances``), so steering changes neither these nor those of other robots.
    """
    # After the stop the robot turns, with ``turn_deg`` still to turn and an integral of 0.
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
    """Return whether ``walk_step`` at this tick may use the rays: only if the robot drives, or is about to drive."""
    mode = state.mode
    if mode == STOP:
        if not state.sampled:  # the stop goes on
            return False
        mode = state.resume
    if mode == DRIVE:
        return True
    return abs(state.error_deg - gyro_deg) <= program.tolerance_deg  # the turn or avoidance is finished


@inlined
def walk_step(
    state: WalkState, program: WalkProgram, gyro_deg: float, nearest_mm: float, dice: Dice
) -> WalkState:
    """Return the state for the next control period: what the robot does from this tick to the next.

    ``gyro_deg``: angle turned since the last tick, anticlockwise positive. ``nearest_mm``: the shortest ray, used
    only if ``looks``. ``dice``: uniform numbers, to be drawn anew when ``legs`` or ``avoidances`` has grown.
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
        mode, timer_ms = resume, 0  # after the sample
    elif mode != DRIVE:
        error_deg -= gyro_deg

    # A sample is due: stop, and note what to resume.
    due = timer_ms > program.sample_interval_ms
    if due and (mode != AVOID or program.interrupts_avoidance):
        return WalkState(STOP, mode, False, leg_ms, driven_ms, timer_ms, 0,
                         error_deg, integral_deg_s, legs, avoidances, samples, next_leg_ms)  # fmt: skip

    # A finished turn begins a new leg; a finished avoidance continues the old one.
    if mode != DRIVE and abs(error_deg) <= program.tolerance_deg:
        if mode == TURN:
            leg_ms = leg_duration_ms(program, dice.leg) if math.isnan(next_leg_ms) else next_leg_ms
            driven_ms, legs, next_leg_ms = 0, legs + 1, math.nan
            if program.timer != HOLD_IN_TURN and program.timer != ALWAYS:
                timer_ms = 0
        mode = DRIVE

    # Before each tick of a drive: is the leg over, or is something in the way?
    if mode == DRIVE:
        if driven_ms >= leg_ms:
            mode, error_deg, integral_deg_s = TURN, turn_angle_deg(program, dice.turn), 0.0
        elif nearest_mm < program.avoidance_threshold_mm:
            mode, error_deg, integral_deg_s = AVOID, turn_angle_deg(program, dice.avoid), 0.0
            avoidances += 1
            if program.timer == RESET_AT_AVOIDANCE or program.timer == HELD_AT_AVOIDANCE:
                timer_ms = 0

    # Advance the clocks by the control period that begins now.
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
    """Return whether the sample timer runs in this mode, by the rule ``timer`` (an index into ``TIMERS``)."""
    if mode == DRIVE:
        return True
    if mode == AVOID:
        return timer != FROZEN_IN_AVOIDANCE and timer != HELD_AT_AVOIDANCE
    return mode == TURN and timer == ALWAYS


@inlined
def turn_command_percent(state: WalkState, program: WalkProgram) -> float:
    """Return the right wheel's command in a turn, % of full speed, positive anticlockwise; the left's is its
    negative."""
    command = program.gain * state.error_deg + program.integral_gain * state.integral_deg_s
    return min(max(command, -100.0), 100.0)


@inlined
def wheel_commands_percent(state: WalkState, program: WalkProgram) -> tuple[float, float]:
    """Return the commands of the left and of the right wheel until the next tick, % of full speed."""
    if state.mode == DRIVE:
        return 100.0, 100.0
    if state.mode == STOP:
        return 0.0, 0.0
    turn = turn_command_percent(state, program)
    return -turn, turn
