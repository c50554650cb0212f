"""Small recordings of our own: made by our simulator, written in the formats of the lab."""

from __future__ import annotations

import runpy
from pathlib import Path

import polars as pl
import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate

write_log = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "lab" / "make.py"))["write_log"]
"""Write a run of five robots as the CSV of the study's robots."""
TILES = ("01010", "10010", "10101", "01101", "10010")


@pytest.fixture(scope="session")
def told() -> Scenario:
    """Five robots for 400 s with positive feedback; they decide."""
    return preset("paper-empirical").with_values(
        {
            "floor.tiles": TILES,
            "floor.source": "ours",
            "strategy.name": "positive",
            "sensor.rms_threshold": 1.55,
            "decision.min_observations": 40,
            "decision.gate": "own",
            "run.t_end_s": 400.0,
        }
    )


@pytest.fixture(scope="session")
def made(told: Scenario) -> Result:
    return simulate(told, 7, 2, poses=True)


@pytest.fixture(scope="session")
def logs(made: Result, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("logs")
    found = [folder / f"session-{run}.csv" for run in (0, 1)]
    for run, path in enumerate(found):
        write_log(made, path, run)
    return found


@pytest.fixture(scope="session")
def console_logs(made: Result, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("console")
    found = [folder / f"console-{run}.txt" for run in (0, 1)]
    for run, path in enumerate(found):
        write_console(made, path, run)
    return found


def write_console(result: Result, path: Path, run: int) -> None:
    """Write the samples of a run after 5 s as the study's simulator prints them, each robot's last one twice."""
    key = ["run", "robot", "sample"]
    total_s = pl.col("avoid_s", "stop_s").cast(pl.Float64).cum_sum().over("robot")
    samples = result.motion.filter(run=run).with_columns(total_s)
    for table in (result.observations, result.inference):
        samples = samples.join(table, on=key, maintain_order="left")
    samples = samples.filter(pl.col("time_s") > 5.0)
    lasts = samples.group_by("robot", maintain_order=True).last().select(samples.columns)
    lines = [
        f"1,{row['time_s']:.6f},{row['robot']},{row['energy']:.6f},{row['message']},{row['belief_below']:.6f},"
        f"{row['alpha']},{row['beta']},{row['sample']},{row['messages_received']},0,0,{row['x_m']:.6f},"
        f"{1.0 - row['y_m']:.6f},0,{round(1000 * row['avoid_s'])},{round(1000 * row['stop_s'])},0,{row['decision']}"
        for row in pl.concat([samples, lasts]).to_dicts()
    ]
    path.write_text("\n".join(["7500 15000 2000 50 40 1 1500 7 1 5 2000 0 0", *lines]) + "\n")


@pytest.fixture(scope="session")
def ground(told: Scenario) -> Floor:
    return told.floor_for(0, 0)
