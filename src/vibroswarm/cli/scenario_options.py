"""The scenario that options describe, and warnings about probable mistakes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, cast

from vibroswarm.cli.options import SwarmOptions
from vibroswarm.cli.terminal import say

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.study.options import ScenarioOptions


def keywords_of(options: SwarmOptions) -> ScenarioOptions:
    """Return the options that describe a scenario, as keywords of the functions of ``study.options``."""
    from vibroswarm.study.options import ScenarioOptions

    known = ScenarioOptions.__annotations__
    return cast(ScenarioOptions, {name: value for name, value in vars(options).items() if name in known})


def scenario_from(options: SwarmOptions) -> Scenario:
    """Return the scenario that the options describe, and print warnings about it."""
    from vibroswarm.study.options import scenario_of

    return warned(scenario_of(**keywords_of(options)))


def scenario_named(name: str, settings: Sequence[str] = (), field: str | None = None) -> Scenario:
    """Return the scenario of a preset or file, with fields set, and print warnings about it."""
    from vibroswarm.study import options

    return warned(options.scenario_named(name, settings, field))


def warned(scenario: Scenario) -> Scenario:
    """Return a scenario, and print warnings about it."""
    warn_of([scenario])
    return scenario


def warn_of(scenarios: Iterable[Scenario]) -> None:
    """Print on stderr each different warning about these scenarios."""
    from vibroswarm.study.options import warnings_of

    for text in dict.fromkeys(text for scenario in scenarios for text in warnings_of(scenario)):
        say(f"Warning: {text}.")
