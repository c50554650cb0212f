"""Where a robot believes it is: a mixture of Gaussians over its pose, speed and gyro errors, corrected at walls.

Each component is a Kalman filter of one history; what is discrete is drawn at random by each component: whether a ray
saw a wall, which, or another robot, and whether the robot was blocked. So few components do the work of many
particles (a Rao-Blackwellised particle filter: Doucet et al., "Rao-Blackwellised particle filtering for dynamic
Bayesian networks", UAI 2000). Scalars and arrays of fixed size; nothing is allocated.

| name | symbol | unit | equation |
|---|---|---|---|
| state | m | m, m, rad, -, rad/s, - | x, y, heading, speed factor, gyro bias, gyro scale less 1 |
| turn | t | rad | (measured - bias duration) / (1 + scale) |
| drive | - | m | speed factor * full speed * battery * duration, along heading + t / 2, times sinc(t / 2) |
| covariance | P | - | F P F' + Q at each move, F the derivative of the new state by the old |
| ray | q | m | distance of the nearest wall along the rays, q = h(m), H its derivative |
| innovation | e, S | m, m^2 | ray as measured - q; H P H' + ray noise |
| correction | - | - | m += P H' e / S, P -= P H' H P / S |
| weight | - | - | times the density of e, N(0, S), plus that of meeting a robot |
| nothing seen | - | - | q > threshold: mean and variance of the Gaussian cut off there; weight times what is left |
| unexpected | n | - | sum of -ln(weight left) if nothing was seen, of P(robot) at each obstacle; fades by KEPT |
| excess | - | - | max(n / obstacles - USUAL, 0): with it stated spreads and ``lost_share`` grow |
| smoothed place | - | m | places of the last ``lag`` samples, corrected with the state by their covariance with it |

A robot whose laws are not as it was told meets "robots" where there are walls, and walls that are not there. It cannot
tell why, but it can say that its places are less sure than the laws make them, and look for itself further away.

Memory of a robot with 4-byte numbers and symmetric covariances stored once: 4 (6 + 21 + 1 + lag (2 + 2 + 12)) bytes a
component: 1.5 kB for 4 components, 5.9 kB for 16, at a lag of 4.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inlined, inner
from vibroswarm.robot.pose_correction import inside, meet, saw_nothing
from vibroswarm.robot.pose_mixture import (
    BIAS,
    HEADING,
    KEPT,
    OBSTACLES,
    SAMPLES,
    SCALE,
    SPEED,
    STATES,
    UNEXPECTED,
    LocalisationProgram,
    Mixture,
    X,
    Y,
    excess,
    next_uniform,
    resample,
)

BLOCKED_DRIVE: Final = 0.5
BLOCKED_SPREAD: Final = 0.29
"""Mean and standard deviation of the share of a drive that a robot blocked in it has driven: uniform."""
LEAST_LIKELY: Final = 1e-9
"""A probability below this is unexpected no more than this."""
LOST_SLOPE: Final = 0.3
LOST_MOST: Final = 0.5
"""How ``lost_share`` grows with the monitor's excess, and up to which value."""
WIDEN_SLOPE: Final = 4.0
WIDEN_MOST: Final = 10.0
"""How the factor of stated spreads grows with it, and up to which value."""


@inlined
def add_move(f: Mixture, i: int, with_place: bool) -> None:
    """Set P to F P F', F from the scratch: rows 2 and 3 are the derivatives of x and y, row 0 that of the heading."""
    row, covariance, cross = f.rows, f.covariances, f.past_covariances
    of_bias, of_scale = row[0, BIAS], row[0, SCALE]
    x_heading, x_speed, x_bias, x_scale = row[2, HEADING], row[2, SPEED], row[2, BIAS], row[2, SCALE]
    y_heading, y_speed, y_bias, y_scale = row[3, HEADING], row[3, SPEED], row[3, BIAS], row[3, SCALE]
    for j in range(STATES):
        heading, speed = covariance[i, HEADING, j], covariance[i, SPEED, j]
        bias, scale = covariance[i, BIAS, j], covariance[i, SCALE, j]
        if with_place:
            covariance[i, X, j] += x_heading * heading + x_speed * speed + x_bias * bias + x_scale * scale
            covariance[i, Y, j] += y_heading * heading + y_speed * speed + y_bias * bias + y_scale * scale
        covariance[i, HEADING, j] += of_bias * bias + of_scale * scale
    for j in range(SPEED):
        heading, speed = covariance[i, j, HEADING], covariance[i, j, SPEED]
        bias, scale = covariance[i, j, BIAS], covariance[i, j, SCALE]
        if with_place:
            covariance[i, j, X] += x_heading * heading + x_speed * speed + x_bias * bias + x_scale * scale
            covariance[i, j, Y] += y_heading * heading + y_speed * speed + y_bias * bias + y_scale * scale
        covariance[i, j, HEADING] += of_bias * bias + of_scale * scale
    for j in range(SPEED):  # the other columns of rows that do not change
        for k in range(SPEED, STATES):
            covariance[i, k, j] = covariance[i, j, k]
    for n in range(f.past.shape[1]):
        for a in range(2):
            heading, speed = cross[i, n, a, HEADING], cross[i, n, a, SPEED]
            bias, scale = cross[i, n, a, BIAS], cross[i, n, a, SCALE]
            if with_place:
                cross[i, n, a, X] += x_heading * heading + x_speed * speed + x_bias * bias + x_scale * scale
                cross[i, n, a, Y] += y_heading * heading + y_speed * speed + y_bias * bias + y_scale * scale
            cross[i, n, a, HEADING] += of_bias * bias + of_scale * scale


@inner
def drive(
    f: Mixture,
    program: LocalisationProgram,
    duration_s: float,
    turned_rad: float,
    sampled_s: float,
    at_obstacle: bool,
) -> None:
    """Update the mixture by a drive that has ended.

    Args:
        duration_s: how long the robot drove. turned_rad: as the gyro measured. sampled_s: time of the last sample,
            since which the battery's factor is the same. at_obstacle: whether it ended because a ray saw something.
    """
    mean, covariance, row = f.means, f.covariances, f.rows
    full_m = program.full_speed_m_s * (1.0 - sampled_s / program.battery_life_s) * duration_s
    walk = program.gyro_walk_rad_sqrt_s * program.gyro_walk_rad_sqrt_s * duration_s
    heeds = program.corrects and not at_obstacle and duration_s > program.blind_s
    weighed = False
    for i in range(f.weights.size):
        turn = (turned_rad - mean[i, BIAS] * duration_s) / (1.0 + mean[i, SCALE])
        half = 0.5 * turn
        sinc = math.sin(half) / half if abs(half) > 1e-6 else 1.0
        share, blocked_m2 = 1.0, 0.0
        if program.corrects and next_uniform(f) < program.blocked_share:
            share = BLOCKED_DRIVE
            spread_m = BLOCKED_SPREAD * full_m * mean[i, SPEED]
            blocked_m2 = spread_m * spread_m
        cosine, sine = math.cos(mean[i, HEADING] + half), math.sin(mean[i, HEADING] + half)
        per_speed_m = share * full_m * sinc
        chord_m = per_speed_m * mean[i, SPEED]
        x_by_turn = -0.5 * chord_m * sine - chord_m * turn / 12.0 * cosine
        y_by_turn = 0.5 * chord_m * cosine - chord_m * turn / 12.0 * sine
        row[0, BIAS], row[0, SCALE] = -duration_s, -turn
        row[2, HEADING], row[2, SPEED] = -chord_m * sine, per_speed_m * cosine
        row[2, BIAS], row[2, SCALE] = -duration_s * x_by_turn, -turn * x_by_turn
        row[3, HEADING], row[3, SPEED] = chord_m * cosine, per_speed_m * sine
        row[3, BIAS], row[3, SCALE] = -duration_s * y_by_turn, -turn * y_by_turn
        mean[i, X] += chord_m * cosine
        mean[i, Y] += chord_m * sine
        mean[i, HEADING] += turn
        add_move(f, i, True)
        covariance[i, X, X] += x_by_turn * x_by_turn * walk + blocked_m2 * cosine * cosine
        covariance[i, Y, Y] += y_by_turn * y_by_turn * walk + blocked_m2 * sine * sine
        covariance[i, HEADING, HEADING] += walk
        both = x_by_turn * y_by_turn * walk + blocked_m2 * cosine * sine
        covariance[i, X, Y] += both
        covariance[i, Y, X] += both
        covariance[i, X, HEADING] += x_by_turn * walk
        covariance[i, HEADING, X] += x_by_turn * walk
        covariance[i, Y, HEADING] += y_by_turn * walk
        covariance[i, HEADING, Y] += y_by_turn * walk
        if program.corrects:
            left = inside(f, i, program)
            if heeds:
                left *= saw_nothing(f, i, program)
            if left < 1.0:
                f.weights[i] *= left
                weighed = True
    if weighed:
        likely = 0.0
        for i in range(f.weights.size):
            likely += f.weights[i]
        f.monitor[UNEXPECTED] -= math.log(min(max(likely, LEAST_LIKELY), 1.0))
        resample(f)


@inner
def turn(f: Mixture, program: LocalisationProgram, duration_s: float, turned_rad: float) -> None:
    """Update the mixture by a turn in place that has ended: at the end of a leg, or to avoid something."""
    walk = program.gyro_walk_rad_sqrt_s * program.gyro_walk_rad_sqrt_s * duration_s
    noise = program.turn_noise_rad * program.turn_noise_rad + walk
    shift = program.turn_shift_m * program.turn_shift_m
    for i in range(f.weights.size):
        angle = (turned_rad - f.means[i, BIAS] * duration_s) / (1.0 + f.means[i, SCALE])
        f.means[i, HEADING] += angle
        f.rows[0, BIAS], f.rows[0, SCALE] = -duration_s, -angle
        add_move(f, i, False)
        f.covariances[i, HEADING, HEADING] += noise
        f.covariances[i, X, X] += shift
        f.covariances[i, Y, Y] += shift


@inner
def obstacle(f: Mixture, program: LocalisationProgram, ray_m: float, after_drive: bool) -> None:
    """Update the mixture by an avoidance that began because the shortest ray was ``ray_m``.

    Args:
        ray_m: 0 if the ray begins inside of something. after_drive: whether the robot drove before, or turned.
    """
    if not program.corrects:
        return
    robots = program.robots_per_m if after_drive else 2.0 * program.robots_per_m
    lost_share = min(program.lost_share + LOST_SLOPE * excess(f, program), max(LOST_MOST, program.lost_share))
    density, of_robots = 0.0, 0.0
    for i in range(f.weights.size):
        of_component, of_robot = meet(f, i, program, ray_m, robots, lost_share)
        density += f.weights[i] * of_component
        of_robots += f.weights[i] * of_robot
        f.weights[i] *= of_component
    f.monitor[UNEXPECTED] = KEPT * f.monitor[UNEXPECTED] + of_robots / density
    f.monitor[OBSTACLES] = KEPT * f.monitor[OBSTACLES] + 1.0
    resample(f)


@inner
def sampled(f: Mixture, program: LocalisationProgram, estimate: NDArray[np.float64]) -> None:
    """Write the estimate (``ESTIMATE``) at a sample that was just taken, and remember its place.

    Before ``lag`` samples, the number of the lagged sample is -1 and its place is 0.
    """
    number, lag = f.numbers[SAMPLES], f.past.shape[1]
    slot = number % lag
    east, north = 0.0, 0.0
    for j in range(9):
        estimate[j] = 0.0
    for i in range(f.weights.size):
        weight = f.weights[i]
        estimate[0] += weight * f.means[i, X]
        estimate[1] += weight * f.means[i, Y]
        east += weight * math.cos(f.means[i, HEADING])
        north += weight * math.sin(f.means[i, HEADING])
        estimate[5] += weight * f.past[i, slot, 0]
        estimate[6] += weight * f.past[i, slot, 1]
    estimate[2], estimate[4] = math.atan2(north, east), number - lag if number >= lag else -1
    for i in range(f.weights.size):
        weight = f.weights[i]
        x_m, y_m = f.means[i, X] - estimate[0], f.means[i, Y] - estimate[1]
        estimate[3] += (
            0.5 * weight * (f.covariances[i, X, X] + f.covariances[i, Y, Y] + x_m * x_m + y_m * y_m)
        )
        x_m, y_m = f.past[i, slot, 0] - estimate[5], f.past[i, slot, 1] - estimate[6]
        estimate[7] += weight * (max(f.past_variances[i, slot, 0], 0.0) + x_m * x_m)
        estimate[8] += weight * (max(f.past_variances[i, slot, 1], 0.0) + y_m * y_m)
    factor = min(1.0 + WIDEN_SLOPE * excess(f, program), WIDEN_MOST)
    for j in (3, 7, 8):
        estimate[j] = factor * math.sqrt(max(estimate[j], 0.0))
    for i in range(f.weights.size):
        for a in range(2):
            f.past[i, slot, a], f.past_variances[i, slot, a] = f.means[i, a], f.covariances[i, a, a]
            for j in range(STATES):
                f.past_covariances[i, slot, a, j] = f.covariances[i, a, j]
        change_speed(f, i, program)
    f.numbers[SAMPLES] = number + 1


@inlined
def change_speed(f: Mixture, i: int, program: LocalisationProgram) -> None:
    """Forget the speed if it is redrawn after each sample, or let it wander."""
    if program.speed_redrawn:
        f.means[i, SPEED] = program.speed_factor
        for j in range(STATES):
            f.covariances[i, SPEED, j] = 0.0
            f.covariances[i, j, SPEED] = 0.0
        f.covariances[i, SPEED, SPEED] = program.speed_spread * program.speed_spread
        for n in range(f.past.shape[1]):
            for a in range(2):
                f.past_covariances[i, n, a, SPEED] = 0.0
    elif program.speed_wander > 0.0:
        wander = program.speed_wander * f.means[i, SPEED]
        f.covariances[i, SPEED, SPEED] += wander * wander
