"""Robot parameters as the kernels read them, and the parameters that differ from robot to robot.

| name | symbol | unit | equation |
|---|---|---|---|
| misalignment | m_d | - | U(min, max), drawn once per robot |
| veer | a + b + c | - | variation of m_d, added to it: wander a, drift b and spread c |
| speed factor | s_d | - | Gamma(shape, scale) + location, clipped; drawn per sample or per robot |
| factor of the run | - | - | triangular, mean 1, sd ``speed_run_spread``; multiplies s_d; drawn once per run |
| battery | b_d | - | 1 - t / battery_life |
| wheels | v_l, v_r | m/s | command v (1 -+ m_d) s_d b_d (Eq. 19) |
| track | - | m | turn rate = (v_r - v_l) / track |

Of the veer, the wander is drawn at each sample, the drift is linear between values drawn every
``misalignment_drift_samples`` samples, and the spread is drawn once per run. The factors of all three are standard
deviations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner, kernel, zero_rows
from vibroswarm.core.rng import (
    ALONE,
    FIRST,
    HARDWARE,
    OF_DAY,
    OF_DRIFT,
    OF_WANDER,
    SPEED,
    VEER,
    fill_uniform,
    uniform,
)
from vibroswarm.core.ticks import tick_at
from vibroswarm.robot.walk import TIMERS, WalkProgram
from vibroswarm.scenario.fault_draws import onset_s
from vibroswarm.scenario.fields import Robot
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import lattice_sites, longest_step_m, start_region

SPEED_NODES: Final = 2**14
"""Number of intervals of the table of speed-factor quantiles, which is linear between its nodes."""

DRIFT_SAMPLES: Final = 30
"""Default of ``robot.misalignment_drift_samples``."""

AT_ONCE: Final = 8
"""Number of a robot's speed factors, and shifts of its veer, drawn at once."""

Setup = Any
"""A scenario's parameters of bodies and walk, as one row of numbers (``setup_of``), which compiled code passes on at
no cost. Its fields are those of ``WalkProgram`` and:

* ``tick_s``; ``width_m``, ``height_m`` of the arena; ``radius_m`` of a body.
* ``full_speed_m_s``, ``drive_track_m``, ``turn_track_m``; ``battery_life_s``.
* ``misalignment_min``, ``misalignment_max``, ``misalignment_wander`` (0: none), ``misalignment_drift`` (0: none),
  ``misalignment_drift_samples``.
* ``speed_redrawn``: 1 if the speed factor is drawn at each sample, 0 if once per robot. ``speed_each``: 1 if the
  scenario lists each robot's speed factor. ``speed_wander`` (0: none), ``speed_run_spread`` (0: none),
  ``speed_factor_min``, ``speed_factor_max``.
* ``ray_forward_m``: how far ahead of the robot's centre rays start, unless the scenario lists it for each robot
  (``give_each``). ``ray_side_m``, ``ray_cos``, ``ray_sin``: start of each ray, to the left of the robot's axis, and its
  direction; shape (rays,).
* ``outside_m``: distance from the centre at which rays start, if that may be beyond a wall, else 0.
* ``look_m``: length up to which rays matter: the shorter of their range and ``walk.avoidance_threshold_mm``.
  ``ray_reach_m``: no ray sees anything further than this from the robot's centre.
* ``disc_radius_m``: radius of other robots as the rays see them. ``sight_m``: no ray sees a robot whose centre is
  further away than this.
* ``fan_ahead_m``, ``fan_behind_m``, ``fan_beside_m``: no ray sees a robot whose centre is further ahead of the rays'
  start, further behind it (a negative number), or further to a side of the robot's axis.
* ``longest_step_m``: no robot moves further between two ticks. ``zone_m``: bodies whose centres are further apart than
  this cannot touch at the next tick.
* ``blind_ms``: driving time after a turn during which a robot ignores its rays (0: none).
* ``start``: range of the robots' centres at the start: x from, x to, y from, y to, m. ``lattice``: numbers of columns
  and rows of robots that fit side by side into that range.
"""


@lru_cache(maxsize=16)
def speed_quantiles(robot: Robot) -> NDArray[np.float64]:
    """Return the quantiles of the clipped speed factor at equally spaced probabilities, (SPEED_NODES + 1,); cached.

    If the scenario lists ``robot.speed_factors``, return that list instead.
    """
    if robot.speed_factors is not None:
        return np.array(robot.speed_factors, dtype=np.float64)
    factor = robot.speed_factor_scale * _gamma_quantiles(robot.speed_factor_shape)
    table = np.clip(factor + robot.speed_factor_location, robot.speed_factor_min, robot.speed_factor_max)
    return np.ascontiguousarray(table, dtype=np.float64)


@lru_cache(maxsize=16)
def _gamma_quantiles(shape: float) -> NDArray[np.float64]:
    """Return the quantiles of a Gamma distribution of scale 1: cached, as they take nearly all of the time in fits."""
    from scipy.special import gammaincinv

    probability = np.linspace(0.0, 1.0, SPEED_NODES + 1)
    # The greatest float below 1 replaces 1, whose quantile is infinite: clipped to ``speed_factor_max``, which may be
    # far above all other quantiles, it would distort the last interval.
    probability[-1] = 1.0 - 2.0**-53
    return np.asarray(gammaincinv(shape, probability))


def setup_of(scenario: Scenario) -> Setup:
    """Return a scenario's parameters as the kernels read them; see ``Setup`` for the fields."""
    robot, rays = scenario.robot, scenario.rays
    look_m = min(rays.range_m, scenario.walk.avoidance_threshold_mm / 1000.0)
    forward_m = rays.forward_each_m or (rays.forward_m,)
    aside_m = max(abs(side) for side in rays.side_m)
    start_m = math.hypot(max(forward_m), aside_m)  # no ray starts further from the robot's centre
    ray_reach_m = start_m + look_m
    angles = [math.radians(angle) for angle in rays.angle_deg]
    # End of each ray of length ``look_m``: how far it is ahead of the rays' start, and to the left of the robot's axis.
    ahead_m = [look_m * math.cos(angle) for angle in angles]
    beside_m = [side + look_m * math.sin(angle) for side, angle in zip(rays.side_m, angles, strict=True)]
    zone_m = 2.0 * (robot.body_radius_m + longest_step_m(scenario))  # two bodies, each moving one step
    # ``or 0.0``: None means that the scenario has no such variation, or no blind time. ``outside_m`` is 0 for rays that
    # start within the body, as these cannot start beyond a wall. The fan of the rays includes their start, from which
    # ``fan_ahead_m`` and ``fan_behind_m`` are measured: hence the 0.0 in both.
    values: dict[str, Any] = {
        "tick_s": scenario.tick_s,
        "width_m": scenario.arena.width_m,
        "height_m": scenario.arena.height_m,
        "radius_m": robot.body_radius_m,
        "full_speed_m_s": robot.full_speed_m_s,
        "drive_track_m": robot.drive_track_m,
        "turn_track_m": robot.turn_track_m,
        "misalignment_min": robot.misalignment_min,
        "misalignment_max": robot.misalignment_max,
        "misalignment_wander": robot.misalignment_wander or 0.0,
        "misalignment_drift": robot.misalignment_drift or 0.0,
        "misalignment_drift_samples": robot.misalignment_drift_samples or DRIFT_SAMPLES,
        "speed_redrawn": int(robot.speed_redraw == "sample"),
        "speed_each": int(robot.speed_factors is not None),
        "speed_wander": robot.speed_wander or 0.0,
        "speed_run_spread": robot.speed_run_spread or 0.0,
        "speed_factor_min": robot.speed_factor_min,
        "speed_factor_max": robot.speed_factor_max,
        "battery_life_s": robot.battery_life_s,
        "ray_forward_m": rays.forward_m,
        "ray_side_m": list(rays.side_m),
        "ray_cos": [math.cos(angle) for angle in angles],
        "ray_sin": [math.sin(angle) for angle in angles],
        "outside_m": start_m if start_m >= robot.body_radius_m else 0.0,
        "look_m": look_m,
        "ray_reach_m": ray_reach_m,
        "disc_radius_m": rays.disc_radius_m,
        "longest_step_m": longest_step_m(scenario),
        "zone_m": zone_m,
        "sight_m": ray_reach_m + rays.disc_radius_m,
        "fan_ahead_m": max(0.0, *ahead_m) + rays.disc_radius_m,
        "fan_behind_m": min(0.0, *ahead_m) - rays.disc_radius_m,
        "fan_beside_m": max(aside_m, *map(abs, beside_m)) + rays.disc_radius_m,
        "blind_ms": scenario.walk.blind_after_turn_ms or 0.0,
        "start": list(start_region(scenario)),
        "lattice": list(lattice_sites(scenario)),
        **walk_program(scenario)._asdict(),
    }
    return _row(values)


def _row(values: Mapping[str, Any]) -> Setup:
    """Return numbers as one structured row: whole ones as int64, others as float64, a list as a field of its length."""
    fields: list[tuple[Any, ...]] = []
    for name, value in values.items():
        array = np.asarray(value)
        kind = np.float64 if array.dtype.kind == "f" else np.int64
        fields.append((name, kind, array.shape) if array.shape else (name, kind))
    rows = zero_rows(1, np.dtype(fields))
    for name, value in values.items():
        rows[name][0] = value
    return rows[0]


def walk_program(scenario: Scenario) -> WalkProgram:
    """Return the walk's parameters as the robot's program reads them."""
    walk, sample = scenario.walk, scenario.sample
    return WalkProgram(
        tick_ms=scenario.run.control_period_ms,
        location_ms=walk.walk_duration_location_ms,
        scale_ms=walk.walk_duration_scale_ms,
        is_exponential=walk.walk_duration_law == "exponential",
        leg_min_ms=walk.leg_min_ms,
        leg_max_ms=walk.leg_max_ms,
        turn_max_deg=walk.turn_max_deg,
        avoidance_threshold_mm=walk.avoidance_threshold_mm,
        gain=walk.turn_gain_percent_per_deg,
        integral_gain=walk.turn_integral_gain_percent_per_deg_s,
        tolerance_deg=walk.turn_tolerance_deg,
        sample_interval_ms=sample.sample_interval_ms,
        stop_ms=sample.stop_ms,
        timer=TIMERS.index(sample.timer),
        interrupts_avoidance=sample.interrupts_avoidance,
    )


@inner
def misalignment(setup: Setup, seed: int, run: int, robot: int) -> float:
    """Return a robot's misalignment m_d, drawn uniformly; its veer is not included."""
    u = uniform(seed, run, robot, HARDWARE, FIRST, ALONE)
    return setup.misalignment_min + (setup.misalignment_max - setup.misalignment_min) * u


@inner
def triangular(both: float) -> float:
    """Return a random number of mean 0 and variance 1: the scaled sum of two uniform numbers."""
    return math.sqrt(6.0) * (both - 1.0)


@inner
def two_uniform(seed: int, run: int, robot: int, purpose: int, index: int, peer: int) -> float:
    """Return the sum of the uniform numbers at (purpose, index, peer) and (purpose, index, peer + 1)."""
    return uniform(seed, run, robot, purpose, index, peer) + uniform(
        seed, run, robot, purpose, index, peer + 1
    )


@inner
def draw_sums(
    drawn: NDArray[np.float64], seed: int, run: int, robot: int, purpose: int, first: int, peer: int
) -> None:
    """Write ``two_uniform`` at the indices first, first + 1, ... into ``drawn[0]``; ``drawn``: (2, AT_ONCE)."""
    fill_uniform(drawn[0], seed, run, robot, purpose, first, peer)
    fill_uniform(drawn[1], seed, run, robot, purpose, first, peer + 1)
    for k in range(AT_ONCE):
        drawn[0, k] += drawn[1, k]


@inner
def draw_veer_shifts(
    shifts: NDArray[np.float64],
    drawn: NDArray[np.float64],
    setup: Setup,
    seed: int,
    run: int,
    robot: int,
    first: int,
) -> None:
    """Draw by how much wander and drift change a robot's misalignment after ``first``, first + 1, ... samples."""
    for k in range(AT_ONCE):
        shifts[k] = 0.0
    if setup.misalignment_wander > 0.0:
        draw_sums(drawn, seed, run, robot, VEER, first, ALONE)
        for k in range(AT_ONCE):
            shifts[k] += setup.misalignment_wander * triangular(drawn[0, k])
    if setup.misalignment_drift > 0.0:
        # The drift is drawn at every ``misalignment_drift_samples``-th sample (a node) and is linear in between. Each
        # sample is at the fraction ``part`` of the way from one node to the next.
        latest, low, high = -1, 0.0, 0.0
        for k in range(AT_ONCE):
            node = (first + k) // setup.misalignment_drift_samples
            if node != latest:
                latest = node
                low = triangular(two_uniform(seed, run, robot, VEER, node, OF_DRIFT))
                high = triangular(two_uniform(seed, run, robot, VEER, node + 1, OF_DRIFT))
            part = (first + k) / setup.misalignment_drift_samples - node
            # Between two nodes of variance 1, the variance is (1 - part)^2 + part^2, on average 2/3. The factor
            # sqrt(1.5) raises this average to 1.
            shifts[k] += setup.misalignment_drift * math.sqrt(1.5) * (low + (high - low) * part)


@kernel
def begin_veer(swarm: NDArray[np.void], setup: Setup, run_spread: float, seed: int, run: int) -> None:
    """Add to each robot's misalignment its spread in this run, and its wander and drift until the first sample."""
    for i in range(swarm.size):
        row = swarm[i]
        if run_spread > 0.0:
            row.misalignment += run_spread * triangular(two_uniform(seed, run, i, VEER, FIRST, OF_DAY))
        row.misalignment += row.veer_shifts[0]


@inner
def draw_speed_factors(
    factors: NDArray[np.float64],
    drawn: NDArray[np.float64],
    setup: Setup,
    speeds: NDArray[np.float64],
    seed: int,
    run: int,
    robot: int,
    first: int,
) -> None:
    """Draw a robot's speed factors s_d after ``first``, first + 1, ..., first + AT_ONCE - 1 samples."""
    if setup.speed_each:
        factors[:] = speeds[robot % speeds.size]  # the list repeats if there are more robots than entries
    else:
        # Uniform numbers first, their quantiles in a loop of its own: compilers vectorise separate loops.
        if setup.speed_redrawn:
            fill_uniform(factors[:], seed, run, robot, SPEED, first, ALONE)
        else:
            factors[:] = uniform(seed, run, robot, SPEED, FIRST, ALONE)
        for k in range(AT_ONCE):
            # Interpolate linearly in the table of quantiles. The uniform number is below 1, so node + 1 exists.
            position = factors[k] * (speeds.size - 1)
            node = int(position)
            low = speeds[node]
            factors[k] = low + (speeds[node + 1] - low) * (position - node)
    if setup.speed_run_spread > 0.0:
        of_run = varied(setup.speed_run_spread, two_uniform(seed, run, robot, SPEED, FIRST, OF_DAY))
        for k in range(AT_ONCE):
            factors[k] = clipped(setup, factors[k] * of_run)
    if setup.speed_wander > 0.0:
        draw_sums(drawn, seed, run, robot, SPEED, first, OF_WANDER)
        for k in range(AT_ONCE):
            factors[k] = clipped(setup, factors[k] * varied(setup.speed_wander, drawn[0, k]))


@inner
def varied(spread: float, both: float) -> float:
    """Return a random factor of a robot's speed, of mean 1 and standard deviation ``spread``, from ``two_uniform``."""
    return 1.0 + spread * math.sqrt(6.0) * (both - 1.0)


@inner
def clipped(setup: Setup, factor: float) -> float:
    """Return a speed factor, clipped to the bounds that motion counts on."""
    return min(max(factor, setup.speed_factor_min), setup.speed_factor_max)


def give_each(swarm: NDArray[np.void], scenario: Scenario, setup: Setup, seed: int, run: int) -> None:
    """Set failures, misalignments and ray starts listed per robot, and the veer; short lists are repeated."""
    if scenario.faults.any_of_motion:
        tick_ms = scenario.run.control_period_ms
        # Time from which each robot of this run stands for good, and from which its battery is empty, s; inf: never.
        # With an empty battery it stands for good too, and is also silent.
        stopped, empty = (
            onset_s(scenario, seed, [run], kind)[0].tolist() for kind in ("stopped", "battery_empty")
        )
        for i, (stops_s, empty_s) in enumerate(zip(stopped, empty, strict=True)):
            earlier_s = min(stops_s, empty_s)
            # A fault from time 0 on takes effect at tick 1, the first tick whose step is simulated.
            if math.isfinite(earlier_s):
                swarm[i]["fails_tick"] = max(tick_at(earlier_s, tick_ms), 1)
            if math.isfinite(empty_s):
                swarm[i]["silent_tick"] = max(tick_at(empty_s, tick_ms), 1)
    listed = (
        ("misalignment", scenario.robot.misalignments),
        ("ray_forward_m", scenario.rays.forward_each_m),
    )
    for name, values in listed:
        if values is not None:
            # np.resize repeats a list that is too short.
            swarm[name] = np.resize(np.array(values, dtype=np.float64), swarm.size)
    # Last, as the veer is added to the misalignment, listed or drawn.
    if veers_vary(scenario.robot):
        begin_veer(swarm, setup, scenario.robot.misalignment_run_spread or 0.0, seed, run)


def veers_vary(robot: Robot) -> bool:
    """Return whether misalignments change between samples or runs."""
    return any((robot.misalignment_wander, robot.misalignment_drift, robot.misalignment_run_spread))
