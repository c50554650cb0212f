"""Columns of tables with figures of a cell (``statistics.figures``), what else is known of it, and with estimates."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import Estimate, number
from vibroswarm.show.document import Column, Table, limits_of
from vibroswarm.statistics.figures import BY_NAME, FIGURES, RunFigure
from vibroswarm.statistics.intervals import Interval

_NUMBERS: Final = {
    "runs": Column("runs"),
    "failed_runs": Column("failed runs"),
    "robots": Column("robots in all runs"),
    "t_end_s": Column("end of a run", "s"),
    "level": Column("level of intervals", share=True, decimals=0),
}


SIZES: Final = ("runs", "failed_runs", "robots", "t_end_s", "level")
"""Columns that are no figures: what those of a cell are computed from."""
MAP_CAPTION: Final = (
    "Maps of the tiles that robots have at the end, mean over robots: Brier score (0.25: knows nothing), AUC (0.5: "
    "knows nothing), distance between the centres of gravity of map and truth. Time to detection: from when on a robot "
    "believes with p_c that more vibrates than the boundary, on floors where this is so. 95 % intervals over runs."
)
"""What the figures of ``statistics.map_figures`` are."""


TIME_AND_ERROR: Final = {
    f"{axis}{end}": f"{figure}{end}"
    for axis, figure in (("time", "decision_time_s"), ("error", "forced_error"))
    for end in ("", "_low", "_high")
}
"""Columns of a picture of time against error, and the figures in them."""
WIDEST_MAP: Final = 16
"""Most columns of tiles of a map that is printed as text."""


def flat_row(values: Mapping[str, Any], *nested: str) -> dict[str, Any]:
    """Return values as one row of a table; those of the mappings ``nested`` become columns NAME_INNER at its end."""
    plain = {name: value for name, value in values.items() if name not in nested}
    inner = {name: values[name] or {} for name in nested}
    return plain | {f"{name}_{key}": value for name, each in inner.items() for key, value in each.items()}


def tile_lines(tiles: pl.DataFrame) -> str:
    """Write a map of tiles as lines of text: probabilities that they vibrate in percent, a wrong one with ``!``.

    Args:
        tiles: row, vibrating (the probability) and vibrates (the truth; null: not known), row by row.
    """
    cells = tiles.select(
        "row",
        text=pl.Series([number(100 * p, 0).rjust(3) for p in tiles["vibrating"]])
        + pl.when((pl.col("vibrating") > 0.5) != (pl.col("vibrates") == 1))
        .then(pl.lit("!"))
        .otherwise(pl.lit(" ")),
    )
    return "\n".join(cells.group_by("row", maintain_order=True).agg(pl.col("text").str.join(" "))["text"])


def with_limits_of(names: Iterable[str], columns: Collection[str]) -> list[str]:
    """Return the names of figures, each followed by those of its limits if a table has them."""
    return [each for name in names for each in (name, *limits_of(name)) if each in columns]


def column_of(figure: RunFigure) -> Column:
    """Return the format of a figure: seconds without decimals, shares in percent, others with three decimals."""
    if figure.unit == "s":
        return Column(figure.title, "s", decimals=0)
    if figure.is_share:
        return Column(figure.title, share=True)
    return Column(figure.title, figure.unit, decimals=3)


def figure_columns(wide: Collection[str] = ()) -> dict[str, Column]:
    """Return the formats of all figures of a cell; a terminal prints those named in ``wide`` on request only."""
    formats = {figure.name: column_of(figure) for figure in FIGURES} | _NUMBERS
    formats["error"] = column_of(BY_NAME["robots_wrong"])
    return {name: replace(column, wide=name in wide) for name, column in formats.items()}


def answers_table(judged: pl.DataFrame, names: int = 0, more: str = "") -> list[Table]:
    """Tabulate how right answers were over time (``statistics.answers_over_time``); nothing if none of that is known.

    Args:
        names: number of columns that say whose answers they are. more: end of the caption.
    """
    known = judged.select(column for column in judged if column.count())
    if known.width <= names:
        return []
    caption = f"Answers over time: shares right when given, and delays after a change{more}."
    return [Table(known, figure_columns(), caption, name="answers", names=max(names, 1))]


def map_table(rows: pl.DataFrame, names: Mapping[str, Column]) -> Table:
    """Tabulate how good robots' maps are, and how soon they detect (``statistics.map_figures``).

    Args:
        names: formats of the columns that say whose maps they are.
    """
    return Table(
        rows, {**figure_columns(("runs",)), **names}, caption=MAP_CAPTION, name="maps", names=len(names)
    )


def estimate_of(interval: Interval | None, scale: float = 1.0) -> Estimate:
    """Return an estimate with its limits; a single session has no limits, and None becomes nan."""
    if interval is None:
        return Estimate(math.nan, math.nan, math.nan)
    low, high = (math.nan, math.nan) if interval.n == 1 else (interval.low, interval.high)
    return Estimate(scale * interval.estimate, scale * low, scale * high)


def columns_of(name: str, interval: Interval | None) -> dict[str, float]:
    """Return an estimate and its limits as the columns NAME, NAME_low and NAME_high."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), estimate_of(interval), strict=True))
