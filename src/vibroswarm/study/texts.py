"""Scenarios as text and back: what a worker is given is text, and where it was written it need not be read again."""

from __future__ import annotations

from typing import Final

from vibroswarm.scenario import Scenario

MOST: Final = 4096
"""Scenarios that are remembered."""
_known: dict[str, Scenario] = {}


def text_of(scenario: Scenario) -> str:
    """A scenario as TOML."""
    text = scenario.to_toml()
    _remember(text, scenario)
    return text


def scenario_of(text: str) -> Scenario:
    """A scenario from its TOML."""
    found = _known.get(text)
    if found is None:
        found = Scenario.from_toml(text)
        _remember(text, found)
    return found


def _remember(text: str, scenario: Scenario) -> None:
    if len(_known) >= MOST:
        _known.clear()
    _known[text] = scenario
