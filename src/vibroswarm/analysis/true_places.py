"""Say of results that robots knew their true places, which no real robot does."""

from __future__ import annotations

from collections.abc import Iterable

from vibroswarm.scenario.scenario import Scenario


def true_places_notes(scenarios: Iterable[Scenario]) -> list[str]:
    """Return a list of one sentence, the first to print of a result, if its robots used their true places.

    The sentence names the strategies of these robots. The list is empty if no strategy reads places, or if robots
    estimate them.

    Args:
        scenarios: those behind the result; several if they are shown together.
    """
    names = dict.fromkeys(one.strategy.name for one in scenarios if one.reads_true_places)
    if not names:
        return []
    return [f"{', '.join(names)} with true places: an upper bound, as real robots must estimate theirs."]
