"""Items 3 and 14: the paper's search by particle swarm, with its optimum and validated costs; and repeated searches.

A score is a cost as the search estimates it, from few runs; the validated ("true") cost of a parameter set is estimated
on fresh runs. The course of a single search is partly chance, so item 14 repeats shorter searches and summarises each:

| name | symbol | equation |
|---|---|---|
| personal best of particle i after iteration k | b_ik | the lowest of its scores so far |
| gap after iteration k | g_k | mean of b_ik over particles i, minus the smallest b_ik |
| remaining gap | - | g_last / g_first |
| change of the mean cost | - | mean over the last fifth of the iterations / mean over the first fifth - 1 |

The measured values of the claims are rows of ``claims.MEASURED``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import Interval, columns_of, mean_interval
from vibroswarm.optimize import (
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
from vibroswarm.paper.claim_values import Row, exact, frame, mean, of_interval
from vibroswarm.paper.columns import parameters, published
from vibroswarm.paper.item import CLAIMS, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import draw_error_bars, draw_parameters, draw_search
from vibroswarm.scenario.scenario import preset
from vibroswarm.show.document import Column
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

PARTICLES: Final = 10
"""Particles of a short search."""
ITERATIONS: Final = 12
"""Most iterations of a short search."""
LEAST_ITERATIONS: Final = 6
"""Fewest iterations for a verdict: in shorter searches the first and the last fifth are next to each other."""
RUNS_A_SHORT_ITERATION: Final = 80
"""A short search gets one iteration for this many runs per cell of the reproduction, up to ``ITERATIONS``."""
RUNS_A_SEARCH: Final = 250
"""There is one short search for this many runs per cell of the reproduction: 1000 runs give 4 searches."""
FIFTH: Final = 0.2
"""Share of the iterations at the beginning, and at the end, over which mean costs are averaged."""


def searches_of(settings: Settings) -> list[Search]:
    """Return the short searches: the paper's search with fewer particles and iterations, each with a seed of its own.

    There are at least two searches, because standard errors are computed from the differences between searches.
    """
    full = search_of(settings)
    iterations = min(ITERATIONS, max(2, settings.runs // RUNS_A_SHORT_ITERATION))
    pso = replace(full.pso, particles=PARTICLES, iterations=iterations)
    # The paper's search (item 3) has the seed ``settings.seed``; the short searches have the next seeds.
    return [
        replace(full, pso=pso, study=replace(full.study, seed=settings.seed + 1 + place))
        for place in range(max(2, settings.runs // RUNS_A_SEARCH))
    ]


def compute_repeats(work: Work) -> Tables:
    """Run the short searches one after the other; return histories, summaries, and the claims' measured values."""
    histories: list[pl.DataFrame] = []
    rows: list[dict[str, Any]] = []
    searches = searches_of(work.settings)
    for place, search in enumerate(searches):
        search_result = run_search(
            search,
            work.folder / search.hash,
            workers=work.settings.workers,
            mixed=True,  # a search that another version began is continued
            # The default value keeps this search's ``place``.
            progress=lambda now, place=place: work.progress(  # type: ignore[misc]
                (place + now.share) / len(searches)
            ),
        )
        histories.append(_history(search_result, place))
        rows.append(
            {"search": place, "seed": search.seed, "runs": search_result.runs, **_summary(search_result)}
        )
    table = pl.DataFrame(rows, infer_schema_length=None)
    return {
        "history": pl.concat(histories),
        "searches": table,
        CLAIMS: frame(list(_measured_repeats(table, searches[0].pso.iterations))),
    }


def _summary(found: Found) -> dict[str, float]:
    """Return the summary of one search: its lowest score, its gaps, and its mean costs.

    gap_first, gap_last and gap_left are g_first, g_last and their ratio; cost_first and cost_last are the mean costs
    over the first and over the last fifth of the iterations, and cost_change is their relative change.
    """
    personal_best = np.array([iteration.personal for iteration in found.history])  # (iterations, particles)
    gaps = personal_best.mean(axis=1) - personal_best.min(axis=1)
    costs = np.array([iteration.mean for iteration in found.history])
    fifth = max(round(FIFTH * costs.size), 1)
    return {
        "best": float(personal_best[-1].min()),
        "gap_first": float(gaps[0]),
        "gap_last": float(gaps[-1]),
        "gap_left": float(gaps[-1] / gaps[0]),
        "cost_first": float(costs[:fifth].mean()),
        "cost_last": float(costs[-fifth:].mean()),
        "cost_change": float(costs[-fifth:].mean() / costs[:fifth].mean() - 1.0),
    }


def _history(found: Found, place: int) -> pl.DataFrame:
    """Return one row for each iteration of search number ``place``.

    Columns: search; iteration; best, the lowest personal best; personal, the mean of the personal bests; mean, the mean
    score of all particles.
    """
    rows = [
        (place, iteration.number, min(iteration.personal), float(np.mean(iteration.personal)), iteration.mean)
        for iteration in found.history
    ]
    kinds = dict.fromkeys(("search", "iteration"), pl.Int64) | dict.fromkeys(
        ("best", "personal", "mean"), pl.Float64
    )
    return pl.DataFrame(rows, schema=kinds, orient="row")


def _measured_repeats(table: pl.DataFrame, iterations: int) -> Iterator[Row]:
    """Yield the measured values of the claims about searches: means over the short searches.

    Args:
        table: summaries, one row per search. iterations: number of iterations of each search.
    """
    too_short = (
        None
        if iterations >= LEAST_ITERATIONS
        else f"each search took fewer than {LEAST_ITERATIONS} iterations"
    )
    for value_name, name in (("gap-of-bests-left", "gap_left"), ("change-of-mean-cost", "cost_change")):
        cell = f"{table.height} short searches"
        yield mean(value_name, COLUMN, cell, table[name].to_numpy(), cannot=too_short)


def pictures_of_repeats(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield the picture of the costs over the iterations (``LINES``), with intervals over the short searches."""
    rows = [  # ``str``, because polars gives keys the static type "object"
        (float(str(iteration)), label, *mean_interval(part[name].to_numpy())[:3])
        for name, label in LINES.items()
        for (iteration,), part in tables["history"].group_by("iteration", maintain_order=True)
    ]
    points = pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high"], orient="row")
    yield picture(
        "search-repeats", "Costs over the iterations of short searches", draw_error_bars, points,
        x_label="iteration", label="cost as the search estimates it (mean + sd)",
        interval="95 % interval over searches",
    )  # fmt: skip


LINES: Final = {
    "mean": "mean of all particles",
    "personal": "mean of the personal bests",
    "best": "best of all",
}
"""Columns of ``_history`` that are drawn, with their labels."""


SEARCH_REPEATS: Final = Item(
    number=14,
    name="search-repeats",
    title="The search, several times",
    about=(
        f"A search gives one value, whatever its particles: the error is over searches. One of the paper's "
        f"size takes 15,000 runs, so short ones replace it, with {PARTICLES} particles and {ITERATIONS} "
        f"iterations (fewer with fewer runs per cell), one for each {RUNS_A_SEARCH} runs per cell. So few are rarely "
        "conclusive; `--only search-repeats --runs 10000` has 40. The whole search is item 3.",
        "Personal bests can only fall, and each is the lowest of its noisy scores: that they approach each other "
        "is partly due to this rule, not to the particles.",
    ),
    compute=compute_repeats,
    pictures=pictures_of_repeats,
    shown=(
        TableView(
            "searches",
            "Each short search, with the costs as it estimated them.",
            {
                "search": Column("search"), "seed": Column("seed"), "runs": Column("runs"),
                "best": Column("best of all"),
                "gap_first": Column("personal bests above it, first"), "gap_last": Column("last"),
                "gap_left": Column("left", share=True),
                "cost_first": Column("mean cost, first fifth"), "cost_last": Column("last fifth"),
                "cost_change": Column("change", share=True),
            },
        ),
    ),
)  # fmt: skip
