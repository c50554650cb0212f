"""Warnings of scenarios that are valid and hardly what was meant: each once, on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from vibroswarm.scenario import Scenario

_said: Final[set[str]] = set()


def forget() -> None:
    """Begin a new command."""
    _said.clear()


def warn_of(scenarios: Iterable[Scenario]) -> None:
    """Say what is to be said of these scenarios and was not; of many alike, of the first and how many there are."""
    from vibroswarm.motion.turn_stability import scenario_warnings

    texts = dict.fromkeys(text for scenario in scenarios for text in scenario_warnings(scenario))
    new = [text for text in texts if text not in _said]
    _said.update(new)
    if new:
        print(f"Warning: {new[0]}.", file=sys.stderr)
    if len(new) > 1:
        print(f"Warning: likewise in {len(new) - 1} further scenarios.", file=sys.stderr)
