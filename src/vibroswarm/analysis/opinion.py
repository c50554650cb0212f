"""Whether the posterior of robots is an estimate of the fill ratio, or an opinion.

Without feedback the bits that robots count are readings, so that alpha / (alpha + beta) estimates the share of ones.
Under feedback they also count what others have concluded: the posterior runs away from the readings.
"""

from __future__ import annotations

from typing import Final

from vibroswarm.scenario.scenario import Scenario

_ALWAYS: Final = frozenset({"positive", "soft"})

OPINION_NOTE: Final = (
    "Under feedback a robot's posterior is its opinion, not an estimate of the fill ratio: it counts what other robots "
    "concluded as if they had read it."
)


def holds_opinions(scenario: Scenario) -> bool:
    """Return whether robots count conclusions of others as readings; False for strategies that are not shipped."""
    name = scenario.strategy.name
    return name in _ALWAYS or (name == "bayes_bots" and bool(scenario.strategy.params.positive_feedback))
