"""Networks of others: what arrives when, and that nothing is lost or made up on the way."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from vibroswarm import networks
from vibroswarm.code_files import load_file
from vibroswarm.networks import Network
from vibroswarm.presets import preset
from vibroswarm.result import Result
from vibroswarm.simulation import simulate
from vibroswarm.strategies import u

EXAMPLES = Path(__file__).parents[2] / "examples" / "strategies"
VALUES: dict[str, Any] = {"run.t_end_s": 100.0, "decision.min_observations": 20, "decision.hold_s": 5.0}


def at_once(
    n: Any, sender: int, tick: int, number: int, size: int, x_m: Any, y_m: Any, arrival: Any, d: Any, p: Any, w: Any
) -> None:  # fmt: skip
    for j in range(arrival.size):
        arrival[j] = tick + 1


def late(
    n: Any, sender: int, tick: int, number: int, size: int, x_m: Any, y_m: Any, arrival: Any, d: Any, p: Any, w: Any
) -> None:  # fmt: skip
    for j in range(arrival.size):
        arrival[j] = tick + 1 + int(500.0 * u(d, j))


def never(
    n: Any, sender: int, tick: int, number: int, size: int, x_m: Any, y_m: Any, arrival: Any, d: Any, p: Any, w: Any
) -> None:  # fmt: skip
    for j in range(arrival.size):
        arrival[j] = -1


class Busy:
    sent: int


def every_third(
    n: Any, sender: int, tick: int, number: int, size: int, x_m: Any, y_m: Any, arrival: Any, d: Any, p: Any, w: Any
) -> None:  # fmt: skip
    n.sent += 1
    for j in range(arrival.size):
        arrival[j] = tick + 1 if n.sent % 3 == 0 else -1


OTHERS = (
    Network("at_once", send=at_once),
    Network("late", send=late),
    Network("never", send=never),
    Network("every_third", state=Busy, send=every_third),
)


@pytest.fixture(scope="module", autouse=True)
def networks_of_others() -> Iterator[None]:
    for one in OTHERS:
        networks.register(one)
    load_file("strategy", str(EXAMPLES / "voter.py:voter"))
    yield
    for one in OTHERS:
        networks.base.forget(one.name)


def run(network: str, strategy: str, runs: int = 2) -> Result:
    values = {**VALUES, "network.name": network, "strategy.name": strategy}
    return simulate(preset("paper").with_values(values), 3, runs)


@pytest.mark.parametrize("strategy", ["none", "positive", "soft", "voter"])
def test_a_network_that_delivers_at_once_is_ideal(strategy: str) -> None:
    ideal, other = run("ideal", strategy), run("at_once", strategy)
    for name in ("inference", "robots", "runs"):
        assert getattr(ideal, name).equals(getattr(other, name)), name
    # Negative control: one that is late is another.
    assert not ideal.inference.equals(run("late", strategy).inference)


@pytest.mark.parametrize("strategy", ["soft", "voter"])
def test_messages_are_received_or_lost(strategy: str) -> None:
    sent = run("ideal", strategy).robots["sent"].sum()
    assert run("never", strategy).robots["received"].sum() == 0
    third = run("every_third", strategy).robots
    assert third["received"].sum() <= 4 * (third["sent"].sum() // 3 + 2)
    assert third["received"].sum() > 0.8 * 4 * third["sent"].sum() / 3
    assert sent > 0


@pytest.mark.parametrize("network", ["late", "every_third"])
def test_a_run_is_the_same_alone_and_beside_others(network: str) -> None:
    both, alone = run(network, "voter", 2), run(network, "voter", 1)
    assert both.inference.filter(both.inference["run"] == 0).equals(alone.inference)
