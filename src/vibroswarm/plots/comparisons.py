"""Bars of the outcomes of runs: right, wrong, split (robots differ), incomplete (one is undecided), truth undefined."""

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
    """Draw one bar per cell, divided by the outcomes of its runs, with the share of right runs and its ``interval``."""
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
