"""What a scenario's robots consist of: the functions of their strategy, constants, and the sizes of their memory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from vibroswarm.errors import InputError
from vibroswarm.export import robot_program
from vibroswarm.export.source import plain, source_of
from vibroswarm.inference.agents import sizes_of, strategy_used, world_of
from vibroswarm.localisation.locate import is_estimated, program_of
from vibroswarm.motion.robot_params import setup_of
from vibroswarm.observation.observe import sense_program
from vibroswarm.robot.belief import belief_below as posterior_below
from vibroswarm.robot.pose_mixture import ESTIMATE, LocalisationProgram, Mixture, empty_mixture
from vibroswarm.robot.sensing import SenseProgram
from vibroswarm.robot.walk import WalkProgram
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.strategies.base import Strategy
from vibroswarm.strategies.static_analysis import PLACE, fields_read
from vibroswarm.strategies.world import World, belief_below

HOOKS: Final = ("begin", "on_sample", "on_timer", "decision", "steer")


@dataclass(frozen=True)
class RobotParts:
    """The parts of a scenario's robots."""

    strategy: Strategy
    hooks: Mapping[str, Any]
    """Values of names of ``robot_program``: the strategy's functions, and what they have."""
    replaced: Mapping[Callable[..., Any], Callable[..., Any]]
    params: Mapping[str, Any]
    world: World
    walker: WalkProgram
    sensing: SenseProgram
    localiser: LocalisationProgram | None
    mixture: Mixture | None
    sizes: Mapping[str, int]
    rms_threshold: float
    blind_ms: float
    estimates: int = len(ESTIMATE)


def parts_of(scenario: Scenario) -> RobotParts:
    """Return the parts of a scenario's robots.

    Raises:
        InputError: robots of this kind cannot be exported.
    """
    strategy = strategy_of(scenario.strategy.name)
    refuse_options(scenario, strategy)
    read = fields_read(strategy) & set(PLACE)
    localiser, mixture = None, None
    if read and not is_estimated(scenario):
        raise InputError(
            f"is 'true', but a real robot does not know where it is, and '{strategy.name}' reads "
            f"{', '.join(sorted(read))}; use --set localisation.method=mixture",
            field="localisation.method",
        )
    if read:  # a strategy that reads no place needs no localisation
        localiser = program_of(scenario)
        lag = scenario.localisation.lag
        count = scenario.localisation.components if scenario.localisation.method == "mixture" else 1
        mixture = empty_mixture(count, lag)
    setup = setup_of(scenario)
    return RobotParts(
        strategy=strategy,
        hooks=hooks_of(strategy, mixture is not None),
        replaced={plain(belief_below): robot_program.belief_of_posterior},
        params=params_of(scenario, strategy),
        world=world_of(scenario, 0),
        walker=WalkProgram(**{name: setup[name].item() for name in WalkProgram._fields}),
        sensing=sense_program(scenario),
        localiser=localiser,
        mixture=mixture,
        sizes=sizes_of(scenario),
        rms_threshold=float(scenario.sensor.rms_threshold),
        blind_ms=float(setup["blind_ms"]),
    )


def refuse_options(scenario: Scenario, strategy: Strategy) -> None:
    """Refuse parameters for which another variant of the strategy runs.

    Raises:
        InputError: that names the first of them, and the functions that run.
    """
    used, params = strategy_used(scenario), scenario.strategy.params
    if used is strategy:
        return
    for name, field in type(params).model_fields.items():
        value = getattr(params, name)
        plain_choice = scenario.with_values({f"strategy.{strategy.name}.{name}": field.default})
        if value != field.default and strategy_used(plain_choice) != used:
            functions = source_of(used.on_sample)
            shown = str(value).lower() if isinstance(value, bool) else value
            raise InputError(
                f"{shown}: robots with this option cannot be exported yet, for their messages and readings have no "
                f"form there (see {functions.file}, line {functions.before + 1}); leave it at "
                f"{str(field.default).lower()}",
                field=f"strategy.{strategy.name}.{name}",
            )


def params_of(scenario: Scenario, strategy: Strategy) -> dict[str, Any]:
    """Return the strategy's parameters by name."""
    names = strategy.params_type.names or ()
    values = strategy.params_row(scenario.strategy.params)
    return {name: np.asarray(value).item() for name, value in zip(names, values, strict=True)}


def hooks_of(strategy: Strategy, has_places: bool) -> dict[str, Any]:
    """Return what stands for each open name of ``robot_program`` with a strategy: its hooks, or what replaces them."""
    found: dict[str, Any] = {hook: getattr(strategy, hook) for hook in HOOKS if getattr(strategy, hook)}
    found["on_message"] = strategy.on_message
    if strategy.on_message is None:
        found["on_message"] = robot_program.hear_bit
        found["on_counts"] = strategy.on_counts
    found["belief"] = strategy.belief or robot_program.no_belief
    found["next_s"] = robot_program.timer_of_state
    found["HAS_TIMER"], found["HAS_STEER"] = strategy.on_timer is not None, strategy.steer is not None
    found["HAS_PLACES"] = has_places
    found["posterior_below"] = posterior_below
    return found
