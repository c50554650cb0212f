"""A robot's plan: what it does from a tick on, and until when it knows that nothing will change that.

Between two events a robot stands, drives an exact arc, or turns in place. Its row holds the state after the step at
``tick``; ``catch_up`` brings it to a later tick if nothing has happened in between, as that many steps of the
fixed-step engine would. A plan has one piece, or two if a robot drives up to a sample: the second is its stop.

| name | symbol | unit | equation |
|---|---|---|---|
| radius | R = v / w | m | the arc's; a robot that turns goes round R = m_d track / 2 |
| pose | x, y, h | m, m, rad | x + R (sin h' - sin h), y - R (cos h' - cos h), h' = h + w t |
| turn gain | G | deg per tick and % | degrees turned in a tick by a command of 1 % |
| turn | e, integral | deg, deg s | e <- e - G c; integral <- integral + e dt; c = clip(2.5 e + 0.15 integral) |
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

PLANNER = np.dtype(
    [*((name, ROBOT[name]) for name in ROBOT.names or ())]
    + [
        (name, np.int64)
        for name in ("tick", "self_event_tick", "plan_end_tick", "lookahead_tick", "sample_tick")
    ]
    + [(name, np.int64) for name in ("end_turn_ticks", "written_tick")]
    + [(name, np.float64) for name in ("sin_h", "cos_h", "radius_m", "turn_gain", "intended_speed_m_s")]
    + [(name, np.float64) for name in ("end_x_m", "end_y_m", "end_heading_rad", "end_sin_h", "end_cos_h")]
    + [(name, np.float64) for name in ("end_error_deg", "end_integral_deg_s", "end_gyro_deg")]
    + [("cached_ticks", np.int64)]
    + [
        (name, np.float64)
        for name in ("cached_error_deg", "cached_integral_deg_s", "cached_x_m", "cached_y_m")
    ]
    + [
        (name, np.float64)
        for name in (
            "mid_x_m",
            "mid_y_m",
            "chord_x_m",
            "chord_y_m",
            "position_error_m",
            "max_step_m",
            "clearance_m",
        )
    ]
)
"""``ROBOT``, and its plan.

* ``tick``: the plan starts here; the row's state is that after the step at this tick. ``self_event_tick``: the robot's
  own next event: a timer, or the end of a leg, a turn or a stop. ``plan_end_tick``: the plan ends here: at
  ``self_event_tick`` or, if a robot drives up to a sample, at the end of its stop. ``lookahead_tick``: a wall or
  another robot may matter from here on. ``sample_tick``: the sample of a stop.
* ``sin_h``, ``cos_h``: of the heading at ``tick``. ``end_x_m`` to ``end_cos_h``: a driver's pose at
  ``self_event_tick``. ``end_error_deg`` to ``end_gyro_deg``, ``end_turn_ticks``: a turn just before its own event, and
  its length.
  ``cached_*``: the same for the tick at which somebody last looked ahead on a turn.
* ``blocked``: the move at ``tick`` did not happen; ``intended_speed_m_s`` is the speed that it would have had.
* ``mid``, ``chord``, ``position_error_m``: the approximate position (``lookahead``). ``max_step_m``: the longest way in
  a tick. ``clearance_m``: no robot's centre is nearer at ``tick``.
* ``written_tick``: a turn's segments are written up to here.
"""

Planners = NDArray[np.void]
Planner = Any
"""A row of them."""

ROOT_TICKS: Final = 1e-9
"""Rounding is less than this where the ticks of a turn at full command are reckoned."""

SLOW_SWING: Final = 4.0 * math.cos(math.pi / 16.0) ** 2
"""A step whose trace squared is above this many determinants swings by less than pi / 16, if at all."""

STRAIGHT_RAD_S: Final = 1e-8
"""Below this turn rate an arc is taken as straight: off by less than 0.01 micrometre in 4 s."""


@inlined
def turn_command(setup: Setup, error_deg: float, integral_deg_s: float) -> float:
    """Return the wheel command of a turn, %: 2.5 e + 0.15 integral, clipped."""
    command = setup.gain * error_deg + setup.integral_gain * integral_deg_s
    return min(max(command, -100.0), 100.0)


@inner
def turn_ahead(
    setup: Setup, gain: float, error_deg: float, integral_deg_s: float, most: int
) -> tuple[int, float, float, float]:
    """Simulate a turn until it ends, for at most ``most`` ticks.

    Returns: the number of ticks n; error (deg), integral (deg s) and gyro (deg per tick) just before the step n ticks
        ahead.
    """
    dt_s = setup.tick_s
    command = turn_command(setup, error_deg, integral_deg_s)
    gyro_deg = gain * command
    n, skipped = 1, False
    while n < most and abs(error_deg - gyro_deg) > setup.tolerance_deg:
        if is_tail(setup, gain, error_deg, integral_deg_s, command):
            n, error_deg, integral_deg_s = tail_ahead(setup, gain, error_deg, integral_deg_s, n, most)
            gyro_deg = gain * turn_command(setup, error_deg, integral_deg_s)
            break
        skip = 0 if skipped else saturated_ticks(setup, gain, error_deg, integral_deg_s, command, most - n)
        if skip > 0:
            # In these ticks at full command the error falls by the same amount each time, and the integral grows by
            # the sum of the errors. Hardly any such ticks are left afterwards, so they are skipped only once.
            skipped = True
            first = error_deg - gyro_deg
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

    The command must stay below full, and sixteen steps must not be enough for the error to swing through 0 and back,
    as the end of the turn would then be missed. If error and integral have the same sign, the error falls to 0; the
    command falls with it if the integral adds no more than the gain takes away. Beyond 0, the error keeps its sign
    for good if the eigenvalues of a step are real, else for half a period. That is more than sixteen steps if their
    angle, arccos(trace / (2 sqrt(determinant))), is below pi / 16.
    """
    if abs(command) >= 100.0 or error_deg * integral_deg_s < 0.0:
        return False
    falls = setup.integral_gain * setup.tick_ms / 1000.0 <= setup.gain * setup.gain * gain
    determinant = 1.0 - gain * setup.gain
    trace = 1.0 + determinant - setup.tick_s * gain * setup.integral_gain
    return bool(falls and determinant > 0.0 and trace > 0.0 and trace * trace > SLOW_SWING * determinant)


@inlined
def tail_ahead(
    setup: Setup, gain: float, error_deg: float, integral_deg_s: float, n: int, most: int
) -> tuple[int, float, float]:
    """Simulate the tail of a turn from tick ``n`` to just before the step that ends it, at most to tick ``most``;
    return that tick, the error and the integral.

    A step is linear there, (e, integral) <- M (e, integral), and the error falls until the turn ends. If it is above
    the tolerance after sixteen steps, it was so throughout, so these are taken at once, by M^16; then four, by M^4.
    """
    a, b = 1.0 - gain * setup.gain, -gain * setup.integral_gain
    c, d = setup.tick_s * a, 1.0 + setup.tick_s * b
    a2, b2, c2, d2 = square(a, b, c, d)
    a4, b4, c4, d4 = square(a2, b2, c2, d2)
    a8, b8, c8, d8 = square(a4, b4, c4, d4)
    a16, b16, c16, d16 = square(a8, b8, c8, d8)
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
    """Return a lower bound on the further ticks at full command that do not end the turn, at most ``most``; 0 if the
    command is below full."""
    if abs(command) < 100.0:
        return 0
    sign = 1.0 if command > 0.0 else -1.0
    error, integral = sign * error_deg, sign * integral_deg_s
    beyond = setup.gain * error + setup.integral_gain * integral - 100.0
    if beyond <= 0.0 or error <= 0.0 or integral < 0.0:
        return 0
    per_tick = 100.0 * gain
    # After k ticks the command, before it is clipped, is beyond - fall k - bend k^2 above 100 %: 0 at the root.
    by_integral = 0.5 * setup.integral_gain * setup.tick_s
    fall = setup.gain * per_tick - by_integral * (2.0 * error - per_tick)
    bend = by_integral * per_tick
    until_command = 2.0 * beyond / (fall + math.sqrt(fall * fall + 4.0 * bend * beyond)) - ROOT_TICKS
    until_done = (error - setup.tolerance_deg) / per_tick - 2.0
    return min(int(max(min(until_command, until_done), 0.0)), most)


@inlined
def due_ticks(state_mode: int, timer_ms: int, setup: Setup) -> int:
    """Return the number of ticks until the sample timer interrupts a robot in this mode; NEVER if it does not."""
    if state_mode == AVOID and not setup.interrupts_avoidance:
        return NEVER
    if timer_ms > setup.sample_interval_ms:
        return 1
    if not counts(state_mode, setup.timer):
        return NEVER
    return 2 + int((setup.sample_interval_ms - timer_ms) / setup.tick_ms)


@inlined
def ticks_to_sample(setup: Setup, stopped_ms: int) -> int:
    """Return the number of ticks after which a robot that has stood for this time samples; it moves again at the
    next tick."""
    return max(1, math.ceil((setup.stop_ms - stopped_ms) / setup.tick_ms))


@inlined
def ticks_to_self_event(row: Planner, setup: Setup, horizon: int) -> int:
    """Return the number of ticks until the robot's own next event, at most ``horizon``; a turn's end state is
    cached.

    The horizon does not limit stops. A robot that has failed stands for good: its next event is the tick at which it
    falls silent, and after that NEVER_FAILS."""
    if row.failed:
        row.sample_tick = NEVER_FAILS
        return (row.silent_tick if row.silent_tick > row.tick else NEVER_FAILS) - row.tick
    if row.mode == STOP:
        row.sample_tick = row.tick + ticks_to_sample(setup, row.stopped_ms)
        return row.sample_tick + 1 - row.tick
    most = min(due_ticks(row.mode, row.timer_ms, setup), horizon)
    if row.mode == DRIVE:
        leg = 1 + max(0, math.ceil((row.leg_ms - row.driven_ms) / setup.tick_ms))
        return min(most, leg)
    ahead, error_deg, integral_deg_s, gyro_deg = turn_ahead(
        setup, row.turn_gain, row.error_deg, row.integral_deg_s, most
    )
    row.end_turn_ticks, row.end_gyro_deg = ahead, gyro_deg
    row.end_error_deg, row.end_integral_deg_s = error_deg, integral_deg_s
    return ahead


@inlined
def begin_plan(row: Planner, setup: Setup, tick: int) -> None:
    """Use the state set by ``control`` as the plan from ``tick`` on."""
    row.tick, row.written_tick, row.blocked = tick, tick, 0
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
    """Block the move at the plan's tick; heading and clocks continue."""
    row.intended_speed_m_s = row.speed_m_s
    row.speed_m_s, row.radius_m, row.max_step_m, row.blocked = 0.0, 0.0, 0.0, 1


@inlined
def turned_to(row: Planner, setup: Setup, n: int) -> tuple[float, float, float]:
    """Return the error, integral and gyro of a turn just before the step ``n`` ticks after its plan's."""
    if n == row.end_turn_ticks:
        return row.end_error_deg, row.end_integral_deg_s, row.end_gyro_deg
    ahead = turn_ahead(setup, row.turn_gain, row.error_deg, row.integral_deg_s, n)
    return ahead[1], ahead[2], ahead[3]


@inner
def pose_at(row: Planner, setup: Setup, tick: int) -> tuple[float, float, float]:
    """Return the position and heading at a tick of the plan, m, m, rad."""
    x_m, y_m, heading_rad, _, _ = facing_at(row, setup, tick)
    return x_m, y_m, heading_rad


@inlined
def facing_at(row: Planner, setup: Setup, tick: int) -> tuple[float, float, float, float, float]:
    """Return the position and heading at a tick of the plan, m, m, rad, and the heading's sine and cosine."""
    n = tick - row.tick
    if n == 0 or row.mode == STOP:
        return row.x_m, row.y_m, row.heading_rad, row.sin_h, row.cos_h
    if row.mode == DRIVE:
        return along_arc(row, n * setup.tick_s)
    error_deg, _, gyro_deg = turned_to(row, setup, n)
    return turned_by(row, row.error_deg - (error_deg - gyro_deg))


@inner
def position_at(row: Planner, setup: Setup, tick: int) -> tuple[float, float]:
    """Return the position at a tick of the plan, m, m."""
    if row.mode == STOP:
        return row.x_m, row.y_m
    if row.mode == DRIVE:
        x_m, y_m, _, _, _ = along_arc(row, (tick - row.tick) * setup.tick_s)
        return x_m, y_m
    return position_in_turn(row, setup, tick)


@inner
def position_in_turn(row: Planner, setup: Setup, tick: int) -> tuple[float, float]:
    """Return the position at a tick of a turn, m, m. It is cached: later ticks are computed from there."""
    n = tick - row.tick
    if n == 0 or row.blocked:
        return row.x_m, row.y_m
    if n == row.cached_ticks:
        return row.cached_x_m, row.cached_y_m
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
    """Compute ``facing_at`` for a turning robot, from the angle since its plan's tick."""
    turned = math.radians(angle_deg)
    sine, cosine = sin_cos(turned)
    heading = row.heading_rad + turned
    sin_h, cos_h = row.sin_h * cosine + row.cos_h * sine, row.cos_h * cosine - row.sin_h * sine
    x_m = row.x_m + row.radius_m * (sin_h - row.sin_h)
    y_m = row.y_m - row.radius_m * (cos_h - row.cos_h)
    return x_m, y_m, heading, sin_h, cos_h


@inner
def along_arc(row: Planner, time_s: float) -> tuple[float, float, float, float, float]:
    """Compute ``facing_at`` for a driving robot, from the time since its plan's tick."""
    turned = row.rate_rad_s * time_s
    heading = row.heading_rad + turned
    if abs(turned) > SMALL_RAD:
        sin_h, cos_h = math.sin(heading), math.cos(heading)
        rise, run = sin_h - row.sin_h, cos_h - row.cos_h
    else:
        sine, cosine_less_1 = small_sin_cos(turned)
        rise = row.sin_h * cosine_less_1 + row.cos_h * sine
        run = row.cos_h * cosine_less_1 - row.sin_h * sine
        sin_h, cos_h = row.sin_h + rise, row.cos_h + run
    if row.radius_m == 0.0:  # straight, or blocked
        along = row.speed_m_s * time_s
        return row.x_m + along * row.cos_h, row.y_m + along * row.sin_h, heading, sin_h, cos_h
    return row.x_m + row.radius_m * rise, row.y_m - row.radius_m * run, heading, sin_h, cos_h


@inlined
def sinc(angle_rad: float) -> float:
    """Return sin(angle) / angle; of small angles from its series, to 1e-11."""
    if abs(angle_rad) > 0.05:
        return math.sin(angle_rad) / angle_rad
    return 1.0 - angle_rad * angle_rad / 6.0 * (1.0 - angle_rad * angle_rad / 20.0)


@inlined
def blocked_drive_end(row: Planner, setup: Setup, ticks: int) -> tuple[float, float]:
    """Return where the move of a blocked driver, tried ``ticks`` after its plan's tick, would end, m, m."""
    half = 0.5 * row.rate_rad_s * setup.tick_s
    sine, cosine = sin_cos((2 * ticks + 1) * half)
    chord = row.intended_speed_m_s * setup.tick_s * sinc(half)
    x_m = row.x_m + chord * (row.cos_h * cosine - row.sin_h * sine)
    return x_m, row.y_m + chord * (row.sin_h * cosine + row.cos_h * sine)


@inlined
def blocked_turn_end(row: Planner, setup: Setup, turned_deg: float, gyro_deg: float) -> tuple[float, float]:
    """Return where the move of a blocked turning robot would end, m, m.

    Args:
        turned_deg: the angle turned since its plan's tick.
        gyro_deg: the angle that this move turns.
    """
    half = 0.5 * math.radians(gyro_deg)
    sine, cosine = sin_cos(math.radians(turned_deg) + half)
    pivot_m = 0.5 * row.misalignment * setup.turn_track_m
    chord = 2.0 * half * pivot_m * sinc(half)
    x_m = row.x_m + chord * (row.cos_h * cosine - row.sin_h * sine)
    return x_m, row.y_m + chord * (row.sin_h * cosine + row.cos_h * sine)


@inlined
def catch_up(row: Planner, setup: Setup, tick: int) -> None:
    """Bring a moving robot to ``tick``, just before its step there: pose, clocks, turn and ticks spent in its mode.

    Clocks gain one tick less than has passed: the step at ``tick`` itself adds the last.
    """
    n = tick - row.tick
    passed_ms = (n - 1) * setup.tick_ms
    if counts(row.mode, setup.timer):
        row.timer_ms += passed_ms
    if row.mode == DRIVE:
        row.drive_ticks += n
        row.driven_ms += passed_ms
        if tick == row.self_event_tick:
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
    """Return whether a robot that wakes at ``tick`` only has to stop to sample, as planned."""
    due_ms = row.timer_ms + (tick - row.tick - 1) * setup.tick_ms
    return bool(
        row.plan_end_tick > row.self_event_tick
        and tick == row.self_event_tick
        and due_ms > setup.sample_interval_ms
    )


@inlined
def begin_stop(row: Planner, setup: Setup, tick: int) -> None:
    """Stop a driver to sample, with the same result as ``catch_up``, ``control_one`` and a new plan."""
    passed_ms = (tick - row.tick - 1) * setup.tick_ms
    row.timer_ms += passed_ms
    row.driven_ms += passed_ms
    row.drive_ticks += tick - row.tick
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
    """Write the second piece of a driver's plan: the stop at its end, so that others can look ahead on it.

    Its tick is one before the stop, as encounters are searched from the tick after it.
    """
    stop.tick, stop.self_event_tick = row.self_event_tick - 1, row.plan_end_tick
    stop.mid_x_m, stop.mid_y_m = row.end_x_m, row.end_y_m


@inlined
def end_stop(row: Planner) -> None:
    """End a stop: bring a standing robot, whose gyro reads 0, to the tick of its sample."""
    row.stop_ticks += row.sample_tick - row.tick
    row.gyro_deg = 0.0
    row.tick, row.sampled = row.sample_tick, 1
    row.samples += 1


@inlined
def stand_on(row: Planner, tick: int) -> None:
    """Let a robot stand from the tick of its sample until ``tick``."""
    row.stop_ticks += tick - row.tick
    row.tick = tick
