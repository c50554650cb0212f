"""Checks of every strategy, each a function that yields what is wrong, in words; nothing if all is well.

All checks but the last run on the same scenarios: settings of ``SETTINGS`` with the strategy, in an eventful minute
(``SHORT``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

from vibroswarm.errors import CodeError
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.testing.plain_reference import plain_run
from vibroswarm.testing.runs import (
    SEED,
    SHORT,
    Finding,
    Pieces,
    equals_plain,
    in_each,
    run_checks,
    same_again,
    same_elsewhere,
    tables_of,
)

SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "one robot": {"swarm.robots": 1},
    "five robots": {"swarm.robots": 5},
    "five, messages lost": {"swarm.robots": 5, "network.name": "loss", "network.loss.share": 0.3},
    "twelve": {"swarm.robots": 12},
}
"""Fields of the scenarios of the checks, by the description of each scenario."""
THREE_KINDS: Final[dict[str, Any]] = {
    "swarm.robots": 4,
    "sensor.model": "confusion",
    "floor.source": "random:0.4,0.36,0.24",
}
"""Fields of a further scenario, for strategies that read more than two classes."""
LONG: Final[dict[str, Any]] = {"run.t_end_s": 1200.0, "floor.source": "random:0.2", "swarm.robots": 5}
"""Fields of a scenario with an easy floor and much time, in which a robot should decide by any strategy."""


def check_strategy(name: str) -> list[Finding]:
    """Run all checks of a registered strategy, and return their findings in order.

    Args:
        name: of the strategy, as in scenarios.
    """
    return run_checks(CHECKS, name, WARNINGS_ONLY)


def _scenarios(name: str) -> Iterator[tuple[str, Scenario]]:
    """Yield the scenarios in which the strategy ``name`` is checked, each with its description.

    Robots know their true places, because ``plain_run`` does not replay localisation.
    """
    own = {**SHORT, "strategy.name": name, "localisation.method": "true"}
    for words, values in SETTINGS.items():
        yield words, preset("paper").with_values(own | values)
    strategy = strategy_of(name)
    if strategy.many_readings:
        task = "majority" if strategy.answers_kinds else "fill_ratio"
        yield "three kinds of tile", preset("paper").with_values(own | THREE_KINDS | {"task.name": task})


def _pieces(name: str) -> Pieces:
    return tables_of(_scenarios(name))


def _runs(scenario: Scenario) -> Iterator[str]:
    """Check that runs can be simulated, and that decisions are -1 or answers, and beliefs from 0 to 1, at all samples.

    Answers are 0 and 1 or, of a strategy that ``answers_kinds``, the kinds of tile.
    """
    try:
        result = simulate(scenario, SEED, 2)
    except CodeError as error:
        yield str(error)
        return
    answers = scenario.sensor.kinds if strategy_of(scenario.strategy.name).answers_kinds else 2
    if not result.inference["decision"].is_in(range(-1, answers)).all():
        yield f"a decision is not from -1 to {answers - 1}"
    belief = result.inference["belief_below"].drop_nulls().drop_nans()  # strategies without beliefs have none
    if not belief.is_between(0.0, 1.0).all():
        yield "a belief is outside of 0 to 1"


def _no_reading(name: str) -> Iterator[str]:
    """Check, in plain Python, that a class beyond the last kind of tile does no harm: compiled, it may spoil memory."""
    if not strategy_of(name).many_readings:
        return
    (scenario,) = (one for words, one in _scenarios(name) if words == "three kinds of tile")
    rates = ((0.4, 0.1, 0.1, 0.4), (0.1, 0.4, 0.1, 0.4), (0.1, 0.1, 0.4, 0.4))
    asked = scenario.with_values({"sensor.confusion.rates": rates})
    seen = simulate(asked.with_values({"strategy.name": "dirichlet", "task.name": "majority"}), SEED, [0])
    try:
        plain_run(asked, SEED, seen.motion, seen.ends, seen.observations, seen.moves)
    except IndexError as error:
        yield f"three kinds, and class 3: {error}; leave out what is not below w.kinds, or declare arrays of readings"


def _decides(name: str) -> Iterator[str]:
    """Check that at least one robot decides in long runs on an easy floor."""
    result = simulate(preset("paper").with_values({**LONG, "strategy.name": name}), SEED, 3)
    if (result.robots["decision"] == -1).all():
        yield "no robot has decided in 3 runs of 1200 s on an easy floor (20 % vibrate)"


# Names of the checks, as ``vibroswarm check`` prints them.
CHECKS: Final[dict[str, Callable[[str], Iterator[str]]]] = {
    "it compiles, and gives decisions and beliefs": in_each(_scenarios, _runs),
    "the same again, alone or beside others": in_each(_scenarios, same_again),
    "the same in another process": partial(same_elsewhere, "strategy", _pieces),
    "compiled as in plain Python": in_each(_scenarios, equals_plain),
    "it accepts a class that is not a kind": _no_reading,
    "it decides": _decides,
}
"""All checks of a strategy, in order, by what each requires."""
WARNINGS_ONLY: Final = ("it decides",)
"""Checks whose failure is not an error."""
