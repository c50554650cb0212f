"""A robot's plan: what it does from one tick on, and until when it knows that nothing will change that.

Between two events a robot stands, drives an exact arc, or turns in place. Its row holds the state after the
step at tick ``tick``; ``catch_up`` brings it to a later tick at which nothing has happened in between, just
as so many steps of the fixed-step engine would.

| name | symbol | unit | equation |
|---|---|---|---|
| radius | R = v / w | m | the arc's; a robot that turns goes round R = m_d track / 2 |
| pose | x, y, h | m, m, rad | x + R (sin h' - sin h), y - R (cos h' - cos h), h' = h + w t |
| turn gain | G | deg a tick and % | degrees turned in a tick by a command of 1 % |
| turn | e, integral | deg, deg s | e <- e - G c; integral <- integral + e dt; c = clip(2.5 e + 0.15 integral) |
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.compiled import kernel
from vibroswarm.motion.body import Body
from vibroswarm.motion.phases import ROBOT
from vibroswarm.motion.wakes import NEVER
from vibroswarm.robot.walk import (
    AVOID,
    DRIVE,
    STOP,
    TURN,
    WalkProgram,
    counts,
)

PLANNER = np.dtype(
    [*((name, ROBOT[name]) for name in ROBOT.names or ())]
    + [(name, np.int64) for name in ("tick", "own_tick", "alert_tick", "sample_tick")]
    + [(name, np.int64) for name in ("turn_ticks_ahead", "blocked", "crowded", "written_tick")]
    + [(name, np.float64) for name in ("sin_h", "cos_h", "radius_m", "turn_gain")]
    + [(name, np.float64) for name in ("own_x_m", "own_y_m", "own_heading_rad", "own_sin_h", "own_cos_h")]
    + [(name, np.float64) for name in ("ahead_error_deg", "ahead_integral_deg_s", "ahead_gyro_deg")]
    + [(name, np.float64) for name in ("chord_x_m", "chord_y_m", "slack_m", "rate_m")]
)
"""``ROBOT``, and its plan.

tick: the plan is from here, and so is the row's state (after its step). own_tick: the robot's own next event,
a timer, a leg's, turn's or stop's end. alert_tick: a wall or another robot may matter from here. sample_tick:
the sample of a stop. turn_ticks_ahead, ahead_*: a turn just before its own event. blocked: the move at ``tick``
did not happen. crowded: another body is near. written_tick: a turn's segments are
written down up to here. sin_h, cos_h: of the heading at ``tick``; own_*: the pose at ``own_tick`` of a robot that
drives. chord, slack, rate: moves a tick on average, how far beside that it may be, how far it moves at most in a
tick."""

Planners = NDArray[np.void]

STRAIGHT_RAD_S: Final = 1e-8
"""Below this turn rate an arc is taken as straight: off by less than 0.01 micrometre in 4 s."""


@kernel
def turn_command(program: WalkProgram, error_deg: float, integral_deg_s: float) -> float:
    """Wheel command of a turn, %: 2.5 e + 0.15 integral, clipped."""
    command = program.gain * error_deg + program.integral_gain * integral_deg_s
    return min(max(command, -100.0), 100.0)


@kernel
def turn_ahead(
    program: WalkProgram, gain: float, error_deg: float, integral_deg_s: float, most: int
) -> tuple[int, float, float, float]:
    """Ticks of a turn up to the one at which it is done, at most ``most``.

    Gives n, and error, integral and gyro as they stand just before the step n ticks ahead.
    """
    dt_s = program.tick_ms / 1000.0
    n, gyro_deg = 0, 0.0
    while n < most:
        command = program.gain * error_deg + program.integral_gain * integral_deg_s
        if n > 0:
            error_deg -= gyro_deg
            integral_deg_s += error_deg * dt_s
            command = program.gain * error_deg + program.integral_gain * integral_deg_s
        gyro_deg = gain * min(max(command, -100.0), 100.0)
        n += 1
        if abs(error_deg - gyro_deg) <= program.tolerance_deg:
            break
        skip = saturated_ticks(program, gain, error_deg, integral_deg_s, command, most - n)
        if skip > 0:
            # So many ticks at full command: e falls by the same each time, the integral by its sum.
            first = error_deg - gyro_deg
            integral_deg_s += dt_s * skip * (first - 0.5 * gyro_deg * (skip - 1))
            error_deg -= skip * gyro_deg
            n += skip
    return n, error_deg, integral_deg_s, gyro_deg


@kernel
def saturated_ticks(
    program: WalkProgram, gain: float, error_deg: float, integral_deg_s: float, command: float, most: int
) -> int:
    """Further ticks that surely pass at full command and end no turn; a lower bound."""
    sign = 1.0 if command > 0.0 else -1.0
    beyond, error = sign * command - 100.0, sign * error_deg
    per_tick = 100.0 * gain
    # While e has the sign of the command, its share falls by no more than this a tick; the integral's rises.
    if beyond <= 0.0 or error <= 0.0 or sign * integral_deg_s < 0.0:
        return 0
    until_command = beyond / (program.gain * per_tick)
    until_done = (error - program.tolerance_deg) / per_tick - 2.0
    return min(int(max(min(until_command, until_done), 0.0)), most)


@kernel
def due_ticks(state_mode: int, timer_ms: int, program: WalkProgram) -> int:
    """Ticks ahead at which the sample timer interrupts a robot in this mode."""
    if state_mode == AVOID and not program.interrupts_avoidance:
        return NEVER
    if timer_ms > program.sample_interval_ms:
        return 1
    if not counts(state_mode, program.timer):
        return NEVER
    return 2 + int((program.sample_interval_ms - timer_ms) // program.tick_ms)


@kernel
def own_ticks(planners: Planners, i: int, program: WalkProgram, horizon: int) -> int:
    """Ticks ahead of the robot's next own event, at most ``horizon``; a turn's is worked out and kept."""
    row = planners[i]
    if row.mode == STOP:
        wait = max(1, math.ceil((program.stop_ms - row.stopped_ms) / program.tick_ms))
        row.sample_tick = row.tick + wait
        return wait + 1  # it walks again at the tick after the sample
    most = min(due_ticks(row.mode, row.timer_ms, program), horizon)
    if row.mode == DRIVE:
        leg = 1 + max(0, math.ceil((row.leg_ms - row.driven_ms) / program.tick_ms))
        return min(most, leg)
    ahead, error_deg, integral_deg_s, gyro_deg = turn_ahead(
        program, row.turn_gain, row.error_deg, row.integral_deg_s, most
    )
    row.turn_ticks_ahead, row.ahead_gyro_deg = ahead, gyro_deg
    row.ahead_error_deg, row.ahead_integral_deg_s = error_deg, integral_deg_s
    return ahead


@kernel
def begin_plan(planners: Planners, i: int, body: Body, program: WalkProgram, tick: int) -> None:
    """Take what ``control`` has just set as the plan from ``tick`` on."""
    row = planners[i]
    row.tick, row.written_tick, row.blocked, row.turn_ticks_ahead = tick, tick, 0, 0
    if row.mode == DRIVE:
        straight = abs(row.rate_rad_s) < STRAIGHT_RAD_S
        row.radius_m = 0.0 if straight else row.speed_m_s / row.rate_rad_s
    elif row.mode != STOP:
        row.radius_m = 0.5 * row.misalignment * body.turn_track_m
        full = body.full_speed_m_s * row.speed_factor * row.battery
        row.turn_gain = math.degrees(0.02 * full / body.turn_track_m * body.tick_s)


@kernel
def block(planners: Planners, i: int) -> None:
    """The move at the plan's tick does not happen; heading and clocks go on for this tick."""
    row = planners[i]
    row.speed_m_s, row.radius_m, row.blocked = 0.0, 0.0, 1


@kernel
def turned_to(planners: Planners, i: int, program: WalkProgram, n: int) -> tuple[float, float, float]:
    """Error, integral and gyro of a turn just before the step ``n`` ticks after its plan's."""
    row = planners[i]
    if n == row.turn_ticks_ahead:
        return row.ahead_error_deg, row.ahead_integral_deg_s, row.ahead_gyro_deg
    ahead = turn_ahead(program, row.turn_gain, row.error_deg, row.integral_deg_s, n)
    return ahead[1], ahead[2], ahead[3]


@kernel
def pose_at(
    planners: Planners, i: int, body: Body, program: WalkProgram, tick: int
) -> tuple[float, float, float]:
    """Position at a tick of the plan, m, and sine and cosine of the heading there are in ``facing_at``."""
    x_m, y_m, heading_rad, _, _ = facing_at(planners, i, body, program, tick)
    return x_m, y_m, heading_rad


@kernel
def facing_at(
    planners: Planners, i: int, body: Body, program: WalkProgram, tick: int
) -> tuple[float, float, float, float, float]:
    """Position and heading at a tick of the plan, m, m, rad, and the heading's sine and cosine."""
    row = planners[i]
    n = tick - row.tick
    if n == 0 or row.mode == STOP:
        return row.x_m, row.y_m, row.heading_rad, row.sin_h, row.cos_h
    if row.mode == DRIVE:
        heading = row.heading_rad + row.rate_rad_s * (n * body.tick_s)
    else:
        error_deg, _, gyro_deg = turned_to(planners, i, program, n)
        heading = row.heading_rad + math.radians(row.error_deg - (error_deg - gyro_deg))
    sin_h, cos_h = math.sin(heading), math.cos(heading)
    if row.mode == DRIVE and row.radius_m == 0.0:  # straight, or blocked
        along = row.speed_m_s * (n * body.tick_s)
        return row.x_m + along * row.cos_h, row.y_m + along * row.sin_h, heading, sin_h, cos_h
    x_m = row.x_m + row.radius_m * (sin_h - row.sin_h)
    y_m = row.y_m - row.radius_m * (cos_h - row.cos_h)
    return x_m, y_m, heading, sin_h, cos_h


@kernel
def see_own(planners: Planners, i: int, body: Body, program: WalkProgram) -> None:
    """Work out the pose at ``own_tick``."""
    row = planners[i]
    pose = facing_at(planners, i, body, program, row.own_tick)
    row.own_x_m, row.own_y_m, row.own_heading_rad, row.own_sin_h, row.own_cos_h = pose


@kernel
def catch_up(planners: Planners, i: int, body: Body, program: WalkProgram, tick: int) -> None:
    """Bring a robot to ``tick``, just before its step there: pose, clocks, turn, time account."""
    row = planners[i]
    n = tick - row.tick
    passed_ms = (n - 1) * program.tick_ms
    if row.mode == STOP:
        row.stop_ticks += n
        row.stopped_ms += passed_ms
        row.tick = tick
        return
    if row.mode == DRIVE:
        row.drive_ticks += n
        row.driven_ms += passed_ms
    elif row.mode == TURN:
        row.turn_ticks += n
    else:
        row.avoid_ticks += n
    if counts(row.mode, program.timer):
        row.timer_ms += passed_ms
    if row.mode == DRIVE and tick == row.own_tick and not row.blocked:
        row.x_m, row.y_m, row.heading_rad = row.own_x_m, row.own_y_m, row.own_heading_rad
        row.sin_h, row.cos_h = row.own_sin_h, row.own_cos_h
    else:
        x_m, y_m, heading_rad, sin_h, cos_h = facing_at(planners, i, body, program, tick)
        if row.mode != DRIVE:
            row.error_deg, row.integral_deg_s, row.gyro_deg = turned_to(planners, i, program, n)
        row.x_m, row.y_m, row.heading_rad, row.sin_h, row.cos_h = x_m, y_m, heading_rad, sin_h, cos_h
    row.tick = tick


@kernel
def take_sample(planners: Planners, i: int, tick: int) -> None:
    """The stop is over: the robot is at the tick of its sample, and still stands."""
    row = planners[i]
    row.stop_ticks += tick - row.tick
    row.tick, row.sampled = tick, 1
    row.samples += 1
