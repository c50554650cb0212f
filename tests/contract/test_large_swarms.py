"""Swarms of 100 and more run whole, within their time, and as a plain account says."""

from __future__ import annotations

import time
from typing import Any

import pytest

from helpers.plain_reference import differences, plain_run
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate

IDEAL = {"network.name": "ideal"}
LOSS = {"network.name": "loss", "network.loss.share": 0.1}


def large(robots: int, side_m: float, rows: int, t_end_s: float, **more: Any) -> Scenario:
    values = {
        "swarm.robots": robots, "arena.width_m": side_m, "arena.height_m": side_m, "floor.rows": rows,
        "floor.columns": rows, "run.t_end_s": t_end_s,
    }  # fmt: skip
    return preset("paper").with_values(
        values | {name.replace("__", "."): value for name, value in more.items()}
    )


@pytest.mark.parametrize("network", [IDEAL, LOSS], ids=["ideal", "loss"])
def test_a_hundred_robots_take_less_than_ten_seconds(network: dict[str, Any]) -> None:
    """1200 s of the whole run, once compiled. It takes 0.2 s, so that a limit of 10 s is no matter of luck."""
    scenario = large(100, 4.5, 20, 1200.0).with_values(network)
    simulate(scenario.with_values({"run.t_end_s": 6.0}), 1)
    began_s = time.process_time()
    result = simulate(scenario, 1)
    assert time.process_time() - began_s < 10.0
    assert result.motion.height > 20_000
    share = 1.0 - (0.1 if network is LOSS else 0.0)
    heard = result.robots["messages_received"].mean()
    assert heard == pytest.approx(share * 0.99 * result.robots["sent"].sum(), rel=0.02)  # type: ignore[arg-type]


@pytest.mark.parametrize("strategy", ["none", "mcp"])
def test_seventy_robots_equal_the_plain_account(strategy: str) -> None:
    """Above 64 robots losses are drawn message by message."""
    faults = {"faults.stuck_at_1": 0.1, "faults.radio_dead": 0.1 if strategy == "mcp" else 0.0}
    scenario = large(70, 4.5, 20, 7.0, strategy__name=strategy, decision__min_observations=20)
    for network in (IDEAL, LOSS) if strategy == "none" else (IDEAL,):
        one = scenario.with_values(network | faults)
        result = simulate(one, 2)
        plain = plain_run(one, 2, result.motion, result.ends, result.observations)
        assert list(differences(result, plain)) == []


def test_a_thousand_robots_run() -> None:
    """100 s of what takes 1 s of CPU for 1200 s."""
    result = simulate(large(1000, 14.0, 70, 100.0), 3)
    assert result.robots.height == 1000
    assert (result.robots["samples"] > 0).all()
    sent = result.robots["sent"].sum()
    assert 0.9 * sent < result.robots["messages_received"].mean() < sent  # type: ignore[operator]
