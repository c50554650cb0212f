"""Items 3 and 14: the particle swarm, its optimum, and the validated costs; and short searches like it, repeated.

What one search does by chance, several do not:

| name | symbol | equation |
|---|---|---|
| personal best of particle i after iteration k | b_ik | the lowest of its scores so far |
| gap after iteration k | g_k | mean over i of b_ik - the least of them |
| remaining gap | - | g_last / g_first |
| change of the mean cost | - | mean over the last fifth of the iterations / mean over the first fifth - 1 |
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.optimize import Found, PsoSettings, Search, Truth, run_search, truth_of
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.search_report import candidate_table, history_table
from vibroswarm.optimize.space import PAPER, Space
from vibroswarm.paper.claim_values import Row, exact, frame, mean, of_interval
from vibroswarm.paper.columns import parameters, published
from vibroswarm.paper.item import CLAIMS, Item, Picture, Settings, Tables, TableView, Work
from vibroswarm.plots import draw_error_bars, draw_parameters, draw_search
from vibroswarm.plots.labels import SYMBOLS
from vibroswarm.report.html import Column
from vibroswarm.scenario.scenario import preset
from vibroswarm.study.spec import Study

COLUMN: Final = "paper"
ELSEWHERE: Final = "optimised-cost"
"""A preset found by another search; it waits longer."""
RUNS_AN_ITERATION: Final = 20
"""Runs a cell for each iteration: 1000 give the paper's 50 iterations, fewer give fewer, more never more."""
SETTLED_AT: Final = 40
LEAST_SHARE: Final = 0.5
"""Of the paper's iterations; a shorter search gives no verdict on the score at which it ends."""


def search_of(settings: Settings) -> Search:
    """Return the paper's search: 25 particles, 50 iterations, the lowest score wins."""
    swarm = published("parameters.pso")
    iterations = min(swarm["iterations"], max(2, settings.runs // RUNS_AN_ITERATION))
    fill = swarm["fill_ratio"]
    return Search(
        study=Study(settings.scenario(COLUMN, {"floor.source": f"random:{fill}"}), seed=settings.seed),
        space=Space.of(PAPER),
        objectives=(Objective("authors_code"),),
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
    """Search, then evaluate the winner, P0, P* and another optimum on fresh runs."""
    search, workers = search_of(work.settings), work.settings.workers
    search_result = run_search(
        search,
        work.folder / search.hash,
        workers=workers,
        mixed=True,
        progress=lambda now: work.progress(0.8 * now.runs / max(now.wanted, 1)),
    )
    others = [("P*", parameters("P_star")), (ELSEWHERE, search.space.values_of(preset(ELSEWHERE)))]
    truth = truth_of(search_result, runs=max(work.settings.runs, 2), others=others, workers=workers)
    return {
        "history": history_table(search_result),
        "candidates": candidate_table(search_result),
        "truth": _truth_table(search_result, truth),
        CLAIMS: frame(list(_measured(search_result, truth))),
    }


def _truth_table(found: Found, truth: Truth) -> pl.DataFrame:
    """Return the validated costs of the winner and the others, with the differences."""
    rows = []
    for k, scored in enumerate((truth.winner, *truth.others)):
        name = {"start": "P0"}.get(scored.name, scored.name)
        less = None if k == 0 else truth.against[k - 1]
        line: dict[str, Any] = {
            "parameters": name,
            **{n.rpartition(".")[2]: v for n, v in scored.values.items()},
        }
        line |= {"believed": truth.believed if k == 0 else None}
        line |= dict(zip(("true", "true_low", "true_high"), scored.score[:3], strict=True))
        limits = (None, None, None) if less is None else less[:3]
        rows.append(
            line
            | dict(zip(("less", "less_low", "less_high"), limits, strict=True))
            | {"runs": scored.score.n}
        )
    return pl.DataFrame(rows, infer_schema_length=None)


def _measured(found: Found, truth: Truth) -> Iterator[Row]:
    """Yield rows of the claims about the search."""
    from vibroswarm.optimize.validation import paired_score

    objective = found.search.objectives[0]
    scored = {scored_set.name: scored_set for scored_set in truth.others}
    start, star, other = scored["start"], scored["P*"], scored[ELSEWHERE]
    yield of_interval("search-beats-start", COLUMN, "P0 less P*", paired_score(objective, start, star))
    yield of_interval("search-is-best", COLUMN, f"{ELSEWHERE} less P*", paired_score(objective, other, star))
    shares = {iteration.number: iteration.mean_point for iteration in found.history}
    last = max(shares)
    published_iterations = published("parameters.pso.iterations")
    least = round(LEAST_SHARE * published_iterations)
    too_short = None if last >= least else f"the search took fewer than {least} iterations"
    ratio = _ratio(truth.believed, truth.winner.score)
    yield of_interval("search-score-holds", COLUMN, "this search", ratio, too_short)
    at = min(
        shares, key=lambda number: abs(number - SETTLED_AT * last / published("parameters.pso.iterations"))
    )
    short = (
        None
        if last >= published_iterations
        else f"the search took fewer than {published_iterations} iterations"
    )
    for k, name in enumerate(found.search.space.names):
        moved = shares[last][k] - shares[at][k]
        # A property of this search only.
        yield exact("search-settles", COLUMN, name.rpartition(".")[2], moved, short)


def _ratio(believed: float, true: Interval) -> Interval:
    """Return believed / true - 1."""
    ends = sorted(believed / end - 1.0 for end in (true.low, true.high))
    return true._replace(estimate=believed / true.estimate - 1.0, low=ends[0], high=ends[1])


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Both figures of the paper: scores, and the mean of each parameter relative to its bounds."""
    history = tables["history"].filter(pl.col("stage") == "search")
    personal = [name for name in history.columns if name.startswith("personal ")]
    own = history.select("iteration", *personal).unpivot(index="iteration", value_name="score")
    own = own.with_columns(particle=pl.col("variable").str.strip_prefix("personal ").cast(pl.Int64)).drop(
        "variable"
    )
    scores = history.select(pl.col("iteration").cast(pl.Int64), "best", "mean")
    true = tables["truth"]["true"][0]
    yield Picture(
        "search-scores",
        "Costs over the iterations",
        lambda: draw_search(scores, own, label="cost (mean + sd)", true=true),
    )
    shares = [name for name in history.columns if name.endswith(", of its bounds")]
    means = history.select("iteration", *shares).unpivot(
        index="iteration", value_name="share", variable_name="series"
    )
    field = (
        pl.col("series")
        .str.strip_prefix("mean ")
        .str.strip_suffix(", of its bounds")
        .str.split(".")
        .list.last()
    )
    labels = {name.rpartition(".")[2]: label.text for name, label in SYMBOLS.items()}
    drawn = means.with_columns(pl.col("iteration").cast(pl.Int64), series=field.replace(labels))
    yield Picture("search-parameters", "Mean of the parameters", lambda: draw_parameters(drawn))


SEARCH: Final = Item(
    number=3,
    name="search",
    title="The search, P* and its validation",
    about=(
        "The paper's particle swarm as its program ran it: 25 particles, 50 iterations, 10 runs a particle "
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
                "true": Column("true"), "true_low": Column("from"), "true_high": Column("to"),
                "less": Column("winner - this"), "less_low": Column("from"), "less_high": Column("to"),
                "runs": Column("fresh runs"),
            },
        ),
    ),
)  # fmt: skip

PARTICLES: Final = 10
ITERATIONS: Final = 12
LEAST_ITERATIONS: Final = 6
"""Shorter searches give no verdict: their first and last fifths are next to each other."""
RUNS_A_SHORT_ITERATION: Final = 80
RUNS_A_SEARCH: Final = 250
"""Runs a cell for each search: 1000 give 4 searches of all iterations."""
FIFTH: Final = 0.2


def searches_of(settings: Settings) -> list[Search]:
    """Return the paper's search with fewer particles and iterations, each with its own seed."""
    full = search_of(settings)
    iterations = min(ITERATIONS, max(2, settings.runs // RUNS_A_SHORT_ITERATION))
    pso = replace(full.pso, particles=PARTICLES, iterations=iterations)
    return [
        replace(full, pso=pso, study=replace(full.study, seed=settings.seed + 1 + place))
        for place in range(max(2, settings.runs // RUNS_A_SEARCH))
    ]


def compute_repeats(work: Work) -> Tables:
    """Run the searches one after the other; compute their summaries and claims."""
    histories: list[pl.DataFrame] = []
    rows: list[dict[str, Any]] = []
    searches = searches_of(work.settings)
    for place, search in enumerate(searches):
        search_result = run_search(
            search,
            work.folder / search.hash,
            workers=work.settings.workers,
            mixed=True,
            progress=lambda now, place=place: work.progress(  # type: ignore[misc]
                (place + now.runs / max(now.wanted, 1)) / len(searches)
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
    """Return the summary of one search, see the head of this module."""
    best = np.array([iteration.personal for iteration in found.history])
    gaps = best.mean(axis=1) - best.min(axis=1)
    costs = np.array([iteration.mean for iteration in found.history])
    some = max(round(FIFTH * costs.size), 1)
    return {
        "best": float(best[-1].min()),
        "gap_first": float(gaps[0]),
        "gap_last": float(gaps[-1]),
        "gap_left": float(gaps[-1] / gaps[0]),
        "cost_first": float(costs[:some].mean()),
        "cost_last": float(costs[-some:].mean()),
        "cost_change": float(costs[-some:].mean() / costs[:some].mean() - 1.0),
    }


def _history(found: Found, place: int) -> pl.DataFrame:
    """Return the costs of each iteration of one search."""
    rows = [
        (place, iteration.number, min(iteration.personal), float(np.mean(iteration.personal)), iteration.mean)
        for iteration in found.history
    ]
    names = ("search", "iteration", "best", "personal", "mean")
    kinds = (pl.Int64, pl.Int64, pl.Float64, pl.Float64, pl.Float64)
    return pl.DataFrame(rows, schema=dict(zip(names, kinds, strict=True)), orient="row")


def _measured_repeats(table: pl.DataFrame, iterations: int) -> Iterator[Row]:
    too_short = (
        None
        if iterations >= LEAST_ITERATIONS
        else f"each search took fewer than {LEAST_ITERATIONS} iterations"
    )
    for claim, name in (("search-bests-meet", "gap_left"), ("search-mean-falls", "cost_change")):
        cell = f"{table.height} short searches"
        yield mean(claim, COLUMN, cell, table[name].to_numpy(), cannot=too_short)


def pictures_of_repeats(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield mean cost, mean personal best and global best over the iterations."""
    rows = []
    for name, label in LINES.items():
        for (iteration,), part in tables["history"].group_by("iteration", maintain_order=True):
            rows.append((float(str(iteration)), label, *mean_interval(part[name].to_numpy())[:3]))
    points = pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high"], orient="row")
    draw = partial(
        draw_error_bars, points, x_label="iteration", label="cost as the search estimates it (mean + sd)",
        interval="95 % interval over searches",
    )  # fmt: skip
    yield Picture("search-repeats", "Costs over the iterations of short searches", draw)


LINES: Final = {
    "mean": "mean of all particles",
    "personal": "mean of the personal bests",
    "best": "best of all",
}


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
                "gap_left": Column("left", percent=True),
                "cost_first": Column("mean cost, first fifth"), "cost_last": Column("last fifth"),
                "cost_change": Column("change", percent=True),
            },
        ),
    ),
)  # fmt: skip
