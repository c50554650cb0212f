"""Show and draw tables of cells in two forms: as the paper does, and with intervals over runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.paper.item import Drawn, Picture, TableView
from vibroswarm.plots import draw_error_bars
from vibroswarm.report.html import Column

TIME, BELIEF = "decision time (s)", "belief in the truth"

PAPERS_FORM: Final = {
    "printed_s": Column("printed", "s"),
    "decision_time_s": Column("mean decision time", "s"),
    "decision_time_s_bar": Column("its bar", "s", digits=2),
    "belief_in_truth": Column("mean belief in the truth (the paper's accuracy)"),
    "belief_in_truth_bar": Column("its bar", digits=2),
}
PROPER_FORM: Final = {
    "decision_time_s": Column("restricted mean time", "s"),
    "decision_time_s_low": Column("from", "s"),
    "decision_time_s_high": Column("to", "s"),
    "robots_right": Column("robots right", percent=True),
    "robots_right_low": Column("from", percent=True),
    "robots_right_high": Column("to", percent=True),
    "robots_wrong": Column("wrong", percent=True),
    "robots_wrong_low": Column("from", percent=True),
    "robots_wrong_high": Column("to", percent=True),
    "robots_undecided": Column("undecided", percent=True),
    "robots_undecided_low": Column("from", percent=True),
    "robots_undecided_high": Column("to", percent=True),
}
WALK_FORM: Final = {
    f"{name}{end}": Column(title if not end else {"_low": "from", "_high": "to"}[end], unit)
    for name, title, unit in (
        ("avoid_per_sample_s", "avoidance per sample", "s"),
        ("distance_m", "distance between samples", "m"),
    )
    for end in ("", "_low", "_high")
}
PAPERS_CAPTION: Final = (
    "As in the paper: undecided robots count with the time of the end, accuracy is the belief in the truth, "
    "and a bar is the standard deviation over robots divided by the root of the number of runs."
)
PROPER_CAPTION: Final = (
    "Corrected: the run is the unit, with 95 % intervals over runs and the shares of robots by outcome, "
    "undecided ones included."
)


def two_forms(table: str, keys: Sequence[str], walk: bool = False) -> tuple[TableView, ...]:
    """Return views of a table of cells in the paper's form and in the proper form."""
    heads = {key: Column(key) for key in keys} | {"runs": Column("runs")}
    more = WALK_FORM if walk else {}
    return (
        TableView(table, PAPERS_CAPTION, heads | PAPERS_FORM),
        TableView(table, PROPER_CAPTION, heads | PROPER_FORM | more),
    )


def bars(frame: pl.DataFrame, name: str) -> pl.DataFrame:
    """Add the paper's error bars of a figure as ``estimate``, ``low`` and ``high``."""
    return frame.with_columns(
        estimate=pl.col(name),
        low=pl.col(name) - pl.col(f"{name}_bar"),
        high=pl.col(name) + pl.col(f"{name}_bar"),
    )


def limits(frame: pl.DataFrame, name: str) -> pl.DataFrame:
    """Add the interval of a figure as ``estimate``, ``low`` and ``high``."""
    return frame.with_columns(
        estimate=pl.col(name), low=pl.col(f"{name}_low"), high=pl.col(f"{name}_high")
    ).with_columns(low=pl.min_horizontal("low", "estimate"), high=pl.max_horizontal("high", "estimate"))


FIGURES: Final = (
    ("decision_time_s", TIME, "papers", "time, as the paper defines it"),
    ("belief_in_truth", BELIEF, "papers", "accuracy, as the paper defines it"),
    ("decision_time_s", TIME, "proper", "time, with intervals over runs"),
    ("robots_right", "robots right", "proper", "robots that decide rightly"),
    ("robots_wrong", "robots wrong", "proper", "robots that decide wrongly"),
    ("robots_undecided", "robots undecided", "proper", "robots that never decide"),
)
"""Pictures of both forms: figure, label, form, title."""
ALSO: Final = (FIGURES[0][3], FIGURES[1][3], FIGURES[4][3])
"""Titles of the pictures that are drawn for the columns after the first."""
WALK_FIGURES: Final = (
    ("avoid_per_sample_s", "avoidance per sample (s)", "proper", "avoidance per sample"),
    ("distance_m", "distance between samples (m)", "proper", "distance between samples"),
)


def both_forms(
    name: str,
    whole: pl.DataFrame,
    columns: Sequence[str],
    x: str,
    x_label: str,
    series: str,
    figures: Sequence[tuple[str, str, str, str]] = FIGURES,
    constant: Sequence[str] = (),
) -> Iterator[Picture]:
    """Yield pictures of figures over ``x`` for each column: as the paper draws them, and with intervals over runs.

    Args:
        constant: series that do not depend on x.
    """
    for place, column in enumerate(columns):
        part = whole.filter(pl.col("column") == column)
        if part.is_empty():
            continue
        for figure, label, form, title in (
            figures if place == 0 else [entry for entry in figures if entry[3] in ALSO]
        ):
            short = figure.removesuffix("_s").removesuffix("_m").replace("_", "-")
            draw = partial(_draw, part, figure, label, form, x, x_label, series, constant)
            yield Picture(f"{name}-{column}-{short}-{form}", f"{column}: {title}", draw, place > 0)


def _draw(
    part: pl.DataFrame,
    figure: str,
    label: str,
    form: str,
    x: str,
    x_label: str,
    series: str,
    constant: Sequence[str],
) -> Drawn:
    """Draw a figure over ``x`` with a line for each value of ``series``."""
    intervals = bars(part, figure) if form == "papers" else limits(part, figure)
    frame = intervals.select(
        "estimate", "low", "high", "runs", x=pl.col(x), series=pl.col(series).cast(pl.String)
    ).sort("x", maintain_order=True)
    interval = PAPERS_BAR if form == "papers" else "95 % interval"
    percent = figure.startswith("robots")
    order = {
        name: place for place, name in enumerate(part[series].cast(pl.String).unique(maintain_order=True))
    }
    frame = frame.sort(pl.col("series").replace_strict(order, return_dtype=pl.Int64), "x")
    return draw_error_bars(
        frame, x_label=x_label, label=label, interval=interval, percent=percent, constant=constant
    )


PAPERS_BAR: Final = "the paper's bar (sd over robots / root of runs)"
