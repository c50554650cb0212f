"""The parts of a scenario's robots: hooks, constants and sizes that replace open names of ``robot_program``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroswarm import sensors
from vibroswarm.errors import InputError
from vibroswarm.export import robot_program
from vibroswarm.export.source import plain
from vibroswarm.inference.agents import sizes_of, strategy_used, world_of
from vibroswarm.motion.robot_params import setup_of
from vibroswarm.observation.observe import sense_program
from vibroswarm.robot.belief import belief_below as posterior_below
from vibroswarm.robot.sensing import ClassBorders, SenseProgram
from vibroswarm.robot.walk import WalkProgram
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.base import Strategy
from vibroswarm.strategies.static_analysis import fields_read, reads_places
from vibroswarm.strategies.world import World, belief_below

HOOKS: Final = ("begin", "on_sample", "on_timer", "decision")
"""Hooks that only take the place of the function of the same name in ``robot_program``; ``hooks_of`` treats the others
one by one."""
MOST_ROBOTS: Final = 256
"""A packet has one byte for the number of the robot that sends it."""


@dataclass(frozen=True)
class Classifier:
    """How robots read the class of the numbers that their own sensor measures."""

    class_of: Callable[..., Any]
    """The sensor's function of this name."""
    params: Mapping[str, Any]
    """The sensor's parameters that are numbers, by name."""
    names: tuple[str, ...]
    """Names of the numbers."""


@dataclass(frozen=True)
class RobotParts:
    """The parts of a scenario's robots."""

    scenario: Scenario
    strategy: Strategy
    hooks: Mapping[str, Any]
    """Values of the open names of ``robot_program``, see ``hooks_of``."""
    replaced: Mapping[Callable[..., Any], Callable[..., Any]]
    """Functions of the package that a robot cannot run: the functions exported in place of them."""
    params: Mapping[str, Any]
    """The strategy's parameters, by name."""
    world: World
    """The world as robot 0 knows it."""
    walker: WalkProgram
    """Parameters of the walk."""
    sensing: SenseProgram
    """Parameters of sensing."""
    sizes: Mapping[str, int]
    """Sizes that arrays may have, by name, such as robots and tiles."""
    rms_threshold: float
    """theta_E: a robot reads 1 if the energy is above this."""
    has_own_sensor: bool
    """Whether robots do not measure vibration: the program around them hands them each reading."""
    borders: ClassBorders | None
    """Which class they read of a value of their own sensor; None if it measures classes, or by ``classifier``."""
    classifier: Classifier | None
    """Which class they read of the numbers of their own sensor; None if it measures one value."""
    blind_ms: float
    """How long the robot ignores its rays after a turn; 0: it never does."""


def parts_of(scenario: Scenario) -> RobotParts:
    """Return the parts of a scenario's robots."""
    if scenario.swarm.robots > MOST_ROBOTS:
        raise InputError(
            f"{scenario.swarm.robots} robots cannot be exported: a packet has one byte for its sender's number; at "
            f"most {MOST_ROBOTS}",
            field="swarm.robots",
        )
    strategy = strategy_used(scenario)
    if reads_places(strategy) or strategy.steer is not None:
        raise InputError(
            f"'{strategy.name}' reads places or steers, so it cannot be exported", field="strategy.name"
        )
    sensor = sensors.sensor(scenario.sensor.model)
    measures = sensor.in_section or sensor.accelerometer is not None
    if measures and scenario.sensor.readings > 2:
        raise InputError(
            f"'{sensor.name}' finds several motors in spectra, so it cannot be exported", field="sensor.model"
        )
    setup = setup_of(scenario)
    classifier = None if measures else classifier_of(scenario.sensor)
    return RobotParts(
        scenario=scenario,
        strategy=strategy,
        hooks={
            **hooks_of(strategy),
            "READS_CLASSES": not measures,
            **({} if classifier is None else {"class_of_sensor": classifier.class_of}),
        },
        # A simulated robot reads beliefs from a table; an exported one computes them.
        replaced={plain(belief_below): robot_program.belief_of_posterior},
        params=params_of(scenario, strategy),
        world=world_of(scenario, counts=0),  # 0: the smallest table of beliefs, because it is not exported
        walker=WalkProgram(**{name: setup[name].item() for name in WalkProgram._fields}),
        sensing=sense_program(scenario),
        sizes=sizes_of(scenario),
        rms_threshold=float(scenario.sensor.rms_threshold),
        has_own_sensor=not measures,
        borders=None if measures else borders_of(scenario.sensor),
        classifier=classifier,
        blind_ms=float(setup["blind_ms"]),
    )


def borders_of(sensor: Sensor) -> ClassBorders | None:
    """Return the borders between the classes of a sensor, None if its values are classes, or measured at a place."""
    model = sensors.sensor(sensor.model)
    if model.sense is not None:
        return None
    least = model.class_borders(sensor.params)
    return None if (least == np.arange(1, least.size + 1)).all() else ClassBorders(least)


def classifier_of(sensor: Sensor) -> Classifier | None:
    """Return how robots read the numbers of a sensor that measures at a place; None if it measures by kind."""
    model, p = sensors.sensor(sensor.model), sensor.params
    if model.sense is None:
        return None
    names = model.names_of_numbers(p)
    if model.class_of is None:
        raise InputError(
            f"'{model.name}' reads {', '.join(names)} by NumPy (reading), which no robot can run; give its file "
            "class_of(v, p) in place of reading: the class of one sample, in plain Python",
            field="sensor.model",
        )
    given = {name: getattr(p, name) for name in type(p).model_fields}
    if model.has_threshold:
        given["rms_threshold"] = sensor.rms_threshold
    numbers = {name: value for name, value in given.items() if isinstance(value, bool | int | float)}
    return Classifier(model.class_of, numbers or {"unused": 0}, names)


def omitted_of_world(strategy: Strategy) -> tuple[str, ...]:
    """Return the fields of ``World`` that a robot does not have: large ones that it can do without."""
    return ("beliefs",) if "rates" in fields_read(strategy) else ("beliefs", "rates")


def params_of(scenario: Scenario, strategy: Strategy) -> dict[str, Any]:
    """Return the strategy's parameters by name, as plain Python numbers; a single 0 if it has no parameters."""
    # "or ()" is for the type checker: NumPy's ``names`` may be None, but a row always has a field.
    names = strategy.params_type.names or ()
    values = strategy.params_row(scenario.strategy.params)
    return {name: np.asarray(value).item() for name, value in zip(names, values, strict=True)}


def hooks_of(strategy: Strategy) -> dict[str, Any]:
    """Return the values of the open names of ``robot_program`` for a strategy: its hooks, and constants about them."""
    found: dict[str, Any] = {hook: getattr(strategy, hook) for hook in HOOKS if getattr(strategy, hook)}
    found["on_message"] = strategy.on_message
    if strategy.on_message is None:  # then messages have one bit, and ``on_counts`` counts each
        found["on_message"] = robot_program.hear_bit
        found["on_counts"] = strategy.on_counts
    found["belief"] = strategy.belief or robot_program.no_belief
    # The timer's time is no hook of strategies: ``timer_of_state`` reads it from the state's field ``next_s``.
    found["next_s"] = robot_program.timer_of_state
    found["HAS_TIMER"] = strategy.on_timer is not None
    found["posterior_below"] = posterior_below  # called by ``robot_program.belief_of_posterior``
    return found
