"""The data of a run's page: a dict for JSON with the run's tables, columns packed in base64."""

from __future__ import annotations

from base64 import b64encode
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import betainc

from vibroswarm.run_page.record import COLUMNS, RunRecord
from vibroswarm.run_page.trajectory_thinning import Track, tracks

TIME_QUANTUM_S = 0.001
POSITION_QUANTUM_M = 0.0001
HEADING_QUANTUM_RAD = 2 * np.pi / 3600
"""Resolution of poses."""


def packed_column(values: NDArray[np.generic]) -> dict[str, str]:
    """A column: its type (little-endian, as NumPy names it) and its bytes in base64."""
    column = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return {"type": column.dtype.str.lstrip("<|"), "bytes": b64encode(column.tobytes()).decode("ascii")}


def packed_track(track: Track) -> dict[str, int | str]:
    """A track's knots: rounded differences between them, as variable-length integers in base64.

    Five integers per knot: time, x, y, heading (in quanta), kind (not a difference).
    """
    quanta = [TIME_QUANTUM_S, POSITION_QUANTUM_M, POSITION_QUANTUM_M, HEADING_QUANTUM_RAD]
    steps = np.diff(np.round(track.knots / quanta).astype(np.int64), axis=0, prepend=0)
    rows = np.column_stack([steps, track.kind])
    data = b64encode(varints(rows.ravel())).decode("ascii")
    return {"robot": track.robot, "knots": len(rows), "bytes": data}


def varints(values: NDArray[np.int64]) -> bytes:
    """Encode integers as LEB128 of their zigzag form (0, -1, 1, -2 are 0, 1, 2, 3); small ones take one byte."""
    rest = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    groups = [rest & np.uint64(127)]
    while (rest := rest >> np.uint64(7)).any():
        groups.append(rest & np.uint64(127))
    table = np.stack(groups, axis=1).astype(np.uint8)
    used = table.shape[1] - np.argmax(table[:, ::-1] != 0, axis=1)
    used[~table.any(axis=1)] = 1
    place = np.arange(table.shape[1])
    table[place < used[:, None] - 1] |= 128
    return bytes(table[place < used[:, None]].tobytes())


FORMAT = 1
"""Version of the payload, which the page's scripts check."""

UNKNOWN = 255
"""A message that a recording does not contain."""

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
    "messages_received": pl.UInt32,
    "belief_below": pl.Float64,
    "decision": pl.Int8,
}
"""Columns of the samples: those of motion, observations and inference."""


def payload(record: RunRecord) -> dict[str, Any]:
    """The run as plain dicts, lists, text and finite numbers.

    Samples are packed columns, sorted by robot and sample (``packed_column``); a missing energy is NaN, an unknown
    message ``UNKNOWN``.
    Poses are rounded and thinned (``trajectory_thinning``). All else is as in the record.
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
        .with_columns(pl.col("energy").fill_null(np.nan), pl.col("message").fill_null(UNKNOWN))
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
