"""Robots as rectangles: depths against places where the answer is plain and against points; and room at the start."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.motion.physics.wheels_run import half_extents, overlap, with_room

SIZE = (0.033, 0.025)
Pose = tuple[float, float, float]
POSES = st.tuples(st.floats(-0.04, 0.04), st.floats(-0.04, 0.04), st.floats(-7.0, 7.0))


def depth(one: Pose, other: Pose) -> float:
    return float(overlap(np.array([one]), np.array([other]), SIZE)[0][0])


def points_of(pose: Pose) -> NDArray[np.float64]:
    """Points all over a rectangle, its corners too, (points, 2)."""
    across = np.linspace(-0.5, 0.5, 41)
    x, y = (grid.ravel() for grid in np.meshgrid(across * SIZE[0], across * SIZE[1]))
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return np.column_stack([pose[0] + x * cos - y * sin, pose[1] + x * sin + y * cos])


def inside(points: NDArray[np.float64], pose: Pose) -> NDArray[np.bool_]:
    dx, dy = points[:, 0] - pose[0], points[:, 1] - pose[1]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return (abs(dx * cos + dy * sin) < SIZE[0] / 2) & (abs(dy * cos - dx * sin) < SIZE[1] / 2)


def test_depths_are_those_of_plain_cases() -> None:
    assert depth((0, 0, 0), (0.030, 0, 0)) == pytest.approx(0.003)
    assert depth((0, 0, 0), (0.036, 0, 0)) == pytest.approx(-0.003)
    assert depth((0, 0, 0), (0, 0.024, 0)) == pytest.approx(0.001)
    assert depth((0, 0, 0), (0.028, 0, np.pi / 2)) == pytest.approx(
        0.001
    )  # half of 33 and half of 25 are 29 mm
    assert half_extents(np.array([0.0, np.pi / 2]), SIZE) == pytest.approx(
        np.array([[0.0165, 0.0125], [0.0125, 0.0165]])
    )


@given(POSES, POSES)
@settings(deadline=None)
def test_rectangles_that_are_apart_have_no_point_in_common(one: Pose, other: Pose) -> None:
    both = inside(points_of(one), other).any() or inside(points_of(other), one).any()
    assert not (both and depth(one, other) < 0.0)
    found, direction = (values[0] for values in overlap(np.array([one]), np.array([other]), SIZE))
    if found > 0.0:  # so far apart, they are free
        moved = (one[0] + 1.0001 * found * direction[0], one[1] + 1.0001 * found * direction[1], one[2])
        assert depth(moved, other) < 1e-12


def test_robots_that_start_too_near_are_moved_apart_and_others_are_not() -> None:
    chance = np.random.default_rng(3)
    poses = np.column_stack([chance.uniform(0.015, 0.385, (40, 2)), chance.uniform(-3, 3, 40)])
    poses[0] = (0.2, 0.2, 1.0)
    apart = with_room(poses, SIZE, (0.4, 0.4))
    first, second = np.triu_indices(40, k=1)
    assert overlap(poses[first], poses[second], SIZE)[0].max() > 0.01
    assert overlap(apart[first], apart[second], SIZE)[0].max() <= 0.0
    reach = half_extents(apart[:, 2], SIZE)
    assert (apart[:, :2] >= reach - 1e-12).all()
    assert (apart[:, :2] <= 0.4 - reach + 1e-12).all()
    alone = np.array([[0.1, 0.1, 0.3], [0.3, 0.3, 2.0]])
    assert np.array_equal(with_room(alone, SIZE, (0.4, 0.4)), alone)
    with pytest.raises(InputError, match="40 robots of 33 x 25 mm do not fit"):
        with_room(poses, SIZE, (0.15, 0.15))
