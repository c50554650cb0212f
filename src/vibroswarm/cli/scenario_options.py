"""``vibroswarm scenario``, and the scenario that options describe, with warnings about probable mistakes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, cast

from vibroswarm.cli.deliver import print_saved_file
from vibroswarm.cli.options import Force, OutFile, ScenarioOptions, SwarmOptions
from vibroswarm.cli.terminal import say
from vibroswarm.core.atomic_io import write_file

if TYPE_CHECKING:
    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.study.options import ScenarioOptions as Keywords


def keywords_of(options: SwarmOptions) -> Keywords:
    """Return the options that describe a scenario, as keywords of the functions of ``study.options``."""
    from vibroswarm.study.options import ScenarioOptions as Keywords

    known = Keywords.__annotations__
    return cast(Keywords, {name: value for name, value in vars(options).items() if name in known})


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


def scenario(*, out: OutFile = None, force: Force = False, scenario: ScenarioOptions) -> None:
    """Write a scenario as TOML, with every field, to edit and run again; to the terminal without --out.

    example:
      vibroswarm scenario --robots 8 --out mine.toml; vibroswarm run --scenario mine.toml
    """
    wanted = scenario_from(scenario)
    if out is None:
        print(wanted.to_toml(), end="")
        return
    write_file(out, wanted.to_toml(), replace=force)
    print_saved_file(out, f"scenario {wanted.hash}")
