"""Compare how confident robots of a league are when they decide with how often they are right.

| column | what it is |
|---|---|
| decided_share | share of robots that decided |
| confidence_share | mean confidence at decision time, of the robots that decided |
| right_share | share of right decisions, of the robots that decided |
| too_confident | whether the interval of right_share lies below that of confidence_share |

This holds for the floors of the league. They are harder than those that a uniform prior of the fill ratio expects, so
that robots with a correct sensor model, too, may be too confident on them.
"""

from __future__ import annotations

import numpy as np
import polars as pl

from vibroswarm.league.standings import ENTRY
from vibroswarm.statistics.intervals import cluster_shares, columns_of
from vibroswarm.study.runs import Runs


def belief_table(runs: Runs, cells: pl.DataFrame) -> pl.DataFrame:
    """Return a row for each entry whose robots decided with a belief.

    Args:
        runs: of the league's study. cells: from ``standings.cell_table``.
    """
    decision, below = pl.col("robot.decision"), pl.col("robot.belief_below")
    robots = runs.rows("truth", "robot.decision", "robot.belief_below").explode(decision, below).drop_nulls()
    by_run = (
        robots.join(cells, on="cell")
        .group_by(*ENTRY, "run", maintain_order=True)
        .agg(
            robots=pl.len(),
            decided=(decision >= 0).sum(),
            confidence=pl.when(decision == 0).then(below).when(decision > 0).then(1.0 - below).sum(),
            right=(decision == pl.col("truth")).sum(),
        )
    )
    rows = []
    for own in by_run.partition_by("name", maintain_order=True):
        sums = own.select("confidence", "right").to_numpy().T
        row = own.select(ENTRY).row(0, named=True)
        row["decided_share"] = own["decided"].sum() / own["robots"].sum()
        confidence, right = np.transpose(cluster_shares(sums, own["decided"])).tolist()
        row |= columns_of("confidence_share", confidence) | columns_of("right_share", right)
        rows.append(row | {"too_confident": right[2] < confidence[1]})
    return pl.DataFrame(rows, infer_schema_length=None)
