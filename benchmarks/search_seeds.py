"""The particle swarm again and again: what each search believed, what is true, beside P0 and P*. The long check.

    python benchmarks/search_seeds.py [--seeds 10] [--noise rescore fixed] [--budget 15000] [--fresh 2500] [--out CSV]

``fixed`` is the paper's way (25 particles, 50 iterations, 10 + 10 evaluations), ``rescore`` the default. Every winner,
P0 and P* are scored on the same fresh runs of that seed, and compared in pairs. A row a search, as they come; the times
are those of the whole search, of the clock and of the processors.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl

from vibroswarm.scenario.scenario import preset
from vibroswarm.search.loop import run_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import truth_of
from vibroswarm.study.spec import Study

FIELDS = (
    "walk.walk_duration_location_ms",
    "walk.walk_duration_scale_ms",
    "sample.sample_interval_ms",
    "walk.avoidance_threshold_mm",
    "decision.min_observations",
)


def values_of(name: str) -> dict[str, Any]:
    """The searched fields of a preset."""
    scenario = preset(name)
    sections = (field.split(".") for field in FIELDS)
    return {f"{section}.{field}": getattr(getattr(scenario, section), field) for section, field in sections}


def one(seed: int, noise: str, budget: int, fresh: int) -> dict[str, Any]:
    """A search and what is true of it."""
    search = Search(study=Study(seed=seed))
    search = replace(search, pso=search.pso.model_copy(update={"noise": noise})).with_settings(budget=budget)
    clock_s, cpu_s = time.perf_counter(), time.process_time()
    found = run_search(search)
    clock_s, cpu_s = time.perf_counter() - clock_s, time.process_time() - cpu_s
    others = [("P0", values_of("paper-empirical")), ("P*", values_of("paper"))]
    truth = truth_of(replace(found, search=replace(search, start=())), runs=fresh, others=others)
    row: dict[str, Any] = {
        "noise": noise,
        "seed": seed,
        "runs": found.archive.runs,
        "clock_s": clock_s,
        "cpu_s": cpu_s,
    }
    row |= {field.rpartition(".")[2]: found.values[field] for field in FIELDS}
    row["believed"] = truth.believed
    for name, score in (("true", truth.winner), ("P0", truth.others[0]), ("P*", truth.others[1])):
        row[name], row[f"{name}_low"], row[f"{name}_high"] = score.score[:3]
    row["less P*"], row["less P*_low"], row["less P*_high"] = truth.against[1][:3]
    return row | {"failed": found.archive.failed}


def main() -> None:
    options = argparse.ArgumentParser(description="The particle swarm on many seeds.")
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--noise", nargs="+", default=["rescore", "fixed"])
    options.add_argument("--budget", type=int, default=15_000)
    options.add_argument("--fresh", type=int, default=2_500)
    options.add_argument("--out", type=Path, default=None)
    given = options.parse_args()
    rows: list[dict[str, Any]] = []
    for seed in range(1, given.seeds + 1):
        for noise in given.noise:
            rows.append(one(seed, noise, given.budget, given.fresh))
            print({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in rows[-1].items()}, flush=True)
            if given.out is not None:
                pl.DataFrame(rows, infer_schema_length=None).write_csv(given.out)


if __name__ == "__main__":
    main()
