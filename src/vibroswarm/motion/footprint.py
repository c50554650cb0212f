"""Robots as rectangles on the floor: how deep they overlap each other, and room for those that start too near.

| name | unit | meaning |
|---|---|---|
| pose | m, rad | x, y and heading of a rectangle's middle, (3,) |
| size | m | its length, along the heading, and its width |
| depth | m | how far one of two must move until they are apart; below 0: they are apart |

Two rectangles are apart if, along a side of one of them, their shadows do not overlap (separating axis theorem). So the
depth is the least overlap of their shadows along the four directions of their sides.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError

Floats = NDArray[np.float64]

SPARE_M: Final = 1e-5
"""Distance that is left between two robots that were moved apart, if there is room."""
ROUNDS: Final = 2000
"""Most rounds in which robots that start too near are moved apart."""


def half_shadow(turned_rad: Floats, size_m: tuple[float, float]) -> Floats:
    """Return half of the length of a rectangle's shadow along a direction at an angle to its heading, m."""
    shadow: Floats = (np.abs(np.cos(turned_rad)) * size_m[0] + np.abs(np.sin(turned_rad)) * size_m[1]) / 2
    return shadow


def half_extents(heading_rad: Floats, size_m: tuple[float, float]) -> Floats:
    """Return how far rectangles reach from their middles along x and y, (..., 2), m."""
    return np.stack([half_shadow(heading_rad - turn, size_m) for turn in (0.0, math.pi / 2)], axis=-1)


def overlap(one: Floats, other: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return how deep pairs of rectangles overlap, and the direction in which one of a pair is soonest free.

    Args:
        one, other: poses, (pairs, 3). size_m: of all of them.
    Returns: depths, (pairs,), and unit vectors from ``other`` to ``one``, (pairs, 2).
    """
    depth, direction = np.full(len(one), np.inf), np.zeros((len(one), 2))
    for side_rad in (one[:, 2], one[:, 2] + math.pi / 2, other[:, 2], other[:, 2] + math.pi / 2):
        axis = np.stack([np.cos(side_rad), np.sin(side_rad)], axis=-1)
        apart = ((one - other)[:, :2] * axis).sum(axis=-1)
        shadows = half_shadow(one[:, 2] - side_rad, size_m) + half_shadow(other[:, 2] - side_rad, size_m)
        least = shadows - np.abs(apart) < depth
        depth = np.where(least, shadows - np.abs(apart), depth)
        direction = np.where(least[:, None], np.where(apart < 0, -1.0, 1.0)[:, None] * axis, direction)
    return depth, direction


def with_room(poses: Floats, size_m: tuple[float, float], arena_m: tuple[float, float]) -> Floats:
    """Move rectangles that overlap each other or a wall apart, and return their poses; the others stay bit by bit.

    Args:
        poses: (robots, 3). arena_m: its width and height.
    Raises:
        InputError: they do not fit into the arena.
    """
    poses = poses.copy()
    first, second = np.triu_indices(len(poses), k=1)
    reach = half_extents(poses[:, 2], size_m)
    for _ in range(ROUNDS):
        poses[:, :2] = np.clip(poses[:, :2], reach, np.array(arena_m) - reach)
        depth, direction = overlap(poses[first], poses[second], size_m)
        close = depth > 0.0
        if not close.any():
            return poses
        shift = 0.5 * (depth[close, None] + SPARE_M) * direction[close]  # each by half
        np.add.at(poses[:, :2], first[close], shift)
        np.add.at(poses[:, :2], second[close], -shift)
    raise InputError(
        f"{len(poses)} robots of {1000 * size_m[0]:g} x {1000 * size_m[1]:g} mm do not fit into an arena of "
        f"{arena_m[0]:g} x {arena_m[1]:g} m",
        field="swarm.robots",
    )
