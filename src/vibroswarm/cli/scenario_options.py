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
    from vibroswarm.study.scenario_words import ScenarioWords

MOST: Final = 3
"""How many warnings are printed at once; a study may have one in each of many cells."""
_printed: Final[set[str]] = set()
"""Warnings that ``warn_of`` has printed or counted during this command."""


def words_of(options: ScenarioBase) -> ScenarioWords:
    """Return the options that describe a scenario, as the words of ``study.scenario_words``."""
    from vibroswarm.study.scenario_words import ScenarioWords

    known = ScenarioWords.__annotations__
    return cast(ScenarioWords, {name: value for name, value in vars(options).items() if name in known})


def scenario_from(options: ScenarioBase, *, is_final: bool = True) -> Scenario:
    """Make the scenario that the options describe (``scenario_words.scenario_of``), and print warnings about it.

    Args:
        is_final: whether what it selects stays, so that ``--set`` of a field of anything else is refused.
    """
    from vibroswarm.study.scenario_words import scenario_of

    made = warned(scenario_of(**words_of(options)))
    if is_final:
        refuse_settings(options.settings, [made])
    return made


def refuse_settings(settings: Sequence[str], scenarios: Iterable[Scenario]) -> None:
    """Refuse ``--set`` of a field that has no effect in any of the scenarios (``refuse_without_effect``)."""
    from vibroswarm.scenario.scenario import parse_settings
    from vibroswarm.study.scenario_words import refuse_without_effect

    refuse_without_effect(parse_settings(settings), scenarios, "--set ")


def scenario_named(name: str, settings: Sequence[str] = (), field: str | None = None) -> Scenario:
    """Return what ``scenario_words.scenario_named`` does, and print warnings about it."""
    from vibroswarm.study import scenario_words

    return warned(scenario_words.scenario_named(name, settings, field))


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
    from vibroswarm.study.scenario_words import warnings_of

    # each different warning once, in order
    texts = dict.fromkeys(text for scenario in scenarios for text in warnings_of(scenario))
    new = [text for text in texts if text not in _printed]
    _printed.update(new)
    for text in new[:MOST]:
        say(f"Warning: {text}.")
    if len(new) > MOST:
        say(f"Warnings that are not printed: {len(new) - MOST}.")
