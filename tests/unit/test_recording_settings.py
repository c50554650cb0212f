"""What robots ran with is found again in logs of simulated ones, and not where the log cannot tell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from helpers.recordings import write_log
from vibroswarm.lab.recordings.infer import (
    infer_settings,
)
from vibroswarm.lab.recordings.read import read_log
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate


def found(told: Scenario, tmp_path: Path, **changes: Any) -> dict[str, Any]:
    scenario = told.with_values({name.replace("__", "."): value for name, value in changes.items()})
    result = simulate(scenario, 11, 2, poses=True)
    for run in (0, 1):
        write_log(result, tmp_path / f"{run}.csv", run)
    logs = [(read_log(tmp_path / f"{run}.csv")) for run in (0, 1)]
    return {one.name: one for one in infer_settings(logs)}


@pytest.mark.parametrize(
    ("gate", "strategy"), [("own", "none"), ("total", "positive"), ("received", "positive")]
)
def test_what_ran_is_found(told: Scenario, tmp_path: Path, gate: str, strategy: str) -> None:
    least = {"own": 60, "total": 300, "received": 240}[gate]
    settings = found(
        told, tmp_path, decision__gate=gate, decision__min_observations=least, strategy__name=strategy,
        sensor__rms_threshold=1.45, run__t_end_s=500.0,
    )  # fmt: skip
    threshold = settings["sensor.rms_threshold"]
    assert threshold.low <= 1.45 <= threshold.high + 0.0005  # energies are written to 0.001
    assert settings["strategy.name"].value == strategy
    tau = settings["sample.sample_interval_ms"]
    assert tau.low <= 2000 <= tau.high < tau.low + 100
    assert tau.value == 2000
    assert settings["decision.gate"].value == gate
    assert settings["decision.min_observations"].low <= least <= settings["decision.min_observations"].high


def test_clocks_that_differ_tell_no_strategy(told: Scenario, tmp_path: Path) -> None:
    """With one clock 5 s late what robots received is not what others sent, and soft feedback seems the likeliest."""
    undecided = {"decision.min_observations": 10_000, "strategy.name": "none", "run.t_end_s": 900.0}
    write_log(simulate(told.with_values(undecided), 11, 1, poses=True), tmp_path / "log.csv", 0)
    log = read_log(tmp_path / "log.csv")
    late = pl.col("time_s") + pl.when(pl.col("robot") == log.samples["robot"][0]).then(5.0).otherwise(0.0)
    samples = log.samples.with_columns(late).sort("time_s")
    said = [
        next(one for one in infer_settings([each]) if one.name == "strategy.name")
        for each in (log, replace(log, samples=samples))
    ]
    assert said[1].value is None


def test_bits_that_are_logged_tell_threshold_and_strategy(console_logs: list[Path]) -> None:
    logs = [(read_log(path)) for path in console_logs]
    settings = {one.name: one for one in infer_settings(logs)}
    assert settings["strategy.name"].value == "positive"
    assert settings["sample.sample_interval_ms"].value == 2000
