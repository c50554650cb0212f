"""Item 14: short searches of the paper's kind, again and again: what one search does by luck, several do not.

| name | symbol | equation |
|---|---|---|
| best of particle i after iteration k | b_ik | the luckiest of its scores so far |
| gap after iteration k | g_k | mean over i of b_ik, less the least of them |
| gap that is left | - | g_last / g_first |
| fall of the mean cost | - | mean over the last fifth of the iterations / mean over the first fifth - 1 |
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.optimize import Found, Search, run_search
from vibroswarm.page.report import Column
from vibroswarm.paper.item import CLAIMS, Drawn, Item, Picture, Settings, Shown, Tables, Work
from vibroswarm.paper.items.search import search_of
from vibroswarm.paper.measure import Row, frame, mean
from vibroswarm.plots import draw_error_bars

COLUMN: Final = "paper"
PARTICLES: Final = 10
ITERATIONS: Final = 12
RUNS_AN_ITERATION: Final = 80
RUNS_A_SEARCH: Final = 250
"""Runs a cell for each search: 1000 give 4 searches of all iterations."""
FIFTH: Final = 0.2


def searches_of(settings: Settings) -> list[Search]:
    """The paper's search with fewer particles and iterations, each with a seed of its own."""
    whole = search_of(settings)
    iterations = min(ITERATIONS, max(2, settings.runs // RUNS_AN_ITERATION))
    pso = replace(whole.pso, particles=PARTICLES, iterations=iterations)
    return [
        replace(whole, pso=pso, study=replace(whole.study, seed=settings.seed + 1 + place))
        for place in range(max(2, settings.runs // RUNS_A_SEARCH))
    ]


def compute(work: Work) -> Tables:
    """Searches one after the other, what each came to, claims."""
    histories: list[pl.DataFrame] = []
    rows: list[dict[str, Any]] = []
    searches = searches_of(work.settings)
    for place, search in enumerate(searches):
        found = run_search(
            search,
            work.folder / search.hash,
            workers=work.settings.workers,
            mixed=True,
            tell=lambda told, place=place: work.tell(  # type: ignore[misc]
                (place + told.runs / max(told.wanted, 1)) / len(searches)
            ),
        )
        histories.append(_history(found, place))
        rows.append({"search": place, "seed": search.seed, "runs": found.runs, **_came(found)})
    table = pl.DataFrame(rows, infer_schema_length=None)
    return {"history": pl.concat(histories), "searches": table, CLAIMS: frame(list(_measured(table)))}


def _came(found: Found) -> dict[str, float]:
    best = np.array([one.personal for one in found.history])
    gaps = best.mean(axis=1) - best.min(axis=1)
    costs = np.array([one.mean for one in found.history])
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
    rows = [
        (place, one.number, min(one.personal), float(np.mean(one.personal)), one.mean)
        for one in found.history
    ]
    names = ("search", "iteration", "best", "personal", "mean")
    kinds = (pl.Int64, pl.Int64, pl.Float64, pl.Float64, pl.Float64)
    return pl.DataFrame(rows, schema=dict(zip(names, kinds, strict=True)), orient="row")


def _measured(table: pl.DataFrame) -> Iterator[Row]:
    for claim, name in (("search-bests-meet", "gap_left"), ("search-mean-falls", "cost_change")):
        yield mean(claim, COLUMN, f"{table.height} short searches", table[name].to_numpy())


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Mean cost, personal bests and best of all over the iterations."""
    yield Picture("search-repeats", "Costs over the iterations of short searches", lambda: _draw(tables))


LINES: Final = {
    "mean": "mean of all particles",
    "personal": "mean of the personal bests",
    "best": "best of all",
}


def _draw(tables: Tables) -> Drawn:
    rows = []
    for name, words in LINES.items():
        for (iteration,), part in tables["history"].group_by("iteration", maintain_order=True):
            found = mean_interval(part[name].to_numpy())
            rows.append((float(str(iteration)), words, *found[:3], found.n))
    names = ("x", "series", "estimate", "low", "high", "searches")
    numbers = pl.DataFrame(rows, schema=list(names), orient="row")
    label = "cost as the search believes it (mean + sd)"
    return draw_error_bars(
        numbers.drop("searches"), x_label="iteration", label=label, interval="95 % interval over searches"
    )


ITEM: Final = Item(
    number=14,
    name="search-repeats",
    title="The search, several times",
    about=(
        f"What a search does is one value, whatever its particles: the error is over searches. One of the paper's "
        f"size takes 15,000 runs, so short ones stand for it, alike but for {PARTICLES} particles and {ITERATIONS} "
        f"iterations (fewer with fewer runs a cell), one for each {RUNS_A_SEARCH} runs a cell: so few seldom tell, and "
        "`--only search-repeats --runs 10000` has 40. The whole search is item 3.",
        "Personal bests can only fall, and each is the luckiest of its scores: that they come near to each other "
        "is in part this rule, not the particles' doing.",
    ),
    compute=compute,
    pictures=pictures,
    shown=(
        Shown(
            "searches",
            "Each short search; costs are what it believed.",
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
