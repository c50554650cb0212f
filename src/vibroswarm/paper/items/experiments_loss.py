"""Is packet loss what makes positive feedback overtake? Times of positive less none, with the loss and without.

| name | equation |
|---|---|
| gap of a run | its time with positive feedback less that without feedback, on the same motion, floor and readings |
| what loss changes | gap with the published loss less the gap without any, run by run |
"""

from __future__ import annotations

from itertools import product
from typing import Any, Final

import polars as pl

from vibroswarm.page.report import Column
from vibroswarm.paper.columns import sizes
from vibroswarm.paper.item import Drawn, Work
from vibroswarm.paper.items.experiments_cells import (
    GATES,
    LOSSES,
    THRESHOLDS,
    TIME,
    loss_of,
    published_points,
)
from vibroswarm.paper.published import published
from vibroswarm.plots import draw_error_bars

Z: Final = 1.96
SHOWN: Final = {
    "column": Column("column"), "theta_E": Column("theta_E"), "gate": Column("gate"), "robots": Column("robots"),
    "packets lost": Column("packets lost", percent=True), "published_s": Column("published", "s"),
    "with_s": Column("with loss", "s"), "without_s": Column("without", "s"),
    "change_s": Column("what loss changes", "s"), "change_low": Column("from", "s"),
    "change_high": Column("to", "s"),
}  # fmt: skip


def loss_table(work: Work, columns: list[str]) -> pl.DataFrame:
    """Time of positive less none, with loss and without, and what loss changes; paired run by run."""
    rows = []
    printed = dict(zip(sizes(), published_gaps(), strict=True))
    for column, threshold, gate, robots in product(columns, THRESHOLDS, GATES, sizes()):
        row: dict[str, Any] = {"column": column, "theta_E": threshold, "gate": gate, "robots": robots}
        row["packets lost"] = loss_of(robots)
        three = zip(("with", "without", "change"), gaps(work, column, threshold, gate, robots), strict=True)
        for name, values in three:
            error = float(values.std(ddof=1)) / values.size**0.5
            row |= {f"{name}_s": float(values.mean()), f"{name}_error_s": error}
        row |= {"change_low": row["change_s"] - Z * row["change_error_s"]}
        row |= {"change_high": row["change_s"] + Z * row["change_error_s"]}
        rows.append(row | {"published_s": printed[robots]})
    return pl.DataFrame(rows, infer_schema_length=None)


def published_gaps() -> list[float]:
    """The paper's mean time of positive less that of none, s, by swarm size."""
    none, positive = (published(f"experiments.decision_time_s.{name}") for name in ("none", "positive"))
    return [float(p) - float(n) for n, p in zip(none, positive, strict=True)]


def gaps(work: Work, column: str, threshold: float, gate: str, robots: int) -> tuple[Any, Any, Any]:
    """Positive less none of each run, with loss, without, and the first less the second."""
    found = [
        work.difference(
            TIME,
            (column, packets, threshold, gate, robots, "positive"),
            (column, packets, threshold, gate, robots, "none"),
        )
        for packets in LOSSES
    ]
    return found[0], found[1], found[0] - found[1]


def draw_loss(part: pl.DataFrame) -> Drawn:
    """Published, ours with loss, and without where that makes most of a difference."""
    settings = [("with", threshold, gate) for threshold in THRESHOLDS for gate in GATES]
    frames = [published_points(published_gaps())]
    for name, threshold, gate in [*settings, ("without", THRESHOLDS[0], GATES[0])]:
        mine = part.filter((pl.col("gate") == gate) & (pl.col("theta_E") == threshold))
        error = Z * pl.col(f"{name}_error_s")
        frames.append(
            mine.select(
                pl.col("robots").cast(pl.Float64).alias("x"),
                pl.lit(f"{name} loss, {threshold}, {gate}").alias("series"),
                pl.col(f"{name}_s").alias("estimate"),
                (pl.col(f"{name}_s") - error).alias("low"),
                (pl.col(f"{name}_s") + error).alias("high"),
            )
        )
    label = "time of positive less none (s)"
    return draw_error_bars(pl.concat(frames), x_label="robots", label=label)
