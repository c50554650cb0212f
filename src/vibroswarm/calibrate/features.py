"""The paper's six features of how a swarm samples, and their histograms as its authors made them.

| feature | values | histogram |
|---|---|---|
| avoidance | time spent avoiding since the last sample, s, zeros dropped (the paper's "state times") | 79 bins, [0, 8] s |
| vibrating | energy E on vibrating tiles, only E < 5 | 59 bins on [0, 6] |
| still | energy E on still tiles, only E < 3 | 59 bins on [0, 6] |
| places | x, y of samples | 15 x 15 bins over the data's own range |
| distances | time of a sample, its distance from the previous sample; zero distances dropped | 24 x 24 on [0, 1200] s, [0.05, 0.2] m |
| steps | dx, dy from the previous sample | 39 x 39 on [-0.2, 0.2] m |

The tile of a sample is column floor(x / width), row (rows - 1 - floor(y / height)), clipped to the floor, so that places on
the walls count. A robot's first sample has no step. If rows of a recording are lost, the step leads from the last row
before the gap to the first row after it, as in the authors' analysis. A session is one run.
"""  # noqa: E501

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError, check_choice
from vibroswarm.floors.floor import Floor, refuse_kinds
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

FEATURES: Final = ("avoidance", "vibrating", "still", "places", "distances", "steps")
"""Names of the six features, see the table above."""
WORDS: Final = {
    "avoidance": "avoidance time per sample",
    "vibrating": "energy on vibrating tiles",
    "still": "energy on still tiles",
    "places": "places of samples",
    "distances": "distance over time",
    "steps": "distance and angle",
}
"""The features in words, for titles."""


BELOW: Final = {"vibrating": 5.0, "still": 3.0}
"""Upper limits of the energies on vibrating and on still tiles that the authors used; larger ones are dropped."""
_EDGES: Final = {
    "avoidance": [np.linspace(0.0, 8.0, 80)],
    "vibrating": [np.linspace(0.0, 6.0, 60)],
    "still": [np.linspace(0.0, 6.0, 60)],
    "distances": [np.linspace(0.0, 1200.0, 25), np.linspace(0.05, 0.2, 25)],
    "steps": [np.linspace(-0.2, 0.2, 40)] * 2,
}
"""Edges of the authors' bins; those of places depend on the data."""
PLACE_BINS: Final = 15
"""Bins of the histogram of places along x, and along y."""
AUTHORS_SHORT_S: Final = 0.536
"""Where the 16-bit counter of avoidance (ms) wrapped, the authors added 65 s instead of 65.536 s: this much less."""


def sample_table(result: Result) -> pl.DataFrame:
    """Return one row per sample, ordered by run, robot and time.

    Columns of the sample: run, robot, sample, time_s, x_m, y_m, wall_m (distance from the nearest wall), energy, and
    vibrating (whether the tile below vibrates). Columns of the interval since the robot's previous sample, null at its
    first sample: dx_m, dy_m, distance_m, spacing_s (the time between the two samples) and avoid_s (time spent avoiding;
    also null if a recording does not log it). Column wraps: how often the robot's 16-bit counter of avoidance time
    started again from 0 since the previous sample.

    Raises:
        InputError: the result has no energies, or a floor has more than two kinds of tile.
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
        refuse_kinds(floor)
        x, y = (frame[name].to_numpy()[of_run] for name in ("x_m", "y_m"))
        vibrating[of_run] = floor.tiles[nearest_tile(floor, x, y)] == 1
    wall = wall_distance(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), result.scenario.arena.size_m)
    frame = frame.with_columns(wall_m=pl.Series(wall), vibrating=pl.Series(vibrating))
    frame = frame.sort("run", "robot", "time_s")

    def since(name: str) -> pl.Expr:
        """Return the change of a column since the robot's previous sample."""
        return pl.col(name).diff().over("run", "robot")

    frame = frame.with_columns(
        dx_m=since("x_m"),
        dy_m=since("y_m"),
        spacing_s=since("time_s"),
        # In the table of motion, avoid_s is the time since the previous sample already. At a robot's first sample it is
        # the time since the start of the run, so it is replaced by null there.
        avoid_s=pl.when(since("time_s").is_not_null()).then(pl.col("avoid_s").cast(pl.Float64)),
    )
    frame = frame.with_columns(distance_m=(pl.col("dx_m") ** 2 + pl.col("dy_m") ** 2).sqrt())
    return frame.with_columns(wraps=_wraps(result, frame))


def _wraps(result: Result, frame: pl.DataFrame) -> pl.Series:
    """Return how often the robot's counter of avoidance wrapped since its previous sample, for each row of ``frame``.

    The counter wraps when it starts again from 0. The number is 0 at a robot's first sample, in simulations, and if the
    recording does not state the value at which the counter wraps.
    """
    none = pl.Series("wraps", np.zeros(frame.height, dtype=np.int64))
    if not isinstance(result, Recording):
        return none
    # Seconds, by run; None: not stated. A recording has one session per run, and its runs have the numbers 0, 1, 2, ...
    wraps_at = {
        run: session.get("wraps_at", {}).get("avoid_total_s") for run, session in enumerate(result.sessions)
    }
    key = ["run", "robot", "sample"]
    totals = frame.join(result.rows.select(*key, "avoid_total_s"), on=key, how="left", maintain_order="left")
    wraps = totals.select(
        # ``avoid_total_s`` of a recording grows on where the robot's counter wrapped, so total / (value at which it
        # wraps), rounded down, counts the wraps since the start. 1e-9 makes up for rounding errors where the total is a
        # multiple of this value.
        (pl.col("avoid_total_s") / pl.col("run").replace_strict(wraps_at, return_dtype=pl.Float64) + 1e-9)
        .floor()
        .diff()
        .over("run", "robot")
        .fill_null(0.0)
        .cast(pl.Int64)
        .alias("wraps")
    )
    return wraps.to_series()


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


def values_of(samples: pl.DataFrame, feature: str, *, as_published: bool = False) -> Floats:
    """Return the values of one feature: (n, 1), or (n, 2) for places, distances and steps.

    Energies beyond the limits that the authors used are dropped, and so are avoidance times and distances of 0.

    Args:
        samples: ``sample_table``.
        feature: one of ``FEATURES``.
        as_published: whether avoidance times are those of the authors, who added 65 s instead of 65.536 s where a
            robot's 16-bit counter wrapped.
    Raises:
        InputError: no such feature.
    """
    check_choice(feature, "feature", FEATURES)
    energy, vibrating = samples["energy"].to_numpy(), samples["vibrating"].to_numpy()
    if feature == "vibrating":
        return np.asarray(energy[vibrating & (energy < BELOW["vibrating"])][:, None])
    if feature == "still":
        return np.asarray(energy[~vibrating & (energy < BELOW["still"])][:, None])
    if feature == "places":
        return samples.select("x_m", "y_m").to_numpy()
    stepped = samples.filter(pl.col("dx_m").is_not_null())
    if feature == "distances":
        moved = stepped.filter(pl.col("distance_m") > 0)
        return moved.select("time_s", "distance_m").to_numpy()
    if feature == "steps":
        return stepped.select("dx_m", "dy_m").to_numpy()
    avoided = stepped.filter(pl.col("avoid_s") > 1e-9)
    missing_s = AUTHORS_SHORT_S * pl.col("wraps") if as_published else 0.0
    return avoided.select(pl.col("avoid_s") - missing_s).to_numpy()


def histogram(values: Floats, feature: str) -> Floats:
    """Return the authors' histogram of these values: counts, (bins,), flattened if there are two columns.

    A bin includes its lower edge, and the last bin its upper edge too. Values outside the range are not counted.

    Args:
        values: (n, 1) or (n, 2), as ``values_of`` returns them.
    Raises:
        InputError: no such feature.
    """
    check_choice(feature, "feature", FEATURES)
    # Only the feature "places" is not in ``_EDGES``: its edges depend on the values.
    edges = _EDGES.get(feature) or [np.histogram_bin_edges(values[:, axis], PLACE_BINS) for axis in (0, 1)]
    return np.histogramdd(values, bins=edges)[0].ravel()


def shapeless(feature: str, u: Floats) -> Floats:
    """Return values of a feature without any structure, uniform over its range.

    Their similarity to real values is the null, which a simulation without structure would reach
    (``similarity.null_similarity``). The range of energies ends at the limit that the authors used; the other ranges
    are those of the authors' histograms. For places, whose histogram covers the range of its own data, any rectangle
    gives the same histogram. The shape is (n, 1) or (n, 2), as that of ``values_of``.

    Args:
        u: uniform numbers in (0, 1), (n, 2); the second column is not used for a feature with one column.
    """
    spans: dict[str, tuple[tuple[float, float], ...]] = {
        "vibrating": ((0.0, BELOW["vibrating"]),),
        "still": ((0.0, BELOW["still"]),),
        "avoidance": ((0.0, 8.0),),
        "places": ((0.0, 1.0), (0.0, 1.0)),
        "distances": ((0.0, 1200.0), (0.05, 0.2)),
        "steps": ((-0.2, 0.2), (-0.2, 0.2)),
    }
    return np.stack([low + (high - low) * u[:, k] for k, (low, high) in enumerate(spans[feature])], axis=1)


@dataclass(frozen=True, eq=False)
class Sessions:
    """Samples of several sessions (runs), and their features."""

    samples: tuple[pl.DataFrame, ...]
    """Samples of each session (``sample_table``)."""

    def values(self, feature: str, *, as_published: bool = False) -> list[Floats]:
        """Return the values of a feature, session by session."""
        return [values_of(samples, feature, as_published=as_published) for samples in self.samples]


def sessions_of(result: Result) -> Sessions:
    """Return the samples of each run of a result as a session, in the order of runs."""
    table = sample_table(result)
    return Sessions(tuple(table.partition_by("run", maintain_order=True)))


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
