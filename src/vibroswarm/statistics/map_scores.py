"""How good a map is, where the truth is known.

| name | equation |
|---|---|
| Brier score | mean over tiles of (p_t - x_t)^2; 1/4 of a map that knows nothing |
| log score | mean of -ln of the probability given to what is true, at least 1e-12 |
| AUC | probability that a vibrating tile has a larger p_t than a still one; ties count half |
| right | share of tiles with p_t above 1/2 where they vibrate, below where they do not |
| surely wrong | tiles with more than 95 % for what is not true |
| calibration | of tiles with p_t in a bin: their mean p_t, and the share that vibrates |
| location error | distance between the centres of gravity of the map and of what vibrates |
"""

from __future__ import annotations

from typing import Final

import numpy as np
import polars as pl

from vibroswarm.floors.floor import Floor
from vibroswarm.statistics.intervals import Values, wilson_limits

BINS: Final = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)
"""Edges of the bins of calibration."""
SURE: Final = 0.95


def map_scores(p: Values, floor: Floor) -> dict[str, float]:
    """Return the scores of one map by name.

    Args:
        p: probability of each tile, (tiles,).
    """
    x = floor.tiles.ravel().astype(np.float64)
    told = np.where(x == 1, p, 1.0 - p)
    return {
        "brier": float(np.mean((p - x) ** 2)),
        "log_score": float(-np.log(np.maximum(told, 1e-12)).mean()),
        "auc": _auc(p, x),
        "right": float(np.mean(told > 0.5)),
        "surely_wrong": float((told < 1.0 - SURE).sum()),
        "location_error_m": _location_error_m(p, x, floor),
    }


def _auc(p: Values, x: Values) -> float:
    """Return the area under the curve of hits against false calls; nan if all tiles are alike or one p is nan."""
    vibrating, still = int((x == 1).sum()), int((x == 0).sum())
    if not vibrating or not still or np.isnan(p).any():
        return float("nan")
    # Mann and Whitney: ranks of the vibrating tiles, ties at their mean rank, less those among themselves.
    ranks = pl.Series(p).rank().to_numpy()
    return float((ranks[x == 1].sum() - 0.5 * vibrating * (vibrating + 1)) / (vibrating * still))


def _location_error_m(p: Values, x: Values, floor: Floor) -> float:
    """Return the distance between the centres of gravity of map and truth; nan if nothing vibrates."""
    rows, columns, width_m, height_m, _, _ = floor.geometry
    row, column = (index.ravel() for index in np.indices((int(rows), int(columns))))
    if not x.any() or not p.any():
        return float("nan")
    (x0, y0), (x1, y1) = ((np.average(column, weights=w), np.average(row, weights=w)) for w in (p, x))
    return float(np.hypot((x0 - x1) * width_m, (y0 - y1) * height_m))


def calibration(p: Values, x: Values) -> pl.DataFrame:
    """Return a row for each bin of probability: tiles, mean probability, share that vibrates with Wilson's limits.

    The limits are those of independent tiles, which tiles of one map, or of several maps of one floor, are not.

    Args:
        p, x: probability and truth of tiles, of one map or many, (tiles,) each.
    """
    bin_of = np.clip(np.searchsorted(BINS, p, side="right") - 1, 0, len(BINS) - 2)
    rows = []
    for k in range(len(BINS) - 1):
        own = bin_of == k
        if own.any():
            low, high = wilson_limits(x[own].sum(), own.sum())
            rows.append(
                (BINS[k], BINS[k + 1], int(own.sum()), p[own].mean(), x[own].mean(), float(low), float(high))
            )
    names = ("from", "to", "tiles", "probability", "vibrating", "vibrating_low", "vibrating_high")
    return pl.DataFrame(
        rows,
        schema=dict(zip(names, (pl.Float64, pl.Float64, pl.Int64, *[pl.Float64] * 4), strict=True)),
        orient="row",
    )
