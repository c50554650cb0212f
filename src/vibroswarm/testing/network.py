"""Checks of every network."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.message_log import message_log
from vibroswarm.errors import InputError
from vibroswarm.networks import known
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
OF_OURS: Final[dict[str, dict[str, Any]]] = {
    "loss": {"network.loss.share": 0.3},
    "range": {"network.range.range_m": 0.4},
    "delay": {"network.delay.random_s": 3.0},
    "bursts": {"network.bursts.bad_share": 0.3},
    "tree": {"network.tree.frame_ms": 6.0},
}
"""Parameters of our networks whose defaults have no or a small effect."""


def check_network(name: str) -> list[Finding]:
    """Run all checks of a registered network.

    Args:
        name: as scenarios call it.
    """
    return run_checks(CHECKS, name)


def _scenarios(name: str) -> Iterator[tuple[str, Scenario]]:
    base = preset("paper").with_values({**SHORT, "network.name": name, **OF_OURS.get(name, {})})
    refuses = known()[name].check
    for words, values in SETTINGS.items():
        if refuses is not None and _is_refused(base, values):
            continue  # as a network may that is fitted to some sizes
        yield words, base.with_values(values)


def _is_refused(base: Scenario, values: dict[str, Any]) -> bool:
    """Return whether a scenario is invalid."""
    try:
        base.with_values(values)
    except InputError:
        return True
    return False


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


def _none_vanishes(name: str) -> Iterator[str]:
    """Check that every message is received, lost or not due at each robot, and counted as received where it is."""
    for words, scenario in _scenarios(name):
        result = simulate(scenario, SEED, 1, moves=True)
        counts = message_log(result).counts()
        for row, robot in zip(counts.iter_rows(named=True), result.robots.iter_rows(named=True), strict=True):
            told, listed = robot["messages_received"], row["received"]
            if told != listed:
                yield f"{words}: robot {row['robot']} received {told} messages; listed are {listed}"
            if row["received"] + row["lost"] + row["not_due"] != _sent_by_others(result, row["robot"]):
                yield f"{words}: of the messages to robot {row['robot']} some are in no state"


def _sent_by_others(result: Result, robot: int) -> int:
    """Return the number of messages that the other robots sent."""
    return int(result.robots.filter(pl.col("robot") != robot)["sent"].sum())


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
    "every message is received, lost or not due": _none_vanishes,
    "nothing is heard before it is sent": _none_too_early,
    "compiled as in plain Python": lambda name: equals_plain(_scenarios(name)),
    "in pieces as in one": lambda name: in_pieces(_scenarios(name)),
}
