"""What rays tell a component of ``localisation``: a wall, another robot, or that no wall is near."""

from __future__ import annotations

import math
from typing import Final

from vibroswarm.core.jit import inlined
from vibroswarm.robot.pose_mixture import (
    BIAS,
    HEADING,
    SCALE,
    SPEED,
    STATES,
    LocalisationProgram,
    Mixture,
    X,
    Y,
    next_uniform,
)

HALF_ROOT: Final = math.sqrt(0.5)
DENSITY: Final = 1.0 / math.sqrt(2.0 * math.pi)
UNSEEN_M: Final = 1e6
"""Distance of a wall that no ray points at."""
SLANT: Final = 0.05
"""A ray less inclined to a wall than this sine tells nothing of it."""
LOST_SPREAD_M: Final = 0.1
LOST_SPREAD_RAD: Final = math.radians(10.0)
LOST_SHARE: Final = 0.3
"""What is added to the spread of a component that may be lost; for speed, bias and scale as a share of their law's."""
NEAR_WALL_M: Final = 0.02
"""A component this near to touching a wall is corrected by being inside."""
LEAST: Final = 1e-9
"""Least factor of a weight."""
ROBOT_AT_0: Final = 0.3
"""Weight of a robot if a ray begins inside of something, beside the probabilities of walls."""


@inlined
def wall_rays(f: Mixture, i: int, program: LocalisationProgram) -> tuple[float, ...]:
    """Return the shortest distance of the rays to the walls in x, its derivatives by x and heading; the same in y.

    The distance is UNSEEN_M, with derivatives 0, if no ray points at such a wall.
    """
    mean = f.means
    x_m, y_m = mean[i, X], mean[i, Y]
    cosine, sine = math.cos(mean[i, HEADING]), math.sin(mean[i, HEADING])
    of_x, x_by_x, x_by_heading = UNSEEN_M, 0.0, 0.0
    of_y, y_by_y, y_by_heading = UNSEEN_M, 0.0, 0.0
    for j in range(program.ray_side_m.size):
        side_m = program.ray_side_m[j]
        from_x = program.ray_forward_m * cosine - side_m * sine
        from_y = program.ray_forward_m * sine + side_m * cosine
        dx = cosine * program.ray_cos[j] - sine * program.ray_sin[j]
        dy = sine * program.ray_cos[j] + cosine * program.ray_sin[j]
        if abs(dx) > SLANT:
            t = ((program.width_m if dx > 0.0 else 0.0) - x_m - from_x) / dx
            if t < of_x:
                of_x, x_by_x, x_by_heading = t, -1.0 / dx, (from_y + t * dy) / dx
        if abs(dy) > SLANT:
            t = ((program.height_m if dy > 0.0 else 0.0) - y_m - from_y) / dy
            if t < of_y:
                of_y, y_by_y, y_by_heading = t, -1.0 / dy, -(from_x + t * dx) / dy
    return of_x, x_by_x, x_by_heading, of_y, y_by_y, y_by_heading


@inlined
def gain(f: Mixture, i: int, axis: int, by_place: float, by_heading: float) -> float:
    """Write P H' to row ``axis`` of the scratch; return H P H'."""
    row, covariance = f.rows, f.covariances
    for j in range(STATES):
        row[axis, j] = covariance[i, j, axis] * by_place + covariance[i, j, HEADING] * by_heading
    return float(row[axis, axis] * by_place + row[axis, HEADING] * by_heading)


@inlined
def correct(
    f: Mixture,
    i: int,
    axis: int,
    by_place: float,
    by_heading: float,
    variance: float,
    shift: float,
    share: float,
) -> None:
    """Correct a component, and its past places, by a measured number of which ``gain`` was computed last.

    Args:
        variance: S. shift: change of the number's mean. share: reduction of its variance, as a share of S.
    """
    row, covariance, cross = f.rows, f.covariances, f.past_covariances
    step, shrinks = shift / variance, share / variance
    for j in range(STATES):
        f.means[i, j] += row[axis, j] * step
    for n in range(f.past.shape[1]):
        for a in range(2):
            with_number = cross[i, n, a, axis] * by_place + cross[i, n, a, HEADING] * by_heading
            part = with_number * shrinks
            f.past[i, n, a] += with_number * step
            f.past_variances[i, n, a] -= part * with_number
            for j in range(STATES):
                cross[i, n, a, j] -= part * row[axis, j]
    for j in range(STATES):
        part = row[axis, j] * shrinks
        for k in range(j + 1):
            value = covariance[i, j, k] - part * row[axis, k]
            covariance[i, j, k] = value
            covariance[i, k, j] = value


@inlined
def learn_beyond(
    f: Mixture, i: int, axis: int, by_place: float, by_heading: float, mean: float, least: float, noise: float
) -> float:
    """Learn that a number is above ``least``: match the moments of its Gaussian cut off there.

    Returns: the probability that it is, at least LEAST; 1, with no correction, if this is beyond doubt.
    """
    variance = gain(f, i, axis, by_place, by_heading) + noise * noise
    above = mean - least
    if above > 0.0 and above * above > 9.0 * variance:
        return 1.0
    spread = math.sqrt(variance)
    cut = -above / spread
    left = 0.5 * math.erfc(cut * HALF_ROOT)
    ratio = DENSITY * math.exp(-0.5 * cut * cut) / left if cut < 5.0 else cut + 1.0 / cut
    correct(f, i, axis, by_place, by_heading, variance, spread * ratio, min(ratio * (ratio - cut), 1.0))
    return max(left, LEAST)


@inlined
def inside(f: Mixture, i: int, program: LocalisationProgram) -> float:
    """Learn that the robot is inside the arena; return how probable that was."""
    near_m, left = program.radius_m + NEAR_WALL_M, 1.0
    for axis in range(2):
        at_m, by_place = f.means[i, axis], 1.0
        beyond_m = (program.width_m if axis == X else program.height_m) - at_m
        if beyond_m < at_m:
            at_m, by_place = beyond_m, -1.0
        if at_m < near_m:
            left *= learn_beyond(f, i, axis, by_place, 0.0, at_m, program.radius_m, program.seen_noise_m)
    return left


@inlined
def saw_nothing(f: Mixture, i: int, program: LocalisationProgram) -> float:
    """Learn that no ray saw a wall; return how probable that was."""
    spread_m = math.sqrt(max(f.covariances[i, X, X], f.covariances[i, Y, Y]))
    far_m = program.avoidance_threshold_m + program.ray_forward_m + 0.01 + 2.5 * spread_m
    x_m, y_m = f.means[i, X], f.means[i, Y]
    if min(min(x_m, program.width_m - x_m), min(y_m, program.height_m - y_m)) > far_m:
        return 1.0
    return saw_no_wall(f, i, program)


@inlined
def saw_no_wall(f: Mixture, i: int, program: LocalisationProgram) -> float:
    """Compute ``saw_nothing`` for a component that may be near a wall."""
    of_x, x_by_x, x_by_heading, of_y, y_by_y, y_by_heading = wall_rays(f, i, program)
    left = 1.0
    for axis in range(2):
        if axis == Y:
            if left < 1.0:
                _, _, _, of_y, y_by_y, y_by_heading = wall_rays(f, i, program)
            of_x, x_by_x, x_by_heading = of_y, y_by_y, y_by_heading
        left *= learn_beyond(
            f, i, axis, x_by_x, x_by_heading, of_x, program.avoidance_threshold_m, program.seen_noise_m
        )
    return left


@inlined
def meet(
    f: Mixture, i: int, program: LocalisationProgram, ray_m: float, robots: float, lost_share: float
) -> tuple[float, float]:
    """Choose a wall in x, one in y, or a robot for what a ray saw, and correct by it.

    Args:
        lost_share: probability that the component widens if it chooses a robot.
    Returns: the density of what the ray saw, 1/m, and that of a robot alone.
    """
    of_x, x_by_x, x_by_heading, of_y, y_by_y, y_by_heading = wall_rays(f, i, program)
    noise = program.ray_noise_m * program.ray_noise_m
    x_variance = gain(f, i, X, x_by_x, x_by_heading) + noise
    y_variance = gain(f, i, Y, y_by_y, y_by_heading) + noise
    x_error, y_error = ray_m - of_x, ray_m - of_y
    x_spread, y_spread = math.sqrt(x_variance), math.sqrt(y_variance)
    x_beyond = 0.5 * math.erfc(x_error / x_spread * HALF_ROOT)
    y_beyond = 0.5 * math.erfc(y_error / y_spread * HALF_ROOT)
    if ray_m > 0.0:
        x_density = (
            DENSITY / x_spread * math.exp(-0.5 * min(x_error * x_error / x_variance, 1000.0)) * y_beyond
        )
        y_density = (
            DENSITY / y_spread * math.exp(-0.5 * min(y_error * y_error / y_variance, 1000.0)) * x_beyond
        )
        robot_density = robots * x_beyond * y_beyond
    else:  # a probability in place of a density
        x_density, y_density, robot_density = 1.0 - x_beyond, 1.0 - y_beyond, ROBOT_AT_0
    total = x_density + y_density + robot_density + LEAST
    chosen = next_uniform(f) * total
    if f.weights.size == 1:  # one component takes what is most probable
        chosen = 0.0 if x_density >= max(y_density, robot_density) else x_density
        if robot_density > max(x_density, y_density):
            chosen = total
    if chosen < x_density + y_density:
        axis = X if chosen < x_density else Y
        if axis == Y:
            of_x, x_by_x, x_by_heading, x_variance, x_error = of_y, y_by_y, y_by_heading, y_variance, y_error
        if ray_m > 0.0:
            correct(f, i, axis, x_by_x, x_by_heading, x_variance, x_error, 1.0)
        else:
            learn_beyond(f, i, axis, -x_by_x, -x_by_heading, -of_x, 0.0, program.ray_noise_m)
    elif next_uniform(f) < lost_share:
        widen(f, i, program)
    return total, robot_density


@inlined
def widen(f: Mixture, i: int, program: LocalisationProgram) -> None:
    """Add to the spread of a component that may be lost."""
    covariance, share = f.covariances, LOST_SHARE * LOST_SHARE
    covariance[i, X, X] += LOST_SPREAD_M * LOST_SPREAD_M
    covariance[i, Y, Y] += LOST_SPREAD_M * LOST_SPREAD_M
    covariance[i, HEADING, HEADING] += LOST_SPREAD_RAD * LOST_SPREAD_RAD
    covariance[i, BIAS, BIAS] += share * program.gyro_bias_spread_rad_s * program.gyro_bias_spread_rad_s
    covariance[i, SCALE, SCALE] += share * program.gyro_scale_spread * program.gyro_scale_spread
    if not program.speed_redrawn:
        covariance[i, SPEED, SPEED] += share * program.speed_spread * program.speed_spread
