"""One row a run, from the tables of robots and runs: what all intervals and comparisons start from.

| column | what it is |
|---|---|
| run, truth, consensus | as the table of runs has them |
| robots | how many there are |
| right, wrong, undecided | how many of them; right and wrong null where no decision is right |
| decision_time_s | mean over robots of min(decision time, t_end), s: the paper's, the restricted mean |
| belief_in_truth | mean over robots of the belief in what is so, at the decision or at the last sample |
| consensus_time_s | as the table of runs has it: null where there was none |
| right_share, wrong_share, undecided_share | shares of the robots |
| swarm_right, swarm_wrong | 1 where all decided so, else 0; null where no decision is right |
| swarm_time_s | min(consensus time, t_end), s |
"""

from __future__ import annotations

import polars as pl

from vibroswarm.errors import InputError


def run_figures(robots: pl.DataFrame, runs: pl.DataFrame, t_end_s: float) -> pl.DataFrame:
    """The table above, sorted by run.

    Args:
        robots, runs: tables of one cell, as a ``Result`` has them; the same runs in both. t_end_s: end of a run, s.
    Raises:
        InputError: the tables are not of the same runs, a run is there twice, or t_end is not above 0.
    """
    if not t_end_s > 0:
        raise InputError(f"{t_end_s!r} is no end of a run; give a time above 0, s", field="t_end_s")
    time_s = pl.min_horizontal(pl.col("decision_time_s").fill_null(t_end_s), pl.lit(t_end_s))
    of_robots = (
        robots.lazy()
        .group_by("run")
        .agg(
            robots=pl.len().cast(pl.Int64),
            decision_time_s=time_s.mean(),
            belief_in_truth=pl.col("belief_in_truth").mean(),
        )
        .collect()
    )
    joined = runs.join(of_robots, on="run", how="inner").sort("run")
    if joined.height != runs.height or of_robots.height != runs.height:
        raise InputError("the tables of robots and of runs are not of the same runs", field="runs")
    known = pl.col("truth").is_not_null()
    count = pl.col("robots")
    table = joined.with_columns(
        right=pl.when(known).then(pl.col("right").cast(pl.Int64)),
        wrong=pl.when(known).then(pl.col("wrong").cast(pl.Int64)),
        undecided=pl.col("undecided").cast(pl.Int64),
        swarm_right=pl.when(known).then((pl.col("consensus") == "right").cast(pl.Float64)),
        swarm_wrong=pl.when(known).then((pl.col("consensus") == "wrong").cast(pl.Float64)),
        swarm_time_s=pl.min_horizontal(pl.col("consensus_time_s").fill_null(t_end_s), pl.lit(t_end_s)),
    )
    return table.with_columns(
        right_share=pl.col("right") / count,
        wrong_share=pl.col("wrong") / count,
        undecided_share=pl.col("undecided") / count,
    ).select(
        *("run", "truth", "consensus", "robots", "right", "wrong", "undecided"),
        *("decision_time_s", "belief_in_truth", "consensus_time_s"),
        *("right_share", "wrong_share", "undecided_share", "swarm_right", "swarm_wrong", "swarm_time_s"),
    )
