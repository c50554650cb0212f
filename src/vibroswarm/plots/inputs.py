"""Checks of the frames that pictures draw, and values of runs by cell and series, for boxes.

The runs of one cell and series are a group. A run without a value is undecided. If the end of the runs is known, an
undecided run counts as later than the end. A quantile is then exact if it falls among the decided runs; if it falls
among the undecided ones, it is later than the end as well, and drawn in a shaded band right of the end.
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
    crowded,
    lay_out,
    legend_below,
    number,
    of_runs,
    patch_handle,
    rows_of,
    share,
)
from vibroswarm.plots.style import BAND, FAINT, SERIES_UP_TO, Look, Style, looks_of, row_looks

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
    """Check the columns of a frame, and convert numbers to Float64 (NaN becomes null) and texts to String.

    Columns of booleans, and of nulls alone, count as columns of numbers too. A missing text becomes "(no name)".

    Args:
        frame: one row per mark, or per run.
        numbers: required columns of numbers. texts: required columns that are converted to text.
        other: required columns of any type, which are not changed.
        optional_numbers: columns of numbers that are added, filled with nulls, if the frame does not have them.
        complete: columns among ``numbers`` that must not have missing values.
    Returns:
        The frame with these columns, and with all its other columns unchanged.
    Raises:
        InputError: the frame has no rows or lacks a column; or a column of numbers holds something else, an infinite
            number, or a missing number although it must be complete.
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

    A frame without the column gets one series with an empty name. A missing name becomes "(no name)".

    Raises:
        InputError: there are more series than markers, so that they could not be distinguished.
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
    """Check that no two rows have the same values in ``columns``: they would be drawn at the same place.

    Raises:
        InputError: there are such rows; the message has the values of the first.
    """
    repeated = frame.filter(pl.struct(*columns).is_duplicated())
    if repeated.height:
        # an empty name is not shown: ``with_series`` gives it if the frame has no column of series
        values = ", ".join(f"{name} {repeated[name][0]}" for name in columns if repeated[name][0] != "")
        raise InputError(f"two rows have {values}; each place holds one", field=columns[0])


def check_bounds(frame: pl.DataFrame, low: str, middle: str, high: str) -> None:
    """Check that each interval contains its estimate, except for rounding errors.

    Missing values are not checked.

    Args:
        frame: one row per interval. low, middle, high: names of the columns of lower limit, estimate and upper limit.
    Raises:
        InputError: an estimate is outside its interval.
    """
    slack = 1e-9 + 1e-9 * pl.col(middle).abs()
    outside = frame.filter((pl.col(low) > pl.col(middle) + slack) | (pl.col(high) < pl.col(middle) - slack))
    if outside.height:
        row = outside.row(0, named=True)
        raise InputError(f"{row[middle]} does not lie in [{row[low]}, {row[high]}]", field=middle)


def run_counts(frame: pl.DataFrame, column: str = "runs") -> list[int]:
    """Return the numbers of runs in a column, for a caption; nulls are left out.

    The list is empty if the frame does not have the column.
    """
    if column not in frame.columns:
        return []
    return [int(count) for count in frame[column].drop_nulls().to_list()]


def most(*columns: pl.Series, otherwise: float = 0.0) -> float:
    """Return the greatest number in some columns, or ``otherwise`` if they have no numbers."""
    values = [value for column in columns for value in column.drop_nulls().to_list()]
    return float(max(values)) if values else otherwise


BAND_SHARE = 0.07
"""Width of the band after the end of the runs, relative to the axis before it."""


class Group(NamedTuple):
    """The runs of one cell and series."""

    cell: str
    series: str
    row: int
    """Index of the cell, from the top."""
    series_index: int
    """Index of the series, in order of appearance."""
    values: NDArray[np.float64]
    """Values of the decided runs, sorted."""
    runs: int
    """Number of runs, including undecided ones."""

    @property
    def undecided(self) -> int:
        """Number of runs without a value."""
        return self.runs - self.values.size


class Plane(NamedTuple):
    """Rows of cells, with a band for undecided runs at the right if the end is known."""

    rows: Rows
    groups: list[Group]
    series: list[str]
    """Names of the series."""
    end: float | None
    """End of the runs, if it is known."""
    in_band: float
    """x at which values later than the end are drawn, in the middle of the band; not used if the end is unknown."""
    looks: list[Look]
    """Looks of the series."""
    of_rows: dict[str, Look]
    """Looks by cell if there is one series and cells are named after strategies; else empty."""

    def place(self, group: Group) -> float:
        """Return y of a group."""
        return self.rows.place(group.row, group.series_index, len(self.series))

    def look(self, group: Group) -> Look:
        """Return the look of a group."""
        return self.of_rows.get(group.cell, self.looks[group.series_index])

    def at(self, value: float | None) -> float:
        """Return x of a quantile; None stands for a quantile later than the end, which is drawn in the band."""
        return self.in_band if value is None else value


def quantile(group: Group, q: float, *, censored: bool) -> float | None:
    """Return a quantile of a group's runs, interpolated linearly between neighbouring runs.

    Args:
        group: the runs.
        q: which quantile, 0 to 1.
        censored: whether undecided runs count as later than all others; if not, they are left out.
    Returns:
        The quantile; None if one of the neighbouring runs is undecided, or if there are no runs.
    """
    size = group.runs if censored else group.values.size
    if size == 0:
        return None
    place = q * (size - 1)  # among the sorted runs, from 0; undecided runs are the last
    low, high = math.floor(place), math.ceil(place)
    if high >= group.values.size:  # an undecided run
        return None
    return float(group.values[low] + (place - low) * (group.values[high] - group.values[low]))


def plane_of(
    style: Style, frame: pl.DataFrame, label: str, t_end: float | None, missing: str, title: str
) -> Plane:
    """Make the figure for boxes, and split the runs into groups.

    The rows, the axis, the band for undecided runs and the shares of undecided runs are drawn; the caller draws the
    boxes. ``style`` has the sizes of the picture; the other arguments are those of ``draw_boxes``.

    Raises:
        InputError: the frame is not as ``draw_boxes`` describes it, or a value is later than ``t_end``.
    """
    frame, series = with_series(tidy(frame, numbers=("value",), texts=("cell",)))
    groups = _groups(frame, series)
    latest = max((group.values[-1] for group in groups if group.values.size), default=None)
    if t_end is not None and latest is not None and latest > t_end:
        raise InputError(f"holds {latest:g}, later than the end at {t_end:g}", field="value")
    cells = frame["cell"].unique(maintain_order=True).to_list()
    named = series if len(series) > 1 else []
    rows = rows_of(style, cells, label, series=len(series), title=title)
    of_rows = {} if named else row_looks(cells)  # looks by cell: colours show the series if there are several
    plane = Plane(
        rows=rows,
        groups=groups,
        series=series,
        end=t_end,
        in_band=0.0,  # set in the next line, since it follows from the limits of the axis
        looks=looks_of(series),
        of_rows=of_rows,
    )
    plane = plane._replace(in_band=_limits(plane, style))
    _write_shares(plane, missing)
    return plane


def _groups(frame: pl.DataFrame, series: Sequence[str]) -> list[Group]:
    """Split the frame into groups, the runs of one cell and series.

    The groups are sorted by cell, then by series, both in order of appearance. ``series`` has the names of the series.
    """
    row_of = {cell: row for row, cell in enumerate(frame["cell"].unique(maintain_order=True))}
    groups = []
    for (cell, name), part in frame.group_by("cell", "series", maintain_order=True):
        values = np.sort(part["value"].drop_nulls().to_numpy())
        groups.append(
            Group(
                cell=str(cell),
                series=str(name),
                row=row_of[cell],
                series_index=series.index(str(name)),
                values=values,
                runs=part.height,
            )
        )
    return sorted(groups, key=lambda group: (group.row, group.series_index))


def _limits(plane: Plane, style: Style) -> float:
    """Set the limits and ticks of the axis, and draw the band for undecided runs if the end of the runs is known.

    Returns:
        x of the middle of the band. If the end is unknown, there is no band, and the result is not used.
    """
    values = np.concatenate([group.values for group in plane.groups])
    axes = plane.rows.axes
    low = float(values.min()) if values.size else 0.0
    high = plane.end if plane.end is not None else (float(values.max()) if values.size else 1.0)
    if 0 <= low <= 0.5 * high:  # the axis starts at 0 unless all values are far from it
        low = 0.0
    span = (high - low) or abs(high) or 1.0  # above 0, also if all values are equal
    left = low - (0.02 if low == 0 else 0.04) * span  # a margin, so that no mark lies on the edge
    if plane.end is None:
        axes.set_xlim(left, high + 0.04 * span)
        return high
    band = BAND_SHARE * span
    axes.axvspan(high, high + band, color=BAND, linewidth=0, zorder=0)
    axes.axvline(high, color=FAINT, linewidth=axes.spines["bottom"].get_linewidth(), zorder=0.5)
    axes.set_xlim(left, high + band)
    # The end gets a tick. The last of the other ticks are left out where labels would overlap.
    ticks = [tick for tick in axes.get_xticks() if left <= tick < high]
    axes.set_xticks([*ticks, high], labels=[number(tick, 4) for tick in [*ticks, high]])
    lay_out(plane.rows.figure)
    while ticks and crowded(axes.xaxis):
        ticks.pop()
        axes.set_xticks([*ticks, high], labels=[number(tick, 4) for tick in [*ticks, high]])
    return high + band / 2


def _write_shares(plane: Plane, missing: str) -> None:
    """Write the share of undecided runs right of each group, under the heading ``missing`` (the word for undecided).

    If all runs of all groups are decided, nothing is written.
    """
    if not any(group.undecided for group in plane.groups):
        return
    for group in plane.groups:
        plane.rows.note(plane.place(group), share(group.undecided, group.runs))
    plane.rows.heading(missing)


def series_legend(plane: Plane, style: Style, *, marks: bool = False) -> None:
    """Draw a legend of the series below the axes; with one series, draw nothing.

    It shows the hatch of each series or, if ``marks``, its marker.
    """
    from matplotlib.lines import Line2D

    if len(plane.series) < 2:
        return
    handles: list[Any] = [
        Line2D([], [], ls="", marker=one.marker, markeredgecolor=one.colour, markerfacecolor="none")
        if marks
        else patch_handle(style, one, edge=one.colour, filled=False)
        for one in plane.looks
    ]
    legend_below(plane.rows.figure, style, handles, plane.series)


def group_caption(plane: Plane, missing: str) -> str:
    """Write the part of a caption with the number of runs, how many of them have no value, and how those are drawn.

    ``missing`` is the word for a run without a value, such as "undecided".
    """
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
