"""What reports of scenarios share: the setting in one line, what robots know, and how a result was made."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from vibroswarm.core.numbers import count, listed, stated
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.verdict import answers_of, has_wrong_rates
from vibroswarm.strategies import known
from vibroswarm.strategies.static_analysis import told


def setting(scenario: Scenario, varied: Collection[str] = ()) -> str:
    """Write question, robots, floor and end of a scenario, but those that are varied."""
    texts = {
        "swarm.robots": count(scenario.swarm.robots, "robot"),
        "strategy.name": scenario.strategy.name,
        "floor.source": f"floor {scenario.floor.source}",
        "run.t_end_s": f"up to {stated(scenario.run.t_end_s)} s",
    }
    asks = not {"task.name", "decision.decision_boundary"} & set(varied)
    question = f"{answers_of(scenario)[1]}? " if asks and not scenario.task.asks_number else ""
    text = question + ", ".join(text for field, text in texts.items() if field not in varied)
    return text[:1].upper() + text[1:]


def known_beyond(scenarios: Sequence[Scenario]) -> list[str]:
    """Return for each scenario what its robots know that those of another do not, and what no real robot knows."""
    facts = [_facts(scenario) for scenario in scenarios]
    common = set.intersection(*map(set, facts)) if facts else set()
    return [
        ", ".join([*(fact for fact in own if fact not in common), *_beyond_reality(scenario)])
        for own, scenario in zip(facts, scenarios, strict=True)
    ]


def _facts(scenario: Scenario) -> tuple[str, ...]:
    strategy = known().get(scenario.strategy.name)
    return () if strategy is None else told(strategy, scenario.decision.boundary_of)


def _beyond_reality(scenario: Scenario) -> list[str]:
    true_places = ["true places (no real robot)"] if scenario.reads_true_places else []
    return true_places + ["wrong error rates of the sensor"] * has_wrong_rates(scenario)


def versions_by_name(made_by: Sequence[dict[str, str]]) -> dict[str, str]:
    """Return the versions that made a result; those that are not the same everywhere side by side."""
    names = dict.fromkeys(name for versions in made_by for name in versions)
    return {
        name: listed(dict.fromkeys(versions[name] for versions in made_by if name in versions))
        for name in names
    }
