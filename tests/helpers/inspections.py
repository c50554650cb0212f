"""Samples of inspections that tests draw by themselves."""

from __future__ import annotations

import itertools

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.floors.floor import Floor
from vibroswarm.inspection.samples import SAMPLES, Law, Places, Samples
from vibroswarm.scenario.fields import Sensor


def drawn_samples(seed: int, *, count: int, spread_m: float, tile_m: float = 0.2, rows: int = 3) -> Samples:
    """Samples at random places of a random floor, seen with errors, that tell still from vibrating by 1 nat or so."""
    random = np.random.default_rng(seed)
    floor = Floor((random.random((rows, rows)) < 0.5).astype(np.uint8), tile_m, tile_m)
    size_m = rows * tile_m
    at_m = random.random((2, count)) * size_m
    vibrates = floor.tiles.ravel()[floor.tile_at(*at_m)] == 1
    seen_m = np.clip(at_m + spread_m * random.normal(size=at_m.shape), 0.0, size_m - 1e-9)
    frame = pl.DataFrame(
        {
            "robot": np.arange(count) % 5,
            "time_s": np.arange(count, dtype=np.float64),
            "x_m": seen_m[0],
            "y_m": seen_m[1],
            "spread_x_m": np.full(count, spread_m),
            "spread_y_m": np.full(count, spread_m),
            "true_x_m": at_m[0],
            "true_y_m": at_m[1],
            "value": np.ones(count),
            # normal with means +-1 and variance 2: the log ratio of its own density
            "log_ratio": np.where(vibrates, 1.0, -1.0) + np.sqrt(2.0) * random.normal(size=count),
        }
    ).cast(dict(SAMPLES))
    return Samples(frame, (size_m, size_m), Law(Sensor(), "drawn"), Places.FILE, "drawn", floor, True)


def enumerated(samples: Samples) -> NDArray[np.float64]:
    """The probability of each tile, from the likelihoods of all floors."""
    assert samples.floor is not None
    rows, columns, width_m, height_m, left_m, bottom_m = samples.floor.geometry
    x_m, y_m = samples.column("x_m")[:, None], samples.column("y_m")[:, None]
    spread_m = np.maximum(samples.column("spread_x_m"), 1e-12)[:, None]
    across = np.diff(ndtr((left_m + width_m * np.arange(columns + 1) - x_m) / spread_m))
    up = np.diff(ndtr((bottom_m + height_m * np.arange(rows + 1) - y_m) / spread_m))[:, ::-1]  # from the top
    share = (up[:, :, None] * across[:, None, :]).reshape(x_m.size, -1)
    share /= share.sum(axis=1, keepdims=True)
    floors = np.array(list(itertools.product([0, 1], repeat=share.shape[1])))
    more = np.exp(samples.column("log_ratio")) - 1.0
    logs = np.array([np.log1p(more * (share @ floor)).sum() for floor in floors])
    weight = np.exp(logs - logs.max())
    return weight / weight.sum() @ floors
