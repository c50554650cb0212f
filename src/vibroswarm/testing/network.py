"""Checks of every network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import polars as pl

from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.testing.plain_reference import plain_run
from vibroswarm.testing.runs import SEED, SHORT, Finding, equals_plain, in_pieces, run_checks, same_again

SETTINGS: Final[dict[str, dict[str, Any]]] = {
    f"{words}, {strategy}": {"swarm.robots": robots, "strategy.name": strategy}
    for strategy in ("none", "positive")
    for words, robots in (("one robot", 1), ("five robots", 5), ("twelve", 12))
}
OF_OURS: Final[dict[str, dict[str, Any]]] = {"loss": {"network.loss.share": 0.3}}
"""Parameters of our networks whose defaults have no effect."""


def check_network(name: str) -> list[Finding]:
    """Run all checks of a registered network.

    Args:
        name: as scenarios call it.
    """
    return run_checks(CHECKS, name)


def _scenarios(name: str) -> Iterator[tuple[str, Scenario]]:
    base = preset("paper").with_values({**SHORT, "network.name": name, **OF_OURS.get(name, {})})
    for words, values in SETTINGS.items():
        yield words, base.with_values(values)


def _runs(name: str) -> Iterator[str]:
    for words, scenario in _scenarios(name):
        result = simulate(scenario, SEED, 2)
        if result.robots.height != 2 * scenario.swarm.robots:
            yield f"{words}: a robot is missing"


def _received_was_sent(name: str) -> Iterator[str]:
    """Check that no robot receives more messages than the others sent."""
    for words, scenario in _scenarios(name):
        robots = simulate(scenario, SEED, 2).robots
        of_others = pl.col("sent").cast(pl.Int64).sum().over("run") - pl.col("sent")
        for row in robots.with_columns(others=of_others).iter_rows(named=True):
            if row["messages_received"] > row["others"]:
                yield (
                    f"{words}: robot {row['robot']} of run {row['run']} has received "
                    f"{row['messages_received']} messages, and the others have sent {row['others']}"
                )


def _none_too_early(name: str) -> Iterator[str]:
    """Check that no message is read before the tick after it was sent."""
    for words, scenario in _scenarios(name):
        result = simulate(scenario, SEED, 1, moves=True)
        yield from (f"{words}: {problem}" for problem in _heard_before(result))
        plain = plain_run(scenario, SEED, result.motion, result.ends, result.observations, result.moves)
        for message in plain.too_early:
            yield (
                f"{words}: send lets robot {message.receiver} read at tick {message.arrival_tick} "
                f"what robot {message.sender} sends at tick {message.tick}; {message.tick + 1} is the earliest"
            )


def _heard_before(result: Result) -> Iterator[str]:
    """Yield samples before which a robot had received more than was sent; strategies send at each sample."""
    rows = result.motion.select("robot", "time_s", "stop_start_s")
    received = result.inference["messages_received"].to_list()
    for (robot, _, stop_s), count in zip(rows.iter_rows(), received, strict=True):
        sent = rows.filter((pl.col("robot") != robot) & (pl.col("time_s") < stop_s)).height
        if count > sent:
            yield f"robot {robot} has received {count} messages by {stop_s:g} s, when the others had sent {sent}"


CHECKS: Final[dict[str, Callable[[str], Iterator[str]]]] = {
    "it compiles and runs": _runs,
    "the same again, alone or beside others": lambda name: same_again(_scenarios(name)),
    "nobody receives more than the others have sent": _received_was_sent,
    "nothing is heard before it is sent": _none_too_early,
    "compiled as in plain Python": lambda name: equals_plain(_scenarios(name)),
    "in pieces as in one": lambda name: in_pieces(_scenarios(name)),
}
