"""Checks of every strategy and network, each a function that yields what is wrong, in words; nothing if all is well."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import count
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.testing.runs import (
    SEED,
    SHORT,
    Check,
    Finding,
    Pieces,
    in_each,
    run_checks,
    same_again,
    same_in_plain_python,
    tables_of,
)

SETTINGS: Final[dict[str, dict[str, Any]]] = {
    "one robot": {"swarm.robots": 1},
    "five robots": {"swarm.robots": 5},
    "five, messages lost": {"swarm.robots": 5, "network.name": "loss", "network.loss.share": 0.3},
}
"""Fields of the scenarios of the checks, by the description of each scenario."""
THREE_KINDS: Final[dict[str, Any]] = {
    "swarm.robots": 4,
    "sensor.model": "confusion",
    "floor.source": "random:0.4,0.36,0.24",
    "sensor.confusion.rates": ((0.4, 0.1, 0.1, 0.4), (0.1, 0.4, 0.1, 0.4), (0.1, 0.1, 0.4, 0.4)),
}
"""Fields of a further scenario, for strategies that read more than two classes: three kinds of tile, and a class beyond
the last kind."""


def check_strategy(name: str) -> list[Finding]:
    """Run all checks of a registered strategy, and return their findings in order."""
    return run_checks(STRATEGY_CHECKS, name)


def _scenarios_of_strategy(name: str) -> Iterator[tuple[str, Scenario]]:
    own, strategy = {**SHORT, "strategy.name": name}, strategy_of(name)
    for words, values in SETTINGS.items():
        yield words, preset("paper").with_values(own | values)
    if strategy.many_readings:
        task = "majority" if strategy.answers_kinds else "fill_ratio"
        yield "three kinds of tile", preset("paper").with_values(own | THREE_KINDS | {"task.name": task})


def _pieces_of_strategy(name: str) -> Pieces:
    return tables_of(_scenarios_of_strategy(name))


def _runs(scenario: Scenario) -> Iterator[str]:
    inference = simulate(scenario, SEED, 2).inference
    answers = scenario.sensor.kinds if strategy_of(scenario.strategy.name).answers_kinds else 2
    if not inference["decision"].is_in(range(-1, answers)).all():
        yield f"a decision is not from -1 to {answers - 1}"
    belief = inference["belief_below"].drop_nulls().drop_nans()  # strategies without beliefs have none
    if not belief.is_between(0.0, 1.0).all():
        yield "a belief is outside of 0 to 1"


# Names of the checks, as ``vibroswarm check`` prints them. Plain Python comes first: its errors name the line.
STRATEGY_CHECKS: Final[dict[str, Check]] = {
    "the same in another process, in plain Python": partial(
        same_in_plain_python, "strategy", _pieces_of_strategy
    ),
    "it compiles, and gives decisions and beliefs": in_each(_scenarios_of_strategy, _runs),
    "the same again, alone or beside others": in_each(_scenarios_of_strategy, same_again),
}
"""All checks of a strategy, in order, by what each requires."""


SIZES: Final = (1, 5, *range(2, 33))
"""Numbers of robots: the first two that the network takes are tried."""
OF_OURS: Final[dict[str, dict[str, Any]]] = {
    "loss": {"network.loss.share": 0.3},
    "range": {"network.range.range_m": 0.4},
    "delay": {"network.delay.random_s": 3.0},
    "bursts": {"network.bursts.bad_share": 0.3},
    "tree": {"network.tree.frame_ms": 6.0},
}
"""Parameters for networks of this package whose default parameters would have little effect or none."""


def check_network(name: str) -> list[Finding]:
    """Run all checks of a registered network, and return their findings in order."""
    return run_checks(NETWORK_CHECKS, name)


def _scenarios_of_network(name: str) -> Iterator[tuple[str, Scenario]]:
    own = {**SHORT, "network.name": name, "strategy.name": "positive", **OF_OURS.get(name, {})}
    found = []
    for robots in SIZES:
        with suppress(InputError):  # a network for certain swarm sizes refuses others
            found.append(
                (count(robots, "robot"), preset("paper").with_values(own | {"swarm.robots": robots}))
            )
    yield from found[:2] or [("it takes no swarm", preset("paper").with_values(own))]


def _pieces_of_network(name: str) -> Pieces:
    return tables_of(_scenarios_of_network(name))


def _received_was_sent(scenario: Scenario) -> Iterator[str]:
    robots = simulate(scenario, SEED, 2).robots
    # Signed numbers, so that no difference wraps below 0.
    of_others = pl.col("sent").cast(pl.Int64).sum().over("run") - pl.col("sent")
    for row in robots.with_columns(others=of_others).iter_rows(named=True):
        if row["messages_received"] > row["others"]:
            yield (
                f"robot {row['robot']} of run {row['run']} has received "
                f"{row['messages_received']} messages, and the others have sent {row['others']}"
            )


# Names of the checks, as ``vibroswarm check`` prints them.
NETWORK_CHECKS: Final[dict[str, Check]] = {
    "the same in another process, in plain Python": partial(
        same_in_plain_python, "network", _pieces_of_network
    ),
    "the same again, alone or beside others": in_each(_scenarios_of_network, same_again),
    "nobody receives more than the others have sent": in_each(_scenarios_of_network, _received_was_sent),
}
"""All checks of a network, in order, by what each requires."""
