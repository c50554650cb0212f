"""Bootstrap resamples from addressed random numbers: the same for the same seed, draw and stream."""

from __future__ import annotations

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.rng import Purpose, uniforms


def resample(seed: int, draw: int, stream: int, count: int) -> NDArray[np.int64]:
    """Draw ``count`` of the indices below ``count`` with replacement."""
    return (uniforms(seed, draw, stream, Purpose.BOOTSTRAP, count) * count).astype(np.int64)


def cluster_weights(seed: int, draw: int, stream: int, cluster: NDArray[np.int64]) -> NDArray[np.float64]:
    """Draw clusters with replacement: how often each row's cluster is drawn, (rows,)."""
    clusters = int(cluster.max()) + 1
    return np.bincount(resample(seed, draw, stream, clusters), minlength=clusters)[cluster].astype(float)


def robot_clusters(samples: pl.DataFrame) -> NDArray[np.int64]:
    """Number the robots of all sessions through: the cluster of each sample, (samples,)."""
    pairs = samples.select(pl.col("run", "robot").cast(pl.Int64)).to_numpy()
    return np.unique(pairs, axis=0, return_inverse=True)[1].ravel()
