"""The log of one session: samples and tracked positions in SI units, read by format.

| column | unit | content |
|---|---|---|
| line | - | line of the file, from 1 |
| robot | - | number of the robot in the log |
| time_s | s | since the start of the session; for a sample, the time at which its row was written |
| x_m, y_m, heading_rad | m, rad | x to the right, y up |
| energy | RMS | of the sample just taken |
| observation, message | 0, 1 | the bit read, the bit sent |
| alpha, beta, belief_below | - | after the sample; belief that the fill ratio is below the boundary |
| decision | - | -1 undecided, 0, 1 |
| sent | - | messages sent before this sample; robots send one per sample, so it is the number of the sample, from 0 |
| messages_received | - | messages received so far |
| avoid_total_s, stop_total_s | s | time spent avoiding and standing so far |
| place_x_m, place_y_m, place_spread_m | m | where the robot believed that it was, with its standard deviation |

A row with an energy is a sample, in a log without energies one with an observation; other rows are tracked positions.

**webots**, the console log of the study's simulator: lines of data among others, ``1, time s, robot, energy, bit sent,
belief, alpha, beta, sent, received, posterior mean, own mean, x m, z m, walking ms, avoiding ms, pause ms, decision
time s, decision``, with y = 1 - z; each robot's last line is repeated. One of the first lines has the settings.

**rugbot**, the CSV of the study's robots; **camera**, the log of a session tracked by ``lab track``; **table**, any
other table whose columns have the names of ``SAMPLES``, or are named by a column map.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.read_tables import (
    Column,
    ColumnMap,
    Use,
    cells_of,
    converted,
    files_of,
    read_model,
    read_rows,
    text_of,
)
from vibroswarm.errors import InputError

_LENGTH: Final = Use(pl.Float64, -1e4, 1e4, "a length within 10 km")
_DURATION: Final = Use(
    pl.Float64, 0.0, 1e7, "a time from 0 to 1e7 s (of other clocks, in a column map: first = 0)"
)
_WHOLE: Final = Use(pl.Int64, 0, 2**31, "a whole number from 0 on")
_BIT: Final = Use(pl.Int64, 0, 1, "0 or 1")
SAMPLES: Final[dict[str, Use]] = {
    "robot": _WHOLE._replace(required=True),
    "time_s": _DURATION._replace(required=True),
    "x_m": _LENGTH._replace(required=True),
    "y_m": _LENGTH._replace(required=True),
    "energy": Use(pl.Float64, 0.0, 1e9, "a number from 0 to 1e9"),
    "heading_rad": Use(pl.Float64, -1e9, 1e9, "an angle"),
    "observation": _BIT,
    "message": _BIT,
    "alpha": _WHOLE,
    "beta": _WHOLE,
    "belief_below": Use(pl.Float64, 0.0, 1.0, "a probability"),
    "decision": Use(pl.Int64, -1, 1, "-1, 0 or 1"),
    "sent": _WHOLE,
    "messages_received": _WHOLE,
    "avoid_total_s": _DURATION,
    "stop_total_s": _DURATION,
    "place_x_m": _LENGTH,
    "place_y_m": _LENGTH,
    "place_spread_m": Use(pl.Float64, 0.0, 1e4, "a length of 0 or more"),
}
"""Columns of a log's samples, beside ``line``; the table of the module's docstring explains them."""
TRACKS: Final = ("line", "robot", "time_s", "x_m", "y_m", "heading_rad")
"""Columns of a log's tracked positions."""
LATE_S: Final = 1.0
"""A row may have a time this much before that of an earlier row; if it is more, the file is not in order."""
CELLS: Final = 19
_CONSOLE: Final = {
    "time_s": 1, "robot": 2, "energy": 3, "message": 4, "belief_below": 5, "alpha": 6, "beta": 7, "sent": 8,
    "messages_received": 9, "x_m": 12, "y_m": 13, "avoid_total_s": 15, "stop_total_s": 16, "decision": 18,
}  # fmt: skip
_SETTINGS: Final = re.compile(
    r"^(\d+) (\d+) (\d+) (\d+) (\d+) ([012]) (\d+) (\d+) 1 (\d+) (\d+) 0 0\s*$", re.MULTILINE
)
"""Line of settings: eight settings, 1, number of robots, tau, 0, 0."""
FEEDBACK: Final = ("none", "positive", "soft")
CAMERA_LOG: Final = "log.csv"
"""Name of the log in a folder written by ``lab track``."""
CAMERA_COLUMNS: Final = tuple(name for name in SAMPLES if not name.startswith("place_"))


@dataclass(frozen=True, eq=False)
class Log:
    """The log of one session."""

    name: str
    reader: str
    samples: pl.DataFrame
    """``line`` and the columns of ``SAMPLES``, by time."""
    tracks: pl.DataFrame
    """Columns of ``TRACKS``, by time; empty if positions are known at samples only."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    counts: Mapping[str, float] = field(default_factory=dict)
    robots: Mapping[str, int] = field(default_factory=dict)
    """The number that each robot got, by the name that it has in the file; empty: the file has numbers."""
    has_timestamps: bool = False
    """Whether times are counted from the first row, as those of timestamps are."""


def in_schema(rows: pl.DataFrame, schema: Mapping[str, Any]) -> pl.DataFrame:
    """Return the columns of a schema, in its types; those that are not there are null."""
    return rows.select(
        pl.col(name).cast(kind) if name in rows.columns else pl.lit(None, kind).alias(name)
        for name, kind in schema.items()
    )


def log_frame(rows: pl.DataFrame) -> pl.DataFrame:
    """Return rows with ``line`` and all columns of ``SAMPLES``."""
    return in_schema(rows, {"line": pl.UInt32} | {name: use.kind for name, use in SAMPLES.items()})


def log_of(rows: pl.DataFrame, name: str, reader: str, wraps_at: Mapping[str, float], **more: Any) -> Log:
    """Make a log of the rows of files: by time, without copies, and with counters that go on where they wrap.

    Args:
        rows: columns of ``SAMPLES`` that the files have, and ``file`` and ``line``, in the order of the files.
        wraps_at: value at which counters start again from 0, by column. more: further fields of the log.
    """
    own = rows.unique(pl.exclude("line"), keep="first", maintain_order=True)
    late = own.filter(pl.col("time_s").cum_max().over("file") - pl.col("time_s") > LATE_S)
    if late.height:
        raise InputError(
            f"its time, {late['time_s'][0]:g} s, is before that of an earlier row, by more than {LATE_S:g} s: the "
            "file holds two sessions, or its clock began again",
            field=f"{late['file'][0]}, row {late['line'][0]}",
        )
    frame, value = log_frame(own), "energy" if "energy" in rows.columns else "observation"
    by_time = frame.with_columns(file=own["file"]).sort("time_s", "line", maintain_order=True)
    samples, tracks = by_time.filter(pl.col(value).is_not_null()), by_time.filter(pl.col(value).is_null())
    for part in (samples, tracks):
        if (twice := part.filter(pl.struct("robot", "time_s").is_duplicated())).height:
            raise InputError(
                f"robot {twice['robot'][1]} is in two places, or took two samples, at {twice['time_s'][1]:g} s",
                field=f"{twice['file'][1]}, row {twice['line'][1]}",
            )
    steps = {use: pl.col(use).forward_fill().over("robot").diff().over("robot") for use in wraps_at}
    wraps = {use: (step < 0).cast(pl.Int64) for use, step in steps.items()}
    counts = {
        "rows": rows.height,
        "rows_repeated": rows.height - own.height,
        "counters_wrapped": sum(int(samples.select(one.sum()).item()) for one in wraps.values()),
        "samples": samples.height,
    }
    samples = samples.with_columns(
        pl.when(pl.col(use).is_not_null())
        .then((step + wraps_at[use] * wraps[use]).fill_null(pl.col(use)).cum_sum().over("robot"))
        .alias(use)
        for use, step in steps.items()
    )
    return Log(
        name,
        reader,
        log_frame(samples),
        tracks.select(TRACKS),
        counts=counts | more.pop("counts", {}),
        **more,
    )


def read_log(path: str | Path, columns: str | Path | None = None) -> Log:
    """Read the log of a session.

    Args:
        path: of the log, or a folder: one that ``lab track`` has written, or of the session's files.
        columns: path of a column map; without it, the file's format is detected.
    """
    path = Path(path)
    paths = files_of(path, CAMERA_LOG)
    name = path.resolve().name
    if columns is not None:
        by = read_model(ColumnMap, Path(columns), "a column map")
        named = by if by.name != "table" else by.model_copy(update={"name": Path(columns).name})
        return _read_table(paths, name, named)
    reader = _format_of(paths[0])
    if reader == "webots":
        return _read_console(paths[0], name)
    by = rugbot_map() if reader == "rugbot" else ColumnMap(name=reader)
    return _read_table(paths, name, by)


@cache
def rugbot_map() -> ColumnMap:
    """Return the column map of the study's robots."""
    path = Path(str(files("vibroswarm.recordings").joinpath("formats/rugbot.toml")))
    return read_model(ColumnMap, path, "a column map")


def _format_of(path: Path) -> str:
    """A log of the study's robots has at least five of its columns."""
    if any(line.startswith("1,") and line.count(",") == CELLS - 1 for line in text_of(path).splitlines()):
        return "webots"
    header = cells_of(path).columns[2:]
    if len({column.name for column in rugbot_map().columns.values()}.intersection(header)) >= 5:
        return "rugbot"
    return "camera" if tuple(header) == CAMERA_COLUMNS else "table"


def _read_table(paths: list[Path], name: str, by: ColumnMap) -> Log:
    read = read_rows(paths, SAMPLES, by)
    wraps_at = {
        use: column.wraps_at * column.times
        for use, column in read.columns.items()
        if column.wraps_at is not None
    }
    return log_of(
        read.rows, name, by.name, wraps_at, settings=by.settings, robots=read.robots,
        has_timestamps=read.has_timestamps, counts={"missing": read.missing},
    )  # fmt: skip


def _read_console(path: Path, name: str) -> Log:
    text = text_of(path)
    lines = [
        (number, line.split(","))
        for number, line in enumerate(text.splitlines(), start=1)
        if line.startswith("1,") and line.count(",") == CELLS - 1
    ]
    if not lines:
        raise InputError("has no data line (19 numbers separated by commas)", field=str(path))
    table = pl.DataFrame([row for _, row in lines], schema=[str(k) for k in range(CELLS)], orient="row")
    numbers = pl.Series("line", [number for number, _ in lines], pl.UInt32)
    cells = table.select(pl.lit(str(path)).alias("file"), numbers, pl.all())
    columns = {
        use: Column(name=str(place), times=0.001 if use.endswith("total_s") else 1.0)
        for use, place in _CONSOLE.items()
    }
    columns["y_m"] = Column(name=columns["y_m"].name, times=-1.0, plus=1.0)
    read = converted(cells, columns, SAMPLES, missing=())
    return log_of(read.rows, name, "webots", {}, settings=_settings(text))


def _settings(text: str) -> dict[str, Any]:
    """Return the fields of the scenario that a console log states; empty if it has no line of settings."""
    match = _SETTINGS.search(text)
    if match is None:
        return {}
    location, scale, tau, theta_c, least, feedback, eta, *_ = map(int, match.groups())
    return {
        "walk.walk_duration_location_ms": float(location),
        "walk.walk_duration_scale_ms": float(scale),
        "sample.sample_interval_ms": float(tau),
        "walk.avoidance_threshold_mm": float(theta_c),
        "decision.min_observations": least,
        "strategy.name": FEEDBACK[feedback],
        "strategy.soft.eta": float(eta),
    }


def camera_frame(log: Log) -> pl.DataFrame:
    """Return the log of a tracked session as a table, by time: rows with an energy are samples, others positions."""
    rows = pl.concat([log_frame(log.tracks), log.samples]).select(CAMERA_COLUMNS)
    # The sort is stable: a sample stays behind a position of the same time.
    return rows.sort("time_s", "robot", maintain_order=True)
