"""Checks of the frames that pictures draw, and values of runs by cell and series, for boxes and violins.

A run without a value is undecided. If the end of the runs is known, an undecided run counts as later than that: a
quantile is exact if it falls among the decided runs, and is otherwise also later than the end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError, nearest
from vibroswarm.plots.layout import (
    Rows,
    hatched,
    legend_below,
    legend_lines,
    number,
    of_runs,
    rows_of,
    share,
    width_pt,
)
from vibroswarm.plots.style import BAND, FAINT, PAPER, SERIES_UP_TO, Look, Style, looks_of, row_looks

SERIES = "series"


def tidy(
    frame: pl.DataFrame,
    *,
    numbers: Sequence[str] = (),
    texts: Sequence[str] = (),
    other: Sequence[str] = (),
    optional_numbers: Sequence[str] = (),
    complete: Sequence[str] = (),
) -> pl.DataFrame:
    """Return the frame with numbers as Float64 (NaN becomes null) and texts as String, checked.

    Args:
        frame: one row per mark, or per run.
        numbers: required columns of numbers. texts: required columns.
        other: required columns of any type.
        optional_numbers: columns that are filled with nulls if they are missing.
        complete: those of ``numbers`` in which nothing may be missing.

    Raises:
        InputError: no rows, a column missing or of the wrong kind, an infinite or a missing number.
    """
    for name in (*numbers, *texts, *other):
        if name not in frame.columns:
            have = ", ".join(frame.columns) or "none"
            raise InputError(
                f"the frame has no such column{nearest(name, frame.columns)}; it has: {have}", field=name
            )
    if frame.is_empty():
        raise InputError("the frame has no rows; there is nothing to draw")
    tidied = frame.with_columns(
        pl.lit(None, dtype=pl.Float64).alias(name) for name in optional_numbers if name not in frame.columns
    )
    number_columns = (*numbers, *optional_numbers)
    for name in number_columns:
        if not (tidied.schema[name].is_numeric() or tidied.schema[name] in (pl.Null, pl.Boolean)):
            raise InputError(f"holds {tidied.schema[name]}, not numbers", field=name)
    tidied = tidied.with_columns(
        *(pl.col(name).cast(pl.Float64).fill_nan(None) for name in number_columns),
        *(pl.col(name).cast(pl.String).fill_null("(no name)") for name in texts),
    )
    for name in number_columns:
        if tidied[name].is_infinite().any():
            raise InputError("holds an infinite number; leave null where there is no value", field=name)
    for name in complete:
        if tidied[name].has_nulls():
            raise InputError("holds a missing number where one is needed", field=name)
    return tidied


def with_series(frame: pl.DataFrame) -> tuple[pl.DataFrame, list[str]]:
    """Return the frame with a text column ``series``, and the names of the series in order of appearance.

    A frame without the column gets one series with an empty name.

    Raises:
        InputError: more series than there are marks to tell them apart.
    """
    if SERIES not in frame.columns:
        return frame.with_columns(pl.lit("").alias(SERIES)), [""]
    frame = frame.with_columns(pl.col(SERIES).cast(pl.String).fill_null("(no name)"))
    names = frame[SERIES].unique(maintain_order=True).to_list()
    if len(names) > SERIES_UP_TO:
        raise InputError(
            f"{len(names)} series cannot be distinguished; at most {SERIES_UP_TO}: put some of them into cells",
            field=SERIES,
        )
    return frame, names


def check_once(frame: pl.DataFrame, columns: Sequence[str]) -> None:
    """Refuse a frame in which two rows would be drawn at the same place.

    Raises:
        InputError: two rows are alike in ``columns``.
    """
    twice = frame.filter(pl.struct(*columns).is_duplicated())
    if twice.height:
        at = ", ".join(f"{name} {twice[name][0]}" for name in columns if twice[name][0] != "")
        raise InputError(f"two rows have {at}; each place holds one", field=columns[0])


def check_bounds(frame: pl.DataFrame, low: str, middle: str, high: str) -> None:
    """Refuse intervals that do not contain their estimate, except for rounding errors.

    Raises:
        InputError: an estimate is outside its interval.
    """
    slack = 1e-9 + 1e-9 * pl.col(middle).abs()
    outside = frame.filter((pl.col(low) > pl.col(middle) + slack) | (pl.col(high) < pl.col(middle) - slack))
    if outside.height:
        row = outside.row(0, named=True)
        raise InputError(f"{row[middle]} does not lie in [{row[low]}, {row[high]}]", field=middle)


def run_counts(frame: pl.DataFrame, column: str = "runs") -> list[int]:
    """Return the numbers of runs in the frame; empty if it has no such column or only nulls."""
    if column not in frame.columns:
        return []
    return [int(count) for count in frame[column].drop_nulls().to_list()]


def most(*columns: pl.Series, otherwise: float = 0.0) -> float:
    """Return the greatest number in some columns, or ``otherwise`` without any."""
    values = [value for column in columns for value in column.drop_nulls().to_list()]
    return float(max(values)) if values else otherwise


BAND_SHARE = 0.07
"""Width of the band after the end of the runs, relative to the axis before it."""


class Group(NamedTuple):
    """The runs of one cell and series; ``values`` are those decided, sorted."""

    cell: str
    series: str
    row: int
    series_index: int
    values: NDArray[np.float64]
    runs: int

    @property
    def undecided(self) -> int:
        """Runs without a value."""
        return self.runs - self.values.size


class Plane(NamedTuple):
    """Rows of cells, with a band for undecided runs at the right if the end is known."""

    rows: Rows
    groups: list[Group]
    series: list[str]
    end: float | None
    in_band: float
    """x of values later than the end."""
    looks: list[Look]
    """Of the series."""
    of_rows: dict[str, Look]
    """Looks of cells that are named after strategies, where there is one series."""

    def place(self, group: Group) -> float:
        """Return y of a group."""
        return self.rows.place(group.row, group.series_index, len(self.series))

    def look(self, group: Group) -> Look:
        """Return the look of a group."""
        return self.of_rows.get(group.cell, self.looks[group.series_index])

    def at(self, value: float | None) -> float:
        """Return x of a quantile; None, which is later than the end, is drawn in the band."""
        return self.in_band if value is None else value


def quantile(group: Group, q: float, *, censored: bool) -> float | None:
    """Return a quantile of a group's runs, linear between neighbours; None among the undecided, or without any run.

    Args:
        group: the runs.
        q: 0 to 1.
        censored: whether undecided runs count as later than all others; if not, they do not count.
    """
    size = group.runs if censored else group.values.size
    if size == 0:
        return None
    place = q * (size - 1)
    low, high = math.floor(place), math.ceil(place)
    if high >= group.values.size:
        return None
    return float(group.values[low] + (place - low) * (group.values[high] - group.values[low]))


def plane_of(
    style: Style, frame: pl.DataFrame, label: str, t_end: float | None, missing: str, title: str
) -> Plane:
    """Return the rows, groups and the band, for a frame of cell, series and value.

    Raises:
        InputError: the frame is not as described, or a value is later than ``t_end``.
    """
    frame, series = with_series(tidy(frame, numbers=("value",), texts=("cell",)))
    groups = _groups(frame, series)
    latest = max((group.values[-1] for group in groups if group.values.size), default=None)
    if t_end is not None and latest is not None and latest > t_end:
        raise InputError(f"holds {latest:g}, later than the end at {t_end:g}", field="value")
    cells = frame["cell"].unique(maintain_order=True).to_list()
    named = series if len(series) > 1 else []
    rows = rows_of(
        style, cells, label, series=len(series), title=title, furniture=legend_lines(style, named) + 1
    )
    of_rows = {} if named else row_looks(cells)
    plane = Plane(rows, groups, series, t_end, 0.0 if t_end is None else t_end, looks_of(series), of_rows)
    plane = plane._replace(in_band=_limits(plane, style))
    _write_shares(plane, missing)
    return plane


def _groups(frame: pl.DataFrame, series: Sequence[str]) -> list[Group]:
    """Split the frame into groups by cell and series."""
    row_of = {cell: row for row, cell in enumerate(frame["cell"].unique(maintain_order=True))}
    groups = []
    for (cell, name), part in frame.group_by("cell", "series", maintain_order=True):
        values = np.sort(part["value"].drop_nulls().to_numpy())
        groups.append(Group(str(cell), str(name), row_of[cell], series.index(str(name)), values, part.height))
    return sorted(groups, key=lambda group: (group.row, group.series_index))


def _limits(plane: Plane, style: Style) -> float:
    """Set the limits of the axis; return the largest value shown."""
    values = np.concatenate([group.values for group in plane.groups])
    axes = plane.rows.axes
    low = float(values.min()) if values.size else 0.0
    high = plane.end if plane.end is not None else (float(values.max()) if values.size else 1.0)
    if 0 <= low <= 0.5 * high:
        low = 0.0
    span = (high - low) or abs(high) or 1.0
    left = low - (0.02 if low == 0 else 0.04) * span
    if plane.end is None:
        axes.set_xlim(left, high + 0.04 * span)
        return high
    band = BAND_SHARE * span
    axes.axvspan(high, high + band, color=BAND, linewidth=0, zorder=0)
    axes.axvline(high, color=FAINT, linewidth=axes.spines["bottom"].get_linewidth(), zorder=0.5)
    axes.set_xlim(left, high + band)
    room = 2.2 * width_pt(number(high, 4), style.small_pt) / (style.width_in * 72) * span
    ticks = [tick for tick in axes.get_xticks() if left <= tick <= high - room]
    axes.set_xticks([*ticks, high], labels=[number(tick, 4) for tick in [*ticks, high]])
    return high + band / 2


def _write_shares(plane: Plane, missing: str) -> None:
    """Write the share of undecided runs at each group."""
    if not any(group.undecided for group in plane.groups):
        return
    for group in plane.groups:
        plane.rows.note(plane.place(group), share(group.undecided, group.runs))
    plane.rows.heading(missing)


def series_legend(plane: Plane, style: Style, *, marks: bool = False) -> None:
    """Name the series below, by their hatches, or by their marks where only runs are drawn."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if len(plane.series) < 2:
        return
    handles: list[Any] = [
        Line2D(
            [],
            [],
            ls="",
            marker=series_look.marker,
            markeredgecolor=series_look.colour,
            markerfacecolor="none",
        )
        if marks
        else Patch(
            facecolor=PAPER,
            edgecolor=series_look.colour,
            hatch=hatched(style, series_look.hatch),
            linewidth=style.line_pt,
        )
        for series_look in plane.looks
    ]
    legend_below(plane.rows.figure, style, handles, plane.series)


def group_caption(plane: Plane, missing: str) -> str:
    """Return the part of a caption on the number of runs and on those without a value."""
    counts = of_runs([group.runs for group in plane.groups])
    total, lost = sum(group.runs for group in plane.groups), sum(group.undecided for group in plane.groups)
    if not lost:
        return f"{counts}, none {missing}."
    tail = (
        f"they count as later than the end at {number(plane.end, 6)} (shaded)"
        if plane.end is not None
        else "they are not in the drawing"
    )
    return f"{counts}; {lost} of {total} are {missing}: {tail}, and their share stands at the right."
