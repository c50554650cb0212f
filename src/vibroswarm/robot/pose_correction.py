"""Corrections of a component of ``localisation`` by what rays saw: a wall, another robot, or nothing.

"Walls in x" are those at x = 0 and x = width. The derivative of a distance q to one has two entries, ``by_place`` and
``by_heading``, as it depends on x and heading only; likewise for y. ``axis`` (X or Y) says which it is.
"""

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
"""The factor 1 / sqrt(2) with which ``erfc`` takes a number of standard deviations."""
DENSITY: Final = 1.0 / math.sqrt(2.0 * math.pi)
"""Maximum of the standard normal density."""
UNSEEN_M: Final = 1e6
"""Distance of a wall that no ray points at."""
SLANT: Final = 0.05
"""A ray whose angle to a wall has a smaller sine than this is taken not to point at it."""
LOST_SPREAD_M: Final = 0.1
"""Standard deviation of the place that ``widen`` adds."""
LOST_SPREAD_RAD: Final = math.radians(10.0)
"""Standard deviation of the heading that ``widen`` adds."""
LOST_SHARE: Final = 0.3
"""Standard deviation of speed factor, gyro bias and gyro scale that ``widen`` adds, as a share of the initial one."""
NEAR_WALL_M: Final = 0.02
"""Components nearer than this to touching a wall are corrected by the knowledge that the robot is inside."""
LEAST: Final = 1e-9
"""Lower limit of the factors of weights, so that no weight becomes 0."""
ROBOT_AT_0: Final = 0.3
"""Weight of "another robot", relative to the probabilities of walls, if a ray begins inside an obstacle."""


@inlined
def wall_rays(f: Mixture, i: int, program: LocalisationProgram) -> tuple[float, ...]:
    """Return the distance (m) along the rays to the walls in x, its derivatives by x and heading; the same in y.

    If no ray points at a wall in x, its distance is UNSEEN_M and its derivatives are 0; likewise for y.
    """
    mean = f.means
    x_m, y_m = mean[i, X], mean[i, Y]
    cosine, sine = math.cos(mean[i, HEADING]), math.sin(mean[i, HEADING])
    of_x, x_by_x, x_by_heading = UNSEEN_M, 0.0, 0.0
    of_y, y_by_y, y_by_heading = UNSEEN_M, 0.0, 0.0
    for j in range(program.ray_side_m.size):
        side_m = program.ray_side_m[j]
        # The ray begins at (from_x, from_y) from the robot's centre and points along (dx, dy).
        from_x = program.ray_forward_m * cosine - side_m * sine
        from_y = program.ray_forward_m * sine + side_m * cosine
        dx = cosine * program.ray_cos[j] - sine * program.ray_sin[j]
        dy = sine * program.ray_cos[j] + cosine * program.ray_sin[j]
        # t: distance along the ray to the wall that it points at, from x + from_x + t dx = wall; the derivatives follow
        # from this equation. Rays almost parallel to the wall are ignored.
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
    """Write P H' to row ``axis`` of the scratch ``f.rows``; return H P H', the variance of the predicted distance."""
    row, covariance = f.rows, f.covariances
    # H has only two entries that are not 0, so P H' needs two products per state variable.
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
    """Correct a component and its past places by what was learnt about a distance q to a wall, after ``gain`` for q.

    ``variance`` is S; ``shift`` the change of the mean of q plus noise, m; ``share`` the reduction of its variance.
    """
    row, covariance, cross = f.rows, f.covariances, f.past_covariances
    # The mean grows by (P H') step, and P shrinks by (P H') (P H')' shrinks. For a past place ``with_number``, its
    # covariance with q, stands for P H'.
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
    """Correct a component by the fact that a distance is above ``least``; return the fact's probability before that.

    It takes the moments of the Gaussian truncated at ``least``; from 3 standard deviations on it is left as it is.
    """
    variance = gain(f, i, axis, by_place, by_heading) + noise * noise
    above = mean - least
    if above > 0.0 and above * above > 9.0 * variance:
        return 1.0
    spread = math.sqrt(variance)
    cut = -above / spread  # the bound, in standard deviations from the mean
    left = 0.5 * math.erfc(cut * HALF_ROOT)
    # ratio: the normal density at the cut, divided by the probability beyond the cut. From 5 standard deviations on its
    # asymptote is used, as ``left`` underflows farther out. The truncated Gaussian's mean is larger by spread * ratio,
    # and its variance is smaller by the share ratio * (ratio - cut), at most 1; the asymptote would give slightly more.
    ratio = DENSITY * math.exp(-0.5 * cut * cut) / left if cut < 5.0 else cut + 1.0 / cut
    correct(f, i, axis, by_place, by_heading, variance, spread * ratio, min(ratio * (ratio - cut), 1.0))
    return max(left, LEAST)


@inlined
def inside(f: Mixture, i: int, program: LocalisationProgram) -> float:
    """Correct a component by being inside the arena; return the probability of that before, by the nearer walls."""
    near_m, left = program.radius_m + NEAR_WALL_M, 1.0
    for axis in range(2):
        # at_m: distance of the robot's centre from the nearer of the two walls. by_place: its derivative by x or y.
        at_m, by_place = f.means[i, axis], 1.0
        beyond_m = (program.width_m if axis == X else program.height_m) - at_m
        if beyond_m < at_m:
            at_m, by_place = beyond_m, -1.0
        if at_m < near_m:
            left *= learn_beyond(f, i, axis, by_place, 0.0, at_m, program.radius_m, program.seen_noise_m)
    return left


@inlined
def saw_nothing(f: Mixture, i: int, program: LocalisationProgram) -> float:
    """Correct a component by the fact that no ray saw a wall; return the fact's probability before that."""
    spread_m = math.sqrt(max(f.covariances[i, X, X], f.covariances[i, Y, Y]))
    # A wall beyond this is out of reach, with margins of 1 cm and of 2.5 standard deviations of the place.
    far_m = program.avoidance_threshold_m + program.ray_forward_m + 0.01 + 2.5 * spread_m
    x_m, y_m = f.means[i, X], f.means[i, Y]
    if min(min(x_m, program.width_m - x_m), min(y_m, program.height_m - y_m)) > far_m:
        return 1.0
    return saw_no_wall(f, i, program)


@inlined
def saw_no_wall(f: Mixture, i: int, program: LocalisationProgram) -> float:
    """Correct a component near walls by the fact that no ray saw one; return the fact's probability before that."""
    of_x, x_by_x, x_by_heading, of_y, y_by_y, y_by_heading = wall_rays(f, i, program)
    left = 1.0
    for axis in range(2):
        if axis == Y:
            # left < 1: the walls in x have corrected the component, so the distances to the walls in y have changed.
            if left < 1.0:
                _, _, _, of_y, y_by_y, y_by_heading = wall_rays(f, i, program)
            # From here on the variables named after x are those of the walls in y.
            of_x, x_by_x, x_by_heading = of_y, y_by_y, y_by_heading
        left *= learn_beyond(
            f, i, axis, x_by_x, x_by_heading, of_x, program.avoidance_threshold_m, program.seen_noise_m
        )
    return left


@inlined
def meet(
    f: Mixture, i: int, program: LocalisationProgram, ray_m: float, robots: float, lost_share: float
) -> tuple[float, float]:
    """Draw whether the shortest ray saw a wall in x, one in y or a robot, and correct the component accordingly.

    Return the density of this ray length, and the part due to robots, 1/m; with ``ray_m`` 0, probabilities.
    ``robots`` is the density of robots, 1/m, ``lost_share`` the probability that one that draws a robot is widened.
    """
    of_x, x_by_x, x_by_heading, of_y, y_by_y, y_by_heading = wall_rays(f, i, program)
    noise = program.ray_noise_m * program.ray_noise_m
    x_variance = gain(f, i, X, x_by_x, x_by_heading) + noise
    y_variance = gain(f, i, Y, y_by_y, y_by_heading) + noise
    x_error, y_error = ray_m - of_x, ray_m - of_y
    x_spread, y_spread = math.sqrt(x_variance), math.sqrt(y_variance)
    # Probabilities that the wall in x, and that in y, is beyond ray_m.
    x_beyond = 0.5 * math.erfc(x_error / x_spread * HALF_ROOT)
    y_beyond = 0.5 * math.erfc(y_error / y_spread * HALF_ROOT)
    # x_density: the wall in x is at ray_m, and the wall in y is beyond it. y_density: the wall in y is at ray_m, and
    # the wall in x is beyond it. robot_density: a robot is at ray_m, and both walls are beyond it. The limit 1000 keeps
    # exp from underflowing.
    if ray_m > 0.0:
        x_density = (
            DENSITY / x_spread * math.exp(-0.5 * min(x_error * x_error / x_variance, 1000.0)) * y_beyond
        )
        y_density = (
            DENSITY / y_spread * math.exp(-0.5 * min(y_error * y_error / y_variance, 1000.0)) * x_beyond
        )
        robot_density = robots * x_beyond * y_beyond
    else:  # the ray has no length: probabilities that a wall is behind its beginning
        x_density, y_density, robot_density = 1.0 - x_beyond, 1.0 - y_beyond, ROBOT_AT_0
    total = x_density + y_density + robot_density + LEAST  # never 0
    chosen = next_uniform(f) * total
    # ``chosen`` falls into the part of [0, total] of the wall in x, the wall in y or the robot, in this order. A single
    # component takes what is most probable, as no other component could make up for an improbable draw: ``chosen`` is
    # set to the beginning or end of that part.
    if f.weights.size == 1:
        chosen = 0.0 if x_density >= max(y_density, robot_density) else x_density
        if robot_density > max(x_density, y_density):
            chosen = total
    if chosen < x_density + y_density:
        axis = X if chosen < x_density else Y
        if axis == Y:  # from here on the variables named after x are those of the wall in y
            of_x, x_by_x, x_by_heading, x_variance, x_error = of_y, y_by_y, y_by_heading, y_variance, y_error
        if ray_m > 0.0:
            correct(f, i, axis, x_by_x, x_by_heading, x_variance, x_error, 1.0)
        else:  # The wall is behind the ray's beginning: its distance along the ray is below 0, so minus it is above 0.
            learn_beyond(f, i, axis, -x_by_x, -x_by_heading, -of_x, 0.0, program.ray_noise_m)
    elif next_uniform(f) < lost_share:
        widen(f, i, program)
    return total, robot_density


@inlined
def widen(f: Mixture, i: int, program: LocalisationProgram) -> None:
    """Increase the variances of a component that may be lost, so that later corrections can move it far."""
    covariance, share = f.covariances, LOST_SHARE * LOST_SHARE  # variances grow by the squares
    covariance[i, X, X] += LOST_SPREAD_M * LOST_SPREAD_M
    covariance[i, Y, Y] += LOST_SPREAD_M * LOST_SPREAD_M
    covariance[i, HEADING, HEADING] += LOST_SPREAD_RAD * LOST_SPREAD_RAD
    covariance[i, BIAS, BIAS] += share * program.gyro_bias_spread_rad_s * program.gyro_bias_spread_rad_s
    covariance[i, SCALE, SCALE] += share * program.gyro_scale_spread * program.gyro_scale_spread
    if not program.speed_redrawn:  # a factor that is redrawn at each sample has its initial variance anyway
        covariance[i, SPEED, SPEED] += share * program.speed_spread * program.speed_spread
