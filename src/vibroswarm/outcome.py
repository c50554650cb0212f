"""What became of each robot and of each run, summed up from the tables of the stages."""

from __future__ import annotations

from collections.abc import Mapping

import polars as pl

from vibroswarm.motion.contract import Motion
from vibroswarm.result import ROBOTS, RUNS


def truth_of(fill_ratio: float, boundary: float) -> int | None:
    """1 where the fill ratio lies above the boundary, 0 below, None on it."""
    if abs(fill_ratio - boundary) < 1e-12:
        return None
    return 1 if fill_ratio > boundary else 0


def _truths(fills: Mapping[int, float], boundary: float) -> pl.DataFrame:
    return pl.DataFrame(
        [(run, fill, truth_of(fill, boundary)) for run, fill in fills.items()],
        schema={"run": pl.UInt32, "fill_ratio": pl.Float64, "truth": pl.Int8},
        orient="row",
    )


def robot_table(
    motion: Motion, inference: pl.DataFrame, finals: pl.DataFrame, fills: Mapping[int, float], boundary: float
) -> pl.DataFrame:
    """The table of robots, one row a run and robot, also for robots that never sampled.

    A robot's decision is its last, and its time that of the sample at which it came to stand.
    """
    who = ["run", "robot"]
    timed = inference.with_columns(time_s=motion.samples["time_s"])
    before = pl.col("decision").shift(1, fill_value=-1).over(who)
    turned = timed.filter((pl.col("decision") != before) & (pl.col("decision") != -1))
    decided = turned.group_by(who).agg(
        pl.col("decision").last(),
        decision_time_s=pl.col("time_s").last(),
        belief_at_decision=pl.col("belief").last(),
    )
    last = timed.group_by(who).agg(last_belief=pl.col("belief").last(), samples=pl.len().cast(pl.UInt32))
    truth = pl.col("truth")
    belief = pl.coalesce("belief_at_decision", "last_belief")
    table = (
        finals.join(decided, on=who, how="left", maintain_order="left")
        .join(last, on=who, how="left", maintain_order="left")
        .join(_truths(fills, boundary), on="run", how="left", maintain_order="left")
        .with_columns(
            pl.col("decision").fill_null(-1),
            pl.col("samples").fill_null(0),
            belief=belief,
            belief_in_truth=pl.when(truth == 0).then(belief).when(truth == 1).then(1.0 - belief),
        )
    )
    return table.with_columns(sent=pl.col("samples")).select(list(ROBOTS)).cast(ROBOTS)  # type: ignore[arg-type]


def run_table(
    robots: pl.DataFrame, ends: pl.DataFrame, fills: Mapping[int, float], boundary: float, t_end_s: float
) -> pl.DataFrame:
    """The table of runs: consensus right, wrong, split or incomplete, and when."""
    decision, truth = pl.col("decision"), pl.col("truth")
    counted = (
        robots.join(_truths(fills, boundary), on="run", how="left", maintain_order="left")
        .group_by("run", maintain_order=True)
        .agg(
            pl.col("fill_ratio").first(),
            truth.first(),
            right=(decision == truth).fill_null(False).sum(),
            wrong=((decision != truth) & (decision != -1)).fill_null(False).sum(),
            undecided=(decision == -1).sum(),
            alike=decision.n_unique() == 1,
            last_s=pl.col("decision_time_s").max(),
        )
        .join(ends.group_by("run").agg(pl.col("end_s").max()), on="run", how="left", maintain_order="left")
    )
    outcome = (
        pl.when(pl.col("undecided") > 0)
        .then(pl.lit("incomplete"))
        .when(~pl.col("alike"))
        .then(pl.lit("split"))
        .when(truth.is_null())
        .then(pl.lit("agreed"))
        .when(pl.col("right") > 0)
        .then(pl.lit("right"))
        .otherwise(pl.lit("wrong"))
    )
    together = (pl.col("undecided") == 0) & pl.col("alike")
    table = counted.with_columns(
        consensus=outcome,
        consensus_time_s=pl.when(together).then(pl.col("last_s")),
        stopped_early=pl.col("end_s") < t_end_s - 1e-9,
    )
    return table.select(list(RUNS)).cast(RUNS)  # type: ignore[arg-type]
