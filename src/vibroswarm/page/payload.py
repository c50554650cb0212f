"""What the page is given: a run's numbers as a dict that JSON can hold, exactly those of the tables."""

from __future__ import annotations

from typing import Any

import numpy as np
import polars as pl
from scipy.special import betainc

from vibroswarm.page.packing import (
    HEADING_QUANTUM_RAD,
    POSITION_QUANTUM_M,
    TIME_QUANTUM_S,
    packed_column,
    packed_track,
)
from vibroswarm.page.poses import tracks
from vibroswarm.page.record import COLUMNS, RunRecord

FORMAT = 1
"""Version of the payload; the page's scripts read this one."""

NOT_KNOWN = 255
"""A message that a recording does not tell."""

SAMPLE_TYPES = {
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "stop_start_s": pl.Float64,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "tile": pl.Int32,
    "energy": pl.Float32,
    "observation": pl.UInt8,
    "message": pl.UInt8,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "received": pl.UInt32,
    "belief": pl.Float64,
    "decision": pl.Int8,
}
"""Columns of the samples, motion, observations and inference side by side."""


def payload(record: RunRecord) -> dict[str, Any]:
    """The run as plain dicts, lists, text and finite numbers.

    Samples are columns packed bit by bit, sorted by robot and sample (``packing.packed_column``); a missing
    energy is NaN there, a message that is not known ``NOT_KNOWN``.
    Poses are rounded and thinned (``poses``). All else is as in the record.
    """
    return {
        "format": FORMAT,
        "title": record.title,
        "strategy": record.strategy,
        "seed": None if record.seed is None else int(record.seed),
        "run": int(record.run),
        "arena": {"width_m": float(record.arena_width_m), "height_m": float(record.arena_height_m)},
        "floor": _floor(record),
        "body": _body(record),
        "time": {"tick_s": float(record.tick_s), "end_s": float(record.t_end_s)},
        "rule": _rule(record),
        "truth": {
            "fill_ratio": float(record.fill_ratio),
            "ones": float(record.fill_ratio if record.expected_ones is None else record.expected_ones),
            "decision": record.true_decision,
        },
        "outcome": {"consensus": record.consensus, "time_s": record.consensus_time_s},
        "robots": record.robots.select(COLUMNS["robots"]).sort("robot").to_dicts(),
        "samples": {name: packed_column(column) for name, column in _samples(record).items()},
        "poses": _poses(record),
        "details": [[str(name), str(text)] for name, text in record.details.items()],
    }


def _floor(record: RunRecord) -> dict[str, Any]:
    floor = record.floor
    rows, columns = floor.tiles.shape
    return {
        "name": floor.name,
        "rows": rows,
        "columns": columns,
        "tile_width_m": float(floor.tile_width_m),
        "tile_height_m": float(floor.tile_height_m),
        "left_m": float(floor.left_m),
        "bottom_m": float(floor.bottom_m),
        "tiles": "".join(map(str, floor.tiles.ravel().tolist())),
    }


def _body(record: RunRecord) -> dict[str, Any]:
    return {
        "radius_m": float(record.body_radius_m),
        "ray_forward_m": float(record.ray_forward_m),
        "ray_sides_m": [float(side) for side in record.ray_sides_m],
        "ray_angles_rad": [float(angle) for angle in record.ray_angles_rad],
        "ray_range_m": float(record.ray_range_m),
        "ray_disc_radius_m": float(record.ray_disc_radius_m),
        "avoidance_threshold_m": float(record.avoidance_threshold_m),
    }


def _rule(record: RunRecord) -> dict[str, Any]:
    prior = (record.prior_alpha, record.prior_beta)
    tested = record.decision_boundary if record.readings_boundary is None else record.readings_boundary
    return {
        "credible_threshold": float(record.credible_threshold),
        "boundary": float(record.decision_boundary),
        "tested": float(tested),
        "prior_alpha": prior[0],
        "prior_beta": prior[1],
        "prior_belief": float(betainc(*prior, tested)),
        "min_observations": int(record.min_observations),
        "gate": record.gate,
        "answers": None if record.answers is None else list(record.answers),
    }


def _samples(record: RunRecord) -> dict[str, np.ndarray[Any, Any]]:
    table = record.motion
    for other in (record.observations, record.inference):
        new = [name for name in other.columns if name not in table.columns]
        table = table.join(other.select("robot", "sample", *new), on=["robot", "sample"], how="inner")
    table = (
        table.sort("robot", "sample")
        .cast({"energy": pl.Float32})
        .with_columns(pl.col("energy").fill_null(np.nan), pl.col("message").fill_null(NOT_KNOWN))
    )
    return {name: table[name].cast(kind).to_numpy() for name, kind in SAMPLE_TYPES.items()}


def _poses(record: RunRecord) -> dict[str, Any]:
    robots, kinds = tracks(record.segments, record.t_end_s)
    return {
        "time_quantum_s": TIME_QUANTUM_S,
        "position_quantum_m": POSITION_QUANTUM_M,
        "heading_quantum_rad": HEADING_QUANTUM_RAD,
        "kinds": kinds,
        "robots": [packed_track(track) for track in robots],
    }
