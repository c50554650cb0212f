"""Robot parameters as the kernels read them, and what differs from robot to robot.

| name | symbol | unit | equation |
|---|---|---|---|
| misalignment | m_d | - | U(min, max), one a robot |
| its variation | a + b + c | - | added to m_d; a: one a sample, b: linear between values, c: one a run |
| speed factor | s_d | - | Gamma(shape, scale) + location, clipped; one a sample or one a robot |
| battery | b_d | - | 1 - t / battery_life |
| wheels | v_l, v_r | m/s | command v (1 -+ m_d) s_d b_d (Eq. 19) |
| track | - | m | turn rate = (v_r - v_l) / track |

Turns in place are stable if the closed loop of the turn controller is:

| name | symbol | unit | equation |
|---|---|---|---|
| turn gain | G | deg per tick and % | degrees turned in a control period by a command of 1 %, of the fastest robot |
| gains | Kp, Ki | %/deg, %/(deg s) | `walk.turn_gain_percent_per_deg`, `walk.turn_integral_gain_percent_per_deg_s` |
| loop | e, I | deg, deg s | e' = e - G (Kp e + Ki I), I' = I + dt e' below full command, as in `robot.walk` |
| bound | - | - | its eigenvalues lie within the unit circle just when G (2 Kp + dt Ki) < 4 (Jury's criterion) |

Where they are not, each step makes the last bits of a turn larger: after some tens of steps two computations of one run
differ, though both are right. So the engines agree in every event only where turns are stable. A turn that cannot pass
its tolerance within one step ends at its first pass, and nothing grows.
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
    OF_WANDER_TOO,
    SPEED,
    VEER,
    uniform,
)
from vibroswarm.core.ticks import tick_at
from vibroswarm.faults import onset_s
from vibroswarm.robot.walk import TIMERS, WalkProgram
from vibroswarm.scenario.fields import Robot
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import lattice_sites, longest_step_m, start_region

SPEED_NODES: Final = 2**14
"""Intervals of the speed factor's quantile table; linear between nodes."""

DRIFT_SAMPLES: Final = 30
"""Default of ``robot.misalignment_drift_samples``."""

AT_ONCE: Final = 8
"""Number of a robot's speed factors drawn at once."""

Setup = Any
"""A scenario's parameters of bodies and walk, as one row of numbers (``setup_of``), which compiled code passes on at
no cost. Its fields are those of ``WalkProgram`` and:

tick_s; width_m, height_m of the arena; radius_m of a body; full_speed_m_s, drive_track_m, turn_track_m;
misalignment_min, misalignment_max; misalignment_wander, misalignment_drift (0: none), misalignment_drift_samples;
speed_redrawn (0, 1); speed_each (0, 1: ``robot.speed_factors``); speed_wander
(0: none), speed_factor_min, speed_factor_max; battery_life_s; ray_forward_m and, one entry a ray, ray_side_m, ray_cos,
ray_sin; outside_m: how far from the centre rays start, where that may be beyond a wall, else 0; look_m: rays matter up
to the shorter of their range and theta_c; ray_reach_m: no ray sees a thing further than this from the robot's centre;
disc_radius_m of other robots to rays; longest_step_m: no robot moves further between two ticks; zone_m: bodies further
apart than this, centre to centre, cannot touch at the next tick; sight_m: no ray sees a robot further away;
fan_ahead_m, fan_behind_m, fan_beside_m: nor one further ahead of the rays' start, behind it, or aside of the robot's
axis; blind_ms: so long after a turn no ray is heeded (0: none); start: x from, x to, y from, y to of the centres at the
start; lattice: columns and rows of robots that fit side by side into it."""


@lru_cache(maxsize=16)
def speed_quantiles(robot: Robot) -> NDArray[np.float64]:
    """Return the clipped speed factor at equally spaced probabilities, shape (SPEED_NODES + 1,).

    If ``robot.speed_factors`` is given, return these instead, shape (robots named,).
    """
    if robot.speed_factors is not None:
        return np.array(robot.speed_factors, dtype=np.float64)
    from scipy.special import gammaincinv

    probability = np.linspace(0.0, 1.0, SPEED_NODES + 1)
    probability[-1] = 1.0 - 2.0**-53
    factor = robot.speed_factor_scale * gammaincinv(robot.speed_factor_shape, probability)
    table = np.clip(factor + robot.speed_factor_location, robot.speed_factor_min, robot.speed_factor_max)
    return np.ascontiguousarray(table, dtype=np.float64)


def setup_of(scenario: Scenario) -> Setup:
    """Return a scenario's parameters as the kernels read them."""
    robot, rays = scenario.robot, scenario.rays
    look_m = min(rays.range_m, scenario.walk.avoidance_threshold_mm / 1000.0)
    forward_m = rays.forward_each_m or (rays.forward_m,)
    aside_m = max(abs(side) for side in rays.side_m)
    start_m = math.hypot(max(forward_m), aside_m)
    ray_reach_m = start_m + look_m
    angles = [math.radians(angle) for angle in rays.angle_deg]
    ahead_m = [look_m * math.cos(angle) for angle in angles]
    beside_m = [side + look_m * math.sin(angle) for side, angle in zip(rays.side_m, angles, strict=True)]
    zone_m = 2.0 * (robot.body_radius_m + longest_step_m(scenario))
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
    """Return numbers and lists of numbers, by name, as one row; integers and booleans as int64."""
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
    """Draw m_d of a robot."""
    u = uniform(seed, run, robot, HARDWARE, FIRST, ALONE)
    return setup.misalignment_min + (setup.misalignment_max - setup.misalignment_min) * u


@inner
def triangular(seed: int, run: int, robot: int, index: int, peer: int) -> float:
    """Return a random number of a robot's veer with mean 0 and variance 1: a scaled sum of two uniform numbers."""
    both = uniform(seed, run, robot, VEER, index, peer) + uniform(seed, run, robot, VEER, index, peer + 1)
    return math.sqrt(6.0) * (both - 1.0)


@inner
def veer_shift(setup: Setup, seed: int, run: int, robot: int, sample: int) -> float:
    """Return the number to be added to a robot's own misalignment after ``sample`` samples; 0 if it does not vary."""
    shift = 0.0
    if setup.misalignment_wander > 0.0:
        shift += setup.misalignment_wander * triangular(seed, run, robot, sample, ALONE)
    if setup.misalignment_drift > 0.0:
        node = sample // setup.misalignment_drift_samples
        part = sample / setup.misalignment_drift_samples - node
        low = triangular(seed, run, robot, node, OF_DRIFT)
        high = triangular(seed, run, robot, node + 1, OF_DRIFT)
        # Between nodes the variance is (1 - part)^2 + part^2, on average 2/3; sqrt(1.5) makes up for that.
        shift += setup.misalignment_drift * math.sqrt(1.5) * (low + (high - low) * part)
    return shift


@kernel
def begin_veer(swarm: NDArray[np.void], setup: Setup, run_spread: float, seed: int, run: int) -> None:
    """Add to each robot's own misalignment its variation in this run and until its first sample."""
    for i in range(swarm.size):
        row = swarm[i]
        if run_spread > 0.0:
            row.misalignment += run_spread * triangular(seed, run, i, FIRST, OF_DAY)
        row.misalignment += veer_shift(setup, seed, run, i, 0)


@inner
def draw_speed_factors(
    factors: NDArray[np.float64],
    setup: Setup,
    speeds: NDArray[np.float64],
    seed: int,
    run: int,
    robot: int,
    first: int,
) -> None:
    """Draw a robot's speed factors s_d after ``first`` samples and after each of the next AT_ONCE - 1.

    The loops are separate so that compilers vectorise them.

    Args:
        factors: (AT_ONCE,), written. speeds: ``speed_quantiles``.
    """
    if setup.speed_each:
        factors[:] = speeds[robot % speeds.size]
    else:
        for k in range(AT_ONCE):
            factors[k] = uniform(seed, run, robot, SPEED, first + k if setup.speed_redrawn else FIRST, ALONE)
        for k in range(AT_ONCE):
            place = factors[k] * (speeds.size - 1)
            node = int(place)
            low = speeds[node]
            factors[k] = low + (speeds[node + 1] - low) * (place - node)
    if setup.speed_wander > 0.0:
        for k in range(AT_ONCE):
            factors[k] = wandered(setup, factors[k], seed, run, robot, first + k)


@inner
def wandered(setup: Setup, factor: float, seed: int, run: int, robot: int, sample: int) -> float:
    """Return a speed factor multiplied by its variation at a sample."""
    # The sum of two uniform numbers is triangular, of variance 1/6.
    both = uniform(seed, run, robot, SPEED, sample, OF_WANDER)
    both += uniform(seed, run, robot, SPEED, sample, OF_WANDER_TOO)
    factor *= 1.0 + setup.speed_wander * math.sqrt(6.0) * (both - 1.0)
    return min(max(factor, setup.speed_factor_min), setup.speed_factor_max)


def give_each(swarm: NDArray[np.void], scenario: Scenario, setup: Setup, seed: int, run: int) -> None:
    """Set body parameters that the scenario lists per robot, and when robots stop for good.

    Lists repeat beyond their ends.

    Args:
        swarm: (robots,), rows after ``begin``. setup: ``setup_of``.
    """
    if scenario.motion_faults.any_of_motion:
        tick_ms = scenario.run.control_period_ms
        stopped, empty = (
            onset_s(scenario, seed, [run], kind)[0].tolist() for kind in ("stopped", "battery_empty")
        )
        for i, (stops_s, empty_s) in enumerate(zip(stopped, empty, strict=True)):
            earlier_s = min(stops_s, empty_s)
            if math.isfinite(earlier_s):
                swarm[i]["fails_tick"] = max(tick_at(earlier_s, tick_ms), 1)
            if math.isfinite(empty_s):
                swarm[i]["silent_tick"] = max(tick_at(empty_s, tick_ms), 1)
    named = (
        ("misalignment", scenario.robot.misalignments),
        ("ray_forward_m", scenario.rays.forward_each_m),
    )
    for name, values in named:
        if values is not None:
            swarm[name] = np.resize(np.array(values, dtype=np.float64), swarm.size)
    if veers_vary(scenario.robot):
        begin_veer(swarm, setup, scenario.robot.misalignment_run_spread or 0.0, seed, run)


def veers_vary(robot: Robot) -> bool:
    """Return whether misalignments change between samples or runs."""
    return any((robot.misalignment_wander, robot.misalignment_drift, robot.misalignment_run_spread))


def turn_gain_deg(scenario: Scenario) -> float:
    """Return G, the angle that the fastest robot turns in a control period at a command of 1 %, deg."""
    robot = scenario.robot
    fastest = robot.full_speed_m_s * robot.speed_factor_max
    return math.degrees(2.0 * 0.01 * fastest / robot.turn_track_m * scenario.tick_s)


def spectral_radius(scenario: Scenario) -> float:
    """Return the largest absolute eigenvalue of a step of the turn controller below full command; stable below 1.

    Without an integral gain it is that of the error alone, as the integral then has no effect.
    """
    gain = turn_gain_deg(scenario)
    p = gain * scenario.walk.turn_gain_percent_per_deg
    q = gain * scenario.walk.turn_integral_gain_percent_per_deg_s * scenario.tick_s
    if q == 0.0:
        return abs(1.0 - p)
    trace, determinant = 2.0 - p - q, 1.0 - p
    beyond = 0.25 * trace * trace - determinant
    if beyond <= 0.0:
        return math.sqrt(determinant)
    return 0.5 * abs(trace) + math.sqrt(beyond)


def is_stable(scenario: Scenario) -> bool:
    """Return whether ``spectral_radius`` is below 1, by the bound, which is insensitive to rounding near 1."""
    walk = scenario.walk
    gains = 2.0 * walk.turn_gain_percent_per_deg
    gains += scenario.tick_s * walk.turn_integral_gain_percent_per_deg_s
    return turn_gain_deg(scenario) * gains < 4.0


def passes_tolerance(scenario: Scenario) -> bool:
    """Return whether the fastest robot at full command may cross the whole tolerance in one step."""
    return 100.0 * turn_gain_deg(scenario) > 2.0 * scenario.walk.turn_tolerance_deg


def scenario_warnings(scenario: Scenario) -> list[str]:
    """Return warnings about a valid but probably unintended scenario, one sentence each."""
    if is_stable(scenario) or not passes_tolerance(scenario):
        return []
    walk = scenario.walk
    gain, integral = walk.turn_gain_percent_per_deg, walk.turn_integral_gain_percent_per_deg_s
    most, radius = 4.0 / turn_gain_deg(scenario), spectral_radius(scenario)
    return [
        f"turns are not stable: robots swing about the angle they turn to (spectral radius {radius:.3g}), and rounding "
        "grows in each swing, so that other machines or engines may give other runs; 2 "
        f"walk.turn_gain_percent_per_deg + run.control_period_ms / 1000 walk.turn_integral_gain_percent_per_deg_s is "
        f"{2.0 * gain + scenario.tick_s * integral:.4g}, and must be below {most:.4g}"
    ]
