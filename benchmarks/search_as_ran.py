"""The study's search as its program ran it, beside the default: what each search believes, and what is true.

    python benchmarks/search_as_ran.py [--seeds 10] [--budget 15000] [--fresh 2500] [--out CSV] [--ways NAME ...]

| way | velocities at first, first move | runs of an evaluation | crashes | winner |
|---|---|---|---|---|
| as-ran | 0, inertia 1.0 | re-evaluation x (iteration + 1), shared by all particles | a tenth, dropped | lowest score |
| own-runs | the same | each its own | the same | the same |
| default | small, less | each its own | none | of a race on further runs |

Every winner, P0 and P* are scored on the same fresh runs of that seed. `own-runs` differs from `as-ran` in nothing but
the numbers of the runs, so that the difference of believed / true between them is what the shared seeds cause. Robots
count received messages only (`decision.gate`), as in the program of the search.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import polars as pl

from search_seeds import FIELDS, values_of
from vibroswarm.scenario.scenario import preset
from vibroswarm.search import evaluate
from vibroswarm.search.loop import Found, run_search
from vibroswarm.search.pso import PsoSettings, shared_run
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import truth_of
from vibroswarm.statistics.intervals import mean_interval
from vibroswarm.study.spec import Study

WAYS = ("as-ran", "own-runs", "default")
CRASHED = 0.1
GATE = {"decision.gate": "received"}


def search_of(way: str, seed: int, budget: int) -> Search:
    """The search of one way and seed."""
    pso = PsoSettings() if way == "default" else PsoSettings(noise="as-ran", crash_share=CRASHED)
    study = Study(preset("paper").with_values(GATE).model_dump(exclude_none=True), seed=seed)
    return Search(study=study, pso=pso).with_settings(budget=budget)


def run_way(way: str, seed: int, budget: int) -> Found:
    """Run a search of one way."""
    numbers = count()
    own = (lambda evaluation, iteration: next(numbers)) if way == "own-runs" else shared_run
    with patch.object(evaluate, "shared_run", own):
        return run_search(search_of(way, seed, budget))


def one(way: str, seed: int, budget: int, fresh: int) -> dict[str, Any]:
    """A search and what is true of it."""
    begun_s = time.perf_counter()
    found = run_way(way, seed, budget)
    took_s = time.perf_counter() - begun_s
    others = [("P0", values_of("paper-empirical")), ("P*", values_of("paper"))]
    truth = truth_of(replace(found, search=replace(found.search, start=())), runs=fresh, others=others)
    row: dict[str, Any] = {"way": way, "seed": seed, "runs": found.runs, "crashed": found.archive.failed}
    row |= {field.rpartition(".")[2]: found.values[field] for field in FIELDS}
    row |= {
        "runs of the winner": found.archive.count(found.best),
        "clock_s": took_s,
        "believed": truth.believed,
    }
    for name, score in (("true", truth.winner), ("P0", truth.others[0]), ("P*", truth.others[1])):
        row[name], row[f"{name}_low"], row[f"{name}_high"] = score.score[:3]
    row["less P*"], row["less P*_low"], row["less P*_high"] = truth.against[1][:3]
    return row | {"believed / true": row["believed"] / row["true"]}


def main() -> None:
    options = argparse.ArgumentParser(description="The study's search as its program ran it.")
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--budget", type=int, default=15_000)
    options.add_argument("--fresh", type=int, default=2_500)
    options.add_argument("--ways", nargs="+", default=WAYS, choices=WAYS)
    options.add_argument("--out", type=Path, default=None)
    given = options.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(1, given.seeds + 1):
        for way in given.ways:
            rows.append(one(way, seed, given.budget, given.fresh))
            print({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in rows[-1].items()}, flush=True)
            if given.out is not None:
                pl.DataFrame(rows, infer_schema_length=None).write_csv(given.out)
    table = pl.DataFrame(rows, infer_schema_length=None)
    for way in given.ways:
        own = table.filter(pl.col("way") == way)
        words = [
            f"{name} {interval.estimate:.3g} [{interval.low:.3g}, {interval.high:.3g}]"
            for name in ("believed", "true", "believed / true", "less P*")
            for interval in [mean_interval(own[name].to_numpy())]
        ]
        better = int((own["less P*_high"] < 0).sum()), int((own["less P*_low"] > 0).sum())
        print(f"{way}: {', '.join(words)}; better than P* {better[0]}, worse {better[1]} of {own.height}")


if __name__ == "__main__":
    main()
