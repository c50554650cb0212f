"""Networks of others: what arrives when, and that nothing is lost or made up on the way."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from vibroswarm import networks, strategies
from vibroswarm.core.jit import PLAIN, read_only
from vibroswarm.inference import replayer
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.generated_kernels import kernels
from vibroswarm.inference.replay import infer
from vibroswarm.motion.source import source
from vibroswarm.networks import Network
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of, simulate
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


def send_two_reads(
    n: Any, a: Any, sender: int, tick: int, number: int, size: int, x_m: Any, y_m: Any, arrival: Any, d: Any, p: Any,
    w: Any,
) -> None:  # fmt: skip
    """From Python 3.13 on, one instruction reads ``x_m`` and ``sender``."""
    arrival[:] = tick + 1 if x_m[sender] > 0.5 else -1


def send_comprehension(
    n: Any, a: Any, sender: int, tick: int, number: int, size: int, x_m: Any, north_m: Any, arrival: Any, d: Any,
    p: Any, w: Any,
) -> None:  # fmt: skip
    """Before Python 3.12, a comprehension is a function that is given ``north_m``, called so here."""
    arrival[:] = max([tick + int(north_m[j]) for j in range(arrival.size)])


LOSSY = Network("lossy", lost=lossy)
OTHER = Network("other", params=Params, state=Busy, send=send)
"""One network of two ways: for each, and each strategy, one would be compiled by itself."""
WAYS = {"late": LATE, "every_third": EVERY_THIRD}


@pytest.mark.parametrize(
    ("hook", "reads"), [(send, False), (send_two_reads, True), (send_comprehension, True)]
)
def test_a_network_that_reads_positions_is_given_them(hook: Any, reads: bool) -> None:
    assert Network("other", params=Params, state=Busy, send=hook).reads_positions == reads


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


@pytest.mark.parametrize(
    ("network", "names"), [("late", ["soft", "none"]), ("every_third", ["soft"]), ("lossy", ["none"])]
)
def test_deliveries_are_computed_once_and_equal_messages_one_by_one(
    network: str, names: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a network with delays, one with a memory, and one that loses more at some robots than at others."""
    scenario = over(network)
    cells = [over(network, strategy) for strategy in names]
    motion = source("event").batch(scenario, 5, [0, 1, 2])
    observations = observe(scenario, 5, motion.samples, floors_of(scenario, 5, [0, 1, 2]))
    timeline = timeline_of(scenario, motion)
    shared = [infer(cell, 5, timeline, observations) for cell in cells]
    assert len(timeline.deliveries) == 1

    monkeypatch.setattr(replayer, "counts_only", lambda strategy: False)
    for cell, (table, robots) in zip(cells, shared, strict=True):
        one_by_one, also = infer(cell, 5, timeline, observations)
        assert table.equals(one_by_one)
        assert robots.equals(also)

    monkeypatch.undo()  # and deliveries decide what is heard: with those of others the tables differ
    ((key, found),) = timeline.deliveries.items()
    timeline.deliveries[key] = found._replace(which=read_only(np.zeros_like(found.which)))
    assert not infer(cells[0], 5, timeline, observations)[0].equals(shared[0][0])


def test_what_deliveries_depend_on_is_not_mixed_up() -> None:
    scenario = over("late")
    motion = source("event").batch(scenario, 5, [0])
    timeline = timeline_of(scenario, motion)
    observations = observe(scenario, 5, motion.samples, floors_of(scenario, 5, [0]))
    for other in (scenario, over("every_third"), scenario.with_values({"decision.credible_threshold": 0.9})):
        infer(other, 5, timeline, observations)
    infer(scenario, 6, timeline, observations)
    assert len(timeline.deliveries) == 4


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_messages_that_were_delivered_need_no_kernel_of_their_own() -> None:
    """Read-only and writable arrays are two types to Numba: what is handed to a kernel is always of one."""
    for network in ("ideal", "late"):
        simulate(over(network), 3, 1)
    compiled: Any = kernels(strategies.strategy("none"), networks.network("ideal"), "replay_counts").replay
    assert len(compiled.signatures) == 1
