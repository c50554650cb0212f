"""The scenario that options describe, and warnings about probable mistakes, each printed once a command.

Every command clears what an earlier command of the same process has printed, so this module imports nothing that
simulations need: ``vibroswarm --help`` loads it too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final, cast

from vibroswarm.cli.terminal import say

if TYPE_CHECKING:
    from vibroswarm.cli.options import ScenarioBase
    from vibroswarm.scenario.scenario import Scenario
    from vibroswarm.study.options import ScenarioOptions

MOST: Final = 3
"""How many warnings are printed at once; a study may have one in each of many cells."""
_printed: Final[set[str]] = set()
"""Warnings that ``warn_of`` has printed or counted during this command."""


def words_of(options: ScenarioBase) -> ScenarioOptions:
    """Return the options that describe a scenario, as the words of ``study.options``."""
    from vibroswarm.study.options import ScenarioOptions

    known = ScenarioOptions.__annotations__
    return cast(ScenarioOptions, {name: value for name, value in vars(options).items() if name in known})


def scenario_from(options: ScenarioBase) -> Scenario:
    """Make the scenario that the options describe (``study.options.scenario_of``), and print warnings about it."""
    from vibroswarm.study.options import scenario_of

    return warned(scenario_of(**words_of(options)))


def scenario_named(name: str, settings: Sequence[str] = (), field: str | None = None) -> Scenario:
    """Return what ``study_options.scenario_named`` does, and print warnings about it."""
    from vibroswarm.study import options as study_options

    return warned(study_options.scenario_named(name, settings, field))


def warned(scenario: Scenario) -> Scenario:
    """Return a scenario, and print warnings about it."""
    warn_of([scenario])
    return scenario


def forget() -> None:
    """Forget the printed warnings, since a new command starts in the same process."""
    _printed.clear()


def warn_of(scenarios: Iterable[Scenario]) -> None:
    """Print on stderr the first ``MOST`` new warnings about these scenarios, and how many others there are.

    A warning is new if this command has not printed or counted it yet.
    """
    from vibroswarm.study.options import warnings_of

    # each different warning once, in order
    texts = dict.fromkeys(text for scenario in scenarios for text in warnings_of(scenario))
    new = [text for text in texts if text not in _printed]
    _printed.update(new)
    for text in new[:MOST]:
        say(f"Warning: {text}.")
    if len(new) > MOST:
        say(f"Warnings that are not printed: {len(new) - MOST}.")
