"""Networks of others: what arrives when, and that nothing is lost or made up on the way."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from helpers.plain_reference import equals_plain
from vibroswarm import networks, strategies
from vibroswarm.core.jit import PLAIN
from vibroswarm.inference.generated_kernels import kernels
from vibroswarm.networks import Network
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.strategies import u

VALUES: dict[str, Any] = {"run.t_end_s": 100.0, "decision.min_observations": 20, "decision.hold_s": 5.0}


LATE, EVERY_THIRD = range(2)


class Params:
    way: int = LATE


class Busy:
    sent: int


def send(
    n: Any, a: Any, sender: int, tick: int, number: int, size: int, x_m: Any, y_m: Any, arrival: Any, d: Any, p: Any,
    w: Any,
) -> None:  # fmt: skip
    n.sent += 1
    for j in range(arrival.size):
        if p.way == LATE:
            arrival[j] = tick + 1 + int(500.0 * u(d, j))
        else:
            arrival[j] = tick + 1 if n.sent % 3 == 0 else -1


def lossy(sender: int, receiver: int, d: Any, p: Any, w: Any) -> bool:
    return bool(u(d, 0) < 0.3 + 0.05 * receiver)


LOSSY = Network("lossy", lost=lossy)
OTHER = Network("other", params=Params, state=Busy, send=send, positions=False)
"""One network of two ways: for each, and each strategy, one would be compiled by itself."""
WAYS = {"late": LATE, "every_third": EVERY_THIRD}


@pytest.fixture(scope="module", autouse=True)
def networks_of_others() -> Iterator[None]:
    networks.register(OTHER)
    networks.register(LOSSY)
    yield
    networks.base.forget(OTHER.name)
    networks.base.forget(LOSSY.name)


def over(network: str, strategy: str = "none") -> Scenario:
    values = {**VALUES, "network.name": network, "strategy.name": strategy}
    if network in WAYS:
        values |= {"network.name": OTHER.name, f"network.{OTHER.name}.way": WAYS[network]}
    return preset("paper").with_values(values)


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_a_strategy_and_a_network_need_one_kernel() -> None:
    """Read-only and writable arrays are two types to Numba: what is handed to a kernel is always of one."""
    for way in WAYS:
        simulate(over(way), 3, 1)
    compiled: Any = kernels(strategies.strategy("none"), networks.network(OTHER.name)).replay
    assert len(compiled.signatures) == 1


@pytest.mark.parametrize("network", [*WAYS, LOSSY.name])
def test_bits_are_counted_as_messages_are_read_one_by_one(network: str) -> None:
    """With delays, with a memory, and with more losses at some robots than at others."""
    assert list(equals_plain(over(network))) == []
