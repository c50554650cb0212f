"""What ``vibroswarm detect`` prints and draws."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from vibroswarm.cli.output import print_line, print_paragraph, print_table
from vibroswarm.plots.curves import draw_detection
from vibroswarm.plots.picture import Picture
from vibroswarm.scenario.scenario import Scenario


def print_detection(
    need: pl.DataFrame, distinguished: pl.DataFrame, scenario: Scenario, error: float, false_alarms: float
) -> None:
    """Print which floors are distinguished and when, then every cell.

    Args:
        need, distinguished: from ``analysis.detection.needed`` and ``pairs``.
        error, false_alarms: tolerated probabilities.
    """
    boundary, t_end_s = scenario.decision.decision_boundary, scenario.run.t_end_s
    if distinguished.is_empty():
        print_paragraph(
            f"All floors are on one side of {100 * boundary:g} %: no pairs of misses and false alarms."
        )
    else:
        print_paragraph(
            f"Does more than {100 * boundary:g} % vibrate? With at most {100 * error:g} % misses and "
            f"{100 * false_alarms:g} % false alarms (upper limits, 95 %):"
        )
        print_line()
        print_table(
            ["fill ratio", "robots", "found within", "without false alarms on floors up to", ""],
            [_pair(row, t_end_s) for row in _best(distinguished).iter_rows(named=True)],
            names=2,
            texts=0,
        )
    print_line()
    print_table(
        ["fill ratio", "robots", "runs", "missed, %", "false alarms, %", "needed", "clear until"],
        [
            [
                f"{row['fill_ratio']:.4g}",
                row["robots"],
                row["runs"],
                _share(row["missed"], row["missed_high"]),
                _share(row["false_alarm"], row["false_alarm_high"]),
                "-" if row["missed"] is None else _time(row["needed_s"], t_end_s),
                _clear(row),
            ]
            for row in need.iter_rows(named=True)
        ],
        names=2,
        texts=0,
        more=("runs",),
    )
    print_paragraph(
        f"Missed: no right consensus by {t_end_s:g} s; undecided counts. False alarm: a wrong consensus on 'more'. "
        "In brackets the upper limit (95 %, Wilson over runs), which must be below the tolerated probability. Needed: "
        "when that of misses falls below it; clear until: how long that of false alarms stays below it. Each limit "
        "holds separately."
    )


def _best(distinguished: pl.DataFrame) -> pl.DataFrame:
    """For each floor above and number of robots, the fullest floor below that it is distinguished from."""
    reached = pl.col("time_s").is_not_null()
    return (
        distinguished.sort(
            "fill_ratio", "robots", reached, "fill_ratio_below", descending=[False, False, True, True]
        )
        .group_by("fill_ratio", "robots", maintain_order=True)
        .first()
    )


def _pair(row: dict[str, float | None], t_end_s: float) -> list[object]:
    start: list[object] = [f"{row['fill_ratio']:.4g}", row["robots"], _time(row["time_s"], t_end_s)]
    if row["time_s"] is None:
        return [*start, "-", ""]
    return [*start, f"{row['fill_ratio_below']:.4g}", "(fewest robots)" if row["fewest"] else ""]


def _share(share: float | None, high: float | None) -> str:
    return "-" if share is None or high is None else f"{100 * share:.1f} (below {100 * high:.1f})"


def _time(time_s: float | None, t_end_s: float) -> str:
    return f"not by {t_end_s:g} s" if time_s is None else f"{time_s:.0f} s"


def _clear(row: dict[str, float | None]) -> str:
    """Format the time until which false alarms are rare enough."""
    if row["false_alarm"] is None:
        return "-"
    until_s = row["clear_until_s"]
    if until_s is None:
        return "the end"
    return f"{until_s:.0f} s" if until_s > 0 else "never"


MOST_CURVES = 8


def detection_pictures(
    curve: pl.DataFrame, boundary: float, tolerated: float, style: str = "column"
) -> Iterator[tuple[str, Picture]]:
    """Yield names and pictures, from ``analysis.detection.detection_curve``."""
    drawable = curve.filter(pl.col("missed").is_not_null())
    if drawable.is_empty():
        return
    for robots in drawable["robots"].unique().sort().to_list()[:MOST_CURVES]:
        part = drawable.filter(pl.col("robots") == robots)
        series = pl.format("{} s", pl.col("horizon_s").round(0).cast(pl.Int64))
        title = f"{robots} robots" if robots != 1 else "1 robot"
        yield f"detection-{robots}-robots", _draw(part, series, boundary, tolerated, style, title)
    if drawable["robots"].n_unique() > 1:
        part = drawable.filter(pl.col("horizon_s") == pl.col("horizon_s").max())
        yield (
            "detection-robots",
            _draw(part, pl.format("{} robots", "robots"), boundary, tolerated, style, ""),
        )


def _draw(
    part: pl.DataFrame, series: pl.Expr, boundary: float, tolerated: float, style: str, title: str
) -> Picture:
    """Draw misses against the fill ratio, one line for each series."""
    frame = part.select(
        "fill_ratio", "missed", "runs", low="missed_low", high="missed_high", series=series
    ).sort("series", "fill_ratio", maintain_order=True)
    order = part.select(series=series)["series"].unique(maintain_order=True)
    rank = pl.col("series").replace_strict(order.to_list(), range(order.len()), return_dtype=pl.Int64)
    return draw_detection(
        frame.sort(rank, maintain_order=True),
        boundary=boundary,
        tolerated=tolerated,
        title=title,
        style=style,
    )
