"""Strategies: what a robot says and when it decides; one file each (``base`` defines the protocol)."""

from __future__ import annotations

from vibroswarm.strategies import none, positive, soft  # noqa: F401  (these register themselves)

# isort: split
from vibroswarm.strategies import kinds  # noqa: F401  (lists of strategies keep this order)

# isort: split
from vibroswarm.strategies import (  # noqa: F401
    averaging,
    bayes_bots,
    explore,
    forget,
    mcp,
    places,
    reset,
    valentini,
)
from vibroswarm.strategies.base import Report, Strategy, array, known, names, register, strategy, strategy_in
from vibroswarm.strategies.world import belief_below, u

__all__ = [
    "Report",
    "Strategy",
    "array",
    "belief_below",
    "known",
    "names",
    "register",
    "strategy",
    "strategy_in",
    "u",
]
