"""Make the small recordings of this folder: ``python examples/lab/make.py``. They are simulated, not real.

Two sessions of five robots in the CSV of the study's robots, the first also as the CSV of a camera of one's own, which
a column map explains.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars as pl

from vibroswarm.motion.pose import pose
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

TILES = ("01010", "10010", "10101", "01101", "10010")
KEY = ["run", "robot", "sample"]
HEAD = (
    ",Timestamp,ROV Number,Marker ID,X Meter,Y Meter,Energy,Alpha,Beta,Belief,d_f,"
    "Swarm Send,Swarm Recv,Collision Time,Sense Time"
)
MARKERS = (10, 11, 6, 39, 14)
CAMERA_S = 0.22
"""Time between two positions of the camera, s."""


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
    result = simulate(scenario, 12, 2, poses=True)
    for run in (0, 1):
        write_log(result, folder / f"session-{run + 1}.csv", run)
    (folder / "floor.txt").write_text("\n".join(TILES) + "\n", encoding="utf-8")
    (folder / "columns.toml").write_text(MAP, encoding="utf-8")
    result.motion.join(result.observations, on=KEY).filter(pl.col("run") == 0).select(
        (pl.col("time_s") * 1000).round().cast(pl.Int64).alias("t_ms"),
        pl.col("robot").alias("id"),
        (pl.col("x_m") * 1000).round(1).alias("x_mm"),
        ((1.0 - pl.col("y_m")) * 1000).round(1).alias("down_mm"),
        pl.col("energy").round(3).alias("rms"),
    ).write_csv(folder / "camera.csv")


def write_log(result: Result, path: Path, run: int = 0) -> None:
    """Write a run of five robots: where they were every 0.22 s, with the samples taken since."""
    total_ms = (pl.col("avoid_s", "stop_s").cast(pl.Float64).cum_sum().over("robot") * 1000.0).round() % 65536
    samples = result.motion.filter(run=run).with_columns(total_ms.cast(pl.Int64))
    for table in (result.observations, result.inference):
        samples = samples.join(table, on=KEY, maintain_order="left")
    loops_s = np.arange(0.0, result.ends.filter(run=run)["end_s"].max(), CAMERA_S)
    rows = [
        (loop, robot, x, y, "None," * 8 + "None")
        for robot in range(len(MARKERS))
        for loop, (x, y, _) in enumerate(pose(result.poses, run, robot, loops_s))
    ]
    loops = np.minimum(np.searchsorted(loops_s, samples["time_s"]), loops_s.size - 1).tolist()
    for loop, row in zip(loops, samples.to_dicts(), strict=True):
        belief = f"{math.floor(row['belief_below'] * 1000 + 1e-9) / 1000:g}"
        cells = [row[name] for name in ("sample", "messages_received", "avoid_s", "stop_s")]
        decision = 2 if row["decision"] == -1 else row["decision"]  # 2: undecided
        cells = [f"{row['energy']:.3f}", row["alpha"], row["beta"], belief, decision, *cells]
        rows.append((loop, row["robot"], row["x_m"], row["y_m"], ",".join(map(str, cells))))
    lines = [
        f"{number},{loops_s[loop]:.2f},{robot + 1},{MARKERS[robot]:.1f},{min(x, 1.0):.7f},{min(y, 1.0):.7f},{cells}"
        for number, (loop, robot, x, y, cells) in enumerate(sorted(rows, key=lambda row: row[0]))
    ]
    path.write_text("\n".join([HEAD, *lines]) + "\n", encoding="utf-8")


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
    make(Path(__file__).parent)
