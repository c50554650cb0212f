"""Item 14: short searches like the paper's, repeated: what one search does by chance, several do not.

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

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.optimize import Found, Search, run_search
from vibroswarm.paper.claim_values import Row, frame, mean
from vibroswarm.paper.item import CLAIMS, Item, Picture, Settings, Tables, TableView, Work
from vibroswarm.paper.items.search import search_of
from vibroswarm.plots import draw_error_bars
from vibroswarm.report.html import Column

COLUMN: Final = "paper"
PARTICLES: Final = 10
ITERATIONS: Final = 12
LEAST_ITERATIONS: Final = 6
"""Shorter searches give no verdict: their first and last fifths are next to each other."""
RUNS_AN_ITERATION: Final = 80
RUNS_A_SEARCH: Final = 250
"""Runs a cell for each search: 1000 give 4 searches of all iterations."""
FIFTH: Final = 0.2


def searches_of(settings: Settings) -> list[Search]:
    """Return the paper's search with fewer particles and iterations, each with its own seed."""
    full = search_of(settings)
    iterations = min(ITERATIONS, max(2, settings.runs // RUNS_AN_ITERATION))
    pso = replace(full.pso, particles=PARTICLES, iterations=iterations)
    return [
        replace(full, pso=pso, study=replace(full.study, seed=settings.seed + 1 + place))
        for place in range(max(2, settings.runs // RUNS_A_SEARCH))
    ]


def compute(work: Work) -> Tables:
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
        CLAIMS: frame(list(_measured(table, searches[0].pso.iterations))),
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


def _measured(table: pl.DataFrame, iterations: int) -> Iterator[Row]:
    too_short = (
        None
        if iterations >= LEAST_ITERATIONS
        else f"each search took fewer than {LEAST_ITERATIONS} iterations"
    )
    for claim, name in (("search-bests-meet", "gap_left"), ("search-mean-falls", "cost_change")):
        cell = f"{table.height} short searches"
        yield mean(claim, COLUMN, cell, table[name].to_numpy(), cannot=too_short)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
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


ITEM: Final = Item(
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
    compute=compute,
    pictures=pictures,
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
