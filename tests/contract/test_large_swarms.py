"""Swarms of 100 and more run whole, within their time, and as a plain account says."""

from __future__ import annotations

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
