"""Checks of every network, each a function that yields what is wrong, in words; nothing if all is well."""

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
    return run_checks(CHECKS, name)


def _scenarios(name: str) -> Iterator[tuple[str, Scenario]]:
    own = {**SHORT, "network.name": name, "strategy.name": "positive", **OF_OURS.get(name, {})}
    found = []
    for robots in SIZES:
        with suppress(InputError):  # a network for certain swarm sizes refuses others
            found.append(
                (count(robots, "robot"), preset("paper").with_values(own | {"swarm.robots": robots}))
            )
    yield from found[:2] or [("it takes no swarm", preset("paper").with_values(own))]


def _pieces(name: str) -> Pieces:
    return tables_of(_scenarios(name))


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
CHECKS: Final[dict[str, Check]] = {
    "the same in another process, in plain Python": partial(same_in_plain_python, "network", _pieces),
    "the same again, alone or beside others": in_each(_scenarios, same_again),
    "nobody receives more than the others have sent": in_each(_scenarios, _received_was_sent),
}
"""All checks of a network, in order, by what each requires."""
