"""Item 3: the paper's search by particle swarm, with its optimum and validated costs.

A score is a cost as the search estimates it, from few runs; the validated ("true") cost of a parameter set is estimated
on fresh runs.

The measured values of the claims are rows of ``claims.MEASURED``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import polars as pl

from vibroswarm.paper.claim_values import Row, exact, frame, of_interval
from vibroswarm.paper.columns import parameters, published
from vibroswarm.paper.item import CLAIMS, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import draw_parameters, draw_search
from vibroswarm.scenario.scenario import preset
from vibroswarm.search import (
    Found,
    Objective,
    PsoSettings,
    Search,
    Truth,
    candidate_table,
    history_table,
    paired_score,
    run_search,
    truth_of,
)
from vibroswarm.show.document import Column
from vibroswarm.statistics.intervals import Interval, columns_of
from vibroswarm.study.spec import Study

COLUMN: Final = "paper"
"""Preset in which the searches are made, also if it is not among the requested columns."""
ELSEWHERE: Final = "optimised-cost"
"""A preset found by another search; its robots wait longer before they decide."""
RUNS_AN_ITERATION: Final = 20
"""The search gets one iteration for this many runs per cell of the reproduction, so 1000 runs, or more, give the
paper's 50 iterations."""
LEAST_SHARE: Final = 0.5
"""A search with a smaller share than this of the paper's iterations gives no verdict on its final score."""


def search_of(settings: Settings) -> Search:
    """Return the paper's search: 25 particles, 50 iterations (fewer with few runs), the lowest score wins.

    A personal best keeps the score with which it became the best, which is never computed again (``noise="fixed"``).
    The search starts from P0 (``paper-empirical``).
    """
    swarm = published("parameters.pso")
    # At least two iterations, however few runs the reproduction has.
    iterations = min(swarm["iterations"], max(2, settings.runs // RUNS_AN_ITERATION))
    fill = swarm["fill_ratio"]
    return Search(
        study=Study(settings.scenario(COLUMN, {"floor.source": f"random:{fill}"}), seed=settings.seed),
        objectives=(Objective("authors_code"),),  # the cost as the authors' program computes it
        pso=PsoSettings(
            particles=swarm["particles"],
            iterations=iterations,
            evaluations=swarm["evaluations"],
            extra=swarm["extra_evaluations_top_20_percent"],
            inertia_first=swarm["omega_first"],
            inertia_last=swarm["omega_last"],
            weight_personal=swarm["omega_p"],
            weight_global=swarm["omega_g"],
            noise="fixed",
        ),
        start=("paper-empirical",),
    )


def compute(work: Work) -> Tables:
    """Search, then evaluate the winner, P0, P* and the parameters of the preset ``ELSEWHERE`` on fresh runs.

    Return tables of the search's history and candidates, the validated costs ("truth"), and the claims' measured
    values.
    """
    search, workers = search_of(work.settings), work.settings.workers
    search_result = run_search(
        search,
        work.folder / search.hash,
        workers=workers,
        mixed=True,  # a search that another version began is continued
        progress=lambda now: work.progress(0.8 * now.share),  # the rest is the validation
    )
    # ``truth_of`` itself adds the winner, and P0 as the search's start.
    others = [("P*", parameters("P_star")), (ELSEWHERE, search.space.values_of(preset(ELSEWHERE)))]
    fresh_runs = max(work.settings.runs, 2)  # an interval needs two runs
    truth = truth_of(search_result, runs=fresh_runs, others=others, workers=workers)
    return {
        "history": history_table(search_result),
        "candidates": candidate_table(search_result),
        "truth": _truth_table(truth),
        CLAIMS: frame(list(_measured(search_result, truth))),
    }


def _truth_table(truth: Truth) -> pl.DataFrame:
    """Return one row for each validated parameter set, the winner first, with its parameters and costs.

    ``believed`` is the winner's score in the search (null for the other sets), ``true`` the cost on fresh runs, and
    ``less`` the cost of the winner minus the cost of the row's set (null for the winner itself).
    """
    rows = []
    differences = (None, *truth.against)  # None: the winner, which is not compared with itself
    for scored, difference in zip((truth.winner, *truth.others), differences, strict=True):
        row: dict[str, Any] = {
            # The search names its first parameter set "start"; here it is P0.
            "parameters": {"start": "P0"}.get(scored.name, scored.name),
            **{field.rpartition(".")[2]: value for field, value in scored.values.items()},
        }
        row |= {"believed": truth.believed if difference is None else None}
        row |= columns_of("true", scored.score) | columns_of("less", difference or [None] * 3)
        rows.append(row | {"runs": scored.score.n})
    # null in all rows if there are too few runs
    limits = {f"{name}_{end}": pl.Float64 for name in ("true", "less") for end in ("low", "high")}
    return pl.DataFrame(rows, schema_overrides=limits, infer_schema_length=None)


def _measured(found: Found, truth: Truth) -> Iterator[Row]:
    """Yield the measured values of the claims about the search.

    On fresh runs, they are the cost of P0 minus the cost of P*, and the cost of the preset ``ELSEWHERE`` minus the cost
    of P*. For the search, they are the relative difference of the winner's final score from its cost on fresh runs,
    and, for each parameter, how far its mean over particles still moves after the iteration at which the paper's search
    has settled, as a share of the parameter's range.
    """
    objective = found.search.objectives[0]
    scored = {scored_set.name: scored_set for scored_set in truth.others}
    start, star, other = scored["start"], scored["P*"], scored[ELSEWHERE]
    yield of_interval("cost-of-start-less-found", COLUMN, "P0 less P*", paired_score(objective, start, star))
    yield of_interval(
        "cost-elsewhere-less-found", COLUMN, f"{ELSEWHERE} less P*", paired_score(objective, other, star)
    )
    # Mean of the particles after each iteration; each parameter as a share of its range, 0 to 1.
    mean_points = {iteration.number: iteration.mean_point for iteration in found.history}
    last = max(mean_points)
    published_iterations = published("parameters.pso.iterations")
    least = round(LEAST_SHARE * published_iterations)
    too_short = None if last >= least else f"the search took fewer than {least} iterations"
    ratio = _ratio(truth.believed, truth.winner.score)
    yield of_interval("believed-score-over-fresh", COLUMN, "this search", ratio, cannot=too_short)
    # The iteration at which the paper's parameters settle; in a shorter search, that of the same share of its length.
    settles_at = published("parameters.pso.stabilises_at_iteration") * last / published_iterations
    settled = min(mean_points, key=lambda number: abs(number - settles_at))
    shortened = (  # why a search with fewer iterations than the paper's cannot answer the question, or None
        None
        if last >= published_iterations
        else f"the search took fewer than {published_iterations} iterations"
    )
    for k, name in enumerate(found.search.space.names):
        moved = mean_points[last][k] - mean_points[settled][k]
        # Exact, because it is a property of this one search.
        yield exact("late-change-of-parameter", COLUMN, name.rpartition(".")[2], moved, cannot=shortened)


def _ratio(believed: float, true: Interval) -> Interval:
    """Return believed / true - 1 with its limits, from the interval of the true cost; infinite for a limit of 0."""
    ends = sorted(believed / end - 1.0 if end else math.inf for end in (true.low, true.high))
    return true._replace(estimate=believed / true.estimate - 1.0, low=ends[0], high=ends[1])


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield two pictures, as in the paper: scores, and the mean of each parameter as a share of its range.

    The table of history has a column "personal I" for each particle I, and a column "mean NAME, of its bounds" for each
    parameter, whose NAME is a dotted field.
    """
    # A search may end with another stage, a race of its best candidates; the paper's search has none.
    history = tables["history"].filter(pl.col("stage") == "search")
    personal = [name for name in history.columns if name.startswith("personal ")]
    by_particle = history.select("iteration", *personal).unpivot(index="iteration", value_name="score")
    by_particle = by_particle.with_columns(
        particle=pl.col("variable").str.strip_prefix("personal ").cast(pl.Int64)
    ).drop("variable")
    scores = history.select(pl.col("iteration").cast(pl.Int64), "best", "mean")
    yield picture(
        "search-scores", "Costs over the iterations", draw_search, scores, by_particle, label="cost (mean + sd)",
        true=tables["truth"]["true"][0],
    )  # fmt: skip
    shares = [name for name in history.columns if name.endswith(", of its bounds")]
    means = history.select("iteration", *shares).unpivot(
        index="iteration", value_name="share", variable_name="series"
    )
    field = pl.col("series").str.strip_prefix("mean ").str.strip_suffix(", of its bounds")
    drawn = means.with_columns(pl.col("iteration").cast(pl.Int64), series=field)
    yield picture("search-parameters", "Mean of the parameters", draw_parameters, drawn)


SEARCH: Final = Item(
    number=3,
    name="search",
    title="The search, P* and its validation",
    about=(
        "The paper's particle swarm as its text has it: 25 particles, 50 iterations, 10 runs a particle "
        "and 10 more for the best fifth, cost of the authors' program, mean and standard deviation over runs; the "
        "lowest score wins and is never recomputed. It starts from P0 with preset `paper`. With fewer runs per cell it "
        "takes fewer iterations.",
        "Then, beyond the paper, the winner, P0, P* and parameters from another search "
        "(preset `optimised-cost`) are evaluated on the same fresh runs.",
    ),
    compute=compute,
    pictures=pictures,
    shown=(
        TableView(
            "truth",
            "Costs on fresh runs, lower is better, with 95 % intervals; the last columns have the difference "
            "(winner - these parameters).",
            {
                "parameters": Column("parameters"),
                "walk_duration_location_ms": Column("gamma_0", "ms"),
                "walk_duration_scale_ms": Column("gamma", "ms"),
                "sample_interval_ms": Column("tau", "ms"),
                "avoidance_threshold_mm": Column("theta_c", "mm"),
                "min_observations": Column("O_c"),
                "believed": Column("believed by the search"),
                "true": Column("true", limits=("true_low", "true_high")),
                "less": Column("winner - this", limits=("less_low", "less_high")),
                "runs": Column("fresh runs"),
            },
        ),
    ),
)  # fmt: skip
