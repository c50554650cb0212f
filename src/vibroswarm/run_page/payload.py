"""Convert a run to the data of its web page: its tables and constants, as a dict for JSON.

Numeric columns are packed: their bytes are encoded in base64.

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
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import check_choice
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.run_page.trajectory_thinning import Track, tracks
from vibroswarm.tasks.fill_ratio import ON_THE_BOUNDARY

ROBOT_COLUMNS = (
    "robot",
    "decision",
    "decision_time_s",
    "belief_at_decision",
    "alpha",
    "beta",
    "samples",
    "sent",
    "messages_received",
)
"""Columns of the table of robots that the page has."""

OUTCOMES = ("right", "wrong", "split", "incomplete", "truth_undefined")
"""Outcomes of the swarm: all robots decided rightly, or all wrongly; their decisions differ (``split``); a robot is
undecided (``incomplete``); or a consensus on a floor without a right answer (``truth_undefined``)."""


class MapsOverTime(NamedTuple):
    """Maps of the floor that robots keep, at several times of a run."""

    time_s: NDArray[np.float64]
    """(times,), two or more, evenly spaced from 0."""
    beliefs: NDArray[np.float64]
    """(times, maps, tiles): belief that the tile vibrates. The maps are those of each robot and the pooled map, or the
    pooled map alone."""


@dataclass(frozen=True, eq=False)
class RunRecord:
    """One run for a page. Lengths in m, times in s, angles in rad.

    The tables are those of a result, of this run alone. Arena coordinates begin at the lower left corner of the walls;
    x points right, y up.

    Raises:
        InputError: ``consensus`` is unknown.
    """

    title: str
    """Heading of the page; any text."""
    arena: Mapping[str, float]
    """Its ``width_m`` and ``height_m``: x of its right wall and y of its upper wall, m."""
    floor: Floor
    """The tiles, in arena coordinates."""
    t_end_s: float
    """End of the run, s."""
    strategy: str
    """Strategy of the robots in words, such as "soft feedback"."""
    seed: int | None
    """Seed that reproduces the run, with ``run``; None: the run was recorded."""
    run: int
    """Number of the run."""
    fill_ratio: float
    """True share of tiles that vibrate."""
    consensus: str
    """Outcome of the swarm, one of ``OUTCOMES``."""
    consensus_time_s: float | None
    """Time at which the last robot decided, s; None without a consensus."""
    motion: pl.DataFrame
    """The run's samples: robot, time and place."""
    poses: pl.DataFrame
    """The robots' poses."""
    observations: pl.DataFrame
    """What each sample read."""
    inference: pl.DataFrame
    """Belief, decision and messages of a robot after each of its samples."""
    robots: pl.DataFrame
    """One row per robot: its outcome."""
    rule: Mapping[str, Any]
    """How robots decide, as the page's scripts read it (``write.rule_of``)."""
    body: Mapping[str, Any]
    """A robot's body and its rays, as the page's scripts read them (``write.body_of``)."""
    expected_ones: float | None = None
    """Expected share of ones on this floor, shown instead of the fill ratio if robots compare their readings with
    another share than the boundary; None: the fill ratio."""
    tick_s: float = 0.02
    """The robots' control period, s."""
    truth: int | None = None
    """The right decision, None if neither is; used only if the question is not about the fill ratio, which gives it."""
    notes: tuple[str, ...] = ()
    """Sentences to be read before the question, such as that robots knew their true places."""
    estimates: Mapping[str, Any] | None = None
    """What robots say to a task that asks for a number, in words; None: it asks for a decision."""
    kinds: int = 2
    """Number of kinds of tile, or of classes of readings if they are more."""
    faults: tuple[Mapping[str, Any], ...] = ()
    """For each fault: robot, ``fault`` in words, ``from_s``, and whether it ``stops`` the robot for good."""
    details: dict[str, str] = field(default_factory=dict)
    """Further texts in the page's footer, by name."""
    places: pl.DataFrame | None = None
    """Where robots believe they are at each sample: robot, sample, x_m, y_m, heading_rad, spread_m;
    and, if known, the smoothed place of an earlier sample (``LAGGED_COLUMNS``)."""
    maps: MapsOverTime | None = None
    """The robots' maps of the floor; None: they keep none."""
    reports: tuple[Mapping[str, Any], ...] = ()
    """What robots report, of each value that is shown: its ``name`` and unit; its ``values`` after each sample, packed,
    sorted by robot and sample (nan: none yet); and the ``truth``, the number that it estimates, if it does: pairs of a
    time (s), 0 first, and the number from then on."""
    reported: int = 0
    """Number of values that robots report; those that ``reports`` lacks are not shown."""

    def __post_init__(self) -> None:
        """Check the consensus.

        Raises:
            InputError: it is unknown.
        """
        check_choice(self.consensus, "consensus", OUTCOMES)

    @property
    def true_decision(self) -> int | None:
        """The right decision: 1 if the fill ratio is above the boundary, 0 if it is below, None if it is the boundary.

        For a question that is not about the fill ratio, it is ``truth``.
        """
        if self.rule["answers"] is not None:
            return self.truth
        beyond = self.fill_ratio - self.rule["boundary"]
        return None if abs(beyond) < ON_THE_BOUNDARY else int(beyond > 0.0)


TIME_QUANTUM_S = 0.001
"""Unit in which times of knots are packed."""
POSITION_QUANTUM_M = 0.0001
"""Unit in which positions of knots are packed."""
HEADING_QUANTUM_RAD = 2 * np.pi / 3600
"""Unit in which headings of knots are packed."""


def packed_column(values: NDArray[np.generic]) -> dict[str, str]:
    """Pack a column: its little-endian type in NumPy's notation without the byte order, and its bytes in base64."""
    column = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"))
    return {"type": column.dtype.str.lstrip("<|"), "bytes": b64encode(column.tobytes()).decode("ascii")}


def packed_track(track: Track) -> dict[str, int | str]:
    """Pack a track's knots as variable-length integers in base64.

    A knot has five integers: the differences of time, x, y and heading from the knot before (from 0 for the first
    knot), in units of their quantum, and the kind itself.
    """
    # Units of the columns of ``knots``: time, x, y, heading.
    quanta = [TIME_QUANTUM_S, POSITION_QUANTUM_M, POSITION_QUANTUM_M, HEADING_QUANTUM_RAD]
    # Rounded before differences are taken, so that rounding errors do not add up.
    steps = np.diff(np.round(track.knots / quanta).astype(np.int64), axis=0, prepend=0)
    rows = np.column_stack([steps, track.kind])
    data = b64encode(varints(rows.ravel())).decode("ascii")
    return {"robot": track.robot, "knots": len(rows), "bytes": data}


def varints(values: NDArray[np.int64]) -> bytes:
    """Encode integers as LEB128 of their zigzag form, in which numbers near 0 take one byte.

    The zigzag form of 0, -1, 1, -2 is 0, 1, 2, 3. LEB128 writes groups of 7 bits, the lowest first, one per byte; bit 7
    of a byte is set if another byte follows.
    """
    rest = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    groups = [rest & np.uint64(127)]
    while (rest := rest >> np.uint64(7)).any():
        groups.append(rest & np.uint64(127))
    table = np.stack(groups, axis=1).astype(np.uint8)  # (values, groups)
    # Number of bytes that each value needs: up to its highest group that is not 0, but at least one.
    used = table.shape[1] - np.argmax(table[:, ::-1] != 0, axis=1)
    used[~table.any(axis=1)] = 1
    place = np.arange(table.shape[1])
    table[place < used[:, None] - 1] |= 128
    return bytes(table[place < used[:, None]].tobytes())


FORMAT = 1
"""Version of the payload, which the page's scripts check."""

UNKNOWN = 255
"""Stands for a missing message: the robot sent none, its messages are no bits, or a recording does not contain it."""

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
"""Columns of the samples: those of motion, observations and inference. A column with missing values is packed as
floats with nan, whatever its type here."""


def payload(record: RunRecord) -> dict[str, Any]:
    """Convert a run to dicts, lists, text, booleans, finite numbers and None, which the page's scripts read.

    Samples and places are packed columns (``packed_column``), sorted by robot and sample; a missing message is
    ``UNKNOWN``, any other missing value nan. The maps are packed too, with beliefs rounded to 1/255. Trajectories are
    rounded, thinned and packed (``packed_track``). Everything else has the record's values.
    """
    samples = _joined(record)
    return {
        "format": FORMAT,
        "title": record.title,
        "strategy": record.strategy,
        "seed": None if record.seed is None else int(record.seed),
        "run": int(record.run),
        "arena": dict(record.arena),
        "floor": _floor(record),
        **({"kinds": record.kinds} if record.kinds > 2 else {}),
        "body": dict(record.body),
        "time": {"tick_s": float(record.tick_s), "end_s": float(record.t_end_s)},
        "rule": dict(record.rule),
        "truth": {
            "fill_ratio": float(record.fill_ratio),
            "ones": float(record.fill_ratio if record.expected_ones is None else record.expected_ones),
            "decision": record.true_decision,
        },
        "notes": list(record.notes),
        "outcome": {"consensus": record.consensus, "time_s": record.consensus_time_s},
        "estimates": None if record.estimates is None else dict(record.estimates),
        "robots": record.robots.select(ROBOT_COLUMNS).sort("robot").to_dicts(),
        "samples": {name: packed_column(column) for name, column in _samples(samples).items()},
        "places": None if record.places is None else _places(samples, record.places),
        "maps": None if record.maps is None else _maps(record.maps),
        **({"reports": list(record.reports), "reported": record.reported} if record.reports else {}),
        "poses": _poses(record),
        "faults": list(map(dict, record.faults)),
        "details": [[str(name), str(text)] for name, text in record.details.items()],
    }


def _floor(record: RunRecord) -> dict[str, Any]:
    """Return the floor for the page; its tiles at time 0 are text of their kinds, row by row from the top."""
    floor = record.floor
    rows, columns = floor.tiles.shape
    patches = [(p.x_m, p.y_m, p.width_m, p.height_m, p.is_disc, p.contrast) for p in floor.patches]
    # time (s), tile and new kind of each change, in the order of time
    changes = list(zip(*(column.tolist() for column in floor.changes), strict=True))
    return {
        "name": floor.name,
        "rows": rows,
        "columns": columns,
        "tile_width_m": float(floor.tile_width_m),
        "tile_height_m": float(floor.tile_height_m),
        "left_m": float(floor.left_m),
        "bottom_m": float(floor.bottom_m),
        "tiles": "".join(rows_of(floor.tiles)),
        "has_values": floor.has_contrasts,
        **({"patches": patches} if patches else {}),
        **({"changes": changes} if floor.is_changing else {}),
    }


def _joined(record: RunRecord) -> pl.DataFrame:
    """Return the samples that have a row in motion, observations and inference, sorted by robot and sample number."""
    table = record.motion
    for other in (record.observations, record.inference):
        new = [name for name in other.columns if name not in table.columns]
        table = table.join(other.select("robot", "sample", *new), on=["robot", "sample"], how="inner")
    return table.sort("robot", "sample")


def _samples(samples: pl.DataFrame) -> dict[str, np.ndarray[Any, Any]]:
    """Return the columns ``SAMPLE_TYPES`` of the samples.

    A missing message is ``UNKNOWN``, any other missing value nan: ``to_numpy`` converts a column with nulls, such as
    alpha of a strategy without a posterior, to floats with nan.
    """
    table = samples.cast({"energy": pl.Float32}).with_columns(
        pl.col("energy").fill_null(np.nan), pl.col("message").fill_null(UNKNOWN)
    )
    return {name: table[name].cast(kind).to_numpy() for name, kind in SAMPLE_TYPES.items()}


PLACE_COLUMNS = ("x_m", "y_m", "heading_rad", "spread_m")
"""Where a robot believes that it is, and the standard deviation of this place."""
LAGGED_COLUMNS = ("lagged_sample", "lagged_x_m", "lagged_y_m", "lagged_spread_x_m", "lagged_spread_y_m")
"""The smoothed place of an earlier sample; optional."""


def _places(samples: pl.DataFrame, places: pl.DataFrame) -> dict[str, Any]:
    """Return the estimated places as packed columns, one entry for each of the samples; nan without an estimate."""
    names = (*PLACE_COLUMNS, *(name for name in LAGGED_COLUMNS if name in places.columns))
    known = places.select("robot", "sample", *names)
    of_samples = samples.select("robot", "sample")
    estimates = of_samples.join(known, on=["robot", "sample"], how="left", maintain_order="left")
    return {
        name: packed_column(estimates[name].cast(pl.Float32).fill_null(np.nan).to_numpy()) for name in names
    }


def _maps(maps: MapsOverTime) -> dict[str, Any]:
    """Return the maps for the page: beliefs as whole numbers from 0 to 255, ordered by time, then map, then tile.

    ``count`` is the number of maps at each time; ``step_s`` the time between two of them, s.
    """
    beliefs = np.rint(255.0 * maps.beliefs).astype(np.uint8)
    return {
        "step_s": float(maps.time_s[1] - maps.time_s[0]),
        "count": beliefs.shape[1],
        "beliefs": packed_column(beliefs.ravel()),
    }


def _poses(record: RunRecord) -> dict[str, Any]:
    """Return the robots' thinned trajectories for the page, with the units of their packed integers."""
    robots, kinds = tracks(record.poses)
    return {
        "time_quantum_s": TIME_QUANTUM_S,
        "position_quantum_m": POSITION_QUANTUM_M,
        "heading_quantum_rad": HEADING_QUANTUM_RAD,
        "kinds": kinds,
        "robots": [packed_track(track) for track in robots],
    }
