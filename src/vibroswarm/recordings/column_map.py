"""Read the log of a session from any CSV file, by a column map in TOML.

The format of the study's robots is one such map (``formats/rugbot.toml``). A map names for each column of
``log.SAMPLES`` (called a "use") the column of the file from which it is read:

    missing = ["None", ""]              # texts of empty cells
    [columns]
    robot = "ROV Number"
    time_s = { name = "t_ms", times = 0.001 }
    y_m = { name = "z", times = -1.0, plus = 1.0 }
    sent = { name = "Swarm Send", wraps_at = 65536 }
    decision = { name = "d_f", values = { "2" = -1, "0" = 0, "1" = 1 } }
    [settings]                          # fields of the scenario that hold for every such file
    "sample.stop_ms" = 1000.0

``robot``, ``time_s``, ``x_m``, ``y_m`` and ``energy`` are required. A row with an energy is a sample; a row without is
a tracking row, the position of a robot seen by a camera. ``place_x_m``, ``place_y_m`` and ``place_spread_m`` are where
the robot itself believed that it was; without a camera ``x_m`` and ``y_m`` are read from the same columns. ``tag``
names a column with the marker on the robot, of which each robot has only one. Errors name the row.

A number in the file is multiplied by ``times``, then ``plus`` is added; a text is looked up in ``values``. ``wraps_at``
is the number at which a counter starts again from 0. ``first`` of ``time_s`` is the time of the file's earliest row, s,
for clocks that do not begin with the session, such as seconds since 1970. Timestamps (``seconds_of``) count from
the earliest row, which is at ``first``, or else at ``plus``; ``times`` has no effect on them. A map may also have the
keys ``name``, the name of the format, and ``about``, its description, which is for people only.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import count, some, stated
from vibroswarm.core.untrusted_files import parsed_toml, read_bytes
from vibroswarm.errors import InputError, check_known_keys, nearest, number_of
from vibroswarm.recordings.log import COUNTERS, OWN_PLACE, REQUIRED, SAMPLES, TRACKS, Log, log_frame

LARGEST_BYTES: Final = 64 * 2**20
"""Size of the largest log file. Reading takes some 25 times as much memory; an hour of ten robots has 10 MB."""

MOST_S: Final = 1e7
"""Longest session."""
_ALLOWED: Final[dict[str, tuple[float, float, str]]] = {
    "robot": (0, 2**31, "a whole number from 0 on"),
    "energy": (0.0, 1e9, "a number from 0 to 1e9"),
    "x_m": (-1e4, 1e4, "a length within 10 km, in metres"),
    "y_m": (-1e4, 1e4, "a length within 10 km, in metres"),
    "time_s": (
        0.0,
        MOST_S,
        "a time since the start of the session, from 0 to 1e7 s; of other clocks subtract the first time (in a column "
        "map: first = 0)",
    ),
    "belief_below": (0.0, 1.0, "a probability"),
    "observation": (0, 1, "0 or 1: recordings have two kinds of tile"),
    "message": (0, 1, "0 or 1: recordings have two kinds of tile"),
    "decision": (-1, 1, "-1, 0 or 1: recordings have two kinds of tile"),
    "alpha": (1, 2**31, "a whole number from 1 on"),
    "beta": (1, 2**31, "a whole number from 1 on"),
    "sent": (0, 2**31, "a whole number from 0 on"),
    "messages_received": (0, 2**31, "a whole number from 0 on"),
    "avoid_total_s": (0.0, 1e9, "a time from 0 on"),
    "stop_total_s": (0.0, 1e9, "a time from 0 on"),
    "place_x_m": (-1e4, 1e4, "a length within 10 km, in metres"),
    "place_y_m": (-1e4, 1e4, "a length within 10 km, in metres"),
    "place_spread_m": (0.0, 1e4, "a length of 0 or more, in metres"),
}
"""Range of values of a column, and the range in words; columns whose least value is an int have whole numbers."""


_PREAMBLE: Final = re.compile(
    r"""\A(?:\s*(?:#[^\r\n]*|"?sep=.?"?[ \t]*)[\r\n]++(?!\s*[\d.+-]))+""", re.ASCII | re.IGNORECASE
)
"""Lines before the header: comments, and the separator as spreadsheets write it. A comment directly above numbers is
none: it is the header."""


def text_of(path: Path, what: str = "a log of one session", *, comments: bool = True) -> str:
    """Read the text of a log, or of another file that comes with it (column map, acceleration).

    A byte order mark is removed, and bytes that are not UTF-8 are replaced by U+FFFD. Lines before the header that are
    comments (``#``) or say the separator (``sep=,``) become empty.

    Args:
        path: of the file. what: the kind of file expected, for errors. comments: whether it may begin with such lines.
    Raises:
        InputError: it is not a plain file, larger than ``LARGEST_BYTES``, binary, or empty.
    """
    name = str(path)
    text = read_bytes(path, LARGEST_BYTES, what).decode("utf-8-sig", errors="replace")
    if "\0" in text[:4096]:  # text has no null characters; binary files have some near their start
        raise InputError("is a binary file, or text in UTF-16; give a text log in UTF-8", field=name)
    if comments:
        text = _PREAMBLE.sub(lambda found: "\n" * len(found[0].splitlines()), text)
    if not text.strip():
        raise InputError("is empty", field=name)
    return text


def table_of(text: str, name: str) -> tuple[pl.Series, pl.DataFrame]:
    """Parse CSV text with a header into a table of the file's columns; return it after the numbers of its lines.

    Cells stay strings. Lines without text in any cell are skipped. A name that the header repeats gets its column's
    number: "x", "x (3)".

    Args:
        name: of the file, for errors.
    Returns: for each row the number of the line on which it begins, from 1, as the series ``line``; and the table.
    Raises:
        InputError: it is not CSV, a row has another number of cells than the header, or names of the header cannot be
            told apart.
    """
    reader = csv.reader(text.splitlines())
    lines: list[int] = []
    rows: list[list[str]] = []
    try:
        header = next(filter(None, reader))
        head = [cell.strip() for cell in header]
        if len(head) == 1 and (mark := next((one for one in ";\t" if one in head[0]), "")):
            mark = "tabs" if mark == "\t" else f"'{mark}'"
            raise InputError(f"has {mark} between columns; use ',' there, and '.' in numbers", field=name)
        begins = reader.line_num + 1  # a quoted cell may have line breaks
        for row in reader:
            if any(row):  # spreadsheets write empty lines as ",,,"
                lines.append(begins)
                rows.append(row)
            begins = reader.line_num + 1
    except (csv.Error, StopIteration) as error:
        raise InputError(f"is not a CSV file: {error}", field=name) from None
    for number, row in zip(lines, rows, strict=True):
        if len(row) != len(head):
            raise InputError(
                f"{count(len(row), 'cell')}, but the header has {len(head)}", field=f"{name}, row {number}"
            )
        # The first cell alone rules out almost every row.
        if row[0].strip(" \ufeff") == head[0] and [cell.strip(" \ufeff") for cell in row] == head:
            raise InputError(
                "is the header again; leave it out, or if the file holds two sessions, give each its own file",
                field=f"{name}, row {number}",
            )
    names = [
        cell if head.index(cell) == place else f"{cell} ({place + 1})" for place, cell in enumerate(head)
    ]
    for place, cell in enumerate(names):
        if cell in names[:place]:
            raise InputError(f"has two columns '{cell}'; give them different names", field=name)
    # Without rows every column is empty.
    columns = list(zip(*rows, strict=True)) or [()] * len(head)
    frame = pl.DataFrame(
        {column: list(cells) for column, cells in zip(names, columns, strict=True)},
        schema=dict.fromkeys(names, pl.String),
    )
    return pl.Series("line", lines, dtype=pl.UInt32), frame


def check_columns(wanted: Mapping[str, str], there: list[str], name: str) -> None:
    """Check that a file has all columns that are read from it.

    Args:
        wanted: for each use (what the column is read as) the name of the column in the file.
        there: names of the columns that the file has. name: name of the file, for errors.
    Raises:
        InputError: a column is missing; the error names the first, and says how a log without it is read.
    """
    missing = [(use, column) for use, column in wanted.items() if column not in there]
    if missing:
        use, column = missing[0]
        others = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
        is_optional = use in USES and use not in REQUIRED
        without = "; if it was not logged, give a column map without it (--columns)" if is_optional else ""
        raise InputError(
            f"has no column '{column}'{nearest(column, there)}, needed for {use}{others}; it has "
            f"{some(list(map(repr, there)), 20)}{without}",
            field=name,
        )


def numbers_of(
    cells: pl.Series, lines: pl.Series, name: str, column: str, missing: tuple[str, ...], hint: str = ""
) -> pl.Series:
    """Convert a column of text to numbers; null where a cell is one of ``missing``.

    Args:
        cells: the texts. lines: number of each cell's line, for errors. name, column: of the file and of the column,
            for errors. missing: texts of empty cells. hint: ends the error of a text.
    Raises:
        InputError: a cell is neither a finite number nor one of ``missing``; the error names the row.
    """
    stripped = cells.str.strip_chars()
    empty = stripped.is_in(list(missing))
    numbers = stripped.cast(pl.Float64, strict=False)
    wrong = ~empty & ~numbers.is_finite().fill_null(False)
    words = f"in column '{column}' is not a number{hint}"
    _refuse_first(wrong, lines, name, lambda k: f"'{str(cells[k])[:40]}' {words}")
    return pl.select(pl.when(~empty).then(numbers)).to_series()


TIMESTAMP: Final = r"^\s*\d{4}-\d\d-\d\d[T ]"
"""Pattern of the beginning of a timestamp of ISO 8601, which a time may be instead of a number."""


def seconds_of(
    cells: pl.Series, lines: pl.Series, name: str, column: str, missing: tuple[str, ...]
) -> pl.Series:
    """Convert a column of timestamps of ISO 8601 to seconds since the earliest; null where a cell is missing.

    They have a date and seconds, with "T" or a space between; all have a zone, or none has.

    Args:
        cells, lines, name, column, missing: as for ``numbers_of``. At least one cell matches ``TIMESTAMP``.
    Raises:
        InputError: a cell is neither such a timestamp nor one of ``missing``; the error names the row.
    """
    stripped = cells.str.strip_chars()
    first = stripped.filter(stripped.str.contains(TIMESTAMP))[0]
    # The dash of a date is no sign of a zone.
    has_zone = re.search(r"(Z|[+-]\d\d(:?\d\d)?)$", first[len("2026-05-01") :]) is not None
    texts = stripped.str.replace(" ", "T", literal=True)
    times = texts.str.to_datetime("%FT%T%.f%#z" if has_zone else "%FT%T%.f", time_unit="us", strict=False)
    is_missing = stripped.is_in(list(missing))
    # A leap second is read as the second after it, so that times after it would be 1 s early.
    wrong = (times.is_null() | stripped.str.contains(r":\d\d:60")) & ~is_missing
    like = "2026-05-01T10:00:00.250Z" if has_zone else "2026-05-01T10:00:00.250"
    words = f"in column '{column}' is not a time such as {like} (seconds below 60; all times have a zone, or none has)"
    _refuse_first(wrong, lines, name, lambda k: f"'{str(cells[k])[:40]}' {words}")
    seconds = pl.select(pl.when(~is_missing).then(times)).to_series()
    seconds = (seconds - seconds.min()).dt.total_microseconds() / 1e6
    first_row = lines[seconds.arg_min() or 0]
    words = f"in column '{column}' is more than {stated(MOST_S)} s after the time of row {first_row}"
    _refuse_first(seconds > MOST_S, lines, name, lambda k: f"'{str(cells[k])[:40]}' {words}")
    return seconds


def _refuse_first(wrong: pl.Series, lines: pl.Series, name: str, words: Callable[[int], str]) -> None:
    """Raise an error about the first row that is wrong, if there is one.

    Args:
        wrong: whether each row is wrong. lines: number of each row's line. name: of the file. words: what is wrong with
            row number k of ``lines``.
    """
    if wrong.any():
        k = int(wrong.arg_true()[0])
        raise InputError(words(k), field=f"{name}, row {lines[k]}")


def check_values(values: pl.Series, lines: pl.Series, name: str, use: str, column: str) -> None:
    """Check that the numbers of a column are in the range of its use (``_ALLOWED``); missing values pass.

    A use that ``_ALLOWED`` does not have is not checked.

    Args:
        values: numbers of the column, after conversion. lines: number of each value's line, for errors.
        name: name of the file, for errors. use: column of ``log.SAMPLES`` that the numbers are for.
        column: name of the column in the file, for errors.
    Raises:
        InputError: a number is out of range, or not whole where it must be; the error names the first such row.
    """
    if use not in _ALLOWED:
        return
    low, high, words = _ALLOWED[use]
    wrong = (values < low) | (values > high)
    if isinstance(low, int):
        wrong |= values != values.round()
    said = f"in column '{column}' is not {words}"
    _refuse_first(wrong.fill_null(False), lines, name, lambda k: f"{stated(values[k])} {said}")


def plain_number(value: Any, what: str, name: str) -> float:
    """Return a value of a TOML file as a float, after checking that it is a finite number.

    Args:
        value: the value. what: its key, for errors. name: name of the file, for errors.
    Raises:
        InputError: it is not a finite number.
    """
    return float(number_of(value, f"{name}, {what}", -1e300))


_HINTS: Final = {
    "robot": "; give robots numbers (with lab import also in a column map: values = { ada = 0, bob = 1 })",
    "time_s": ", and not a time such as 2026-05-01T10:00:00.250Z",
}
"""What would be right in place of a text, by use."""
USES: Final = (*(name for name in SAMPLES if name != "line"), "tag")
"""Keys of ``[columns]`` in a column map."""


@dataclass(frozen=True)
class Column:
    """A column of the file, and how its cells are converted to numbers: cell * times + plus, or by ``values``."""

    name: str
    """Name of the column in the file."""
    times: float = 1.0
    """Factor of a number in the file."""
    plus: float = 0.0
    """Number that is added after the multiplication."""
    wraps_at: float | None = None
    """Value at which a counter returns to 0, in the file's unit; None: it does not."""
    values: Mapping[str, float] | None = None
    """The number for each text; None: cells are numbers. If it is given, no other key has an effect."""
    first: float | None = None
    """The least time of the file, s, in place of ``plus``; None: times count from the clock's 0."""


@dataclass(frozen=True)
class ColumnMap:
    """Instructions for reading a kind of CSV file."""

    name: str
    """Name of the format."""
    columns: Mapping[str, Column]
    """Columns of the file by use (``USES``)."""
    missing: tuple[str, ...] = ("", "None", "nan", "NaN")
    """Texts of empty cells."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Fields of the scenario that hold for every such file."""


@cache
def own_map(name: str) -> ColumnMap:
    """Return a column map of this package: "rugbot" (the study's robots) or "camera" (logs of ``lab track``)."""
    text = files("vibroswarm.recordings").joinpath(f"formats/{name}.toml").read_text(encoding="utf-8")
    return column_map(text, name)


def column_map(text: str, name: str, has_energies: bool = True) -> ColumnMap:
    """Parse a column map from TOML text.

    Args:
        name: of the file, for errors; also the map's name, unless the text sets one.
        has_energies: whether the column for energy is required. Without it all rows are tracking rows.
    Raises:
        InputError: invalid TOML, an unknown key or column, a value of another kind, or a required column missing.
    """
    values = parsed_toml(text, name)
    check_known_keys(values, f"column map {name}", ("missing", "columns", "settings", "name", "about"))
    columns = values.get("columns")
    if not isinstance(columns, dict):
        raise InputError("has no [columns]", field=name)
    by_use = {use: _column(use, value, name) for use, value in columns.items()}
    lacking = [use for use in REQUIRED if use not in columns and (has_energies or use != "energy")]
    if lacking:
        more = "; only with --acceleration it may be missing" if lacking[0] == "energy" else ""
        raise InputError(f"does not name the column for {lacking[0]}{more}", field=f"{name}, [columns]")
    if by_use["time_s"].first is not None and not has_energies:
        raise InputError(
            "times have to be those of the acceleration; leave first out", field=f"{name}, columns.time_s"
        )
    if ("alpha" in columns) != ("beta" in columns):
        raise InputError(
            "names a column for one of alpha and beta; name both or neither", field=f"{name}, [columns]"
        )
    if 0 < len(columns.keys() & set(OWN_PLACE)) < len(OWN_PLACE):
        raise InputError(
            f"names some of {', '.join(OWN_PLACE)}; name all or none", field=f"{name}, [columns]"
        )
    missing = values.get("missing", ["", "None", "nan", "NaN"])
    if not isinstance(missing, list) or not all(isinstance(text_value, str) for text_value in missing):
        raise InputError("must be a list of strings", field=f"{name}, missing")
    settings = values.get("settings", {})
    if not isinstance(settings, dict):
        raise InputError("must be a table of fields of the scenario", field=f"{name}, settings")
    return ColumnMap(
        name=str(values.get("name", name)),
        columns=by_use,
        missing=tuple(text_value.strip() for text_value in missing),
        settings=settings,
    )


def _column(use: str, value: Any, name: str) -> Column:
    """Parse the entry of one column: the name of a column of the file, or a table with ``name`` and other keys.

    Args:
        use: key of the entry. value: of the entry, as TOML gives it. name: of the file, for errors.
    Raises:
        InputError: an unknown use or key, or a value of another kind.
    """
    location = f"{name}, columns.{use}"
    if use not in USES:
        raise InputError(f"unknown column{nearest(use, USES)}", field=location)
    if isinstance(value, str):
        return Column(name=value)
    if not isinstance(value, dict) or not isinstance(value.get("name"), str):
        raise InputError(
            'must be the name of a column, or { name = "...", times = ..., plus = ... }', field=location
        )
    check_known_keys(value, location, ("name", "times", "plus", "wraps_at", "values", "first"))
    table = value.get("values")
    if table is not None and not isinstance(table, dict):
        raise InputError("values must be a table from text to number", field=location)
    wraps_at = value.get("wraps_at")
    if wraps_at is not None and use not in COUNTERS:
        raise InputError(
            f"only counters may wrap ({', '.join(COUNTERS)}); unwrap other columns in the file",
            field=location,
        )
    if wraps_at is not None and not plain_number(wraps_at, "wraps_at", location) > 0:
        raise InputError(f"{wraps_at} is not above 0", field=f"{location}, wraps_at")
    first = value.get("first")
    if first is not None and use != "time_s":
        raise InputError("only time_s has first, the time of the file's earliest row", field=location)
    if first is not None and "plus" in value:
        raise InputError("has first and plus; give one of them", field=location)
    numbers = (
        None if table is None else {key: plain_number(number, key, location) for key, number in table.items()}
    )
    return Column(
        name=value["name"],
        times=plain_number(value.get("times", 1.0), "times", location),
        plus=plain_number(value.get("plus", 0.0), "plus", location),
        wraps_at=None if wraps_at is None else plain_number(wraps_at, "wraps_at", location),
        values=numbers,
        first=None if first is None else plain_number(first, "first", location),
    )


def read_mapped(path: Path, by: ColumnMap) -> Log:
    """Read a CSV file as a log, by a column map.

    Args:
        path: of the file. by: the column map.
    Raises:
        InputError: a column is missing, a required cell is empty, text stands in place of a number, a value is
            impossible, or a robot has two tags; the error names the row.
    """
    name = str(path)
    names = {use: column.name for use, column in by.columns.items()}
    marks_header = any(column.startswith("#") for column in names.values())
    lines, table = table_of(text_of(path, comments=not marks_header), name)
    check_columns(names, table.columns, name)
    columns: dict[str, pl.Series] = {"line": lines}
    for use, column in by.columns.items():
        columns[use] = _converted(table[column.name], lines, name, use, column, by.missing)
    for use in ("robot", "time_s", "x_m", "y_m"):
        _check_there(columns[use], lines, name, by.columns[use].name)
    if "alpha" in columns:
        half = columns["alpha"].is_null() != columns["beta"].is_null()
        _refuse_first(half, lines, name, lambda k: "has one of alpha and beta; give both or neither")
    _check_tags(columns, name)
    is_sample = (
        columns["energy"].is_not_null() if "energy" in columns else pl.repeat(False, lines.len(), eager=True)
    )
    for use in set(OWN_PLACE) & columns.keys() if "energy" in columns else ():
        _check_there(columns[use].filter(is_sample), lines.filter(is_sample), name, by.columns[use].name)
    frame = pl.DataFrame({use: values.alias(use) for use, values in columns.items() if use != "tag"})
    samples, tracks = frame.filter(is_sample), frame.filter(~is_sample)
    # Converted to the unit of the log's column.
    wraps_at = {
        use: column.wraps_at * column.times
        for use, column in by.columns.items()
        if column.wraps_at is not None
    }
    return Log(
        name=path.name,
        reader=by.name,
        samples=log_frame(samples.to_dict(), SAMPLES),
        tracks=log_frame({use: tracks[use] for use in TRACKS if use in tracks.columns}, TRACKS),
        wraps_at=wraps_at,
        settings=by.settings,
        counts={"rows": table.height},
        has_timestamps=by.columns["time_s"].values is None
        and has_timestamps(table[by.columns["time_s"].name]),
    )


def has_timestamps(cells: pl.Series) -> bool:
    """Return whether any of these texts is a timestamp."""
    return bool(cells.str.contains(TIMESTAMP).any())


def _converted(
    cells: pl.Series, lines: pl.Series, name: str, use: str, column: Column, missing: tuple[str, ...]
) -> pl.Series:
    """Convert one column to numbers: scaled and shifted, or looked up in its ``values``; missing cells become null.

    Args:
        cells: texts of the file. lines: number of each cell's line, for errors. name: of the file, for errors.
        use: one of ``USES``, for the check of the range. column: its entry in the column map.
        missing: texts of empty cells.
    Raises:
        InputError: a cell is not a number, not one of ``values``, or out of range; the error names the row.
    """
    if use == "time_s" and column.values is None and has_timestamps(cells):
        numbers = seconds_of(cells, lines, name, column.name, missing)
        numbers += column.plus if column.first is None else column.first
    elif column.values is None:
        numbers = numbers_of(cells, lines, name, column.name, missing, _HINTS.get(use, ""))
        if column.first is not None:
            numbers = (numbers - numbers.min()) * column.times + column.first
        elif (column.times, column.plus) != (1.0, 0.0):
            numbers = numbers * column.times + column.plus
    else:
        keys = cells.str.strip_chars().str.replace(r"\.0$", "")  # a spreadsheet writes 1 as 1.0
        unknown = ~keys.is_in(list(column.values)) & ~keys.is_in(list(missing))
        words = f"in column '{column.name}' is not one of {', '.join(column.values)}"
        _refuse_first(unknown, lines, name, lambda k: f"'{str(cells[k])[:40]}' {words}")
        numbers = keys.replace_strict(dict(column.values), default=None, return_dtype=pl.Float64)
    check_values(numbers, lines, name, use, column.name)
    return numbers


def _check_there(numbers: pl.Series, lines: pl.Series, name: str, column: str) -> None:
    """Refuse the first empty cell (null) of a converted column."""
    _refuse_first(numbers.is_null(), lines, name, lambda k: f"empty cell in column '{column}'")


def _check_tags(found: Mapping[str, pl.Series], name: str) -> None:
    """Check that each robot has the same tag (marker) in all rows that have one.

    Args:
        found: converted columns by use. name: of the file.
    Raises:
        InputError: a robot has two different tags; the error names the first row that differs.
    """
    if "tag" not in found:
        return
    pairs = pl.DataFrame({use: found[use].alias(use) for use in ("line", "robot", "tag")}).drop_nulls()
    first_tags = pairs.group_by("robot", maintain_order=True).agg(pl.col("tag").first().alias("first"))
    differing = pairs.join(first_tags, on="robot", maintain_order="left").filter(
        pl.col("tag") != pl.col("first")
    )
    if differing.height:
        line, robot, tag, first_tag = differing.row(0)
        raise InputError(
            f"robot {robot:g} has marker {tag:g}, but marker {first_tag:g} in earlier rows; a robot has one marker, "
            "so the robot's number or the marker is wrong",
            field=f"{name}, row {line}",
        )
