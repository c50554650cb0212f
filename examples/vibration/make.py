"""Make ``acceleration.csv`` in this folder: ``python examples/vibration/make.py``; simulated, it stands for yours.

Three robots on a floor of 5 x 5 tiles whose motors run at 90 and 140 Hz: what their accelerometers read in 16 stops.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import polars as pl

from vibroswarm.floors.floor import place_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import Samples
from vibroswarm.sensors.acceleration import accelerations
from vibroswarm.simulation import simulate


def make(file: Path) -> None:
    """Write the file."""
    scenario = Scenario().with_values(
        {
            "swarm.robots": 3,
            "floor.source": "random:0.4,0.36,0.24",
            "sensor.model": "acceleration",
            "sensor.acceleration.motor_hz": (90.0, 140.0),
            "sensor.rms_threshold": 1.0,
            "strategy.name": "dirichlet",
            "task.name": "majority",
            "run.t_end_s": 30.0,
        }
    )
    run = simulate(scenario, seed=1, runs=1)
    rows, floor = run.motion.filter(pl.col("sample") < 8), run.floor(0)
    x_m, y_m, time_s = (rows[name].to_numpy() for name in ("x_m", "y_m", "time_s"))
    robot, sample = (rows[name].to_numpy().astype(np.int64) for name in ("robot", "sample"))
    samples = Samples(place_of(floor), floor.tiles.ravel(), x_m, y_m, time_s, robot, sample, seed=1, run=0)
    readings = accelerations(samples, scenario.sensor.params)
    count = readings.shape[2]  # (samples, axes, count)
    before_s = np.arange(count - 1, -1, -1) / scenario.sensor.params.rate_hz
    of_samples = {"robot": robot, "x_m": x_m, "y_m": y_m}
    columns = {name: np.repeat(values, count) for name, values in of_samples.items()}
    columns |= dict(zip(("ax", "ay", "az"), readings.transpose(1, 0, 2).reshape(3, -1), strict=True))
    columns["time_s"] = (time_s[:, None] - before_s).ravel()
    order = ("robot", "time_s", "ax", "ay", "az", "x_m", "y_m")
    frame = pl.DataFrame(columns).select(order).sort("robot", "time_s")
    digits = {"time_s": 4, "ax": 2, "ay": 2, "az": 2, "x_m": 3, "y_m": 3}
    frame.with_columns(pl.col(name).round(count) for name, count in digits.items()).write_csv(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "file",
        type=Path,
        nargs="?",
        default=Path(__file__).with_name("acceleration.csv"),
        help="default: acceleration.csv here",
    )
    make(parser.parse_args().file)
