"""One row per sample of a result, with what happened since the robot's previous sample.

A robot's first sample has no previous one. If rows of a recording are lost, the step leads from the last row before
the gap to the first row after it, as in the analysis of the study's authors. A session is one run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, refuse_kinds
from vibroswarm.lab.recordings.recording import Recording
from vibroswarm.result import Result

ROUNDING_S = 1e-9
"""Times of avoidance up to this are none: in recordings they are differences of logged totals."""


def sample_table(result: Result) -> pl.DataFrame:
    """Return one row per sample, ordered by run, robot and time.

    Columns of the sample: run, robot, sample, time_s, stop_start_s, x_m, y_m, wall_m (distance from the nearest wall),
    energy, and vibrating (whether the tile below vibrates). Columns of the interval since the robot's previous sample,
    null at its first sample: dx_m, dy_m, distance_m, spacing_s (the time between the two samples) and avoid_s (time
    spent avoiding; also null if a recording does not log it).

    Raises:
        InputError: the result has no energies, or a floor has more than two kinds of tile.
    """
    key = ["run", "robot", "sample"]
    energies = result.rows if isinstance(result, Recording) else result.observations
    frame = result.motion.select(*key, "time_s", "stop_start_s", "x_m", "y_m", "avoid_s").join(
        energies.select(*key, pl.col("energy").cast(pl.Float64)), on=key, how="left", maintain_order="left"
    )
    if frame["energy"].null_count():
        raise InputError("has no energies; simulate with energies", field="result")
    vibrating = np.empty(frame.height, dtype=np.bool_)
    run = frame["run"].to_numpy()
    for number in np.unique(run):
        of_run, floor = run == number, result.floor(int(number))
        refuse_kinds(floor)
        x, y = (frame[name].to_numpy()[of_run] for name in ("x_m", "y_m"))
        vibrating[of_run] = floor.tiles[nearest_tile(floor, x, y)] == 1
    wall = wall_distance(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), result.scenario.arena.size_m)
    frame = frame.with_columns(wall_m=pl.Series(wall), vibrating=pl.Series(vibrating))
    since = {"dx_m": "x_m", "dy_m": "y_m", "spacing_s": "time_s"}
    frame = frame.sort("run", "robot", "time_s").with_columns(
        pl.col(name).diff().over("run", "robot").alias(new) for new, name in since.items()
    )
    return frame.with_columns(
        # At a robot's first sample the table of motion has the time since the start of the run.
        avoid_s=pl.when(pl.col("spacing_s").is_not_null()).then(pl.col("avoid_s").cast(pl.Float64)),
        distance_m=(pl.col("dx_m") ** 2 + pl.col("dy_m") ** 2).sqrt(),
    )


def as_published(result: Result) -> pl.DataFrame:
    """Return samples with times of avoidance as the study's authors computed them from the logs of their robots.

    Where a robot's 16-bit counter (ms) started again from 0, they added 65 s for 65.536 s.
    """
    samples = sample_table(result)
    if not isinstance(result, Recording):
        return samples
    key = ["run", "robot", "sample"]
    counted = result.rows.select(*key, wraps=(pl.col("avoid_total_s") / 65.536 + 1e-9).floor())
    theirs = [run for run, session in enumerate(result.sessions) if session["reader"] == "rugbot"]
    wraps = pl.col("wraps").diff().over("run", "robot").fill_null(0.0) * pl.col("run").is_in(theirs)
    joined = samples.join(counted, on=key, how="left", maintain_order="left")
    return joined.with_columns(pl.col("avoid_s") - 0.536 * wraps)


def by_session(result: Result) -> list[pl.DataFrame]:
    """Return the samples of each run of a result, in the order of runs."""
    return sample_table(result).partition_by("run", maintain_order=True)


def wall_distance(x_m: Floats, y_m: Floats, arena_m: tuple[float, float]) -> Floats:
    """Return the distance of places from the nearest wall, m, in the shape of ``x_m`` and ``y_m``."""
    return np.minimum(np.minimum(x_m, arena_m[0] - x_m), np.minimum(y_m, arena_m[1] - y_m))


def nearest_tile(floor: Floor, x_m: Floats, y_m: Floats) -> tuple[Ints, Ints]:
    """Return the rows and the columns of the tiles below some places, in the shape of ``x_m`` and ``y_m``.

    A place beyond the floor's rim counts as on the nearest tile, as in the authors' analysis. Row 0 is the top row.
    """
    rows, columns, width, height, left, bottom = floor.geometry
    column = np.clip(np.floor((x_m - left) / width), 0, columns - 1).astype(np.int64)
    return rows - 1 - np.clip(np.floor((y_m - bottom) / height), 0, rows - 1).astype(np.int64), column


def lag_one(values: Any, robot: Any = None) -> float | None:
    """Return the correlation of successive values of a robot, about the mean of all values.

    Args:
        values: of each sample, (samples,). robot: its robot, (samples,), robot by robot in the order of time; None: all
            are of one robot.
    Returns: None if all values are equal, or if no robot has two samples.
    """
    deviation = values - values.mean()
    variance = float((deviation**2).mean())
    products = deviation[1:] * deviation[:-1]
    if robot is not None:
        products = products[robot[1:] == robot[:-1]]
    return float(products.mean()) / variance if variance > 0 and products.size else None
