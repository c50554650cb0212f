"""Checks of every network, each a function that yields what is wrong, in words; nothing if all is well.

All checks run on the same scenarios: swarms of ``SIZES`` with the network, in an eventful minute (``SHORT``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import count, stated
from vibroswarm.errors import InputError
from vibroswarm.networks import known, network
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
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

SIZES: Final = (1, 5, 12)
"""Numbers of robots in the scenarios of the checks."""
STRATEGIES: Final = ("none", "positive")
"""Strategies in the scenarios of the checks."""
MOST: Final = 32
"""Largest swarm that is tried if a network takes none of these."""
OF_OURS: Final[dict[str, dict[str, Any]]] = {
    "loss": {"network.loss.share": 0.3},
    "range": {"network.range.range_m": 0.4},
    "delay": {"network.delay.random_s": 3.0},
    "bursts": {"network.bursts.bad_share": 0.3},
    "tree": {"network.tree.frame_ms": 6.0},
}
"""Parameters for networks of this package whose default parameters would have little effect or none."""


def check_network(name: str) -> list[Finding]:
    """Run all checks of a registered network, and return their findings in order.

    Args:
        name: of the network, as in scenarios.
    Raises:
        InputError: there is no such network.
    """
    network(name)  # refuses an unknown name
    return run_checks(CHECKS, name)


def _scenarios(name: str) -> Iterator[tuple[str, Scenario]]:
    """Yield the scenarios in which the network ``name`` is checked, each with its description."""
    own = {**SHORT, "network.name": name, **OF_OURS.get(name, {})}
    for strategy in STRATEGIES:
        for robots in _sizes(name, own):
            values = own | {"swarm.robots": robots, "strategy.name": strategy}
            yield f"{count(robots, 'robot')}, {strategy}", preset("paper").with_values(values)


def _sizes(name: str, own: dict[str, Any]) -> Sequence[int]:
    """Return the numbers of robots with which a network is checked.

    By its own check, a network for certain swarm sizes refuses others, which are left out. If it has no check of its
    own, or refuses all, a refused scenario is an error.
    """
    if known()[name].check is None:
        return SIZES
    taken = [robots for robots in range(1, MOST + 1) if _takes(own | {"swarm.robots": robots})]
    return [robots for robots in SIZES if robots in taken] or taken[:1] or SIZES


def _takes(values: dict[str, Any]) -> bool:
    """Return whether a scenario of these values is valid."""
    try:
        preset("paper").with_values(values)
    except InputError:
        return False
    return True


def _pieces(name: str) -> Pieces:
    return tables_of(_scenarios(name))


def _runs(scenario: Scenario) -> Iterator[str]:
    """Check that two runs can be simulated, and that the table of robots has a row for each robot of each run."""
    result = simulate(scenario, SEED, 2)
    if result.robots.height != 2 * scenario.swarm.robots:
        yield "a robot is missing"


def _received_was_sent(scenario: Scenario) -> Iterator[str]:
    """Check that no robot receives more messages than the others sent."""
    robots = simulate(scenario, SEED, 2).robots
    # Signed numbers, so that no difference wraps below 0.
    of_others = pl.col("sent").cast(pl.Int64).sum().over("run") - pl.col("sent")
    for row in robots.with_columns(others=of_others).iter_rows(named=True):
        if row["messages_received"] > row["others"]:
            yield (
                f"robot {row['robot']} of run {row['run']} has received "
                f"{row['messages_received']} messages, and the others have sent {row['others']}"
            )


def _none_too_early(scenario: Scenario) -> Iterator[str]:
    """Check that no message is read before the tick after it was sent.

    The compiled run is checked by its counts of messages. In plain Python, the arrival ticks that ``send`` gives are
    checked themselves.
    """
    result = simulate(scenario, SEED, 1, moves=True)
    yield from _heard_before(result)
    plain = plain_run(scenario, SEED, result.motion, result.ends, result.observations, result.moves)
    for message in plain.too_early:
        yield (
            f"send lets robot {message.receiver} read at tick {message.arrival_tick} "
            f"what robot {message.sender} sends at tick {message.tick}; {message.tick + 1} is the earliest, "
            "and -1 means never"
        )


def _heard_before(result: Result) -> Iterator[str]:
    """Yield, in words, each sample before which a robot had received more messages than the others had sent by then.

    The strategies of the scenarios send one message at each sample, so the others' samples are the messages sent. A
    robot that stands for a sample hears nothing, so it can have received only messages sent before its stop began.

    Args:
        result: of one run; its tables ``motion`` and ``inference`` have their rows in the same order.
    """
    rows = result.motion.select("robot", "time_s", "stop_start_s")
    received = result.inference["messages_received"].to_list()
    for (robot, _, stop_s), heard in zip(rows.iter_rows(), received, strict=True):
        sent = rows.filter((pl.col("robot") != robot) & (pl.col("time_s") < stop_s)).height
        if heard > sent:
            yield f"robot {robot} has received {heard} messages by {stated(stop_s)} s, when the others had sent {sent}"


# Names of the checks, as ``vibroswarm check`` prints them.
CHECKS: Final[dict[str, Callable[[str], Iterator[str]]]] = {
    "it compiles and runs": in_each(_scenarios, _runs),
    "the same again, alone or beside others": in_each(_scenarios, same_again),
    "the same in another process": partial(same_elsewhere, "network", _pieces),
    "nobody receives more than the others have sent": in_each(_scenarios, _received_was_sent),
    "nothing is heard before it is sent": in_each(_scenarios, _none_too_early),
    "compiled as in plain Python": in_each(_scenarios, equals_plain),
}
"""All checks of a network, in order, by what each requires."""
