"""Scenarios drawn as widely as a scenario allows, in all that robots and their motion depend on.

``random_values`` says each choice by one of the methods of ``Choice``: with a seed as here, or with Hypothesis
(``tests/helpers/drawn_scenarios.py``). Every field of the sections in ``SECTIONS`` is drawn, which a test holds.
What does not fit together is mended towards what does (robots that do not fit, steps longer than a radius), so that
each draw is a scenario.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np

from vibroswarm.robot.walk import TIMERS
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.scenario.validation import lattice_sites, longest_step_m

SECTIONS = ("arena", "swarm", "robot", "rays", "walk", "sample", "run")
"""The sections of a scenario on which motion depends, and of ``faults`` those of ``MotionFaults``."""
APART = ("run.stop", "sample.signal_ms", "rays.noise_m")
"""Fields of these sections that are of no matter to motion."""
ROBOT_STEPS = 2_000_000
"""About so many control periods of a robot are simulated, so that no scenario takes much longer than another."""

RAY_COUNTS = (1, 2, 3, 3, 5, 9)
"""Numbers of rays; engines are compiled for each of them."""


class Choice(Protocol):
    """Where the numbers come from."""

    def one(self, values: Sequence[Any]) -> Any:
        """One of these."""

    def between(self, low: float, high: float) -> float:
        """A number in [low, high]."""


class Seeded:
    """Choices made by a seed."""

    def __init__(self, seed: int, number: int) -> None:
        self.rng = np.random.default_rng((seed, number))

    def one(self, values: Sequence[Any]) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))


def random_scenario(seed: int, number: int) -> Scenario:
    """Scenario ``number`` of a seed."""
    return fitted(random_values(Seeded(seed, number)))


def random_values(choose: Choice, ray_counts: Sequence[int] = RAY_COUNTS) -> dict[str, Any]:
    """Values of all fields that motion depends on, by dotted name; some scenarios are near the preset, some far."""
    often = choose.one([0.1, 0.4, 0.8])
    makers: dict[str, Callable[[Choice], dict[str, Any]]] = {
        "robot": robot_values,
        "rays": partial(rays_values, counts=ray_counts),
        "walk": walk_values,
        "sample": sample_values,
        "faults": fault_values,
    }
    values: dict[str, Any] = place_values(choose)
    for section, make in makers.items():
        drawn = {f"{section}.{name}": value for name, value in make(choose).items()}
        values |= {name: value for name, value in drawn.items() if choose.between(0.0, 1.0) < often}
    return values


def logarithmic(choose: Choice, low: float, high: float) -> float:
    """A number in [low, high], each order of magnitude as often as another."""
    return min(max(math.exp(choose.between(math.log(low), math.log(high))), low), high)


def place_values(choose: Choice) -> dict[str, Any]:
    """Arena, swarm and run."""
    width_m = choose.one([1.0, logarithmic(choose, 0.03, 8.0)])
    return {
        "arena.width_m": width_m,
        "arena.height_m": choose.one([1.0, width_m, logarithmic(choose, 0.03, 8.0)]),
        "swarm.robots": choose.one([1, 2, 3, 5, 5, 8, 10, 13, 14, 15, 16, 17, 20, 30, 40, 100]),
        "swarm.start_margin_m": choose.one([0.05, 0.0, choose.between(0.0, 0.5)]),
        "run.control_period_ms": choose.one([20, 20, 1, 5, 7, 13, 50, 100, 150, 333, 1000]),
        "run.t_end_s": logarithmic(choose, 5.0, 2000.0),
    }


def robot_values(choose: Choice) -> dict[str, Any]:
    """The body."""
    bends = sorted(choose.one([0.0, -0.1, 0.1, 1e-9, choose.between(-0.95, 0.95)]) for _ in range(2))
    slowest = logarithmic(choose, 0.05, 2.0)
    fastest = slowest * choose.one([1.0, choose.between(1.0, 4.0)])
    each = choose.one([False, False, True])
    named = [choose.between(slowest, fastest) for _ in range(choose.one([1, 2, 5]))]
    several = choose.one([None, [choose.between(-0.95, 0.95) for _ in range(3)], [0.05, -0.08]])
    values = {
        "body_radius_m": logarithmic(choose, 0.002, 0.1),
        "full_speed_m_s": logarithmic(choose, 1e-4, 1.0),
        "drive_track_m": logarithmic(choose, 0.004, 0.4),
        "turn_track_m": logarithmic(choose, 0.004, 0.4),
        "misalignment_min": bends[0],
        "misalignment_max": bends[1],
        "misalignments": several,
        "speed_factor_shape": logarithmic(choose, 0.5, 50.0),
        "speed_factor_scale": logarithmic(choose, 1e-3, 1.0),
        "speed_factor_location": choose.between(0.0, 2.0),
        "speed_factor_min": slowest,
        "speed_factor_max": fastest,
        "speed_redraw": "robot" if each else choose.one(["sample", "robot"]),
        "speed_factors": named if each else None,
        "speed_wander": choose.one([None, choose.between(0.01, 0.4)]),
        "battery_life_s": logarithmic(choose, 1.0, 1e6),
    }
    room = 1.0 - max(abs(bend) for bend in (*bends, *(several or ())))
    widest = min(0.99 * room / (6.0**0.5 * 3.3), 0.2)
    for name in ("wander", "drift", "run_spread"):
        values[f"misalignment_{name}"] = choose.one([None, None, choose.between(0.01, 1.0) * widest])
    values["speed_run_spread"] = choose.one([None, choose.between(0.01, 0.4)])
    return values | {"misalignment_drift_samples": choose.one([None, 1, 7])}


def rays_values(choose: Choice, counts: Sequence[int]) -> dict[str, Any]:
    """The distance sensors."""
    count = choose.one(counts)
    widest = choose.one([30.0, 90.0, 180.0])
    return {
        "forward_m": choose.one([0.0, 0.008, choose.between(0.0, 0.1)]),
        "forward_each_m": choose.one([None, [choose.between(0.0, 0.1) for _ in range(2)]]),
        "side_m": [choose.one([0.0, choose.between(-0.05, 0.05)]) for _ in range(count)],
        "angle_deg": [choose.between(-widest, widest) for _ in range(count)],
        "range_m": logarithmic(choose, 0.005, 3.0),
        "disc_radius_m": choose.one([0.0, 0.0055, choose.between(0.0, 0.1)]),
    }


def walk_values(choose: Choice) -> dict[str, Any]:
    """Legs, turns and avoidance."""
    leg_min_ms = choose.one([0.0, 20.0, logarithmic(choose, 1.0, 20_000.0)])
    return {
        "walk_duration_law": choose.one([None, None, "exponential"]),
        "walk_duration_location_ms": choose.one([0.0, logarithmic(choose, 1.0, 60_000.0)]),
        "walk_duration_scale_ms": choose.one([0.0, logarithmic(choose, 1.0, 60_000.0)]),
        "leg_min_ms": leg_min_ms,
        "leg_max_ms": leg_min_ms + choose.one([0.0, logarithmic(choose, 1.0, 60_000.0)]),
        "turn_max_deg": choose.one([180.0, choose.between(0.1, 180.0)]),
        "avoidance_threshold_mm": choose.one([0.0, logarithmic(choose, 1.0, 3000.0)]),
        "turn_gain_percent_per_deg": logarithmic(choose, 0.05, 100.0),
        "turn_integral_gain_percent_per_deg_s": choose.one([0.0, logarithmic(choose, 0.01, 50.0)]),
        "turn_tolerance_deg": logarithmic(choose, 0.02, 90.0),
        "blind_after_turn_ms": choose.one([None, logarithmic(choose, 1.0, 5000.0)]),
    }


def sample_values(choose: Choice) -> dict[str, Any]:
    """When robots stop, and for how long."""
    return {
        "sample_interval_ms": choose.one([0.0, logarithmic(choose, 1.0, 60_000.0)]),
        "stop_ms": choose.one([0.0, 1000.0, logarithmic(choose, 1.0, 10_000.0)]),
        "timer": choose.one(list(TIMERS)),
        "interrupts_avoidance": choose.one([True, False]),
    }


def fault_values(choose: Choice) -> dict[str, Any]:
    """Robots that stop for good."""
    early_s, late_s = sorted(logarithmic(choose, 0.1, 2000.0) for _ in range(2))
    return {
        "stopped": choose.one([0.0, 0.0, choose.between(0.0, 1.0)]),
        "stopped_from_s": choose.one([early_s, [early_s, late_s]]),
        "battery_empty": choose.one([0.0, 0.0, choose.between(0.0, 1.0)]),
        "battery_life_s": choose.one([[early_s, late_s], late_s]),
    }


def fitted(values: dict[str, Any], robot_steps: int = ROBOT_STEPS) -> Scenario:
    """The scenario of these values, mended where they do not go together."""
    values = {name: value for name, value in values.items() if value is not None}
    mend_pairs(values)
    values["swarm.robots"], robots = 1, values["swarm.robots"]
    plain = {**values, "robot.full_speed_m_s": 1e-9, "swarm.start_margin_m": 0.0, "run.t_end_s": 1e-3}
    least = 2.0 * plain.get("robot.body_radius_m", 0.015)
    for side in ("arena.width_m", "arena.height_m"):
        values[side] = plain[side] = max(values[side], least)
    scenario = Scenario().with_values(plain)
    longest_m = scenario.robot.body_radius_m * 1e-9 / longest_step_m(scenario)
    speed = values.get("robot.full_speed_m_s", Scenario().robot.full_speed_m_s)
    values["robot.full_speed_m_s"] = min(speed, 0.999 * longest_m)
    room_m = 0.5 * min(values["arena.width_m"], values["arena.height_m"])
    values["swarm.start_margin_m"] = min(values["swarm.start_margin_m"], room_m)
    columns, rows = lattice_sites(
        scenario.with_values({"swarm.start_margin_m": values["swarm.start_margin_m"]})
    )
    values["swarm.robots"] = min(robots, columns * rows)
    period_s = values["run.control_period_ms"] / 1000.0
    values["run.t_end_s"] = min(values["run.t_end_s"], robot_steps * period_s / values["swarm.robots"])
    life_s = values.get("robot.battery_life_s", Scenario().robot.battery_life_s)
    values["robot.battery_life_s"] = max(life_s, 1.01 * values["run.t_end_s"])
    return Scenario().with_values(values)


def mend_pairs(values: dict[str, Any]) -> None:
    """Let what was drawn, and what is as in the preset, be in order; changes ``values``."""
    base = Scenario()

    def given(name: str) -> Any:
        section, _, field = name.partition(".")
        return values.get(name, getattr(getattr(base, section), field))

    for pair in ("robot.misalignment_{}", "robot.speed_factor_{}", "walk.leg_{}_ms"):
        low, high = (pair.format(end) for end in ("min", "max"))
        values[low], values[high] = sorted((given(low), given(high)))
    if "robot.speed_factors" in values:
        low, high = given("robot.speed_factor_min"), given("robot.speed_factor_max")
        values["robot.speed_factors"] = [min(max(one, low), high) for one in values["robot.speed_factors"]]
        values["robot.speed_redraw"] = "robot"
    count = min(len(given("rays.side_m")), len(given("rays.angle_deg")))
    values["rays.side_m"], values["rays.angle_deg"] = (
        list(given(name))[:count] for name in ("rays.side_m", "rays.angle_deg")
    )
    least_ms = values["run.control_period_ms"] - given("sample.stop_ms")
    values["sample.sample_interval_ms"] = max(given("sample.sample_interval_ms"), least_ms)
