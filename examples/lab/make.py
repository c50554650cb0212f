"""Make the small recordings of this folder: ``python examples/lab/make.py``. They are simulated, not real.

Two sessions of five robots in the robots' CSV, the first also as the simulator's console log, and as the CSV of a camera
of one's own, which a column map explains.
"""  # noqa: E501

from __future__ import annotations

import argparse
from pathlib import Path

import polars as pl

from vibroswarm.recordings.export import write_rugbot, write_webots
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

TILES = ("01010", "10010", "10101", "01101", "10010")


def make(folder: Path) -> None:
    """Write all files into a folder."""
    scenario = preset("paper-empirical").with_values(
        {
            "floor.tiles": TILES,
            "floor.source": "floor.txt",
            "strategy.name": "positive",
            "sensor.rms_threshold": 1.55,
            "decision.gate": "own",
            "decision.min_observations": 12,
            "network.name": "loss",
            "network.loss.share": 0.02,
            "run.t_end_s": 120.0,
        }
    )
    result = simulate(scenario, 12, 2, segments=True)
    for run in (0, 1):
        write_rugbot(result, folder / f"session-{run + 1}.csv", run, replace=True)
    write_webots(result, folder / "console-1.txt", 0, replace=True)
    (folder / "floor.txt").write_text("\n".join(TILES) + "\n", encoding="utf-8")
    (folder / "columns.toml").write_text(MAP, encoding="utf-8")
    key = ["run", "robot", "sample"]
    result.motion.join(result.observations, on=key).filter(pl.col("run") == 0).select(
        (pl.col("time_s") * 1000).round().cast(pl.Int64).alias("t_ms"),
        pl.col("robot").alias("id"),
        (pl.col("x_m") * 1000).round(1).alias("x_mm"),
        ((1.0 - pl.col("y_m")) * 1000).round(1).alias("down_mm"),
        pl.col("energy").round(3).alias("rms"),
    ).write_csv(folder / "camera.csv")


MAP = """\
# How camera.csv is read: milliseconds and millimetres, y counted down from the upper wall.
name = "camera"

[columns]
robot = "id"
time_s = { name = "t_ms", times = 0.001 }
x_m = { name = "x_mm", times = 0.001 }
y_m = { name = "down_mm", times = -0.001, plus = 1.0 }
energy = "rms"
"""

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", default=Path(__file__).parent, help="default: this folder"
    )
    make(parser.parse_args().folder)
