"""Bars of outcomes.

The outcomes of runs are right, wrong (all robots decided right, or all wrong), split (robots decided differently),
incomplete (a robot is undecided) and truth undefined (all robots made the same decision, but none is right on this
floor). Each run has exactly one of them.
"""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.plots.inputs import tidy
from vibroswarm.plots.layout import (
    Rows,
    legend_below,
    of_runs,
    patch_handle,
    percent_axis,
    rows_of,
    share,
)
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import INK, OUTCOME_HATCHES, OUTCOMES, Look, style_named


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
        interval: what that interval is, for the caption. unit: what is counted, "run" or "robot".
        title: above the picture. style: "column", "page" or "slide".

    Returns: the picture; its numbers are ``cell``, ``runs`` (a count), the shares of the outcomes (null: the cell has
        no runs), and ``right_low`` and ``right_high``.
    Raises:
        InputError: the frame is not as described.
    """
    kinds = list(OUTCOMES)
    frame = tidy(frame, texts=("cell",), optional=(*kinds, "right_low", "right_high"))
    frame = frame.with_columns(pl.col(kinds).fill_null(0.0)).with_columns(runs=pl.sum_horizontal(kinds))
    seen = [kind for kind in kinds if frame[kind].sum() > 0] or kinds[:1]
    shares = frame.with_columns(
        pl.when(pl.col("runs") > 0).then(pl.col(kind) / pl.col("runs")) for kind in kinds
    )
    rows = rows_of(style_named(style), frame["cell"].to_list(), f"share of {unit}s", title=title)
    for row, values in enumerate(shares.to_dicts()):
        _bar(rows, row, values, seen, unit)
    rows.axes.set_xlim(0, 1)
    percent_axis(rows.axes.xaxis)
    looks = [Look(OUTCOMES[kind], "", (0, ()), OUTCOME_HATCHES[kind], hollow=False) for kind in seen]
    words = {"incomplete": "undecided", "truth_undefined": "truth undefined"}
    names = [f"{words.get(kind, kind)}{'' if unit == 'run' else f' ({unit}s)'}" for kind in seen]
    legend_below(rows.figure, rows.style, [patch_handle(look) for look in looks], names)
    caption = f"What became of the {unit}s, by cell: {of_runs([int(runs) for runs in frame['runs']], unit)}."
    if frame["right_low"].is_not_null().any():
        caption += f" The bracket is the {interval} of the share right."
    numbers = shares.select("cell", pl.col("runs").cast(pl.UInt64), *kinds, "right_low", "right_high")
    return Picture(rows.figure, numbers, caption)


def _bar(rows: Rows, row: int, values: dict[str, Any], seen: list[str], unit: str) -> None:
    """Draw the stacked bar of a cell, with the interval of its share of right runs, which is also written."""
    if not values["runs"]:
        rows.axes.text(0.5, row, f"no {unit}s", ha="center", va="center")
        return
    left = 0.0
    for kind in seen:
        looks: dict[str, Any] = {
            "facecolor": OUTCOMES[kind],
            "edgecolor": INK,
            "hatch": OUTCOME_HATCHES[kind],
        }
        rows.axes.barh(row, values[kind], rows.band, left=left, linewidth=0.6, zorder=2, **looks)
        left += values[kind]
    low, high = values["right_low"], values["right_high"]
    if low is not None and high is not None:
        rows.axes.plot([low, high], [row, row], color=INK, marker="|", zorder=3)
    rows.note(row, share(values["right"], 1.0))
