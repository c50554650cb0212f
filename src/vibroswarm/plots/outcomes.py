"""Bars of what became of the runs: right, wrong, split, incomplete, agreed, always adding up to all of them."""

from __future__ import annotations

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.canvas import Rows, hatched, legend_below, legend_lines, percent_axis, rows_of
from vibroswarm.plots.frames import check_once, tidy
from vibroswarm.plots.palette import INK, OUTCOME_HATCHES, OUTCOMES
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named
from vibroswarm.plots.words import of_runs, plain, share


@drawn
def draw_outcomes(
    frame: pl.DataFrame,
    *,
    interval: str = "95 % interval",
    unit: str = "run",
    title: str = "",
    style: str = "column",
) -> Picture:
    """One bar for each cell, of the shares of its runs that ended so.

    Args:
        frame: one row a cell: ``cell`` (text) and counts of runs ``right, wrong, split, incomplete, agreed`` (a column
            that is not there is 0). ``right_low`` and
            ``right_high`` (shares, 0 to 1) draw an interval of the share right.
        interval: what that interval is, for the caption, such as "95 % Wilson interval".
        unit: what is counted, "run" or "robot".
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``cell, runs, right, ..., agreed`` (shares) and ``right_low, right_high``.

    Raises:
        InputError: the frame is not as asked, a count is negative, or a cell stands twice.
    """
    sizes = style_named(style)
    kinds = list(OUTCOMES)
    frame = tidy(frame, texts=("cell",), optional_numbers=(*kinds, "right_low", "right_high"))
    check_once(frame, ["cell"])
    frame = frame.with_columns(pl.col(kinds).fill_null(0.0))
    if frame.select((pl.min_horizontal(kinds) < 0).any()).item():
        raise InputError("a count of runs is negative", field="right")
    frame = frame.with_columns(runs=pl.sum_horizontal(kinds))
    seen = [kind for kind in kinds if frame[kind].sum() > 0] or kinds[:1]
    names = [kind if unit == "run" else f"{kind} ({unit}s)" for kind in seen]
    rows = rows_of(
        sizes, frame["cell"].to_list(), f"share of {unit}s", title=title,
        furniture=legend_lines(sizes, names) + 1,
    )  # fmt: skip
    shares = frame.with_columns(
        pl.when(pl.col("runs") > 0).then(pl.col(kind) / pl.col("runs")).alias(kind) for kind in kinds
    )
    for row, values in enumerate(shares.to_dicts()):
        _bar(rows, sizes, row, values, seen, unit)
    rows.axes.set_xlim(0, 1)
    rows.axes.set_xticks([0, 0.25, 0.5, 0.75, 1])
    percent_axis(rows.axes.xaxis)
    _legend(rows, sizes, seen, names)
    rows.settle(sizes)
    with_interval = frame["right_low"].is_not_null().any()
    caption = (
        f"What became of the {unit}s, by cell: {of_runs([int(runs) for runs in frame['runs']], unit)}."
        + (f" The bracket is the {interval} of the share right." if with_interval else "")
    )
    numbers = shares.select("cell", pl.col("runs").cast(pl.UInt64), *kinds, "right_low", "right_high")
    return Picture(rows.figure, numbers, caption)


def _bar(
    rows: Rows, style: Style, row: int, values: dict[str, float | None], seen: list[str], unit: str
) -> None:
    axes, height = rows.axes, rows.band
    if not values["runs"]:
        axes.text(0.5, row, f"no {unit}s", ha="center", va="center", fontsize=rows.font_pt)
        return
    left = 0.0
    for kind in seen:
        width = values[kind] or 0.0
        if width:
            axes.barh(
                row, width, height, left=left, facecolor=OUTCOMES[kind], edgecolor=INK,
                hatch=hatched(style, OUTCOME_HATCHES[kind]), linewidth=rows.line_pt * 0.6, zorder=2,
            )  # fmt: skip
        left += width
    low, high = values["right_low"], values["right_high"]
    if low is not None and high is not None:
        for colour, width in (("#ffffff", 3.0), (INK, 1.2)):
            axes.plot([low, high], [row, row], color=colour, linewidth=rows.line_pt * width, zorder=3)
            for end in (low, high):
                axes.plot(
                    [end, end], [row - height * 0.28, row + height * 0.28], color=colour,
                    linewidth=rows.line_pt * width, zorder=3, solid_capstyle="butt",
                )  # fmt: skip
    rows.note(row, plain(share(values["right"] or 0.0, 1.0)), colour=OUTCOMES["right"])


def _legend(rows: Rows, style: Style, seen: list[str], names: list[str]) -> None:
    from matplotlib.patches import Patch

    handles = [
        Patch(
            facecolor=OUTCOMES[kind],
            edgecolor=INK,
            hatch=hatched(style, OUTCOME_HATCHES[kind]),
            linewidth=style.line_pt / 2,
        )
        for kind in seen
    ]
    legend_below(rows.figure, style, handles, names)
