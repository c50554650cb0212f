"""The paper's six features of how a swarm samples, and their histograms as its authors made them.

| feature | values | histogram |
|---|---|---|
| avoidance | time spent avoiding since the last sample, s, zeros dropped (the paper's "state times") | 79 bins, [0, 8] s |
| vibrating, still | energy on tiles of each kind | 59 bins on [0, 6], of E < 5 and of E < 3 |
| places | x, y of samples | 15 x 15 bins over the data's own range |
| distances | time of the later sample, distance to the one before, zeros dropped | 24 x 24 on [0, 1200] s, [0.05, 0.2] m |
| steps | dx, dy from the sample before | 39 x 39 on [-0.2, 0.2] m |

The tile of a sample is column floor(x / width), row (rows - 1 - floor(y / height)), clipped to the floor, so that places on
the walls count. A robot's first sample has no step. Steps over a lost row are taken as they are, as the authors did.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

FEATURES: Final = ("avoidance", "vibrating", "still", "places", "distances", "steps")
WORDS: Final = {
    "avoidance": "avoidance time per sample",
    "vibrating": "energy on vibrating tiles",
    "still": "energy on still tiles",
    "places": "places of samples",
    "distances": "distance over time",
    "steps": "distance and angle",
}

Floats = NDArray[np.float64]

VIBRATING_BELOW: Final = 5.0
STILL_BELOW: Final = 3.0
_EDGES: Final = {
    "avoidance": [np.linspace(0.0, 8.0, 80)],
    "vibrating": [np.linspace(0.0, 6.0, 60)],
    "still": [np.linspace(0.0, 6.0, 60)],
    "distances": [np.linspace(0.0, 1200.0, 25), np.linspace(0.05, 0.2, 25)],
    "steps": [np.linspace(-0.2, 0.2, 40)] * 2,
}
"""Edges of the authors' bins; those of places depend on the data."""
PLACE_BINS: Final = 15
AUTHORS_SHORT_S: Final = 0.536
"""The authors add 65 s for a wrap of 65.536 s."""


def sample_table(result: Result) -> pl.DataFrame:
    """Return one row per sample, by run, robot and time.

    Columns: run, robot, sample, time_s, x_m, y_m, energy, vibrating; since the robot's sample before dx_m, dy_m,
    distance_m, spacing_s, avoid_s (null at its first); wraps, of the counter of avoidance.

    Raises:
        InputError: no energies.
    """
    key = ["run", "robot", "sample"]
    energies = result.rows if isinstance(result, Recording) else result.observations
    frame = result.motion.select(*key, "time_s", "x_m", "y_m", "avoid_s").join(
        energies.select(*key, pl.col("energy").cast(pl.Float64)), on=key, how="left", maintain_order="left"
    )
    if frame["energy"].null_count():
        raise InputError("has no energies; simulate with energies", field="result")
    vibrating = np.empty(frame.height, dtype=np.bool_)
    run = frame["run"].to_numpy()
    for number in np.unique(run):
        of_run, floor = run == number, result.floor(int(number))
        x, y = (frame[name].to_numpy()[of_run] for name in ("x_m", "y_m"))
        vibrating[of_run] = floor.tiles[nearest_tile(floor, x, y)] == 1
    frame = frame.with_columns(vibrating=pl.Series(vibrating)).sort("run", "robot", "time_s")

    def since(name: str) -> pl.Expr:
        return pl.col(name).diff().over("run", "robot")

    frame = frame.with_columns(
        dx_m=since("x_m"),
        dy_m=since("y_m"),
        spacing_s=since("time_s"),
        avoid_s=pl.when(since("time_s").is_not_null()).then(pl.col("avoid_s").cast(pl.Float64)),
    )
    frame = frame.with_columns(distance_m=(pl.col("dx_m") ** 2 + pl.col("dy_m") ** 2).sqrt())
    return frame.with_columns(wraps=_wraps(result, frame))


def _wraps(result: Result, frame: pl.DataFrame) -> pl.Series:
    """Return how often the avoidance counter wrapped since the robot's previous sample; 0 at the first."""
    none = pl.Series("wraps", np.zeros(frame.height, dtype=np.int64))
    if not isinstance(result, Recording):
        return none
    wraps_at = {
        run: session.get("wraps_at", {}).get("avoid_total_s") for run, session in enumerate(result.sessions)
    }
    key = ["run", "robot", "sample"]
    totals = frame.join(result.rows.select(*key, "avoid_total_s"), on=key, how="left", maintain_order="left")
    wraps = totals.select(
        (pl.col("avoid_total_s") / pl.col("run").replace_strict(wraps_at, return_dtype=pl.Float64) + 1e-9)
        .floor()
        .diff()
        .over("run", "robot")
        .fill_null(0.0)
        .cast(pl.Int64)
        .alias("wraps")
    )
    return wraps.to_series()


def nearest_tile(floor: Floor, x_m: Floats, y_m: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the row and column of the tile below each place; beyond the floor's rim, of the nearest one, as the
    authors count."""
    rows, columns, width, height, left, bottom = floor.geometry
    column = np.clip(np.floor((x_m - left) / width), 0, columns - 1).astype(np.int64)
    return rows - 1 - np.clip(np.floor((y_m - bottom) / height), 0, rows - 1).astype(np.int64), column


def values_of(samples: pl.DataFrame, feature: str, *, as_published: bool = False) -> Floats:
    """Return the values of one feature, (n, 1) or (n, 2), within the range the authors used.

    Args:
        samples: of ``sample_table``.
        as_published: where a robot's 16-bit counter wrapped, add 65.0 s as the authors did, not 65.536 s.
    """
    energy, vibrating = samples["energy"].to_numpy(), samples["vibrating"].to_numpy()
    if feature == "vibrating":
        return np.asarray(energy[vibrating & (energy < VIBRATING_BELOW)][:, None])
    if feature == "still":
        return np.asarray(energy[~vibrating & (energy < STILL_BELOW)][:, None])
    if feature == "places":
        return samples.select("x_m", "y_m").to_numpy()
    stepped = samples.filter(pl.col("dx_m").is_not_null())
    if feature == "distances":
        moved = stepped.filter(pl.col("distance_m") > 0)
        return moved.select("time_s", "distance_m").to_numpy()
    if feature == "steps":
        return stepped.select("dx_m", "dy_m").to_numpy()
    if feature == "avoidance":
        avoided = stepped.filter(pl.col("avoid_s") > 1e-9)
        short = AUTHORS_SHORT_S * pl.col("wraps") if as_published else 0.0
        return avoided.select(pl.col("avoid_s") - short).to_numpy()
    raise InputError(f"there is no feature '{feature}' (there are {', '.join(FEATURES)})", field="feature")


def histogram(values: Floats, feature: str) -> Floats:
    """Return the authors' histogram of these values, flattened; a bin includes its lower edge, the last one both."""
    edges = _EDGES.get(feature) or [np.histogram_bin_edges(values[:, axis], PLACE_BINS) for axis in (0, 1)]
    place, bins = np.zeros(len(values), dtype=np.int64), 1
    inside = np.ones(len(values), dtype=np.bool_)
    for axis, own in enumerate(edges):
        column = values[:, axis]
        inside &= (column >= own[0]) & (column <= own[-1])
        place = place * (own.size - 1) + _bin_of(column, own)
        bins *= own.size - 1
    return np.bincount(place[inside], minlength=bins).astype(np.float64)


def _bin_of(values: Floats, edges: Floats) -> NDArray[np.int64]:
    """Return the bin of each value between evenly spaced edges; values outside go to the first or last bin."""
    last = edges.size - 2
    fraction = (values - edges[0]) * ((last + 1) / (edges[-1] - edges[0]))
    index: NDArray[np.int64] = np.clip(fraction, 0, last).astype(np.int64)
    index -= (values < edges[index]) & (index > 0)  # rounding may shift a value by one bin
    index += (values >= edges[index + 1]) & (index < last)
    return index


def shapeless(feature: str, u: Floats) -> Floats:
    """Return the values without structure: uniform over the histogram's range; ``u``: (n, 2) in (0, 1)."""
    spans: dict[str, tuple[tuple[float, float], ...]] = {
        "vibrating": ((0.0, VIBRATING_BELOW),),
        "still": ((0.0, STILL_BELOW),),
        "avoidance": ((0.0, 8.0),),
        "places": ((0.0, 1.0), (0.0, 1.0)),
        "distances": ((0.0, 1200.0), (0.05, 0.2)),
        "steps": ((-0.2, 0.2), (-0.2, 0.2)),
    }
    return np.stack([low + (high - low) * u[:, k] for k, (low, high) in enumerate(spans[feature])], axis=1)


@dataclass(frozen=True, eq=False)
class Sessions(NotebookView):
    """Samples of several sessions (runs), and their features."""

    samples: tuple[pl.DataFrame, ...]

    def values(self, feature: str, *, as_published: bool = False) -> list[Floats]:
        """Return the values of a feature, session by session."""
        return [values_of(samples, feature, as_published=as_published) for samples in self.samples]


def sessions_of(result: Result) -> Sessions:
    """Return each run of a result as a session."""
    table = sample_table(result)
    return Sessions(tuple(table.partition_by("run", maintain_order=True)))
