"""What the published times fit best, and by how much: a fit, not a test.

| name | symbol | equation |
|---|---|---|
| standard deviation over runs of ours | s | stands for that over the published experiments, which is not known |
| error of the difference | e | s sqrt(1 / runs + 1 / 15) |
| in errors | - | (ours - published) / e |
"""

from __future__ import annotations

from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.page.report import Column
from vibroswarm.paper.columns import STRATEGIES, sizes
from vibroswarm.paper.item import Drawn, Work
from vibroswarm.paper.items.experiments_cells import LOSSES, TIME
from vibroswarm.paper.measure import REAL_EXPERIMENTS
from vibroswarm.paper.published import published
from vibroswarm.plots import draw_error_bars

FITTED: Final = (1.40, "total")
"""Threshold and gate that come nearest, in `calibrated`, to the published times without feedback; chosen by them."""
SHOWN: Final = {
    "column": Column("column"), "strategy": Column("strategy"), "robots": Column("robots"),
    "published_s": Column("published mean", "s"), "ours_s": Column("ours", "s"),
    "less_s": Column("ours less published", "s"), "error_s": Column("its standard error", "s"),
    "in errors": Column("in errors"),
}  # fmt: skip


def error_beside(values: Any, spread: float | None = None) -> float:
    """Standard error of the mean of these runs less that of ``REAL_EXPERIMENTS`` experiments.

    Args:
        values: (runs,). spread: standard deviation of the experiments; without, that of the runs.
    """
    own = float(np.std(values, ddof=1))
    theirs = own if spread is None else spread
    return float(np.sqrt(own**2 / np.size(values) + theirs**2 / REAL_EXPERIMENTS))


def in_errors(less: float, error: float) -> float | None:
    """A difference in standard errors; None where there is no error, as where nobody decides."""
    return less / error if error > 0 else None


def fit_table(work: Work, columns: list[str]) -> pl.DataFrame:
    """Times at ``FITTED`` beside the published means, at each size and strategy."""
    rows = []
    for column, strategy, (place, robots) in product(columns, STRATEGIES, enumerate(sizes())):
        values = work.values((column, LOSSES[0], *FITTED, robots, strategy), TIME)
        there, ours = (
            float(published(f"experiments.decision_time_s.{strategy}")[place]),
            float(values.mean()),
        )
        error = error_beside(values)
        row: dict[str, Any] = {
            "column": column,
            "strategy": strategy,
            "robots": robots,
            "published_s": there,
        }
        rows.append(
            row
            | {"ours_s": ours, "less_s": ours - there, "error_s": error}
            | {"in errors": in_errors(ours - there, error)}
        )
    return pl.DataFrame(rows, infer_schema_length=None)


def draw_fit(part: pl.DataFrame) -> Drawn:
    """Ours less the published means of one column, with two standard errors of the difference."""
    half = 2 * pl.col("error_s")
    made = part.select(
        pl.col("robots").cast(pl.Float64).alias("x"),
        pl.col("strategy").alias("series"),
        pl.col("less_s").alias("estimate"),
        (pl.col("less_s") - half).alias("low"),
        (pl.col("less_s") + half).alias("high"),
    )
    label = "ours less published (s)"
    return draw_error_bars(made, x_label="robots", label=label, interval="two standard errors")
