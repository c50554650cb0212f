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

import polars as pl

from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import claims_differ
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.static_analysis import fields_read, told


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
    """Return a sentence if robots go by error rates of their sensor that are not its true ones."""
    wrong = (goes_by_rates(one) and claims_differ(one.sensor, grid_of(one)) for one in scenarios)
    return ["Robots are wrong about their sensor: its true error rates are not those that they claim."] * any(
        wrong
    )


def goes_by_rates(scenario: Scenario) -> bool:
    """Return whether robots use the rates of their sensor."""
    return "error rates" in told(scenario.strategy.entry, scenario.decision.boundary_of)


COUNTED: Final = {
    "total": "observations, own and received",
    "received": "received bits",
    "own": "own samples",
}
"""What a gate counts, in words."""
_COLUMNS: Final = {
    "total": ("samples", "messages_received"),
    "own": ("samples",),
    "received": ("messages_received",),
}
"""What it counts, by columns of the table of robots."""


def counted(gate: str) -> pl.Expr:
    """Return the most that a robot has of what a gate counts, from the columns of the table of robots at the end."""
    return pl.sum_horizontal(_COLUMNS[gate]).max()


def gate_unreached(scenario: Scenario, most: int | None) -> str:
    """Return a sentence if no robot had enough observations to decide; empty if one had, or if there is no such gate.

    A task that asks for a number has none.

    Args:
        most: observations of the robot that had most of them (``counted``); None: not known.
    """
    rule = scenario.decision
    if scenario.task.asks_number or "min_observations" not in fields_read(scenario.strategy.entry):
        return ""
    if most is None or most > rule.min_observations:
        return ""
    return (
        f"No robot was allowed to decide: that takes more than {rule.min_observations} {COUNTED[rule.gate]} "
        f"(decision.min_observations); the most that one had is {most}."
    )
