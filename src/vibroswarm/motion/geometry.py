"""Arcs, rays and bodies in the plane; scalars in, scalars out.

| name | symbol | unit | equation |
|---|---|---|---|
| chord | - | m | v dt sinc(w dt / 2), in the direction heading + w dt / 2 |
| ray | t | m | smallest t >= 0 with origin + t direction on a wall or on a disc |

The chord is the straight line from the start to the end of the exact arc that a robot drives in the time dt at constant
speed v and turn rate w.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from vibroswarm.core.jit import inlined, kernel

QUARTER_RAD: Final = math.pi / 2.0
"""A quarter turn."""
QUARTER_REST_RAD: Final = 6.123233995736766e-17
"""The exact quarter turn pi / 2 less its floating-point value."""
SMALL_RAD: Final = 0.8
"""Largest angle for which the series of ``small_sin_cos`` are exact to rounding."""
F: Final = tuple(1.0 / math.factorial(n) for n in range(17))
"""Coefficients 1 / n! of the series of sine and cosine; multiplying by them is many times faster than dividing."""


@kernel
def arc(
    x_m: float, y_m: float, heading_rad: float, speed_m_s: float, rate_rad_s: float, dt_s: float
) -> tuple[float, float, float]:
    """Return the pose (x, y, heading) after ``dt_s`` of constant speed and turn rate; the heading is not wrapped."""
    half = 0.5 * rate_rad_s * dt_s
    # For tiny angles, the first two terms of the power series: sin(half) / half would be 0 / 0 at 0.
    sinc = math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6.0
    chord = speed_m_s * dt_s * sinc
    along = heading_rad + half
    return x_m + chord * math.cos(along), y_m + chord * math.sin(along), heading_rad + 2.0 * half


@inlined
def small_sin_cos(angle_rad: float) -> tuple[float, float]:
    """Return (sin, cos - 1) of an angle of at most SMALL_RAD, from their power series, exact to the last bit or two.

    Subtracting 1 from a cosine close to 1 would lose most of its digits.
    """
    # With t, the square of the angle: sine = angle times ``odd``, and cosine - 1 = -t times ``even``.
    t = angle_rad * angle_rad
    t2 = t * t
    t4 = t2 * t2
    odd = (F[1] - t * F[3]) + t2 * (F[5] - t * F[7]) + t4 * (F[9] - t * F[11])
    odd += t4 * t2 * (F[13] - t * F[15])
    even = (F[2] - t * F[4]) + t2 * (F[6] - t * F[8]) + t4 * (F[10] - t * F[12])
    even += t4 * t2 * (F[14] - t * F[16])
    return angle_rad * odd, -t * even


@inlined
def sin_cos(angle_rad: float) -> tuple[float, float]:
    """Return (sine, cosine) of an angle of at most a few turns, exact to the last bits."""
    # QUARTER_REST_RAD corrects the rounding error of QUARTER_RAD.
    whole = np.floor(angle_rad * (2.0 / math.pi) + 0.5)
    sine, cosine_less_1 = small_sin_cos(angle_rad - whole * QUARTER_RAD - whole * QUARTER_REST_RAD)
    cosine, quarters = 1.0 + cosine_less_1, int(whole)
    if quarters & 1:
        sine, cosine = cosine, -sine
    if quarters & 2:
        sine, cosine = -sine, -cosine
    return sine, cosine


@kernel
def wall_distance(x_m: float, y_m: float, dx: float, dy: float, width_m: float, height_m: float) -> float:
    """Return the distance from a point to the first wall along the unit vector (dx, dy); 0 from outside the arena."""
    if x_m <= 0.0 or y_m <= 0.0 or x_m >= width_m or y_m >= height_m:
        return 0.0
    shortest_m = math.inf
    if dx > 0.0:
        shortest_m = (width_m - x_m) / dx
    elif dx < 0.0:
        shortest_m = -x_m / dx
    if dy > 0.0:
        shortest_m = min(shortest_m, (height_m - y_m) / dy)
    elif dy < 0.0:
        shortest_m = min(shortest_m, -y_m / dy)
    return shortest_m


@kernel
def disc_distance(
    x_m: float, y_m: float, dx: float, dy: float, centre_x_m: float, centre_y_m: float, radius_m: float
) -> float:
    """Return the distance along the unit vector (dx, dy) to a disc; 0 from inside it, infinite if the ray misses it."""
    to_x, to_y = centre_x_m - x_m, centre_y_m - y_m
    along = to_x * dx + to_y * dy  # the distance t solves t^2 - 2 along t + beyond = 0
    beyond = to_x * to_x + to_y * to_y - radius_m * radius_m
    if beyond <= 0.0:  # the ray starts inside the disc
        return 0.0
    if along <= 0.0:  # the disc is behind the ray's start
        return math.inf
    discriminant = along * along - beyond
    if discriminant < 0.0:  # the ray passes beside the disc
        return math.inf
    return along - math.sqrt(discriminant)


@kernel
def wrapped_rad(angle_rad: float) -> float:
    """Return the same angle in [-pi, pi)."""
    return angle_rad - 2.0 * math.pi * np.floor((angle_rad + math.pi) / (2.0 * math.pi))
