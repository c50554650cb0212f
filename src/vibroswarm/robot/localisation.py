"""Where a robot believes it is: a mixture of Gaussians over its pose, speed and gyro errors, corrected at walls.

Each component is a Kalman filter of one possible history. Each component draws the discrete events of its history at
random: whether a ray saw the wall in x, the wall in y or another robot, and whether the robot was blocked in a drive.
So few components do the work of many particles (a Rao-Blackwellised particle filter: Doucet et al., "Rao-Blackwellised
particle filtering for dynamic Bayesian networks", UAI 2000). All arrays have a fixed size; nothing is allocated.
The functions change the mixture ``f`` (``pose_mixture.Mixture``) in place; ``i`` is the index of a component.

| name | symbol | unit | equation |
|---|---|---|---|
| state | m | m, m, rad, -, rad/s, - | x, y, heading, speed factor, gyro bias, gyro scale less 1 |
| turn | t | rad | (measured - bias duration) / (1 + scale) |
| drive | - | m | speed factor * full speed * battery * duration, along heading + t / 2, times sinc(t / 2) |
| covariance | P | - | F P F' + Q at each move, F the derivative of the new state by the old |
| ray | q | m | distance of the nearest wall along the rays, q = h(m), H its derivative |
| innovation | e, S | m, m^2 | ray as measured - q; H P H' + ray noise |
| correction | - | - | m += P H' e / S, P -= P H' H P / S |
| weight | - | - | at an obstacle: multiplied by density of e under N(0, S) + density of meeting a robot |
| nothing seen | - | - | q > threshold: moments of the Gaussian truncated there; weight times P(q > threshold) |
| unexpected | n | - | sum of -ln P(nothing seen) of drives and P(robot) of obstacles; fades by KEPT at each obstacle |
| excess | - | - | max(n / obstacles - USUAL, 0): if it grows, stated spreads and ``lost_share`` grow |
| smoothed place | - | m | places of the last ``lag`` samples, corrected with the state by their covariance with it |

A robot whose assumed noise is wrong seems to meet robots where there are walls, and walls where there are none. It
cannot know the cause, but it can state a larger uncertainty of its place, and consider poses that are further away.

Memory of a robot with 4-byte numbers and symmetric covariances stored once: 4 (6 + 21 + 1 + lag (2 + 2 + 12)) bytes per
component. At a lag of 4 this is 1.5 kB for 4 components and 5.9 kB for 16.
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
"""Mean share of a drive that a blocked robot covers."""
BLOCKED_SPREAD: Final = 0.29
"""Standard deviation of the share of a drive that a blocked robot covers; the share is uniform in [0, 1]."""
LEAST_LIKELY: Final = 1e-9
"""Lower limit of a probability whose logarithm the monitor adds, so that one event cannot dominate its sum."""
LOST_SLOPE: Final = 0.3
"""Growth of ``lost_share`` per unit of the monitor's excess."""
LOST_MOST: Final = 0.5
"""Upper limit of ``lost_share`` while it grows with the monitor's excess."""
WIDEN_SLOPE: Final = 4.0
"""Growth of the factor of stated spreads per unit of the monitor's excess."""
WIDEN_MOST: Final = 10.0
"""Upper limit of the factor of stated spreads, which grows with the monitor's excess."""


@inlined
def add_move(f: Mixture, i: int, with_place: bool) -> None:
    """Propagate the covariances of component ``i`` through a move: P becomes F P F', past covariances C become C F'.

    The rows of F that differ from the identity are in ``f.rows``: row 0 the heading's derivatives, 2 those of x, 3
    those of y.
    """
    row, covariance, cross = f.rows, f.covariances, f.past_covariances
    of_bias, of_scale = row[0, BIAS], row[0, SCALE]
    x_heading, x_speed, x_bias, x_scale = row[2, HEADING], row[2, SPEED], row[2, BIAS], row[2, SCALE]
    y_heading, y_speed, y_bias, y_scale = row[3, HEADING], row[3, SPEED], row[3, BIAS], row[3, SCALE]
    # F P, column by column; all changes are computed from the old values of the column, which are read first.
    for j in range(STATES):
        heading, speed = covariance[i, HEADING, j], covariance[i, SPEED, j]
        bias, scale = covariance[i, BIAS, j], covariance[i, SCALE, j]
        if with_place:
            covariance[i, X, j] += x_heading * heading + x_speed * speed + x_bias * bias + x_scale * scale
            covariance[i, Y, j] += y_heading * heading + y_speed * speed + y_bias * bias + y_scale * scale
        covariance[i, HEADING, j] += of_bias * bias + of_scale * scale
    for j in range(SPEED):  # (F P) F', for the rows before SPEED: x, y and heading
        heading, speed = covariance[i, j, HEADING], covariance[i, j, SPEED]
        bias, scale = covariance[i, j, BIAS], covariance[i, j, SCALE]
        if with_place:
            covariance[i, j, X] += x_heading * heading + x_speed * speed + x_bias * bias + x_scale * scale
            covariance[i, j, Y] += y_heading * heading + y_speed * speed + y_bias * bias + y_scale * scale
        covariance[i, j, HEADING] += of_bias * bias + of_scale * scale
    for j in range(SPEED):  # the rows of speed, bias and scale, by symmetry
        for k in range(SPEED, STATES):
            covariance[i, k, j] = covariance[i, j, k]
    for n in range(f.past.shape[1]):  # C F', for x (a = 0) and y (a = 1) of each past sample
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
    """Move all components by a drive that has ended, and correct and weigh them by what is known at its end.

    The robot is inside the arena, and unless the drive ended at an obstacle, no ray saw a wall. What a ray saw is
    used later, by ``obstacle``. If ``program.corrects`` is false, the components are only moved.
    """
    mean, covariance, row = f.means, f.covariances, f.rows
    full_m = program.full_speed_m_s * (1.0 - sampled_s / program.battery_life_s) * duration_s
    # walk: variance of the measured angle, rad^2. heeds: whether it is known that the rays saw nothing at the drive's
    # end: the drive did not end at an obstacle, and was longer than the time for which rays are ignored after a turn.
    walk = program.gyro_walk_rad_sqrt_s * program.gyro_walk_rad_sqrt_s * duration_s
    heeds = program.corrects and not at_obstacle and duration_s > program.blind_s
    weighed = False
    for i in range(f.weights.size):
        turn = (turned_rad - mean[i, BIAS] * duration_s) / (1.0 + mean[i, SCALE])
        half = 0.5 * turn
        sinc = math.sin(half) / half if abs(half) > 1e-6 else 1.0
        # share: share of the drive that was covered. blocked_m2: variance of the driven distance if it was blocked,
        # m^2.
        share, blocked_m2 = 1.0, 0.0
        if program.corrects and next_uniform(f) < program.blocked_share:
            share = BLOCKED_DRIVE
            spread_m = BLOCKED_SPREAD * full_m * mean[i, SPEED]
            blocked_m2 = spread_m * spread_m
        cosine, sine = math.cos(mean[i, HEADING] + half), math.sin(mean[i, HEADING] + half)
        per_speed_m = share * full_m * sinc
        chord_m = per_speed_m * mean[i, SPEED]
        # The drive is an arc; its chord points along the heading plus turn / 2. So the chord rotates by half of a
        # change of the turn. Its length is proportional to sinc(turn / 2), whose derivative by the turn is about -turn
        # / 12.
        x_by_turn = -0.5 * chord_m * sine - chord_m * turn / 12.0 * cosine
        y_by_turn = 0.5 * chord_m * cosine - chord_m * turn / 12.0 * sine
        # Write the derivatives of the new state by the old for ``add_move``: row 0 holds those of the heading, row 2
        # those of x, row 3 those of y. Row 1 is not used in a move. ``add_move`` reads only the entries that are set
        # here; the others may hold old values. In these derivatives 1 + scale counts as 1, so the derivatives of the
        # turn are -duration (by the bias) and -turn (by the scale).
        row[0, BIAS], row[0, SCALE] = -duration_s, -turn
        row[2, HEADING], row[2, SPEED] = -chord_m * sine, per_speed_m * cosine
        row[2, BIAS], row[2, SCALE] = -duration_s * x_by_turn, -turn * x_by_turn
        row[3, HEADING], row[3, SPEED] = chord_m * cosine, per_speed_m * sine
        row[3, BIAS], row[3, SCALE] = -duration_s * y_by_turn, -turn * y_by_turn
        mean[i, X] += chord_m * cosine
        mean[i, Y] += chord_m * sine
        mean[i, HEADING] += turn
        add_move(f, i, True)  # True: x and y change too, not only the heading
        # Noise of the drive: the gyro's angle error acts on x, y and heading together; blocking acts along the chord.
        covariance[i, X, X] += x_by_turn * x_by_turn * walk + blocked_m2 * cosine * cosine
        covariance[i, Y, Y] += y_by_turn * y_by_turn * walk + blocked_m2 * sine * sine
        covariance[i, HEADING, HEADING] += walk
        # both: noise that x and y share, their covariance
        both = x_by_turn * y_by_turn * walk + blocked_m2 * cosine * sine
        covariance[i, X, Y] += both
        covariance[i, Y, X] += both
        covariance[i, X, HEADING] += x_by_turn * walk
        covariance[i, HEADING, X] += x_by_turn * walk
        covariance[i, Y, HEADING] += y_by_turn * walk
        covariance[i, HEADING, Y] += y_by_turn * walk
        if program.corrects:
            # left: probability, by this component, that the robot is inside the arena and (if ``heeds``) saw no wall
            left = inside(f, i, program)
            if heeds:
                left *= saw_nothing(f, i, program)
            if left < 1.0:
                f.weights[i] *= left
                weighed = True
    if weighed:
        # The weights summed to 1 before. Their sum is now the probability of what is known: that the robot is inside,
        # and (if ``heeds``) that no ray saw a wall.
        likely = 0.0
        for i in range(f.weights.size):
            likely += f.weights[i]
        # LEAST_LIKELY limits how much a single event adds to the monitor; 1.0 is a limit for rounding.
        f.monitor[UNEXPECTED] -= math.log(min(max(likely, LEAST_LIKELY), 1.0))
        resample(f)


@inner
def turn(f: Mixture, program: LocalisationProgram, duration_s: float, turned_rad: float) -> None:
    """Turn all components by a turn in place that has ended, and add its noise."""
    walk = program.gyro_walk_rad_sqrt_s * program.gyro_walk_rad_sqrt_s * duration_s
    noise = program.turn_noise_rad * program.turn_noise_rad + walk  # variance of the measured angle
    # Variance of the place: the centre moves on a small circle.
    shift = program.turn_shift_m * program.turn_shift_m
    for i in range(f.weights.size):
        angle = (turned_rad - f.means[i, BIAS] * duration_s) / (1.0 + f.means[i, SCALE])
        f.means[i, HEADING] += angle
        # Derivatives of the new heading by bias and scale, for ``add_move``; in them 1 + scale counts as 1.
        f.rows[0, BIAS], f.rows[0, SCALE] = -duration_s, -angle
        add_move(f, i, False)
        f.covariances[i, HEADING, HEADING] += noise
        f.covariances[i, X, X] += shift
        f.covariances[i, Y, Y] += shift


@inner
def obstacle(f: Mixture, program: LocalisationProgram, ray_m: float, after_drive: bool) -> None:
    """Correct and weigh all components by an avoidance that began because the shortest ray had length ``ray_m``.

    It is 0 if the ray begins inside an obstacle. In turns in place, another robot is assumed to be twice as likely.
    """
    if not program.corrects:
        return
    robots = program.robots_per_m if after_drive else 2.0 * program.robots_per_m
    # ``lost_share`` grows with the excess up to LOST_MOST, but never falls below the program's own value.
    lost_share = min(program.lost_share + LOST_SLOPE * excess(f, program), max(LOST_MOST, program.lost_share))
    # density: probability density of this ray length, averaged over the components by weight, 1/m. of_robots: the part
    # of this density that is due to other robots. If ``ray_m`` is 0, both are sums of probabilities instead (``meet``).
    density, of_robots = 0.0, 0.0
    for i in range(f.weights.size):
        of_component, of_robot = meet(f, i, program, ray_m, robots, lost_share)
        density += f.weights[i] * of_component
        of_robots += f.weights[i] * of_robot
        f.weights[i] *= of_component
    # of_robots / density is the probability that the obstacle was a robot; the monitor sums it up as unexpected. The
    # density is above 0: ``meet`` adds LEAST to that of each component, and the weights summed to 1.
    f.monitor[UNEXPECTED] = KEPT * f.monitor[UNEXPECTED] + of_robots / density
    f.monitor[OBSTACLES] = KEPT * f.monitor[OBSTACLES] + 1.0
    resample(f)


@inner
def sampled(f: Mixture, program: LocalisationProgram, estimate: NDArray[np.float64]) -> None:
    """Write the robot's estimate (``ESTIMATE``) at a sample just taken, and store the sample's place."""
    number, lag = f.numbers[SAMPLES], f.past.shape[1]
    slot = number % lag
    # Indices of estimate: 0, 1 place; 2 heading; 3 spread; 4 lagged sample; 5, 6 its place; 7, 8 its spreads.
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
    # Variance of the mixture: the variances within the components plus the squared distances of their means from the
    # mixture's mean. max: corrections may leave a variance slightly below 0 by rounding.
    for i in range(f.weights.size):
        weight = f.weights[i]
        x_m, y_m = f.means[i, X] - estimate[0], f.means[i, Y] - estimate[1]
        estimate[3] += (
            0.5 * weight * (f.covariances[i, X, X] + f.covariances[i, Y, Y] + x_m * x_m + y_m * y_m)
        )
        x_m, y_m = f.past[i, slot, 0] - estimate[5], f.past[i, slot, 1] - estimate[6]
        estimate[7] += weight * (max(f.past_variances[i, slot, 0], 0.0) + x_m * x_m)
        estimate[8] += weight * (max(f.past_variances[i, slot, 1], 0.0) + y_m * y_m)
    # Stated spreads grow while recent obstacles contradict the estimated pose more often than usual (``excess``).
    factor = min(1.0 + WIDEN_SLOPE * excess(f, program), WIDEN_MOST)
    for j in (3, 7, 8):  # from variances to standard deviations
        estimate[j] = factor * math.sqrt(max(estimate[j], 0.0))
    # Save the present place of each component, with its covariances with the state, for later corrections.
    for i in range(f.weights.size):
        for a in range(2):
            f.past[i, slot, a], f.past_variances[i, slot, a] = f.means[i, a], f.covariances[i, a, a]
            for j in range(STATES):
                f.past_covariances[i, slot, a, j] = f.covariances[i, a, j]
        change_speed(f, i, program)
    f.numbers[SAMPLES] = number + 1


@inlined
def change_speed(f: Mixture, i: int, program: LocalisationProgram) -> None:
    """Update a component's speed factor after a sample, if the robot's true factor changes at samples.

    One drawn at each sample is reset to its prior; one that varies (``speed_wander``) is taken for a random walk.
    """
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
