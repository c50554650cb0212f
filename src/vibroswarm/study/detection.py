"""Pictures of which fill ratios are told: by horizon, and by number of robots."""

from __future__ import annotations

from collections.abc import Iterator

import polars as pl

from vibroswarm.plots.detection import draw_detection
from vibroswarm.plots.picture import Picture

MOST_CURVES = 8


def detection_pictures(
    curve: pl.DataFrame, boundary: float, tolerated: float, style: str = "column"
) -> Iterator[tuple[str, Picture]]:
    """Names and pictures, from ``analysis.detection.detection_curve``."""
    shown = curve.filter(pl.col("missed").is_not_null())
    if shown.is_empty():
        return
    for robots in shown["robots"].unique().sort().to_list()[:MOST_CURVES]:
        part = shown.filter(pl.col("robots") == robots)
        series = pl.format("{} s", pl.col("horizon_s").round(0).cast(pl.Int64))
        title = f"{robots} robots" if robots != 1 else "1 robot"
        yield f"detection-{robots}-robots", _draw(part, series, boundary, tolerated, style, title)
    if shown["robots"].n_unique() > 1:
        part = shown.filter(pl.col("horizon_s") == pl.col("horizon_s").max())
        yield (
            "detection-robots",
            _draw(part, pl.format("{} robots", "robots"), boundary, tolerated, style, ""),
        )


def _draw(
    part: pl.DataFrame, series: pl.Expr, boundary: float, tolerated: float, style: str, title: str
) -> Picture:
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
