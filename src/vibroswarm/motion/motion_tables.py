"""Tables of motion and their columns; ``source`` describes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from vibroswarm.core.fork_guard import check_threads

MOTION: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "stop_start_s": pl.Float64,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "drive_s": pl.Float32,
    "turn_s": pl.Float32,
    "avoid_s": pl.Float32,
    "stop_s": pl.Float32,
}
SEGMENTS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "start_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "speed_m_s": pl.Float64,
    "turn_rate_rad_s": pl.Float64,
    "kind": pl.Enum(["drive", "turn", "avoid", "stop"]),
}
MOVES: Final[dict[str, Any]] = {**SEGMENTS, "turned_rad": pl.Float64, "ray_m": pl.Float64}
ENDS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "end_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
    "heading_rad": pl.Float64,
    "stop_start_s": pl.Float64,
}


@dataclass(frozen=True)
class Motion:
    """The tables of a source, see ``source``."""

    samples: pl.DataFrame
    ends: pl.DataFrame
    segments: pl.DataFrame | None = None
    moves: pl.DataFrame | None = None


def join(pieces: Sequence[Motion]) -> Motion:
    """Join pieces of motion, in the order of runs and of time within a run.

    The ends of a run, and the data of a move that several pieces contain, are those of the last piece.
    """
    check_threads()
    ends = pl.concat([piece.ends for piece in pieces])
    ends = ends.group_by("run", "robot", maintain_order=True).last()
    segments = [piece.segments for piece in pieces if piece.segments is not None]
    return Motion(
        pl.concat([piece.samples for piece in pieces]),
        ends.select(list(ENDS)),
        pl.concat(segments) if segments else None,
        _join_moves([piece.moves for piece in pieces if piece.moves is not None]),
    )


def _join_moves(pieces: Sequence[pl.DataFrame]) -> pl.DataFrame | None:
    if len(pieces) < 2:
        return pieces[0] if pieces else None
    latest = pl.concat(pieces).unique(["run", "robot", "start_s"], keep="last")
    return latest.sort("run", "start_s", "robot")
