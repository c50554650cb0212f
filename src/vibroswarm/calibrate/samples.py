"""One row per sample of a result, with what happened since the robot's previous sample; and the paper's six features.

If rows of a recording are lost, the step leads from the last row before the gap to the first row after it, as in the
analysis of the study's authors. A session is one run. Histograms of features are those of the authors:

| feature | values | histogram |
|---|---|---|
| avoidance | time spent avoiding since the last sample, s, zeros dropped (the paper's "state times") | 79 bins, [0, 8] s |
| vibrating | energy E on vibrating tiles, only E < 5 | 59 bins on [0, 6] |
| still | energy E on still tiles, only E < 3 | 59 bins on [0, 6] |
| places | x, y of samples | 15 x 15 bins over the data's own range |
| distances | time of a sample, its distance from the previous sample; zero distances dropped | 24 x 24 on [0, 1200] s, [0.05, 0.2] m |
| steps | dx, dy from the previous sample | 39 x 39 on [-0.2, 0.2] m |
"""  # noqa: E501

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, refuse_kinds
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

ROUNDING_S: Final = 1e-9
"""Times of avoidance up to this are none: in recordings they are differences of logged totals."""
WORDS: Final = {
    "avoidance": "avoidance time per sample",
    "vibrating": "energy on vibrating tiles",
    "still": "energy on still tiles",
    "places": "places of samples",
    "distances": "distance over time",
    "steps": "distance and angle",
}
"""The features in words, for titles."""
FEATURES: Final = tuple(WORDS)
"""Names of the six features, see the table above."""
SPANS: Final[dict[str, tuple[tuple[float, float], ...]]] = {
    "avoidance": ((0.0, 8.0),),
    "vibrating": ((0.0, 5.0),),
    "still": ((0.0, 3.0),),
    "places": ((0.0, 1.0), (0.0, 1.0)),
    "distances": ((0.0, 1200.0), (0.05, 0.2)),
    "steps": ((-0.2, 0.2), (-0.2, 0.2)),
}
"""Range of each column of a feature; the authors dropped larger energies."""
_EDGES: Final = {
    "avoidance": [np.linspace(0.0, 8.0, 80)],
    "vibrating": [np.linspace(0.0, 6.0, 60)],
    "still": [np.linspace(0.0, 6.0, 60)],
    "distances": [np.linspace(0.0, 1200.0, 25), np.linspace(0.05, 0.2, 25)],
    "steps": [np.linspace(-0.2, 0.2, 40)] * 2,
}
"""Edges of the authors' bins; those of places depend on the data."""


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
    run, x, y = (frame[name].to_numpy() for name in ("run", "x_m", "y_m"))
    vibrating = np.empty(frame.height, dtype=np.bool_)
    for number in np.unique(run):
        of_run, floor = run == number, result.floor(int(number))
        refuse_kinds(floor)
        vibrating[of_run] = floor.tiles[nearest_tile(floor, x[of_run], y[of_run])] == 1
    wall = pl.Series(wall_distance(x, y, result.scenario.arena.size_m))
    frame = frame.with_columns(wall_m=wall, vibrating=pl.Series(vibrating)).sort("run", "robot", "time_s")
    return frame.with_columns(
        pl.col(name).diff().over("run", "robot").alias(since)
        for since, name in (("dx_m", "x_m"), ("dy_m", "y_m"), ("spacing_s", "time_s"))
    ).with_columns(
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
    return samples.join(counted, on=key, how="left", maintain_order="left").with_columns(
        pl.col("avoid_s") - 0.536 * wraps
    )


def by_session(result: Result) -> list[pl.DataFrame]:
    """Return the samples of each run of a result, in the order of runs."""
    return sample_table(result).partition_by("run", maintain_order=True)


def wall_distance(x_m: Floats, y_m: Floats, arena_m: tuple[float, float]) -> Floats:
    """Return the distance of places from the nearest wall, m."""
    return np.minimum(np.minimum(x_m, arena_m[0] - x_m), np.minimum(y_m, arena_m[1] - y_m))


def nearest_tile(floor: Floor, x_m: Floats, y_m: Floats) -> tuple[Ints, Ints]:
    """Return rows (0 at the top) and columns of the tiles below places; beyond the rim, of the nearest tiles."""
    rows, columns, width, height, left, bottom = floor.geometry
    column = np.clip(np.floor((x_m - left) / width), 0, columns - 1).astype(np.int64)
    return rows - 1 - np.clip(np.floor((y_m - bottom) / height), 0, rows - 1).astype(np.int64), column


def values_of(samples: pl.DataFrame, feature: str) -> Floats:
    """Return the values of one feature of ``sample_table``: (n, 1), or (n, 2) for places, distances and steps."""
    stepped, is_kind = samples.drop_nulls("dx_m"), pl.col("vibrating") == (feature == "vibrating")
    rows, columns = {
        "avoidance": (stepped.filter(pl.col("avoid_s") > ROUNDING_S), ["avoid_s"]),
        "vibrating": (samples.filter(is_kind, pl.col("energy") < 5.0), ["energy"]),
        "still": (samples.filter(is_kind, pl.col("energy") < 3.0), ["energy"]),
        "places": (samples, ["x_m", "y_m"]),
        "distances": (stepped.filter(pl.col("distance_m") > 0), ["time_s", "distance_m"]),
        "steps": (stepped, ["dx_m", "dy_m"]),
    }[feature]
    return rows.select(columns).to_numpy()


def histogram(values: Floats, feature: str) -> Floats:
    """Return the authors' histogram of these values, (bins,): counts, flattened if there are two columns."""
    edges = _EDGES.get(feature) or [np.histogram_bin_edges(values[:, axis], 15) for axis in (0, 1)]
    return np.histogramdd(values, bins=edges)[0].ravel()


def shapeless(feature: str, u: Floats) -> Floats:
    """Return values spread uniformly over a feature's range, as ``values_of``; u is uniform in (0, 1), (n, 2)."""
    return np.stack([low + (high - low) * u[:, k] for k, (low, high) in enumerate(SPANS[feature])], axis=1)
