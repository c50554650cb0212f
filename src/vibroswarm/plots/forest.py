"""Forest pictures: paired differences with their intervals, one comparison a row, with wins, ties and losses."""

from __future__ import annotations

from typing import Any

import polars as pl

from vibroswarm.plots.canvas import Rows, rows_of
from vibroswarm.plots.frames import check_bounds, check_once, run_counts, tidy
from vibroswarm.plots.palette import FAINT, INK, SERIES
from vibroswarm.plots.picture import Picture, drawn
from vibroswarm.plots.style import Style, style_named
from vibroswarm.plots.words import fitted, number, of_runs


@drawn
def draw_forest(
    frame: pl.DataFrame,
    *,
    label: str = "difference of decision time (s)",
    interval: str = "95 % sign-flip interval",
    better: str | None = None,
    title: str = "",
    style: str = "column",
) -> Picture:
    """One row for each comparison: the difference, its interval, and how often it was won, tied and lost.

    A mark is full where the interval does not hold 0, open where it does.

    Args:
        frame: one row a comparison: ``comparison`` (text), ``difference, low, high`` (null: none), and where
            known ``wins, ties, losses`` (counts of pairs) and ``runs`` (pairs).
        label: of the axis, with its unit.
        interval: what low and high are.
        better: "low" or "high" differences are better; None: say neither.
        title: above the picture.
        style: "column", "page" or "slide".

    Returns:
        Picture; its numbers are the columns named above.

    Raises:
        InputError: the frame is not as asked, or an interval does not hold its difference.
    """
    sizes = style_named(style)
    counted = ("wins", "ties", "losses")
    frame = tidy(
        frame,
        texts=("comparison",),
        numbers=("difference", "low", "high"),
        optional_numbers=(*counted, "runs"),
    )
    check_once(frame, ["comparison"])
    check_bounds(frame, "low", "difference", "high")
    rows = rows_of(sizes, frame["comparison"].to_list(), label, title=title, furniture=2 if better else 1)
    counts = frame["wins"].is_not_null().any()
    for row, values in enumerate(frame.to_dicts()):
        _row(rows, sizes, row, values, counts)
    _axis(rows, frame, better)
    if counts:
        _head(rows, "wins / ties / losses")
    rows.settle(sizes)
    runs = run_counts(frame)
    caption = (
        f"{label}, paired by run. Mark: mean difference, full where the interval does not hold 0; line: {interval}"
        + (f" over {of_runs(runs, 'pair')}" if runs else "")
        + "."
        + (" At the right: pairs won, tied and lost." if counts else "")
    )
    numbers = frame.select("comparison", "difference", "low", "high", *counted, "runs")
    return Picture(rows.figure, numbers, caption)


def _row(rows: Rows, style: Style, row: int, values: dict[str, Any], counts: bool) -> None:
    axes = rows.axes
    if values["difference"] is None:
        axes.annotate(
            "no value", (0.02, row), xycoords=("axes fraction", "data"), va="center", fontsize=rows.font_pt,
            color=FAINT,
        )  # fmt: skip
    else:
        if values["low"] is not None and values["high"] is not None:
            axes.plot(
                [values["low"], values["high"]], [row, row], color=INK, linewidth=rows.line_pt * 1.3, marker="|",
                markersize=style.marker_pt, zorder=2,
            )  # fmt: skip
        held = values["low"] is None or values["high"] is None or values["low"] <= 0 <= values["high"]
        axes.plot(
            values["difference"], row, ls="", marker="D", markersize=style.marker_pt, markeredgecolor=SERIES[0],
            markerfacecolor="#ffffff" if held else SERIES[0], markeredgewidth=rows.line_pt, zorder=3,
        )  # fmt: skip
    if counts:
        told = [values[name] for name in ("wins", "ties", "losses")]
        rows.note(row, " / ".join(number(count, 7) for count in told))


def _axis(rows: Rows, frame: pl.DataFrame, better: str | None) -> None:
    axes = rows.axes
    values = [value for name in ("low", "difference", "high") for value in frame[name].drop_nulls().to_list()]
    low, high = min([*values, 0.0]), max([*values, 0.0])
    span = (high - low) or 1.0
    axes.set_xlim(low - 0.06 * span, high + 0.06 * span)
    axes.axvline(0, color=INK, linewidth=rows.line_pt, zorder=1)
    if better:
        arrow = "← better" if better == "low" else "better →"
        axes.annotate(
            arrow, (0, 1), xycoords=("data", "axes fraction"), textcoords="offset points", va="bottom",
            xytext=(-3 if better == "low" else 3, 1), ha="right" if better == "low" else "left",
            fontsize=rows.font_pt, color=FAINT, annotation_clip=False,
        )  # fmt: skip


def _head(rows: Rows, text: str) -> None:
    size = rows.font_pt
    rows.axes.annotate(
        fitted(text, size, rows.figure.get_figwidth() * 72 * 0.22, 2), (1, 1), xycoords="axes fraction",
        xytext=(size * 0.5, 1), textcoords="offset points", va="bottom", ha="left", fontsize=size, color=FAINT,
        annotation_clip=False,
    )  # fmt: skip
