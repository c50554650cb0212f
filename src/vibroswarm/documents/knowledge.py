"""Words that documents share: in which setting robots are, what they know, and which versions made a result."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from vibroswarm.core.numbers import count, listed, stated
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.robot_knowledge import claims_notes, true_places_notes
from vibroswarm.strategies import known
from vibroswarm.strategies.static_analysis import told as told_by_strategy


def setting(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Write robots, floor and end of a scenario, but those that are varied: ``5 robots, floor random:0.48, ...``."""
    words = {
        "swarm.robots": count(scenario.swarm.robots, "robot"),
        "floor.source": f"floor {scenario.floor.source}",
        "run.t_end_s": f"up to {stated(scenario.run.t_end_s)} s",
    }
    return ", ".join(each for field, each in words.items() if field not in varied)


def told(scenarios: Iterable[Scenario]) -> tuple[str, ...]:
    """Return sentences on what robots know that real ones cannot know, or that others do not know.

    Strategies whose code is not loaded are left out of the comparison.
    """
    scenarios = list(scenarios)
    facts: dict[str, set[str]] = {}
    for scenario in scenarios:
        name = scenario.strategy.name
        if (strategy := known().get(name)) is not None:
            facts.setdefault(name, set()).update(told_by_strategy(strategy, scenario.decision.boundary_of))
    common = set.intersection(*facts.values()) if facts else set()
    more = {name: sorted(of_one - common) for name, of_one in facts.items()}
    sentences = true_places_notes(scenarios) + claims_notes(scenarios)
    if any(more.values()):
        beyond = [f"{name} also knows {listed(words)}" for name, words in more.items() if words]
        sentences.append(f"Strategies know different facts of their task: {'; '.join(beyond)}.")
    return tuple(sentences)


def versions_in_words(made_by: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return the versions that made a result, as texts for ``Document.made_by``, numbered if there are several.

    Args:
        made_by: the different ``simulation.versions``, which have the version of each part of the software.
    """
    return {
        "made by" if len(made_by) == 1 else f"made by ({number})": ", ".join(
            f"{name} {version}" for name, version in versions.items()
        )
        for number, versions in enumerate(made_by, start=1)
    }
