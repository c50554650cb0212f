"""A robot's plan: what it does from a tick on, and up to which tick nothing can change that.

Between two events a robot stands, drives on an exact arc, or turns in place. Its row (``PLANNER``) holds the state
after the step at ``row.tick``, the plan's tick. ``catch_up`` brings the row to a later tick if nothing has happened in
between; the result is that of the same number of steps of the fixed-step engine. A plan has one piece, or two if a
robot drives and then stops to sample: the second piece is that stop.

| name | symbol | unit | equation |
|---|---|---|---|
| radius | R | m | of the arc that a robot drives, v / w; of the circle of a turning robot's centre, m_d track / 2 |
| pose | x, y, h | m, m, rad | x + R (sin h' - sin h), y - R (cos h' - cos h), h' = h + w t |
| turn gain | G | deg per tick and % | degrees turned in a tick by a command of 1 % |
| turn | e, I | deg, deg s | one step: e <- e - G c; I <- I + e dt; c = clip(2.5 e + 0.15 I), in % of full command |

A turn in place is a control loop: e (``error_deg``) is the angle still to turn, I (``integral_deg_s``) its integral,
and the gyro reads G c degrees per tick. The turn ends at the step that finds e within the tolerance. The gains
Kp = 2.5 and Ki = 0.15 are defaults of the scenario (``setup.gain`` and ``setup.integral_gain``).
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.control_step import NEVER_FAILS, ROBOT
from vibroswarm.motion.event.event_queue import NEVER
from vibroswarm.motion.geometry import SMALL_RAD, sin_cos, small_sin_cos
from vibroswarm.motion.robot_params import Setup
from vibroswarm.robot.walk import AVOID, DRIVE, STOP, TURN, counts

ROOT_TICKS: Final = 1e-9
"""Bound on the rounding error of the number of ticks at full command; subtracted to get a lower bound."""


SLOW_SWING: Final = 4.0 * math.cos(math.pi / 16.0) ** 2
"""If the squared trace of a step's matrix is above this number times its determinant, its eigenvalues are real, or
their angle is below pi / 16."""


@inlined
def turn_command(setup: Setup, error_deg: float, integral_deg_s: float) -> float:
    """Return the wheel command of a turn: gain e + integral_gain I, clipped to +- 100 %."""
    command = setup.gain * error_deg + setup.integral_gain * integral_deg_s
    return min(max(command, -100.0), 100.0)


@inner
def turn_ahead(
    setup: Setup, gain: float, error_deg: float, integral_deg_s: float, most: int
) -> tuple[int, float, float, float]:
    """Return n >= 1 ticks, at most ``most``, to a turn's end; error (deg), integral (deg s), gyro just before it.

    Steps at full command, and those of the last part of a turn (``is_tail``), are taken several at a time.
    """
    dt_s = setup.tick_s
    command = turn_command(setup, error_deg, integral_deg_s)
    gyro_deg = gain * command
    n, skipped = 1, False
    # A step subtracts the gyro's reading from the error, and ends the turn if the rest is within the tolerance.
    while n < most and abs(error_deg - gyro_deg) > setup.tolerance_deg:
        if is_tail(setup, gain, error_deg, integral_deg_s, command):
            n, error_deg, integral_deg_s = tail_ahead(setup, gain, error_deg, integral_deg_s, n, most)
            gyro_deg = gain * turn_command(setup, error_deg, integral_deg_s)
            break
        skip = 0 if skipped else saturated_ticks(setup, gain, error_deg, integral_deg_s, command, most - n)
        if skip > 0:
            # In these ticks at full command the error falls by the same amount in each, and the integral grows by the
            # sum of the errors. Few such ticks are left afterwards, so this is done only once.
            skipped = True
            first = error_deg - gyro_deg  # the error after the first of these ticks
            integral_deg_s += dt_s * skip * (first - 0.5 * gyro_deg * (skip - 1))
            error_deg -= skip * gyro_deg
            n += skip
            continue
        error_deg -= gyro_deg
        integral_deg_s += error_deg * dt_s
        command = turn_command(setup, error_deg, integral_deg_s)
        gyro_deg = gain * command
        n += 1
    return n, error_deg, integral_deg_s, gyro_deg


@inlined
def is_tail(setup: Setup, gain: float, error_deg: float, integral_deg_s: float, command: float) -> bool:
    """Return whether ``tail_ahead`` may simulate the rest of a turn, sixteen steps at a time.

    * The command stays below full, so that steps are linear. Error and integral have the same sign, so the error falls
      towards 0. In a step, the integral adds at most Ki dt e to the command c = Kp e + Ki I, and the falling error
      takes Kp G c, at least Kp^2 G e, away from it. So the command falls if Ki dt <= Kp^2 G.
    * The error does not swing through 0 and back within sixteen steps, by which the end of the turn would be missed.
      After passing 0, the error keeps its sign for ever if the eigenvalues of a step are real, else for half a period
      of the oscillation. Half a period is more than sixteen steps if the angle of the eigenvalues,
      arccos(trace / (2 sqrt(determinant))), is below pi / 16. Trace and determinant must be positive: with a negative
      eigenvalue, the error could change its sign in each step.
    """
    if abs(command) >= 100.0 or error_deg * integral_deg_s < 0.0:
        return False
    command_falls = setup.integral_gain * setup.tick_s <= setup.gain * setup.gain * gain
    # Determinant and trace of the matrix M of a step (``tail_ahead``).
    determinant = 1.0 - gain * setup.gain
    trace = 1.0 + determinant - setup.tick_s * gain * setup.integral_gain
    return bool(
        command_falls and determinant > 0.0 and trace > 0.0 and trace * trace > SLOW_SWING * determinant
    )


@inlined
def tail_ahead(
    setup: Setup, gain: float, error_deg: float, integral_deg_s: float, n: int, most: int
) -> tuple[int, float, float]:
    """Return the tick before the step that ends a turn, from ``n``, at most ``most``; error (deg), integral (deg s).

    A step is linear here, (e, I) <- M (e, I), and the error falls until the turn ends: if it is above the tolerance
    after sixteen steps, it was in all of them. So sixteen are taken at once, by M^16; then four; then single ones.
    """
    # M = (a b; c d): the first row gives the new error, e - G (Kp e + Ki I); the second row gives I + dt times the new
    # error. a2 to d2 are the elements of M^2, and so on.
    a, b = 1.0 - gain * setup.gain, -gain * setup.integral_gain
    c, d = setup.tick_s * a, 1.0 + setup.tick_s * b
    a2, b2, c2, d2 = square(a, b, c, d)
    a4, b4, c4, d4 = square(a2, b2, c2, d2)
    a8, b8, c8, d8 = square(a4, b4, c4, d4)
    a16, b16, c16, d16 = square(a8, b8, c8, d8)
    # By symmetry, compute with a positive error. ``after`` is the error that the next 16, 4 or 1 steps would leave.
    sign = 1.0 if error_deg > 0.0 else -1.0
    error, integral = sign * error_deg, sign * integral_deg_s
    after = a16 * error + b16 * integral
    while after > setup.tolerance_deg and n + 16 <= most:
        integral = c16 * error + d16 * integral
        error, n = after, n + 16
        after = a16 * error + b16 * integral
    after = a4 * error + b4 * integral
    while after > setup.tolerance_deg and n + 4 <= most:
        integral = c4 * error + d4 * integral
        error, n = after, n + 4
        after = a4 * error + b4 * integral
    after = a * error + b * integral
    while after > setup.tolerance_deg and n < most:
        integral = c * error + d * integral
        error, n = after, n + 1
        after = a * error + b * integral
    return n, sign * error, sign * integral


@inlined
def square(a: float, b: float, c: float, d: float) -> tuple[float, float, float, float]:
    """Return the square of the matrix (a b; c d)."""
    return a * a + b * c, b * (a + d), c * (a + d), d * d + b * c


@inlined
def saturated_ticks(
    setup: Setup, gain: float, error_deg: float, integral_deg_s: float, command: float, most: int
) -> int:
    """Return a lower bound on the ticks, at most ``most``, for which the command stays full and the turn goes on."""
    if abs(command) < 100.0:
        return 0
    # By symmetry, compute with a positive command. ``beyond``: by how much the command is above 100 % before clipping.
    sign = 1.0 if command > 0.0 else -1.0
    error, integral = sign * error_deg, sign * integral_deg_s
    beyond = setup.gain * error + setup.integral_gain * integral - 100.0
    # Only the usual case, in which error and integral have the sign of the command, is computed; 0 is always a valid
    # bound.
    if beyond <= 0.0 or error <= 0.0 or integral < 0.0:
        return 0
    per_tick = 100.0 * gain
    # At full command, the error falls by ``per_tick`` in each tick, and the integral grows by the sum of the errors. So
    # after k ticks the command before clipping is above 100 % by beyond - fall k - bend k^2. Find the positive root.
    # ``fall`` may be negative: the command then rises at first.
    by_integral = 0.5 * setup.integral_gain * setup.tick_s
    fall = setup.gain * per_tick - by_integral * (2.0 * error - per_tick)
    bend = by_integral * per_tick
    until_command = 2.0 * beyond / (fall + math.sqrt(fall * fall + 4.0 * bend * beyond)) - ROOT_TICKS
    until_done = (error - setup.tolerance_deg) / per_tick - 2.0  # two ticks early, to be safe
    return min(int(max(min(until_command, until_done), 0.0)), most)


PLANNER = np.dtype(
    [*((name, ROBOT[name]) for name in ROBOT.names or ())]
    + [
        (name, np.int64)
        for name in ("tick", "self_event_tick", "plan_end_tick", "lookahead_tick", "sample_tick")
    ]
    + [("end_turn_ticks", np.int64)]
    + [(name, np.float64) for name in ("sin_h", "cos_h", "radius_m", "turn_gain", "intended_speed_m_s")]
    + [(name, np.float64) for name in ("end_x_m", "end_sin_h", "end_y_m", "end_cos_h", "end_heading_rad")]
    + [(name, np.float64) for name in ("end_error_deg", "end_gyro_deg", "end_integral_deg_s")]
    + [("cached_ticks", np.int64)]
    + [
        (name, np.float64)
        for name in ("cached_error_deg", "cached_integral_deg_s", "cached_x_m", "cached_y_m")
    ]
    + [
        (name, np.float64)
        for name in (
            "mid_x_m",
            "chord_x_m",
            "mid_y_m",
            "chord_y_m",
            "position_error_m",
            "max_step_m",
            "clearance_m",
        )
    ]
)
"""A robot (the fields of ``ROBOT``) and its plan.

The order of fields matters for speed: numbers that are written one by one and soon copied together stand apart, as one
wide read would have to wait until the writes have reached the processor's cache.

* ``tick``: the plan starts here; the row's state is that after the step at this tick.
* ``self_event_tick``: the robot's own next event: its sample timer, or the end of a leg, a turn or a stop.
  ``plan_end_tick``: the end of the plan: ``self_event_tick`` or, if the robot then stops to sample, the end of that
  stop. ``lookahead_tick``: the first tick at which a wall or another robot may affect it. ``sample_tick``: the tick of
  the sample at the end of a stop.
* ``sin_h``, ``cos_h``: sine and cosine of the heading at ``tick``. ``radius_m``: of the arc or of the turn.
  ``turn_gain``: G.
* ``end_x_m`` to ``end_heading_rad``: a driver's pose at ``self_event_tick``.
* ``end_turn_ticks``: number of ticks from ``tick`` to a turning robot's own event; ``end_error_deg`` to
  ``end_integral_deg_s``: its error, gyro and integral just before the step there.
* ``cached_ticks`` to ``cached_y_m``: the same, and the position, that many ticks after ``tick``, where the turn was
  last computed for another robot.
* ``blocked``: 1 if the move at ``tick`` was blocked; ``intended_speed_m_s`` is the speed that it would have had.
* ``mid``, ``chord``, ``position_error_m``: the approximate position (``lookahead``). ``max_step_m``: the longest way
  that the robot moves in a tick. ``clearance_m``: no neighbour's centre (``neighbours``) is nearer than this at
  ``tick``; infinite without neighbours.
"""


Planners = NDArray[np.void]
"""The robots of one run: ``PLANNER``, shape (robots,)."""


Planner = Any
"""One row of ``Planners``, or the stop that is the second piece of a plan."""


STRAIGHT_RAD_S: Final = 1e-8
"""Below this turn rate an arc is taken as straight, which changes a position by less than 0.01 micrometre in 4 s."""


@inlined
def due_ticks(state_mode: int, timer_ms: int, setup: Setup) -> int:
    """Return the ticks until the sample timer interrupts a robot; NEVER if it may not, or does not run in this mode."""
    if state_mode == AVOID and not setup.interrupts_avoidance:
        return NEVER
    if timer_ms > setup.sample_interval_ms:
        return 1
    if not counts(state_mode, setup.timer):
        return NEVER
    # Until the timer is above the interval, 1 + int(...) further periods pass. The step one tick later finds it so.
    return 2 + int((setup.sample_interval_ms - timer_ms) / setup.tick_ms)


@inlined
def ticks_to_sample(setup: Setup, stopped_ms: int) -> int:
    """Return the number of ticks until a robot that has stood for ``stopped_ms`` samples; it moves one tick later."""
    return max(1, math.ceil((setup.stop_ms - stopped_ms) / setup.tick_ms))


@inlined
def ticks_to_self_event(row: Planner, setup: Setup, horizon: int) -> int:
    """Return the number of ticks from the plan's tick to the robot's own next event, a step at which its plan ends.

    Also set the row's ``sample_tick`` (NEVER_FAILS if it takes none), and ``end_...`` of a turning robot. The event
    of a failed robot is the tick at which it falls silent.
    """
    if row.failed:
        row.sample_tick = NEVER_FAILS
        return (row.silent_tick if row.silent_tick > row.tick else NEVER_FAILS) - row.tick
    if row.mode == STOP:
        row.sample_tick = row.tick + ticks_to_sample(setup, row.stopped_ms)
        return (
            row.sample_tick + 1 - row.tick
        )  # + 1: the robot still stands at its sample, and moves one tick later
    most = min(due_ticks(row.mode, row.timer_ms, setup), horizon)
    if row.mode == DRIVE:
        # The leg ends at the first step that finds the driving time at least as long as the leg. ``driven_ms`` already
        # includes the control period that begins at the plan's tick. So the step 1 tick after the plan's tick finds
        # ``driven_ms``, and each later step finds one period more.
        leg_ticks = 1 + max(0, math.ceil((row.leg_ms - row.driven_ms) / setup.tick_ms))
        return min(most, leg_ticks)
    # The robot turns (an avoiding robot does so too): ``ahead`` counts the step that ends the turn, while the error,
    # integral and gyro are those just before that step.
    ahead, error_deg, integral_deg_s, gyro_deg = turn_ahead(
        setup, row.turn_gain, row.error_deg, row.integral_deg_s, most
    )
    row.end_turn_ticks, row.end_gyro_deg = ahead, gyro_deg
    row.end_error_deg, row.end_integral_deg_s = error_deg, integral_deg_s
    return ahead


@inlined
def begin_plan(row: Planner, setup: Setup, tick: int) -> None:
    """Begin a plan at ``tick`` with the mode, speed and turn rate that the robot's step has just set in its row."""
    row.tick, row.blocked = tick, 0
    row.end_turn_ticks = row.cached_ticks = 0
    if row.mode == DRIVE:
        straight = abs(row.rate_rad_s) < STRAIGHT_RAD_S
        row.radius_m = 0.0 if straight else row.speed_m_s / row.rate_rad_s
        row.max_step_m = abs(row.speed_m_s) * setup.tick_s
    elif row.mode != STOP:
        row.radius_m = 0.5 * row.misalignment * setup.turn_track_m
        full = setup.full_speed_m_s * row.speed_factor * row.battery
        # Both wheels at 1 % of full speed, one backwards, for one tick.
        row.turn_gain = math.degrees(2.0 * 0.01 * full / setup.turn_track_m * setup.tick_s)
        row.max_step_m = abs(row.radius_m) * math.radians(100.0 * row.turn_gain)
    else:
        row.max_step_m = 0.0


@inlined
def block(row: Planner) -> None:
    """Block the move at the plan's tick: the position stays, while heading and clocks go on."""
    row.intended_speed_m_s = row.speed_m_s
    row.speed_m_s, row.radius_m, row.max_step_m, row.blocked = 0.0, 0.0, 0.0, 1


@inlined
def turned_to(row: Planner, setup: Setup, n: int) -> tuple[float, float, float]:
    """Return error (deg), integral (deg s) and gyro (deg) of a turn just before the ``n``-th step after the plan's."""
    if n == row.end_turn_ticks:  # the end of the plan, for which they were computed when the plan was made
        return row.end_error_deg, row.end_integral_deg_s, row.end_gyro_deg
    _, error_deg, integral_deg_s, gyro_deg = turn_ahead(
        setup, row.turn_gain, row.error_deg, row.integral_deg_s, n
    )
    return error_deg, integral_deg_s, gyro_deg


@inner
def pose_at(row: Planner, setup: Setup, tick: int) -> tuple[float, float, float]:
    """Return the position and heading at a tick within the plan, m, m, rad; the heading is not wrapped."""
    x_m, y_m, heading_rad, _, _ = facing_at(row, setup, tick)
    return x_m, y_m, heading_rad


@inlined
def facing_at(row: Planner, setup: Setup, tick: int) -> tuple[float, float, float, float, float]:
    """Return (x_m, y_m, heading_rad, sin_h, cos_h) of a robot at a tick within its plan; the heading is not wrapped."""
    n = tick - row.tick
    if n == 0 or row.mode == STOP:
        return row.x_m, row.y_m, row.heading_rad, row.sin_h, row.cos_h
    if row.mode == DRIVE:
        return along_arc(row, n * setup.tick_s)
    error_deg, _, gyro_deg = turned_to(row, setup, n)
    # The gyro's latest reading has not been subtracted from the error yet, so the angle left to turn is error - gyro.
    return turned_by(row, row.error_deg - (error_deg - gyro_deg))


@inner
def position_at(row: Planner, setup: Setup, tick: int) -> tuple[float, float]:
    """Return the position at a tick within the plan, m, m."""
    if row.mode == STOP:
        return row.x_m, row.y_m
    if row.mode == DRIVE:
        x_m, y_m, _, _, _ = along_arc(row, (tick - row.tick) * setup.tick_s)
        return x_m, y_m
    return position_in_turn(row, setup, tick)


@inner
def position_in_turn(row: Planner, setup: Setup, tick: int) -> tuple[float, float]:
    """Return the position of a turning robot at a tick, m, m; the turn's state there is cached in the row."""
    n = tick - row.tick
    if n == 0 or row.blocked:  # a blocked robot turns, but its position stays
        return row.x_m, row.y_m
    if n == row.cached_ticks:
        return row.cached_x_m, row.cached_y_m
    # Start from the plan's tick, or from the cached state if that is later. The state is that just before the step
    # ``first`` ticks after the plan's tick. ``turn_ahead`` counts this step as 1, so step ``n`` is its step
    # n - first + 1.
    first, error_deg, integral_deg_s = 1, row.error_deg, row.integral_deg_s
    if 0 < row.cached_ticks < n:
        first, error_deg, integral_deg_s = row.cached_ticks, row.cached_error_deg, row.cached_integral_deg_s
    _, error_deg, integral_deg_s, gyro_deg = turn_ahead(
        setup, row.turn_gain, error_deg, integral_deg_s, n - first + 1
    )
    x_m, y_m, _, _, _ = turned_by(row, row.error_deg - (error_deg - gyro_deg))
    row.cached_ticks, row.cached_error_deg, row.cached_integral_deg_s = n, error_deg, integral_deg_s
    row.cached_x_m, row.cached_y_m = x_m, y_m
    return x_m, y_m


@inlined
def turned_by(row: Planner, angle_deg: float) -> tuple[float, float, float, float, float]:
    """Return (x_m, y_m, heading_rad, sin_h, cos_h) of a robot that has turned by ``angle_deg`` in its plan."""
    turned = math.radians(angle_deg)
    sine, cosine = sin_cos(turned)
    heading = row.heading_rad + turned
    sin_h, cos_h = row.sin_h * cosine + row.cos_h * sine, row.cos_h * cosine - row.sin_h * sine
    x_m = row.x_m + row.radius_m * (sin_h - row.sin_h)
    y_m = row.y_m - row.radius_m * (cos_h - row.cos_h)
    return x_m, y_m, heading, sin_h, cos_h


@inner
def along_arc(row: Planner, time_s: float) -> tuple[float, float, float, float, float]:
    """Return (x_m, y_m, heading_rad, sin_h, cos_h) of a robot ``time_s`` after its plan's tick, on the plan's arc."""
    turned = row.rate_rad_s * time_s
    heading = row.heading_rad + turned
    # Changes of the heading's sine and cosine. For small angles they are computed without subtracting close numbers.
    if abs(turned) > SMALL_RAD:
        sin_h, cos_h = math.sin(heading), math.cos(heading)
        sin_change, cos_change = sin_h - row.sin_h, cos_h - row.cos_h
    else:
        sine, cosine_less_1 = small_sin_cos(turned)
        sin_change = row.sin_h * cosine_less_1 + row.cos_h * sine
        cos_change = row.cos_h * cosine_less_1 - row.sin_h * sine
        sin_h, cos_h = row.sin_h + sin_change, row.cos_h + cos_change
    # ``begin_plan`` sets radius 0 for a straight line, and ``block`` for a blocked robot, whose speed is 0.
    if row.radius_m == 0.0:
        along = row.speed_m_s * time_s
        return row.x_m + along * row.cos_h, row.y_m + along * row.sin_h, heading, sin_h, cos_h
    return (row.x_m + row.radius_m * sin_change, row.y_m - row.radius_m * cos_change, heading, sin_h, cos_h)


@inlined
def sinc(angle_rad: float) -> float:
    """Return sin(angle) / angle; for small angles from its power series, whose error is below 1e-11."""
    if abs(angle_rad) > 0.05:
        return math.sin(angle_rad) / angle_rad
    return 1.0 - angle_rad * angle_rad / 6.0 * (1.0 - angle_rad * angle_rad / 20.0)


@inlined
def blocked_drive_end(row: Planner, setup: Setup, ticks: int) -> tuple[float, float]:
    """Return where a blocked driver's move of one tick, ``ticks`` after its plan's tick, would end, m, m."""
    half = 0.5 * row.rate_rad_s * setup.tick_s  # half of the angle that the robot turns in a tick
    # A move along an arc ends where its chord does. The chord's direction is the heading in the middle of the move,
    # which is ``ticks`` + 1/2 ticks after the plan's tick: by then the robot has turned by 2 ticks + 1 such halves.
    sine, cosine = sin_cos((2 * ticks + 1) * half)
    chord = row.intended_speed_m_s * setup.tick_s * sinc(half)
    x_m = row.x_m + chord * (row.cos_h * cosine - row.sin_h * sine)
    return x_m, row.y_m + chord * (row.sin_h * cosine + row.cos_h * sine)


@inlined
def blocked_turn_end(row: Planner, setup: Setup, turned_deg: float, gyro_deg: float) -> tuple[float, float]:
    """Return where the next move, of one tick, of a blocked robot that turns in place would end, m, m."""
    half = 0.5 * math.radians(gyro_deg)
    sine, cosine = sin_cos(math.radians(turned_deg) + half)
    # Radius of the circle on which the robot's centre would move.
    pivot_m = 0.5 * row.misalignment * setup.turn_track_m
    # The move's arc has the length 2 half pivot_m. Its chord points to the heading in the middle of the move.
    chord = 2.0 * half * pivot_m * sinc(half)
    x_m = row.x_m + chord * (row.cos_h * cosine - row.sin_h * sine)
    return x_m, row.y_m + chord * (row.sin_h * cosine + row.cos_h * sine)


@inlined
def catch_up(row: Planner, setup: Setup, tick: int) -> None:
    """Bring the row of a robot that drives or turns to a later ``tick``, to its state just before the step there.

    The clocks gain one period less than has passed: the step at the plan's tick counted its own period already.
    """
    n = tick - row.tick
    passed_ms = (n - 1) * setup.tick_ms
    if counts(row.mode, setup.timer):
        row.timer_ms += passed_ms
    if row.mode == DRIVE:
        row.drive_ticks += n
        row.blocked_ticks += n * row.blocked
        row.driven_ms += passed_ms
        if tick == row.self_event_tick:  # this pose was computed when the plan was made
            x_m, y_m, heading_rad = row.end_x_m, row.end_y_m, row.end_heading_rad
            sin_h, cos_h = row.end_sin_h, row.end_cos_h
        else:
            x_m, y_m, heading_rad, sin_h, cos_h = along_arc(row, n * setup.tick_s)
    else:
        if row.mode == TURN:
            row.turn_ticks += n
        else:
            row.avoid_ticks += n
        error_deg, integral_deg_s, gyro_deg = turned_to(row, setup, n)
        x_m, y_m, heading_rad, sin_h, cos_h = turned_by(row, row.error_deg - (error_deg - gyro_deg))
        row.error_deg, row.integral_deg_s, row.gyro_deg = error_deg, integral_deg_s, gyro_deg
    row.x_m, row.y_m, row.heading_rad, row.sin_h, row.cos_h = x_m, y_m, heading_rad, sin_h, cos_h
    row.tick = tick


@inlined
def stops_at(row: Planner, setup: Setup, tick: int) -> bool:
    """Return whether a robot that wakes at ``tick`` only begins the stop that is the second piece of its plan."""
    due_ms = row.timer_ms + (tick - row.tick - 1) * setup.tick_ms
    return bool(
        row.plan_end_tick > row.self_event_tick
        and tick == row.self_event_tick
        and due_ms > setup.sample_interval_ms
    )


@inlined
def begin_stop(row: Planner, setup: Setup, tick: int) -> None:
    """Make a driver begin its planned stop at ``tick``, the end of its drive."""
    passed_ms = (tick - row.tick - 1) * setup.tick_ms
    row.timer_ms += passed_ms
    row.driven_ms += passed_ms
    row.drive_ticks += tick - row.tick
    row.blocked_ticks += (tick - row.tick) * row.blocked
    row.mode, row.resume, row.stopped_ms = STOP, DRIVE, 0
    row.x_m, row.y_m, row.heading_rad = row.end_x_m, row.end_y_m, row.end_heading_rad
    row.sin_h, row.cos_h = row.end_sin_h, row.end_cos_h
    row.mid_x_m, row.mid_y_m = row.end_x_m, row.end_y_m
    row.chord_x_m = row.chord_y_m = row.position_error_m = 0.0
    row.speed_m_s = row.rate_rad_s = row.max_step_m = 0.0
    row.tick = row.stop_tick = tick
    row.sample_tick = row.plan_end_tick - 1
    row.self_event_tick, row.lookahead_tick = row.plan_end_tick, NEVER


@inlined
def plan_stop(stop: Planner, row: Planner) -> None:
    """Write the second piece of a driver's plan, the stop after its drive, on which other robots look ahead."""
    # The search for encounters begins at the tick after ``stop.tick``; it is to begin at the first tick of the stop.
    stop.tick, stop.self_event_tick = row.self_event_tick - 1, row.plan_end_tick
    stop.mid_x_m, stop.mid_y_m = row.end_x_m, row.end_y_m


@inlined
def end_stop(row: Planner) -> None:
    """Bring the row of a standing robot to the tick of its sample, which ends its stop, and count the sample."""
    row.stop_ticks += row.sample_tick - row.tick
    row.gyro_deg = 0.0
    row.tick, row.sampled = row.sample_tick, 1
    row.samples += 1


@inlined
def stand_on(row: Planner, tick: int) -> None:
    """Bring the row of a standing robot to ``tick``, counting the ticks since its own tick as ticks of standing."""
    row.stop_ticks += tick - row.tick
    row.tick = tick
