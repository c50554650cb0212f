"""What robots think they know, in sentences: true places, as no real robot does, or wrong rates of their sensor.

Also whether they had enough observations to be allowed to decide, by the gate of the decision rule (``decision.gate``):

| gate | what is counted |
|---|---|
| total | observations, own and received |
| own | own samples |
| received | received bits |
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import sensors, strategies
from vibroswarm.core.numbers import percent
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import claimed_rates, claims_differ, rates
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.static_analysis import fields_read, told

STATED_RATES: Final = (
    "sensor.claimed_rates", "decision.assumed_false_positive", "decision.assumed_false_negative",
)  # fmt: skip
"""Fields that say what robots believe of their sensor."""


def true_places_notes(scenarios: Iterable[Scenario]) -> list[str]:
    """Return a list of one sentence, the first to print of a result, if its robots used their true places.

    The sentence names the strategies of these robots. The list is empty if no strategy reads places, or if robots
    estimate them.

    Args:
        scenarios: those behind the result; several if they are shown together.
    """
    names = dict.fromkeys(one.strategy.name for one in scenarios if one.reads_true_places)
    if not names:
        return []
    return [f"{', '.join(names)} with true places: an upper bound, as real robots must estimate theirs."]


def claims_notes(scenarios: Iterable[Scenario]) -> list[str]:
    """Return a sentence for each sensor whose claimed rates are not true, and by whose rates robots go."""
    asked = dict.fromkeys(
        (scenario.sensor, grid_of(scenario)) for scenario in scenarios if goes_by_rates(scenario)
    )
    return [
        f"Robots are wrong about their sensor: {_words(claimed_rates(*each), rates(*each))}."
        for each in asked
        if claims_differ(*each)
    ]


def claims_warnings(scenario: Scenario) -> list[str]:
    """Return a warning for each field of rates that a scenario states, if robots do not go by them; else none."""
    if not _is_loaded(scenario) or goes_by_rates(scenario):
        return []
    return [
        f"{name} has no effect: '{scenario.strategy.name}' takes readings at face value; places, for "
        'example, goes by it, as do robots with decision.boundary_of = "tiles"'
        for name in STATED_RATES
        if scenario[name] is not None
    ]


def goes_by_rates(scenario: Scenario) -> bool:
    """Return whether robots use the rates of their sensor; False if code of the scenario is not loaded."""
    return _is_loaded(scenario) and "error rates" in told(
        strategies.strategy(scenario.strategy.name), scenario.decision.boundary_of
    )


def _is_loaded(scenario: Scenario) -> bool:
    return scenario.strategy.name in strategies.known() and scenario.sensor.model in sensors.known()


def _words(claimed: NDArray[np.float64], true: NDArray[np.float64]) -> str:
    """Write both rates, in percent; of more than two kinds those that differ most."""
    if claimed.shape == (2, 2):
        return (
            f"they expect {percent(claimed[0, 1])} false positives and {percent(claimed[1, 0])} false negatives, and "
            f"the true rates are {percent(true[0, 1])} and {percent(true[1, 0])}"
        )
    kind, read = np.unravel_index(np.abs(claimed - true).argmax(), claimed.shape)
    return (
        f"they expect {percent(claimed[kind, read])} of the samples on kind {kind} to read as {read}, and the true "
        f"share is {percent(true[kind, read])}; no other share differs by more"
    )


COUNTED: Final = {
    "total": "observations, own and received",
    "received": "received bits",
    "own": "own samples",
}
"""What a gate counts, in words."""


def counted(gate: str) -> pl.Expr:
    """Return the most that a robot has of what a gate counts, from the columns of the table of robots at the end."""
    columns = {
        "total": ("samples", "messages_received"),
        "own": ("samples",),
        "received": ("messages_received",),
    }
    return pl.sum_horizontal(columns[gate]).max()


def gate_unreached(scenario: Scenario, most: int | None) -> str:
    """Return a sentence if no robot had enough observations to decide; empty if one had, or if there is no such gate.

    A task that asks for a number has none, and a strategy whose code is not loaded is taken to have none.

    Args:
        most: observations of the robot that had most of them (``counted``); None: not known.
    """
    rule, strategy = scenario.decision, strategies.known().get(scenario.strategy.name)
    if scenario.task.asks_number or strategy is None or "min_observations" not in fields_read(strategy):
        return ""
    if most is None or most > rule.min_observations:
        return ""
    return (
        f"No robot was allowed to decide: that takes more than {rule.min_observations} {COUNTED[rule.gate]} "
        f"(decision.min_observations); the most that one had is {most}."
    )
