"""Read logs by format.

**webots**, the console log of the study's simulator: lines of data among others, ``1, time s, robot, energy, bit sent,
belief, alpha, beta, sent, received, posterior mean, own mean, x m, z m, walking ms, avoiding ms, pause ms, decision
time s, decision``, with y = 1 - z; each robot's last line is repeated. One of the first lines has the settings.

**rugbot**, the CSV of the study's robots; **camera**, the log of a session tracked by ``lab track``; **table**, any
other table whose columns have the names of ``log.SAMPLES``, or are named by a column map.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.lab.recordings.log import SAMPLES, Log, log_frame, log_of
from vibroswarm.lab.recordings.read_tables import (
    Column,
    ColumnMap,
    cells_of,
    converted,
    files_of,
    read_model,
    read_rows,
    text_of,
)

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
        return _read_table(paths, name, read_model(ColumnMap, Path(columns), "a column map"))
    reader = _format_of(paths[0])
    if reader == "webots":
        return _read_console(paths[0], name)
    by = rugbot_map() if reader == "rugbot" else ColumnMap(name=reader)
    return _read_table(paths, name, by)


@cache
def rugbot_map() -> ColumnMap:
    """Return the column map of the study's robots."""
    path = Path(str(files("vibroswarm.lab.recordings").joinpath("formats/rugbot.toml")))
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
