"""Make the files of this folder: ``python examples/inspection/make.py``. They are simulated, and stand for yours.

``plate.csv``: places and values of five robots on a plate of 1 m x 1 m, of which 2 of 25 tiles of 20 cm vibrate
(``floor.txt``). ``reference.csv``: values measured where it is known whether it vibrates.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl

from vibroswarm.observation.energy_model import energy_of
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

TILES = ("00000", "00010", "00000", "01000", "00000")


def make(folder: Path) -> None:
    """Write all files into a folder."""
    scenario = preset("optimised-places").with_values(
        {
            "floor.tiles": TILES,
            "floor.source": "floor.txt",
            "run.t_end_s": 600.0,
            "localisation.method": "true",
        }
    )
    result = simulate(scenario, seed=4)
    samples = result.motion.join(result.observations, on=["run", "robot", "sample"])
    plate = samples.select(
        "robot",
        time_s=pl.col("time_s").round(1),
        x_mm=(1000 * pl.col("x_m")).round(0).cast(pl.Int64),
        y_mm=(1000 * pl.col("y_m")).round(0).cast(pl.Int64),
        value=pl.col("energy").cast(pl.Float64).round(3),
    )
    plate.write_csv(folder / "plate.csv")
    random = np.random.default_rng(1)
    kinds = {"still": False, "vibrating": True}
    reference = pl.concat(
        [
            pl.DataFrame(
                {"kind": word, "energy": energy_of(scenario.sensor, kind, random.random(400)).round(3)}
            )
            for word, kind in kinds.items()
        ]
    )
    reference.write_csv(folder / "reference.csv")
    (folder / "floor.txt").write_text("\n".join(TILES) + "\n", encoding="utf-8")


if __name__ == "__main__":
    make(Path(__file__).parent)
