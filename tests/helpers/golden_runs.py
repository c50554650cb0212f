"""Golden runs: a few short ones, kept as tables of events, so that a change of behaviour cannot go unseen.

To renew them after a change that is meant (say in the commit what has changed, and why):

    python tests/helpers/golden_runs.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

FOLDER = Path(__file__).parents[1] / "golden"

CASES: dict[str, tuple[str, int, tuple[int, ...], dict[str, Any]]] = {
    "paper": (
        "paper",
        1,
        (0, 7),
        {"run.t_end_s": 45.0, "decision.min_observations": 20, "decision.credible_threshold": 0.7},
    ),
    "text": (
        "text",
        2,
        (3,),
        {"run.t_end_s": 45.0, "decision.min_observations": 15, "decision.credible_threshold": 0.7},
    ),
    "positive-until-decided": (
        "paper-empirical",
        2**63 - 1,
        (2**32 - 1,),
        {
            "strategy.name": "positive",
            "run.stop": "all_decided",
            "run.t_end_s": 400.0,
            "decision.min_observations": 10,
            "decision.credible_threshold": 0.8,
            "decision.gate": "received",
            "network.name": "loss",
            "network.loss.share": 0.2,
        },
    ),
    "soft-crowd": (
        "paper",
        4,
        (1,),
        {
            "arena.width_m": 0.3,
            "arena.height_m": 0.6,
            "floor.source": "alternating:0.46",
            "floor.left_m": 0.05,
            "floor.tile_width_m": 0.02,
            "swarm.robots": 12,
            "sample.sample_interval_ms": 1500.0,
            "sample.timer": "always",
            "strategy.name": "soft",
            "strategy.soft.eta": 30.0,
            "strategy.soft.kappa": 0.5,
            "decision.min_observations": 8,
            "decision.credible_threshold": 0.7,
            "decision.revise": True,
            "run.t_end_s": 25.0,
        },
    ),
    "odd-periods": (
        "paper",
        5,
        (0,),
        {
            "run.control_period_ms": 17,
            "run.t_end_s": 50.0,
            "sample.stop_ms": 300.0,
            "sample.timer": "frozen_in_avoidance",
            "sample.interrupts_avoidance": False,
            "robot.speed_redraw": "robot",
            "sensor.model": "energies",
            "sensor.vibrating_energies": [0.9, 1.8, 2.7, 3.1],
            "sensor.still_energies": [0.3, 0.7, 1.4],
            "decision.gate": "own",
            "decision.gate_counts_current": True,
            "decision.min_observations": 4,
            "decision.credible_threshold": 0.6,
            "decision.prior_alpha": 2,
        },
    ),
}
"""Preset, seed, runs, changes."""


def result_of(case: str) -> Result:
    """The runs of a case."""
    name, seed, runs, values = CASES[case]
    return simulate(preset(name).with_values(values), seed, runs, energies=False)


def events_of(result: Result) -> pl.DataFrame:
    """One row a sample: when, where, what was read, said and decided. Times in control periods."""
    period_s = result.scenario.tick_s
    key = ["run", "robot", "sample"]

    def ticks(name: str) -> pl.Expr:
        return (pl.col(name) / period_s).round().cast(pl.Int64)

    times = {"stop_tick": ticks("stop_start_s"), "sample_tick": ticks("time_s")}
    motion = result.motion.select(*key, "x_m", "y_m", **times)
    return (
        motion.join(result.observations.select(*key, "tile", "observation"), on=key, maintain_order="left")
        .join(result.inference.drop("belief_below"), on=key, maintain_order="left")
        .with_columns(pl.col("x_m", "y_m").round(7))
        .select(pl.all().exclude(pl.Float64).cast(pl.Int64), pl.col(pl.Float64))
    )


def stored(case: str) -> pl.DataFrame:
    """The table as it was kept."""
    return pl.read_csv(FOLDER / f"{case}.csv")


def differences(found: pl.DataFrame, kept: pl.DataFrame) -> list[str]:
    """What is not as it was kept: any whole number, or a position by more than a micrometre."""
    if found.columns != kept.columns:
        return [f"columns {found.columns}, kept {kept.columns}"]
    if found.height != kept.height:
        return [f"{found.height} samples, kept {kept.height}"]
    said = []
    for name in kept.columns:
        mine, theirs = found[name].to_numpy(), kept[name].to_numpy()
        wrong = np.flatnonzero(np.abs(mine - theirs) > (1e-6 if kept[name].dtype == pl.Float64 else 0))
        if wrong.size:
            row = int(wrong[0])
            said.append(f"{name}: {wrong.size} rows, first row {row}: {mine[row]}, kept {theirs[row]}")
    return said


if __name__ == "__main__":
    for case in CASES:
        events_of(result_of(case)).write_csv(FOLDER / f"{case}.csv", float_precision=7)
        print(f"{case}.csv")
