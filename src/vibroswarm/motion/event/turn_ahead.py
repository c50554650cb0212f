"""Turns in place, several control periods at a time: when a turn ends, and in which state.

| name | symbol | unit | equation |
|---|---|---|---|
| turn gain | G | deg per tick and % | degrees turned in a tick by a command of 1 % |
| turn | e, I | deg, deg s | one step: e <- e - G c; I <- I + e dt; c = clip(2.5 e + 0.15 I), in % of full command |

A turn in place is a control loop: e (``error_deg``) is the angle still to turn, I (``integral_deg_s``) its integral,
and the gyro reads G c degrees per tick. The turn ends at the step that finds e within the tolerance. The gains
Kp = 2.5 and Ki = 0.15 are defaults of the scenario (``setup.gain`` and ``setup.integral_gain``).
"""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined, inner
from vibroswarm.motion.robot_params import Setup

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
    """Simulate a turn until just before the step that ends it, for at most ``most`` ticks.

    Steps at full command, and those of the last part of a turn (``is_tail``), are taken several at a time.

    Args:
        gain: turn gain G. error_deg, integral_deg_s: state of the turn after the latest step.
    Returns: the number of ticks n (at least 1) to the step that ends the turn; and error (deg), integral (deg s) and
        gyro (deg per tick) just before that step. If the turn does not end within ``most`` ticks, n is ``most``.
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

    Two conditions must hold:

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
    """Simulate the last part of a turn from tick ``n`` to just before the step that ends it, at most to tick ``most``.

    A step is linear there, (e, I) <- M (e, I), and the error falls until the turn ends. So if the error is above the
    tolerance after sixteen steps, it was above it in all of them. Sixteen steps are then taken at once, by M^16; after
    these, four at once, by M^4; and then single ones.

    A step that takes the error across the whole tolerance, to the other side, counts as the end of the turn too: the
    robot wakes at this step, goes on turning, and plans again.

    Returns: the tick reached, the error (deg) and the integral (deg s).
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
    """Return a number of ticks for which the command surely stays full and the turn does not end, at most ``most``.

    This is a lower bound; it is 0 if the command is below full.
    """
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
