"""The paper's six features of how a swarm samples, and their histograms as its authors made them.

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

from vibroswarm.core.arrays import Floats
from vibroswarm.errors import check_choice
from vibroswarm.lab.calibrate.samples import ROUNDING_S

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
PLACE_BINS: Final = 15
"""Bins of the histogram of places along x, and along y."""


def values_of(samples: pl.DataFrame, feature: str) -> Floats:
    """Return the values of one feature of ``sample_table``: (n, 1), or (n, 2) for places, distances and steps.

    Raises:
        InputError: no such feature.
    """
    check_choice(feature, "feature", FEATURES)
    if feature in ("vibrating", "still"):
        own = (pl.col("vibrating") == (feature == "vibrating")) & (pl.col("energy") < SPANS[feature][0][1])
        return samples.filter(own).select("energy").to_numpy()
    if feature == "places":
        return samples.select("x_m", "y_m").to_numpy()
    stepped = samples.drop_nulls("dx_m")
    if feature == "distances":
        return stepped.filter(pl.col("distance_m") > 0).select("time_s", "distance_m").to_numpy()
    if feature == "steps":
        return stepped.select("dx_m", "dy_m").to_numpy()
    return stepped.filter(pl.col("avoid_s") > ROUNDING_S).select("avoid_s").to_numpy()


def histogram(values: Floats, feature: str) -> Floats:
    """Return the authors' histogram of these values: counts, (bins,), flattened if there are two columns.

    A bin includes its lower edge, and the last bin its upper edge too. Values outside the range are not counted.
    """
    # Only the feature "places" is not in ``_EDGES``: its edges depend on the values.
    edges = _EDGES.get(feature) or [np.histogram_bin_edges(values[:, axis], PLACE_BINS) for axis in (0, 1)]
    return np.histogramdd(values, bins=edges)[0].ravel()


def shapeless(feature: str, u: Floats) -> Floats:
    """Return values of a feature without any structure, uniform over its range, in the shape of ``values_of``.

    Args:
        u: uniform numbers in (0, 1), (n, 2); the second column is not used for a feature with one column.
    """
    return np.stack([low + (high - low) * u[:, k] for k, (low, high) in enumerate(SPANS[feature])], axis=1)
