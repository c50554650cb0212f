"""Show and draw tables of cells in two forms, the paper's form and the proper form.

In the paper's form, undecided robots count with the time of the end, and error bars are standard deviations over robots
divided by the square root of the number of runs. In the proper form, a figure has its 95 % interval over runs.

A cell is a scenario that is run many times. A table of cells (``item.Work.rows``) has one row per cell with its
figures, such as ``decision_time_s``. For each figure NAME the columns NAME_low and NAME_high are its limits. Figures of
the paper's form also have the column NAME_bar, the paper's error bar. A "column of the reproduction" is a preset; the
table has it in its column ``column``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import polars as pl

from vibroswarm.paper.item import Picture, TableView, picture
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column

TIME, BELIEF = "decision time (s)", "belief in the truth"
"""Labels of axes."""

PAPERS_FORM: Final = {
    "printed_s": Column("printed", "s"),
    "decision_time_s": Column("mean decision time", "s"),
    "decision_time_s_bar": Column("its bar", "s"),
    "belief_in_truth": Column("mean belief in the truth (the paper's accuracy)"),
    "belief_in_truth_bar": Column("its bar"),
}
"""Columns of the paper's form, without those that name the cell."""
PROPER_FORM: Final = {
    name: Column(title, unit, share=not unit, limits=(f"{name}_low", f"{name}_high"))
    for name, title, unit in (
        ("decision_time_s", "restricted mean time", "s"),
        ("robots_right", "robots right", ""),
        ("robots_wrong", "wrong", ""),
        ("robots_undecided", "undecided", ""),
    )
}
"""Columns of the proper form, without those that name the cell."""
WALK_FORM: Final = {
    name: Column(title, unit, limits=(f"{name}_low", f"{name}_high"))
    for name, title, unit in (
        ("avoid_per_sample_s", "avoidance per sample", "s"),
        ("distance_m", "distance between samples", "m"),
    )
}
"""Columns of how robots walked."""
PAPERS_CAPTION: Final = (
    "As in the paper: undecided robots count with the time of the end, accuracy is the belief in the truth, "
    "and a bar is the standard deviation over robots divided by the root of the number of runs."
)
"""Caption of tables in the paper's form."""
PROPER_CAPTION: Final = (
    "Corrected: the run is the unit, with 95 % intervals over runs and the shares of robots by outcome, "
    "undecided ones included."
)
"""Caption of tables in the proper form."""


def two_forms(keys: Sequence[str], walk: bool = False) -> tuple[TableView, ...]:
    """Return two views of the table ``cells``: in the paper's form, and in the proper form.

    The report skips columns of a view that the table does not have, such as ``printed_s``, which few tables have.

    Args:
        keys: its columns that name the cell, shown first.
        walk: whether the proper form also shows how robots walked.
    """
    first_columns = {key: Column(key) for key in keys} | {"runs": Column("runs")}
    walk_columns = WALK_FORM if walk else {}
    return (
        TableView("cells", PAPERS_CAPTION, first_columns | PAPERS_FORM),
        TableView("cells", PROPER_CAPTION, first_columns | PROPER_FORM | walk_columns),
    )


def bars(frame: pl.DataFrame, name: str) -> pl.DataFrame:
    """Return a table of cells with three more columns: a figure (``estimate``) with the paper's error bars.

    ``low`` and ``high`` are the ends of the error bars.

    Args:
        frame: table of cells, with the columns NAME and NAME_bar. name: the figure's NAME.
    """
    return frame.with_columns(
        estimate=pl.col(name),
        low=pl.col(name) - pl.col(f"{name}_bar"),
        high=pl.col(name) + pl.col(f"{name}_bar"),
    )


def limits(frame: pl.DataFrame, name: str) -> pl.DataFrame:
    """Return a table of cells with three more columns: a figure (``estimate``) with its interval.

    ``low`` and ``high`` are the limits of the interval. A limit that is missing, or lies on the wrong side of the
    estimate (``draw_error_bars`` refuses such limits), is replaced by the estimate, so that no bar is drawn on this
    side.

    Args:
        frame: table of cells, with the columns NAME, NAME_low and NAME_high. name: the figure's NAME.
    """
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
"""Pictures of a table of cells. Of each: column of the table that is drawn, label of its axis, form ("papers" or
"proper") and title."""
ALSO: Final = (FIGURES[0][3], FIGURES[1][3], FIGURES[4][3])
"""Titles of the pictures that are drawn for the columns after the first."""
WALK_FIGURES: Final = (
    ("avoid_per_sample_s", "avoidance per sample (s)", "proper", "avoidance per sample"),
    ("distance_m", "distance between samples (m)", "proper", "distance between samples"),
)
"""Pictures of how robots walked, in the same form as ``FIGURES``."""


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
    """Yield pictures of figures over ``x`` for each column of the reproduction, in the forms that ``figures`` name.

    The first of ``columns`` gets all pictures. The later ones get only the pictures whose titles are in ``ALSO``, and
    the report shows these folded. A column without rows in the table gets no picture.

    Args:
        name: beginning of the pictures' file names.
        whole: table of cells of all columns. columns: presets of the reproduction to draw, in order.
        x, x_label: column of the table on the x axis, and its label.
        series: column of the table; each of its values gets a line in a picture.
        figures: figure, label, form ("papers" or "proper") and title of each picture, as ``FIGURES``.
        constant: series that do not depend on x.
    """
    for place, column in enumerate(columns):
        part = whole.filter(pl.col("column") == column)
        if part.is_empty():
            continue
        is_first = place == 0
        for figure, label, form, title in figures:
            if not is_first and title not in ALSO:
                continue
            # The name of the figure in the file's name, without its unit (s or m).
            short = figure.removesuffix("_s").removesuffix("_m").replace("_", "-")
            yield form_picture(
                f"{name}-{column}-{short}-{form}", f"{column}: {title}", part, figure, label, form, x, series,
                x_label=x_label, constant=constant, folded=not is_first,
            )  # fmt: skip


def form_picture(
    name: str,
    title: str,
    part: pl.DataFrame,
    figure: str,
    label: str,
    form: str,
    x: str,
    series: str | pl.Expr,
    **options: Any,
) -> Picture:
    """Return a picture of a figure over ``x`` with a line for each value of ``series``, in the order of the table.

    Args:
        part: table of cells of one column of the reproduction.
        figure: column of the table to draw. label: its label. form: "papers" or "proper", which decides the error bars.
        x: as for ``both_forms``. series: column, or an expression of each row's line. options: of ``picture``, and of
            ``draw_error_bars``.
    """
    is_papers = form == "papers"
    intervals = bars(part, figure) if is_papers else limits(part, figure)
    return picture(
        name, title, draw_error_bars,
        intervals.select("estimate", "low", "high", "runs", x=x, series=series),
        label=label,
        interval="the paper's bar (sd over robots / root of runs)" if is_papers else "95 % interval",
        percent=figure.startswith("robots"),  # robots_right, robots_wrong and robots_undecided are shares
        **options,
    )  # fmt: skip
