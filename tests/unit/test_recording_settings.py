"""What robots ran with is found again in logs of simulated ones, and not where the log cannot tell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from helpers.recordings import write_log
from vibroswarm.recordings.infer import infer_settings
from vibroswarm.recordings.read import read_log
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate


def found(told: Scenario, tmp_path: Path, **changes: Any) -> dict[str, Any]:
    scenario = told.with_values({name.replace("__", "."): value for name, value in changes.items()})
    result = simulate(scenario, 11, 2, poses=True)
    for run in (0, 1):
        write_log(result, tmp_path / f"{run}.csv", run)
    logs = [(read_log(tmp_path / f"{run}.csv")) for run in (0, 1)]
    return {one.name: one for one in infer_settings(logs)}


def test_what_ran_is_found(told: Scenario, tmp_path: Path) -> None:
    settings = found(told, tmp_path, sensor__rms_threshold=1.45, run__t_end_s=500.0)
    threshold = settings["sensor.rms_threshold"]
    assert threshold.low <= 1.45 <= threshold.high + 0.0005  # energies are written to 0.001
    tau = settings["sample.sample_interval_ms"]
    assert tau.low <= 2000 <= tau.high < tau.low + 100
    assert tau.value == 2000


def test_tau_is_found_in_console_logs(console_logs: list[Path]) -> None:
    logs = [(read_log(path)) for path in console_logs]
    settings = {one.name: one for one in infer_settings(logs)}
    assert settings["sample.sample_interval_ms"].value == 2000
