"""The cells of the real experiments: the swarms that ran, under what is not known of them."""

from __future__ import annotations

from typing import Any, Final

import polars as pl

from vibroswarm.paper.columns import STRATEGIES, sizes
from vibroswarm.paper.item import Cells, Settings
from vibroswarm.paper.published import published
from vibroswarm.paper.real_floor import real_floor

COLUMNS: Final = ("paper", "calibrated")
T_END_S: Final = 1000.0
THRESHOLDS: Final = (1.33, 1.40, 1.55)
"""Of the sensor, those of the recordings; which one the experiments had is not known."""
TEXTS: Final = 1.55
"""The one of Algorithm 2, which is for real experiments."""
GATES: Final = ("total", "own")
"""O_c counts all observations, as in the simulations, or a robot's own, as the real robots do (a fifth as many)."""
LOSSES: Final = ("with loss", "without loss")
TIME: Final = "decision_time_s"
KEYS: Final = ("column", "packets", "theta_E", "gate", "robots", "strategy")


def loss_of(robots: int) -> float:
    """Share of messages addressed to a robot that were lost: plotted is that of all, its own included."""
    plotted = dict(zip(sizes(), published("experiments.packet_loss_percent"), strict=True))[robots]
    return float(plotted) / 100 * robots / (robots - 1)


def cells(settings: Settings) -> Cells:
    """column, packets, threshold, gate, robots, strategy; without loss soft feedback is left out."""
    return {
        (column, packets, threshold, gate, robots, strategy): settings.cell(
            column, _values(packets, threshold, gate, robots, strategy)
        )
        for column in COLUMNS
        if column in settings.columns
        for packets in LOSSES
        for threshold in THRESHOLDS
        for gate in GATES
        for robots in sizes()
        for strategy in (STRATEGIES if packets == LOSSES[0] else STRATEGIES[:2])
    }


def _values(packets: str, threshold: float, gate: str, robots: int, strategy: str) -> dict[str, Any]:
    counted = published("parameters.P_star")[4]
    return real_floor() | {
        "run.t_end_s": T_END_S,
        "swarm.robots": robots,
        "strategy.name": strategy,
        "sensor.rms_threshold": threshold,
        "decision.gate": gate,
        "decision.min_observations": counted
        if gate == "total"
        else counted // published("simulation.robots"),
        "network.name": "loss",
        "network.loss.share": loss_of(robots) if packets == LOSSES[0] else 0.0,
    }


def published_points(values: list[float], name: str = "published") -> pl.DataFrame:
    """The paper's values by swarm size, as a series that has no interval."""
    numbers = [float(value) for value in values]
    there = {"x": [float(n) for n in sizes()], "estimate": numbers, "low": numbers, "high": numbers}
    return (
        pl.DataFrame(there).with_columns(series=pl.lit(name)).select("x", "series", "estimate", "low", "high")
    )
