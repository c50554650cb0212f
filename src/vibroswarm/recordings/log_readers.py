"""Read logs by format; a new format needs a function from a path to a ``Log``, and one call of ``register``.

**webots**, the console log of the study's simulator. It has samples only; lines of data stand among other lines. A
line of data is ``1, time s, robot, energy, bit sent, belief, alpha, beta, sent, received, posterior mean, own mean,
x m, z m, walking ms, avoiding ms, pause ms, decision time s, decision``, with y = 1 - z. Samples of the first 5 s are
not printed, and each robot's last line is repeated. One of the first lines has the settings: ``gamma_0 gamma tau
theta_c O_c feedback eta seed ...``.

**camera**, the log of a session tracked by ``lab track``: CSV, also written here, one session per file.

**rugbot**, the CSV of the study's robots: read by a column map (``column_map``).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError, check_choice
from vibroswarm.recordings.column_map import (
    check_values,
    column_map,
    numbers_of,
    own_map,
    read_mapped,
    text_of,
)
from vibroswarm.recordings.log import OWN_PLACE, SAMPLES, TRACKS, Log, log_frame

CELLS: Final = 19
"""Numbers in a line of data of a console log."""
_PLACES: Final = {
    "time_s": 1, "robot": 2, "energy": 3, "message": 4, "belief_below": 5, "alpha": 6, "beta": 7, "sent": 8,
    "messages_received": 9, "x_m": 12, "y_m": 13, "avoid_total_s": 15, "stop_total_s": 16, "decision": 18,
}  # fmt: skip
"""Index of the cell of each column in a line of data."""
_SETTINGS: Final = re.compile(
    r"^(\d+) (\d+) (\d+) (\d+) (\d+) ([012]) (\d+) (\d+) 1 (\d+) (\d+) 0 0\s*$", re.M
)
"""Line of settings: eight settings, 1, number of robots, tau, 0, 0."""
FEEDBACK: Final = ("none", "positive", "soft")
"""Strategies by their number in the settings."""


def looks_like_webots(head: str) -> bool:
    """Return whether a text is a console log: at least one line looks like a line of data."""
    return any(line.startswith("1,") and line.count(",") == CELLS - 1 for line in head.splitlines())


def read_webots(path: Path) -> Log:
    """Read a console log of the study's simulator.

    Bits that were read are set only where the bits that were sent determine them.

    Raises:
        InputError: no line of data, a line of data of another length, text in place of a number, or an impossible
            value; the error names the line, unless there is none.
    """
    name, text = str(path), text_of(path)
    rows: list[list[str]] = []
    numbers: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        # Other lines are skipped; a line of data that was cut short is not, so that it is reported below.
        if line.count(",") < 10 or not line.startswith("1,"):
            continue
        cells = line.split(",")
        if len(cells) != CELLS:
            raise InputError(
                f"{len(cells)} cells, but a data line has {CELLS}", field=f"{name}, row {number}"
            )
        rows.append(cells)
        numbers.append(number)
    if not rows:
        raise InputError("has no data line (19 numbers separated by commas)", field=name)
    lines = pl.Series("line", numbers, dtype=pl.UInt32)
    table = [
        numbers_of(pl.Series(cells), lines, name, f"{place}", missing=())
        for place, cells in enumerate(zip(*rows, strict=True), start=1)
    ]
    columns: dict[str, Any] = {"line": lines} | {
        use: table[place].alias(use) for use, place in _PLACES.items()
    }
    columns["y_m"] = 1.0 - columns["y_m"]
    for use in ("avoid_total_s", "stop_total_s"):
        # Divided by NumPy, since polars would multiply by 0.001, which rounds differently.
        columns[use] = pl.Series(columns[use].to_numpy() / 1000.0)
    for use, place in _PLACES.items():
        check_values(columns[use], lines, name, use, f"{place + 1}")
    settings = _settings(text)
    columns["observation"] = _bits_read(
        settings.get("strategy.name"), columns["message"], columns["decision"]
    )
    return Log(
        name=path.name,
        reader="webots",
        samples=log_frame(columns, SAMPLES),
        tracks=log_frame({}, TRACKS).clear(),  # without ``clear`` it would have one row of nulls
        settings=settings,
        counts={"rows": len(rows)},
    )


def _bits_read(strategy: str | None, sent: pl.Series, decision: pl.Series) -> pl.Series:
    """Return the bits that were read, as far as the bits sent determine them; null elsewhere.

    A robot without feedback sends the bit that it read. With positive feedback it does so until it decides, and from
    then on sends its decision. With any other strategy, or if the strategy is unknown, all bits are null.

    Args:
        strategy: name of the robots' strategy; None: unknown. sent: bit sent with each sample. decision: decision after
            each sample, -1 while undecided.
    """
    known = pl.lit(strategy == "none") | (pl.lit(strategy == "positive") & (pl.col("decision") == -1))
    frame = pl.DataFrame([sent.alias("sent"), decision.alias("decision")])
    return frame.select(pl.when(known).then("sent").alias("observation")).to_series()


def _settings(text: str) -> dict[str, Any]:
    """Return the fields of the scenario that the log's line of settings states; empty if there is no such line.

    The seed, the number of robots and the second tau in this line are left out.
    """
    match = _SETTINGS.search(text)
    if match is None:
        return {}
    location, scale, tau, theta_c, least, feedback, eta, *_ = (
        int(text_value) for text_value in match.groups()
    )
    return {
        "walk.walk_duration_location_ms": float(location),
        "walk.walk_duration_scale_ms": float(scale),
        "sample.sample_interval_ms": float(tau),
        "walk.avoidance_threshold_mm": float(theta_c),
        "decision.min_observations": least,
        "strategy.name": FEEDBACK[feedback],
        "strategy.soft.eta": float(eta),
    }


CAMERA_LOG: Final = "log.csv"
"""Name of the log in a folder written by ``lab track``."""
CAMERA_COLUMNS: Final = tuple(name for name in SAMPLES if name not in ("line", *OWN_PLACE))
"""Columns of the log of a tracked session: those of a log's samples, under the same names."""


def camera_log_bytes(log: Log) -> bytes:
    """Return the log of a tracked session as CSV, in the order of time.

    Rows with an energy are samples, all others are tracked positions. Times, places and headings are rounded to six
    decimals (s, m, rad).
    """
    tracks = log.tracks.with_columns(
        pl.lit(None, dtype=kind).alias(name)
        for name, kind in SAMPLES.items()
        if name not in log.tracks.columns
    )
    rows = pl.concat([tracks.select(CAMERA_COLUMNS), log.samples.select(CAMERA_COLUMNS)])
    # The sort is stable: a sample stays behind a position of the same time.
    rows = rows.sort("time_s", "robot", maintain_order=True)
    return csv_bytes(rows.with_columns(pl.col("time_s", "x_m", "y_m", "heading_rad").round(6)))


def looks_like_camera(head: str) -> bool:
    """Return whether a text begins with the columns of the log of a tracked session."""
    return head.split("\n", 1)[0].strip() == ",".join(CAMERA_COLUMNS)


def log_file(path: Path) -> Path:
    """Return the path of a log: ``path`` itself, or the log inside if it is a folder written by ``lab track``.

    Raises:
        InputError: it is a folder without a log.
    """
    if not path.is_dir():
        return path
    if not (path / CAMERA_LOG).is_file():
        raise InputError(
            f"is a folder without {CAMERA_LOG}; give a log, or a folder that 'lab track' wrote with --log",
            field=str(path),
        )
    return path / CAMERA_LOG


def named_by_folder(log: Log, given: Path, file: Path) -> Log:
    """Return a log named by its folder if the user gave a folder, since all logs in folders have the same file name.

    Args:
        given: path that the user gave. file: path of the log, from ``log_file``.
    """
    return log if given == file else replace(log, name=given.resolve().name)


HEAD: Final = 2**20
"""Number of characters of a file that are examined to recognise its format."""


@dataclass(frozen=True)
class Reader:
    """A log format."""

    name: str
    """Name of the format."""
    about: str
    """Description of the format, for lists of formats."""
    recognises: Callable[[str], bool]
    """Return whether a file has the format, from the text at its beginning."""
    read: Callable[[Path], Log]
    """Read a file of this format."""


_READERS: dict[str, Reader] = {}
"""Registered formats by name, in the order in which they are tried."""


def register(reader: Reader) -> None:
    """Register a reader by its name; formats are tried in the order of registration.

    It replaces a reader of the same name, and takes its place in that order.
    """
    _READERS[reader.name] = reader


def read_log(
    path: str | Path,
    reader: str | None = None,
    columns: str | Path | None = None,
    has_energies: bool = True,
) -> Log:
    """Read a log.

    Args:
        path: of the log. reader: name of the format; by default the first format that recognises the file.
        columns: path of a column map; if it is given, the file is read by this map, whatever its format.
        has_energies: whether a column map must name the column for energy (``column_map``).
    Raises:
        InputError: an unknown format, no format recognises the file, or the reader's own error.
    """
    path = Path(path)
    if columns is not None:
        text = text_of(Path(columns), "a column map")
        return read_mapped(path, column_map(text, str(columns), has_energies))
    if reader is not None:
        check_choice(reader, "--reader", _READERS)
        return _READERS[reader].read(path)
    head = text_of(path).lstrip("\r\n")[:HEAD]
    for candidate in _READERS.values():
        if candidate.recognises(head):
            return candidate.read(path)
    raise InputError(
        f"is not in a known log format ({', '.join(_READERS)}); any CSV can be read with --columns MAP.toml",
        field=str(path),
    )


def _has_head(head: str) -> bool:
    """Return whether the first line has at least five of the column names of the study's robots.

    A file that lacks some of the columns is still recognised, so that the reader can report what is missing.
    """
    first = head.split("\n", 1)[0].split(",")
    names = {column.name for column in own_map("rugbot").columns.values()}
    return len(names & {cell.strip() for cell in first}) >= 5


register(
    Reader(
        "rugbot",
        "CSV of the study's real robots (tracking rows and sample rows)",
        _has_head,
        lambda path: read_mapped(path, own_map("rugbot")),
    )
)
register(Reader("webots", "console log of the study's simulator", looks_like_webots, read_webots))
register(
    Reader(
        "camera",
        "CSV of 'lab track' (positions by an overhead camera, and samples)",
        looks_like_camera,
        lambda path: read_mapped(path, own_map("camera")),
    )
)
