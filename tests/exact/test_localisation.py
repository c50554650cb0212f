"""The robot's localisation against brute force: moved clouds, Kalman on the joint state, cut-off Gaussians."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import truncnorm

from vibroswarm.localisation.locate import program_of, speed_law
from vibroswarm.motion.geometry import arc, wall_distance
from vibroswarm.robot import localisation as robot
from vibroswarm.robot.pose_correction import correct, gain, inside, meet, wall_rays
from vibroswarm.robot.pose_mixture import (
    BIAS,
    HEADING,
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
    begin,
    empty_mixture,
    resample,
)
from vibroswarm.scenario.scenario import Scenario

LAG = 3


def program(**values: Any) -> LocalisationProgram:
    """Of the paper's robot, poor gyro, constant speed."""
    scenario = Scenario().with_values(
        {"odometry.level": "poor", "robot.speed_redraw": "robot", "localisation.method": "mixture"}
    )
    return program_of(scenario)._replace(**values)


def begun(of: LocalisationProgram, components: int = 1, **pose: float) -> Mixture:
    f = empty_mixture(components, LAG)
    begin(f, of, 12345, pose.get("x", 0.5), pose.get("y", 0.5), pose.get("heading", 0.3))
    return f


def test_moves_spread_as_a_cloud_does() -> None:
    """Mean and covariance after drives and turns, against 40,000 robots that drive exact arcs; also of a past place."""
    of = program(corrects=False, turn_shift_m=0.0)
    f, rng, count = begun(of), np.random.default_rng(1), 40_000
    spreads = [
        0.005,
        0.005,
        math.radians(2.0),
        of.speed_spread,
        of.gyro_bias_spread_rad_s,
        of.gyro_scale_spread,
    ]
    means = [0.5, 0.5, 0.3, of.speed_factor, 0.0, 0.0]
    cloud = rng.normal(means, spreads, (count, STATES))
    past = np.empty((0, 2))
    moves = [("drive", 3.0, 0.4), ("turn", 1.0, 1.2), ("sample", 0.0, 0.0), ("drive", 4.0, -0.3)]
    for kind, duration_s, gyro_rad in moves:
        if kind == "sample":
            robot.sampled(f, of, np.empty(9))
            past = cloud[:, :2].copy()
            continue
        noise = of.gyro_walk_rad_sqrt_s**2 * duration_s + (of.turn_noise_rad**2 if kind == "turn" else 0.0)
        turned = (gyro_rad - cloud[:, BIAS] * duration_s) / (1.0 + cloud[:, SCALE])
        turned += rng.normal(0.0, math.sqrt(noise), count)
        if kind == "turn":
            robot.turn(f, of, duration_s, gyro_rad)
            cloud[:, HEADING] += turned
            continue
        robot.drive(f, of, duration_s, gyro_rad, 100.0, False)
        speed = of.full_speed_m_s * (1.0 - 100.0 / of.battery_life_s) * cloud[:, SPEED]
        for n in range(count):
            cloud[n, :3] = arc(*cloud[n, :3], speed[n], turned[n] / duration_s, duration_s)
    assert f.means[0, :3] == pytest.approx(cloud[:, :3].mean(axis=0), abs=0.002)
    expected = np.cov(np.concatenate([cloud, past], axis=1).T)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (abs(f.covariances[0] - expected[:6, :6]) / scale[:6, :6]).max() < 0.06
    with_past = expected[6:, :6] / scale[6:, :6]
    assert f.past_covariances[0, 0] / scale[6:, :6] == pytest.approx(with_past, abs=0.06)
    assert f.past_variances[0, 0] == pytest.approx(np.diag(expected)[6:], rel=0.06)
    # The spread is due to the gyro too: without its errors another covariance comes out.
    quiet = begun(of._replace(gyro_bias_spread_rad_s=1e-9))
    robot.drive(quiet, of, 3.0, 0.4, 100.0, False)
    assert quiet.covariances[0, HEADING, HEADING] < 0.9 * f.covariances[0, HEADING, HEADING]


@pytest.mark.parametrize("state", [HEADING, SPEED, BIAS, SCALE])
def test_a_drive_spreads_each_state_by_its_derivatives(state: int) -> None:
    """Of a drive that bends by a radian, against differences of where it ends."""
    of, step, ends = program(corrects=False, gyro_walk_rad_sqrt_s=0.0), 1e-5, []
    for change in (-step, step):
        f = begun(of)
        f.means[0, state] += change
        robot.drive(f, of, 4.0, 1.0, 0.0, False)
        ends.append(f.means[0, :HEADING].copy())
    f = begun(of)
    f.covariances[0] = 0.0
    f.covariances[0, state, state] = 1.0
    robot.drive(f, of, 4.0, 1.0, 0.0, False)
    derivative = (ends[1] - ends[0]) / (2.0 * step)
    assert f.covariances[0, :HEADING, state] == pytest.approx(derivative, abs=0.02 * abs(derivative).max())


def test_a_turn_shifts_the_place_in_either_direction_alike() -> None:
    of = program(turn_shift_m=0.004)
    f = begun(of)
    before = f.covariances[0, :2, :2].copy()
    robot.turn(f, of, 1.0, 1.2)
    assert f.covariances[0, :2, :2] - before == pytest.approx(0.004**2 * np.eye(2))


def test_a_correction_is_that_of_the_joint_state() -> None:
    """State and past places, corrected by one number, as by the textbook formula on all of them at once."""
    rng, size = np.random.default_rng(2), STATES + 2 * LAG
    root = rng.normal(size=(size, size))
    joint, mean = root @ root.T, rng.normal(size=size)
    f = begun(program())
    f.means[0], f.covariances[0] = mean[:STATES], joint[:STATES, :STATES]
    f.past[0] = mean[STATES:].reshape(LAG, 2)
    f.past_variances[0] = np.diag(joint)[STATES:].reshape(LAG, 2)
    f.past_covariances[0] = joint[STATES:, :STATES].reshape(LAG, 2, STATES)
    by, noise, error = np.zeros(size), 0.3, 0.7
    by[Y], by[HEADING] = -1.3, 0.4
    variance = gain(f, 0, Y, -1.3, 0.4) + noise
    assert variance == pytest.approx(by @ joint @ by + noise)
    correct(f, 0, Y, -1.3, 0.4, variance, error, 1.0)
    gains = joint @ by / variance
    mean, joint = mean + gains * error, joint - np.outer(gains, by @ joint)
    assert f.means[0] == pytest.approx(mean[:STATES])
    assert f.past[0].ravel() == pytest.approx(mean[STATES:])
    assert f.covariances[0] == pytest.approx(joint[:STATES, :STATES])
    assert f.past_variances[0].ravel() == pytest.approx(np.diag(joint)[STATES:])
    assert f.past_covariances[0].reshape(-1, STATES) == pytest.approx(joint[STATES:, :STATES])


@pytest.mark.parametrize("axis", [X, Y])
@pytest.mark.parametrize("is_far", [False, True])
def test_a_robot_is_on_the_inner_side_of_each_wall(axis: int, is_far: bool) -> None:
    """A place 1 cm from touching a wall, known to 5 cm, is cut off at the wall."""
    of = program(start_spread_m=0.05)
    at_m, spread_m = of.radius_m + 0.01, math.hypot(0.05, of.seen_noise_m)
    place = {"xy"[axis]: 1.0 - at_m if is_far else at_m}
    f = begun(of, **place)
    assert inside(f, 0, of) == pytest.approx(0.5 * math.erfc(-0.01 / spread_m / 2**0.5))
    moved_m = (0.05 / spread_m) ** 2 * (truncnorm(-0.01 / spread_m, np.inf, scale=spread_m).mean())
    expected_m = at_m + moved_m
    assert f.means[0, axis] == pytest.approx(1.0 - expected_m if is_far else expected_m)


@settings(deadline=None)
@given(st.floats(0.06, 0.94), st.floats(0.06, 0.94), st.floats(-10.0, 10.0))
def test_rays_meet_walls_where_geometry_says(x_m: float, y_m: float, heading_rad: float) -> None:
    of = program()
    f = begun(of, x=x_m, y=y_m, heading=heading_rad)
    of_x, x_by_x, x_by_heading, of_y, y_by_y, y_by_heading = wall_rays(f, 0, of)
    exact = []
    for side_m, cosine, sine in zip(of.ray_side_m, of.ray_cos, of.ray_sin, strict=True):
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        start = (x_m + of.ray_forward_m * c - side_m * s, y_m + of.ray_forward_m * s + side_m * c)
        exact.append(wall_distance(*start, c * cosine - s * sine, s * cosine + c * sine, 1.0, 1.0))
    assert min(of_x, of_y) == pytest.approx(min(exact), rel=1e-9)
    step = 1e-7
    f.means[0, HEADING] += step
    turned = wall_rays(f, 0, of)
    f.means[0, HEADING] -= step
    f.means[0, X] += step
    f.means[0, Y] += step
    shifted = wall_rays(f, 0, of)
    near = [(of_x, x_by_x, x_by_heading, 0), (of_y, y_by_y, y_by_heading, 3)]
    for distance, by_place, by_heading, at in near:
        if distance < 0.2:  # elsewhere another ray may be as near
            assert (shifted[at] - distance) / step == pytest.approx(
                by_place, rel=1e-3, abs=1e-3
            ) or by_place == 0.0
            assert (turned[at] - distance) / step == pytest.approx(by_heading, rel=2e-2, abs=2e-2)


def test_components_are_redrawn_by_weight() -> None:
    """Each is copied as often as its weight asks for, rounded up or down; equal weights are left alone."""
    of, weights = program(), np.array([0.55, 0.26, 0.0, 0.1, 0.05, 0.04, 0.0, 0.0])
    f = begun(of, components=8)
    f.means[:, X], f.weights[:] = np.arange(8), 3.0 * weights
    of_component = (f.covariances, f.past, f.past_variances, f.past_covariances)
    for numbers in of_component:
        numbers[:] = np.arange(8).reshape(-1, *[1] * (numbers.ndim - 1))
    resample(f)
    for numbers in of_component:  # all of it is copied
        assert (numbers.reshape(8, -1) == f.means[:, [X]]).all()
    copies = np.bincount(f.means[:, X].astype(int), minlength=8)
    assert copies.sum() == 8
    assert (abs(copies - 8 * weights) < 1.0).all()
    assert f.weights == pytest.approx(np.full(8, 1 / 8))
    uneven = np.array(
        [2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0]
    )  # 6.4 components are effective, which is enough
    f.means[:, X], f.weights[:] = np.arange(8), uneven
    resample(f)
    assert (f.means[:, X] == np.arange(8)).all()
    assert f.weights == pytest.approx(uneven / 8.0)
    f.means[:, X], f.weights[:] = np.arange(8), 5.0
    resample(f)
    assert (f.means[:, X] == np.arange(8)).all()


def test_a_wall_places_a_robot_and_a_robot_does_not() -> None:
    """A ray that fits a wall narrows the place across it; one that fits none is taken for a robot."""
    of = program(lost_share=0.0, start_heading_spread_rad=0.01, start_spread_m=0.05)
    to_wall = 1.0 - 0.9 - of.ray_forward_m  # facing the right wall from x = 0.9
    f = begun(of, x=0.9, y=0.5, heading=0.0)
    density, of_robot = meet(f, 0, of, to_wall + 0.03, of.robots_per_m, 0.0)
    assert of_robot < 0.5 * of.robots_per_m  # a wall may be nearer
    assert f.means[0, X] == pytest.approx(0.87, abs=0.003)
    assert math.sqrt(f.covariances[0, X, X]) < 0.01
    assert math.sqrt(f.covariances[0, Y, Y]) == pytest.approx(0.05)
    spread = math.hypot(0.05, of.ray_noise_m)
    assert density == pytest.approx(math.exp(-0.5 * (0.03 / spread) ** 2) / spread / math.tau**0.5, rel=0.3)
    f = begun(of, x=0.5, y=0.5, heading=0.0)
    for each in meet(f, 0, of, 0.05, of.robots_per_m, 0.0):
        assert each == pytest.approx(of.robots_per_m, rel=1e-3)
    assert f.means[0, :2].tolist() == [0.5, 0.5]
    # A ray that begins in a wall, 1 cm before it by what is believed: the place is cut off. A robot has the weight 0.3.
    f = begun(of, x=0.99 - of.ray_forward_m, y=0.5, heading=0.0)
    total, of_robot = meet(f, 0, of, 0.0, of.robots_per_m, 0.0)
    assert (total, of_robot) == pytest.approx((0.3 + 0.5 * math.erfc(0.01 / spread / 2**0.5), 0.3), abs=0.002)
    within_m = truncnorm(-np.inf, -0.01 / spread, loc=0.01, scale=spread).mean()
    assert f.means[0, X] == pytest.approx(1.0 - of.ray_forward_m - within_m, abs=0.002)
    assert program_of(Scenario().with_values({"swarm.robots": 1})).robots_per_m == 0.0
    # Two robots of 8 and 3 cm whose centres pass within 11 cm of each other meet, on 1 m2; a factor of 6 is assumed.
    ahead = {"swarm.robots": 2, "robot.body_radius_m": 0.08, "rays.disc_radius_m": 0.03}
    straight = Scenario().with_values(ahead | {"rays.angle_deg": [0.0], "rays.side_m": [0.0]})
    assert program_of(straight).robots_per_m == pytest.approx(6.0 * 2.0 * 0.11 * 4.0 / math.pi)


def test_estimates_are_moments_of_the_mixture_and_speeds_change_at_samples() -> None:
    """Stated spreads are 1.4 times as wide where 0.1 more than usual of each obstacle is unexpected."""
    of, f, random = program(speed_wander=0.1), empty_mixture(3, LAG), np.random.default_rng(1)
    begin(f, of, 12345, 0.5, 0.5, 0.3)
    f.weights[:] = weights = np.array([0.5, 0.3, 0.2])
    f.monitor[UNEXPECTED] = 0.6 * f.monitor[OBSTACLES]
    f.numbers[SAMPLES] = LAG  # the first sample that has one ``LAG`` ago
    for drawn in (f.means, f.past, f.past_variances, f.past_covariances):
        drawn[:] = random.random(drawn.shape)
    means, covariances = f.means.copy(), f.covariances.copy()
    lagged_m, variances_m2 = f.past[:, 0].copy(), f.past_variances[:, 0].copy()
    estimate = np.zeros(9)
    robot.sampled(f, of, estimate)
    place_m, lagged_place_m = weights @ means[:, :2], weights @ lagged_m
    east, north = weights @ np.cos(means[:, HEADING]), weights @ np.sin(means[:, HEADING])
    spread_m2 = weights @ (0.5 * ((means[:, :2] - place_m) ** 2).sum(axis=1)) + of.start_spread_m**2
    lagged_spread_m2 = weights @ (variances_m2 + (lagged_m - lagged_place_m) ** 2)
    assert estimate[:3] == pytest.approx([*place_m, math.atan2(north, east)])
    assert estimate[3] == pytest.approx(1.4 * math.sqrt(spread_m2))
    assert estimate[4:] == pytest.approx([0.0, *lagged_place_m, *(1.4 * np.sqrt(lagged_spread_m2))])
    grown = f.covariances[:, SPEED, SPEED] - covariances[:, SPEED, SPEED]
    assert grown == pytest.approx((0.1 * means[:, SPEED]) ** 2)
    assert (f.past_covariances[..., SPEED] != 0.0).any()
    robot.sampled(f, of._replace(speed_redrawn=True), estimate)
    assert (f.past_covariances[..., SPEED] == 0.0).all()
    assert (f.means[:, SPEED] == of.speed_factor).all()


def test_the_law_of_speeds_is_that_of_the_robots() -> None:
    """Mean and spread of the clipped Gamma law, against numbers drawn from it."""
    robots = Scenario().robot
    drawn = np.random.default_rng(3).gamma(3.1, 0.095, 400_000) + 0.8
    drawn = np.clip(drawn, robots.speed_factor_min, robots.speed_factor_max)
    assert speed_law(robots) == pytest.approx((drawn.mean(), drawn.std()), rel=0.005)
