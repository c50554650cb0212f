"""Whether robots had enough observations to be allowed to decide, by the gate of the decision rule (``decision.gate``).

| gate | what is counted |
|---|---|
| total | observations, own and received |
| own | own samples |
| received | received bits |
"""

from __future__ import annotations

from typing import Final

import polars as pl

from vibroswarm import strategies
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies.static_analysis import fields_read

COUNTED: Final = {
    "total": "observations, own and received",
    "received": "received bits",
    "own": "own samples",
}
"""What a gate counts, in words."""


def counted(scenario: Scenario) -> pl.Expr:
    """Return what the gate counts, from the columns of the table of robots at the end."""
    columns = {
        "total": ("samples", "messages_received"),
        "own": ("samples",),
        "received": ("messages_received",),
    }
    return pl.sum_horizontal(columns[scenario.decision.gate]).max()


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
