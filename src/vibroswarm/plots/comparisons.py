"""Comparisons of cells: forest pictures of paired differences, and bars of outcomes.

A picture has one row for each comparison or cell (see ``layout.Rows``). The outcomes of runs are right, wrong (all
robots decided right, or all wrong), split (robots decided differently), incomplete (a robot is undecided) and truth
undefined (all robots made the same decision, but neither decision is right on this floor). Each run has exactly one of
them, so that the parts of a bar add up to all runs.
"""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.plots.inputs import run_counts, tidy
from vibroswarm.plots.layout import (
    Rows,
    hatched,
    legend_below,
    number,
    of_runs,
    patch_handle,
    percent_axis,
    plain,
    rows_of,
    share,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import FAINT, INK, OUTCOME_HATCHES, OUTCOMES, SERIES, Look, Style, style_named


@drawn
def draw_forest(
    frame: pl.DataFrame,
    *,
    label: str = "difference of decision time (s)",
    interval: str = "95 % interval",
    better: str | None = None,
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one row per comparison: the difference, its interval, and counts of wins, ties and losses.

    Marks are full if the interval is known and excludes 0, else open. The counts are written if any row has ``wins``.

    Args:
        frame: one row per comparison with the columns ``comparison`` (text) and ``difference, low, high`` (null: no
            value), and if known ``wins, ties, losses`` (counts of pairs) and ``runs`` (number of pairs).
        label: of the axis, with its unit.
        interval: what low and high are, for the caption.
        better: which differences are better, "low" or "high"; an arrow marks that side. None: no arrow.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are the columns named above.

    Raises:
        InputError: the frame is not as described, a comparison is repeated, or an interval does not contain its
            difference.
    """
    sizes = style_named(style)
    counted = ("wins", "ties", "losses")
    frame = tidy(
        frame,
        texts=("comparison",),
        numbers=("difference", "low", "high"),
        optional_numbers=(*counted, "runs"),
        once=("comparison",),
        bounds=[("low", "difference", "high")],
    )
    rows = rows_of(sizes, frame["comparison"].to_list(), label, title=title)
    with_counts = frame["wins"].is_not_null().any()
    for row, values in enumerate(frame.to_dicts()):
        _row(rows, sizes, row, values, with_counts)
    _axis(rows, frame, better)
    if with_counts:
        rows.heading("wins / ties / losses")
    rows.settle(sizes)  # sets the height of the figure, now that all else is drawn
    runs = run_counts(frame)
    caption = (
        f"{label}, paired by run. Mark: mean difference, full where the interval does not hold 0; line: {interval}"
        + (f" over {of_runs(runs, 'pair')}" if runs else "")
        + "."
        + (" At the right: pairs won, tied and lost." if with_counts else "")
    )
    numbers = frame.select("comparison", "difference", "low", "high", *counted, "runs")
    return Picture(rows.figure, numbers, caption)


def _row(rows: Rows, style: Style, row: int, values: dict[str, Any], with_counts: bool) -> None:
    """Draw one difference with its interval at y = ``row``, open if the interval is not known or contains 0.

    Args:
        rows: the picture. style: its sizes. row: index of the comparison, from the top.
        values: the row of the frame, by column. with_counts: whether wins, ties and losses are written at the right.
    """
    low, high = values["low"], values["high"]
    is_open = low is None or high is None or low <= 0 <= high
    look = Look(SERIES[0], "D", (0, ()), "", hollow=is_open)
    estimate = values["difference"], low, high
    rows.estimate(style, row, estimate, look, color=INK, linewidth=rows.line_pt * 1.3)
    if with_counts:
        # 7 digits, so that counts of a million and more are not rounded either
        counts = (number(values[name], digits=7) for name in ("wins", "ties", "losses"))
        rows.note(row, " / ".join(counts))


def _axis(rows: Rows, frame: pl.DataFrame, better: str | None) -> None:
    """Set limits of the axis that contain 0 and all intervals, draw the line at 0, and mark the better side.

    ``better`` says which differences are better: "low", "high", or None if no side is marked.
    """
    axes = rows.axes
    values = [0.0, *pl.concat([frame["low"], frame["difference"], frame["high"]]).drop_nulls()]
    low, high = min(values), max(values)
    span = (high - low) or 1.0  # above 0, also if all values are 0
    axes.set_xlim(low - 0.06 * span, high + 0.06 * span)  # a margin, so that no mark lies on the edge
    axes.axvline(0, color=INK, linewidth=rows.line_pt, zorder=1)
    if better:
        arrow = "← better" if better == "low" else "better →"
        axes.annotate(
            arrow, (0, 1), xycoords=("data", "axes fraction"), textcoords="offset points", va="bottom",
            xytext=(-3 if better == "low" else 3, 1), ha="right" if better == "low" else "left",
            fontsize=rows.font_pt, color=FAINT, annotation_clip=False,
        )  # fmt: skip


@drawn
def draw_outcomes(
    frame: pl.DataFrame,
    *,
    interval: str = "95 % interval",
    unit: str = "run",
    title: str = "",
    style: str = "column",
) -> Picture:
    """Draw one bar per cell, divided by the outcomes of its runs; the share of right runs is also written beside it.

    Args:
        frame: one row per cell with the columns ``cell`` (text) and the counts of runs ``right``, ``wrong``, ``split``,
            ``incomplete`` and ``truth_undefined`` (missing columns and nulls count as 0). If it has ``right_low`` and
            ``right_high`` (shares, 0 to 1), they are drawn as the interval of the share of right runs.
        interval: what that interval is, for the caption, such as "95 % Wilson interval".
        unit: what is counted, "run" or "robot".
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are ``cell``, ``runs`` (a count), ``right, wrong, split, incomplete, truth_undefined``
        (shares; null: the cell has no runs) and ``right_low, right_high``.

    Raises:
        InputError: the frame is not as described, a count is negative, or a cell is repeated.
    """
    sizes = style_named(style)
    kinds = list(OUTCOMES)
    frame = tidy(frame, texts=("cell",), optional_numbers=(*kinds, "right_low", "right_high"), once=("cell",))
    frame = frame.with_columns(pl.col(kinds).fill_null(0.0))
    if frame.select((pl.min_horizontal(kinds) < 0).any()).item():
        raise InputError("a count of runs is negative", field="right")
    frame = frame.with_columns(runs=pl.sum_horizontal(kinds))
    # Without any runs, the legend has one entry, "right".
    seen = [kind for kind in kinds if frame[kind].sum() > 0] or kinds[:1]
    words = [kind.replace("_", " ") for kind in seen]
    names = words if unit == "run" else [f"{kind} ({unit}s)" for kind in words]
    rows = rows_of(sizes, frame["cell"].to_list(), f"share of {unit}s", title=title)
    shares = frame.with_columns(
        pl.when(pl.col("runs") > 0).then(pl.col(kind) / pl.col("runs")).alias(kind) for kind in kinds
    )
    for row, values in enumerate(shares.to_dicts()):
        _bar(rows, sizes, row, values, seen, unit)
    rows.axes.set_xlim(0, 1)
    rows.axes.set_xticks([0, 0.25, 0.5, 0.75, 1])
    percent_axis(rows.axes.xaxis)
    looks = [Look(OUTCOMES[kind], "", (0, ()), OUTCOME_HATCHES[kind], hollow=False) for kind in seen]
    legend_below(rows.figure, sizes, [patch_handle(sizes, look) for look in looks], names)
    rows.settle(sizes)  # sets the height of the figure, now that all else is drawn
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
    """Draw the stacked bar of a cell at y = ``row``, with the interval of the share of right runs.

    The share of right runs is also written at the right, in percent.

    Args:
        rows: the picture. style: its sizes. row: index of the cell, from the top.
        values: by name, the share of each outcome, the number ``runs``, and the limits ``right_low, right_high`` of the
            share of right runs. seen: the outcomes that occur, in the order of the bar.
        unit: what is counted, "run" or "robot".
    """
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
        # a wider white line under the dark one makes it visible on a hatch
        for colour, width in (("#ffffff", 3.0), (INK, 1.2)):
            axes.plot([low, high], [row, row], color=colour, linewidth=rows.line_pt * width, zorder=3)
            for end in (low, high):
                axes.plot(
                    [end, end], [row - height * 0.28, row + height * 0.28], color=colour,
                    linewidth=rows.line_pt * width, zorder=3, solid_capstyle="butt",
                )  # fmt: skip
    rows.note(row, plain(share(values["right"] or 0.0, 1.0)), colour=OUTCOMES["right"])
