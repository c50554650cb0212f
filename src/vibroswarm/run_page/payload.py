"""The content of a run's page: its tables and constants, as a dict for JSON with columns packed in base64.

| name | symbol | unit |
|---|---|---|
| avoidance_threshold_m | theta_c | m |
| credible_threshold | p_c | - |
| min_observations | O_c | - |
| fill_ratio | f | - |
| belief | p = P(share of ones < readings_boundary) | - |
| decision | d_f | 1 vibrating, 0 still, -1 undecided |
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass, field
from math import radians
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.special import betainc

from vibroswarm.analysis.message_log import MessageLog
from vibroswarm.errors import InputError
from vibroswarm.faults import fault_words
from vibroswarm.floors.floor import Floor
from vibroswarm.run_page.trajectory_thinning import Track, tracks
from vibroswarm.scenario.fault_fields import MOTION_FAULTS

COLUMNS = {
    "motion": ("robot", "sample", "stop_start_s", "time_s", "x_m", "y_m", "heading_rad"),
    "segments": ("robot", "start_s", "x_m", "y_m", "heading_rad", "speed_m_s", "turn_rate_rad_s", "kind"),
    "observations": ("robot", "sample", "tile", "energy", "observation"),
    "inference": (
        "robot",
        "sample",
        "message",
        "alpha",
        "beta",
        "messages_received",
        "belief_below",
        "decision",
    ),
    "robots": (
        "robot",
        "decision",
        "decision_time_s",
        "belief_at_decision",
        "alpha",
        "beta",
        "samples",
        "sent",
        "messages_received",
    ),
}
"""The columns that the page reads from each table, which may have more."""

OUTCOMES = ("right", "wrong", "split", "incomplete", "truth_undefined")
"""Outcomes of the swarm; ``truth_undefined``: a consensus on a floor without a right answer."""


class MapsOverTime(NamedTuple):
    """What robots believe of each tile as a run goes on."""

    time_s: NDArray[np.float64]
    """(times,), evenly spaced from 0."""
    beliefs: NDArray[np.float64]
    """(times, maps, tiles): that the tile vibrates; by robot and pooled, or pooled alone."""


@dataclass(frozen=True, eq=False)
class RunRecord:
    """One run for a page. Lengths in m, times in s, angles in rad.

    Args:
        title: the page's heading; any text.
        arena_width_m, arena_height_m: the walls are at 0 and here; x right, y up.
        floor: the tiles, in arena coordinates.
        t_end_s: when the run ended.
        strategy: what robots sent ("none", "positive", "soft").
        seed, run: these reproduce the run; seed None: it was recorded.
        fill_ratio: the true share of tiles that vibrate.
        consensus: one of ``OUTCOMES``.
        consensus_time_s: when the last robot decided, or None.
        motion, segments, observations, inference, robots: the run's tables (``COLUMNS``).
        tick_s: the robots' control period.
        gate: what ``min_observations`` counts; gate_counts_current: the current sample too.
        gated: whether the strategy heeds ``min_observations``.
        ray_forward_m, ray_sides_m, ray_angles_rad: where rays start and point, seen from the robot.
        ray_disc_radius_m: radius of other robots as seen by rays.
        readings_boundary: the share of ones that robots compare their readings with; None: ``decision_boundary``.
        expected_ones: the expected share of ones on this floor, shown instead of the fill ratio if
            ``readings_boundary`` differs from ``decision_boundary``; None: the fill ratio.
        faults: of each fault of a robot: robot, kind in words, since when (s), whether the robot then stands for good.
        details: further texts in the footer, by name.

    Raises:
        InputError: a table lacks a column, or ``consensus`` is unknown.
    """

    title: str
    arena_width_m: float
    arena_height_m: float
    floor: Floor
    t_end_s: float
    strategy: str
    seed: int | None
    run: int
    fill_ratio: float
    consensus: str
    consensus_time_s: float | None
    motion: pl.DataFrame
    segments: pl.DataFrame
    observations: pl.DataFrame
    inference: pl.DataFrame
    robots: pl.DataFrame
    min_observations: int = 0
    gate: str = "total"
    gate_counts_current: bool = False
    gated: bool = True
    credible_threshold: float = 0.95
    decision_boundary: float = 0.5
    readings_boundary: float | None = None
    expected_ones: float | None = None
    prior_alpha: int = 1
    prior_beta: int = 1
    tick_s: float = 0.02
    body_radius_m: float = 0.015
    ray_forward_m: float = 0.008
    ray_sides_m: tuple[float, ...] = (0.0, 0.0075, -0.0075)
    ray_angles_rad: tuple[float, ...] = (0.0, radians(27), -radians(27))
    ray_range_m: float = 0.15
    ray_disc_radius_m: float = 0.0055
    avoidance_threshold_m: float = 0.055
    truth: int | None = None
    """The right decision; None: neither, or given by the fill ratio (without ``answers``)."""
    answers: tuple[str, str] | None = None
    """Meaning of decisions 0 and 1, if the question is not about the fill ratio."""
    faults: tuple[tuple[int, str, float, bool], ...] = ()
    details: dict[str, str] = field(default_factory=dict)
    places: pl.DataFrame | None = None
    """Where robots believe they are at each sample: robot, sample, x_m, y_m, heading_rad, spread_m;
    and, if known, the smoothed place of an earlier sample (``LAGGED_COLUMNS``)."""
    maps: MapsOverTime | None = None
    """The robots' maps of the floor; None: they keep none."""
    radio: MessageLog | None = None
    """The run's messages; None: all hear all, or it is not known who heard them."""

    def __post_init__(self) -> None:
        for table, columns in COLUMNS.items():
            frame: pl.DataFrame = getattr(self, table)
            missing = [name for name in columns if name not in frame.columns]
            if missing:
                raise InputError(f"the table has no column {', '.join(missing)}", field=table)
        if self.consensus not in OUTCOMES:
            raise InputError(f"'{self.consensus}' is not one of {', '.join(OUTCOMES)}", field="consensus")

    @property
    def true_decision(self) -> int | None:
        """1 if most tiles vibrate, 0 if most are still, None where the fill ratio is the boundary."""
        if self.answers is not None:
            return self.truth
        if self.fill_ratio == self.decision_boundary:
            return None
        return int(self.fill_ratio > self.decision_boundary)


TIME_QUANTUM_S = 0.001
POSITION_QUANTUM_M = 0.0001
HEADING_QUANTUM_RAD = 2 * np.pi / 3600
"""Resolution of poses."""


def packed_column(values: NDArray[np.generic]) -> dict[str, str]:
    """Return a column: its type (little-endian, as NumPy names it) and its bytes in base64."""
    column = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return {"type": column.dtype.str.lstrip("<|"), "bytes": b64encode(column.tobytes()).decode("ascii")}


def packed_track(track: Track) -> dict[str, int | str]:
    """Return a track's knots: rounded differences between them, as variable-length integers in base64.

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
    """Return the run as plain dicts, lists, text and finite numbers.

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
        "places": None if record.places is None else _places(record, record.places),
        "maps": None if record.maps is None else _maps(record.maps),
        "poses": _poses(record),
        "faults": [
            {"robot": robot, "fault": words, "from_s": from_s, "stops": stops}
            for robot, words, from_s, stops in record.faults
        ],
        "radio": None if record.radio is None else _radio(record.radio),
        "details": [[str(name), str(text)] for name, text in record.details.items()],
    }


def fault_rows(faults: pl.DataFrame) -> tuple[tuple[int, str, float, bool], ...]:
    """Return the faults of a run as ``RunRecord`` takes them, from its table of faults."""
    return tuple(
        (row["robot"], fault_words(row["fault"]), row["from_s"], row["fault"] in MOTION_FAULTS)
        for row in faults.to_dicts()
    )


def _floor(record: RunRecord) -> dict[str, Any]:
    """Return the floor as the page reads it."""
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
    """Return the robots' geometry for the page."""
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
    """Return the decision rule for the page."""
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
        "gate_counts_current": record.gate_counts_current,
        "gated": record.gated,
        "answers": None if record.answers is None else list(record.answers),
    }


def _samples(record: RunRecord) -> dict[str, np.ndarray[Any, Any]]:
    """Join motion, observations and inference into columns for the page."""
    table = record.motion
    for more in (record.observations, record.inference):
        new = [name for name in more.columns if name not in table.columns]
        table = table.join(more.select("robot", "sample", *new), on=["robot", "sample"], how="inner")
    table = (
        table.sort("robot", "sample")
        .cast({"energy": pl.Float32})
        .with_columns(pl.col("energy").fill_null(np.nan), pl.col("message").fill_null(UNKNOWN))
    )
    return {name: table[name].cast(kind).to_numpy() for name, kind in SAMPLE_TYPES.items()}


PLACE_COLUMNS = ("x_m", "y_m", "heading_rad", "spread_m")
LAGGED_COLUMNS = ("lagged_sample", "lagged_x_m", "lagged_y_m", "lagged_spread_x_m", "lagged_spread_y_m")
"""The smoothed place of an earlier sample; optional."""


def _places(record: RunRecord, places: pl.DataFrame) -> dict[str, Any]:
    """Return the estimates as packed columns, row by row those of the samples; NaN where there is none."""
    names = (*PLACE_COLUMNS, *(name for name in LAGGED_COLUMNS if name in places.columns))
    known = places.select("robot", "sample", *names)
    of_samples = record.motion.select("robot", "sample")
    for table in (record.observations, record.inference):
        of_samples = of_samples.join(table.select("robot", "sample"), on=["robot", "sample"], how="semi")
    of_samples = of_samples.sort("robot", "sample")
    estimates = of_samples.join(known, on=["robot", "sample"], how="left", maintain_order="left")
    return {
        name: packed_column(estimates[name].cast(pl.Float32).fill_null(np.nan).to_numpy()) for name in names
    }


def _maps(maps: MapsOverTime) -> dict[str, Any]:
    """Return the maps with beliefs in steps of 1/255, map by map of each time."""
    beliefs = np.rint(255.0 * maps.beliefs).astype(np.uint8)
    return {
        "step_s": float(maps.time_s[1] - maps.time_s[0]),
        "count": beliefs.shape[1],
        "beliefs": packed_column(beliefs.ravel()),
    }


def _radio(log: MessageLog) -> dict[str, Any]:
    """Return the messages as packed columns: sender, time_s, and the state at each robot, message by message."""
    columns: dict[str, NDArray[np.generic]] = {
        "sender": log.sender.astype(np.uint16),
        "time_s": log.time_s,
        "state": log.state.ravel(),
    }
    return {name: packed_column(column) for name, column in columns.items()}


def _poses(record: RunRecord) -> dict[str, Any]:
    """Return the robots' thinned trajectories for the page."""
    robots, kinds = tracks(record.segments, record.t_end_s)
    return {
        "time_quantum_s": TIME_QUANTUM_S,
        "position_quantum_m": POSITION_QUANTUM_M,
        "heading_quantum_rad": HEADING_QUANTUM_RAD,
        "kinds": kinds,
        "robots": [packed_track(track) for track in robots],
    }
