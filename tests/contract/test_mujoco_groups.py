"""Robots on wheels that cannot touch are stepped apart: groups, rest, and the same motion as all stepped together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist, squareform

from helpers.motion_runs import Taken, begun
from vibroswarm.core.jit import kernel, zero_rows
from vibroswarm.motion.control_step import ROBOT, Swarm
from vibroswarm.motion.physics.arcs import arc_between
from vibroswarm.motion.physics.wheels_model import (
    BASE_M,
    HALF_WHEEL_M,
    LENGTH_M,
    TRACK_M,
    WHEEL_M,
    WHEELS,
    WIDTH_M,
)
from vibroswarm.motion.physics.wheels_run import WheelsRun, overlap
from vibroswarm.motion.physics.wheels_step import members_of, set_groups
from vibroswarm.scenario.scenario import Scenario

CROWD = Scenario().with_values(
    {"swarm.robots": 8, "arena.width_m": 0.35, "arena.height_m": 0.35, "run.t_end_s": 20.0}
)
"""Robots that push each other in two of three runs."""


@kernel
def largest_group(swarm: Swarm, gap_m: float, first: NDArray[np.int64]) -> int:
    return set_groups(swarm, gap_m, first)


@kernel
def group_of(first: NDArray[np.int64], i: int, members: NDArray[np.int64]) -> int:
    return members_of(first, i, members)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.0, 0.3), st.floats(0.0, 0.3)), min_size=1, max_size=12),
    st.floats(0.01, 0.2),
)
def test_groups_are_the_connected_components_of_robots_that_are_near(
    places: list[tuple[float, float]], gap_m: float
) -> None:
    swarm = zero_rows(len(places), ROBOT)
    swarm["x_m"], swarm["y_m"] = np.array(places).T
    first, members = (np.zeros(len(places), dtype=np.int64) for _ in range(2))
    largest = largest_group(swarm, gap_m, first)
    near = (
        squareform(pdist(np.array(places), "sqeuclidean")) < gap_m * gap_m
        if len(places) > 1
        else np.zeros((1, 1))
    )
    _, labels = connected_components(near, directed=False)
    wanted = {tuple(np.flatnonzero(labels == label).tolist()) for label in labels}
    sizes = [group_of(first, i, members) for i in range(len(places))]
    found = {tuple(members[: group_of(first, i, members)].tolist()) for i, size in enumerate(sizes) if size}
    assert found == wanted
    assert largest == max(map(len, wanted))


@kernel
def arc_to(x_m: float, y_m: float, heading_rad: float, dt_s: float) -> tuple[float, float, float]:
    return arc_between(0.0, 0.0, 0.0, x_m, y_m, heading_rad, dt_s)


def test_arcs_are_found_from_their_ends() -> None:
    """A quarter of a circle of 1 m in 2 s; 10 cm aside, 1 m ahead; and on the spot."""
    assert arc_to(1.0, 1.0, np.pi / 2, 2.0) == pytest.approx((np.pi / 4, np.pi / 4, 0.0), abs=1e-12)
    assert arc_to(1.0, 0.1, 0.0, 2.0) == pytest.approx((0.5, 0.0, 0.1))
    assert arc_to(0.0, 0.0, 1.0, 2.0) == pytest.approx((0.0, 0.5, 0.0))


def path_of(gap_m: float | None) -> NDArray[np.float64]:
    """Return the poses of all robots in 10 s of ``CROWD``, (periods, robots, 3).

    ``gap_m`` replaces the distance within which robots are stepped together.
    """
    state = begun(WheelsRun, CROWD, 7, 0)
    if gap_m is not None:
        state.wheels = state.wheels._replace(gap_m=gap_m)
    places = []
    for period in range(500):
        state.advance(period + 1, Taken().sink)
        places.append(np.column_stack([state.swarm[name] for name in ("x_m", "y_m", "heading_rad")]))
    return np.array(places)


def deepest_m(poses: NDArray[np.float64]) -> float:
    """How deep two robots overlap at most; below 0: they never do."""
    first, second = np.triu_indices(poses.shape[1], k=1)
    size_m = (LENGTH_M, WIDTH_M)
    return max(float(overlap(at[first], at[second], size_m)[0].max()) for at in poses)


def test_robots_in_groups_move_as_all_together() -> None:
    """Within 0.05 mm in 10 s in which robots push each other; the control: always apart, robots overlap."""
    in_groups, together, apart = (path_of(gap_m) for gap_m in (None, np.inf, 0.0))
    assert deepest_m(together) > -0.0004, "no robots meet: the test would show nothing"
    assert abs(in_groups - together)[..., :2].max() < 5e-5
    assert abs(apart - together)[..., :2].max() > 1e-3
    assert deepest_m(apart) > 0.001


def test_the_wheels_are_within_the_outline() -> None:
    """So the outline, which the contract of motion counts, has all parts of a robot in it."""
    for _, x, y, _ in WHEELS:
        assert abs(x) * BASE_M / 2 + WHEEL_M <= LENGTH_M / 2 + 1e-12
        assert abs(y) * TRACK_M / 2 + HALF_WHEEL_M <= WIDTH_M / 2 + 1e-12


def test_a_robot_at_rest_stays_where_it_is() -> None:
    """It is not stepped: bit by bit the same place until its motors are on, as gyro says."""
    state = begun(WheelsRun, CROWD.with_values({"swarm.robots": 1}), 7, 0)
    kept = []
    for period in range(1000):
        before, old = state.data.ctrl[:2].any(), state.data.qpos.copy()
        state.advance(period + 1, Taken().sink)
        stands = not before and not state.data.ctrl[:2].any()
        kept.append((stands, bool((old == state.data.qpos).all()), float(state.swarm["gyro_deg"][0])))
    still = [gyro for stands, same, gyro in kept if stands and same]
    assert len(still) > 60
    assert set(still) == {0.0}
    assert not any(same for stands, same, _ in kept if not stands)
