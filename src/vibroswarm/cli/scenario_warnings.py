"""Warnings about valid scenarios that are probably a mistake; each is printed once, on stderr."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario

_printed: Final[set[str]] = set()


def forget() -> None:
    """Forget what was printed: a new command starts."""
    _printed.clear()


def warn_of(scenarios: Iterable[Scenario]) -> None:
    """Print the first new warning about these scenarios, and how many others there are."""
    from vibroswarm.motion.turn_stability import scenario_warnings

    texts = dict.fromkeys(text for scenario in scenarios for text in scenario_warnings(scenario))
    new = [text for text in texts if text not in _printed]
    _printed.update(new)
    if new:
        print(f"Warning: {new[0]}.", file=sys.stderr)
    if len(new) > 1:
        print(f"Warning: the same for {len(new) - 1} more scenarios.", file=sys.stderr)
