"""Which method should a user take? True cost reached against runs spent, on the simulation itself, 20 seeds each.

    python benchmarks/search_simulated.py --out rows.csv [--seeds 20] [--budgets 1500,5000] [--methods pso random ...]
    python benchmarks/search_simulated.py --draw rows.csv... --picture search-simulated      the table and the picture

Rows of ``search_seeds.py`` may be drawn too.

The paper's five fields from P0, cost ``authors_code`` (mean + sd). All methods have the same account: so many runs,
two fifths of them in the race of the finalists. Every winner of a seed is scored on the same fresh runs. Rows are
written as they come, seed by seed; what is there is not done again.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.search.loop import run_search
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import truth_of
from vibroswarm.statistics.intervals import mean_interval
from vibroswarm.study.spec import Study

METHODS = ("pso, the paper's way", "pso", "random", "sobol", "tpe", "cmaes", "gp")


def search_of(method: str, budget: int, seed: int) -> Search:
    """The default search with another method, budget and seed."""
    search = Search(study=Study(seed=seed))
    if method == METHODS[0]:
        search = replace(search, pso=search.pso.model_copy(update={"noise": "fixed"}))
    return search.with_settings(method=method.split(",")[0], budget=budget)


def one(method: str, budget: int, seed: int, fresh: int, workers: int | None) -> dict[str, Any]:
    """A search and what is true of its winner."""
    search = search_of(method, budget, seed)
    cpu_s = time.process_time()
    found = run_search(search, workers=workers)
    cpu_s = time.process_time() - cpu_s
    truth = truth_of(replace(found, search=replace(search, start=())), runs=fresh, workers=workers)
    score = truth.winner.score
    return {
        "method": method, "budget": budget, "seed": seed, "runs": found.archive.runs, "cpu_s": cpu_s,
        "believed": truth.believed, "true": score.estimate, "true_low": score.low, "true_high": score.high,
        "failed": found.archive.failed, **{k.rpartition(".")[2]: v for k, v in found.values.items()},
    }  # fmt: skip


def summary(rows: pl.DataFrame) -> pl.DataFrame:
    """One row a method and budget: mean true cost over seeds with its limits, the worst seed, believed over true."""
    found = []
    for budget in sorted(rows["budget"].unique().to_list()):
        for method in METHODS:
            part = rows.filter((pl.col("budget") == budget) & (pl.col("method") == method))
            if part.height < 2:
                continue
            true = part["true"].to_numpy()
            estimate, low, high = mean_interval(true)[:3]
            share = part["believed"].to_numpy() / true
            found.append(
                (float(budget), method, estimate, low, high, part.height, float(true.max()),
                 float(share.mean()), float(np.min(share)), float(np.max(share)))
            )  # fmt: skip
    names = ["x", "series", "estimate", "low", "high", "seeds", "worst", "believed", "lowest", "highest"]
    return pl.DataFrame(found, schema=names, orient="row")


def rows_in(path: Path) -> pl.DataFrame:
    """Rows of this benchmark or of ``search_seeds.py``, whose two ways are the default and the paper's."""
    rows = pl.read_csv(path)
    if "method" in rows.columns:
        return rows
    named = pl.col("noise").replace_strict({"rescore": "pso", "fixed": METHODS[0]})
    return rows.select(named.alias("method"), pl.col("runs").alias("budget"), "seed", "believed", "true")


def draw(paths: list[Path], picture: Path | None) -> None:
    """Print the table; draw true cost against runs spent."""
    table = summary(pl.concat([rows_in(path) for path in paths], how="diagonal_relaxed"))
    for row in table.iter_rows(named=True):
        print(
            f"{row['x']:7,.0f} {row['series']:<22} {row['estimate']:6.2f} [{row['low']:.2f}, {row['high']:.2f}] "
            f"worst {row['worst']:5.1f}, believed/true {row['believed']:.2f} ({row['lowest']:.2f} to "
            f"{row['highest']:.2f}), {row['seeds']} seeds"
        )
    if picture is None:
        return
    from vibroswarm.plots import draw_error_bars

    drawn = draw_error_bars(
        table.select("x", "series", "estimate", "low", "high"),
        x_label="runs spent", label="true cost of the winner", interval="95 % interval over seeds", log=True,
        style="page",
    )  # fmt: skip
    drawn.write(picture, ("svg",))
    print(drawn.caption)


def main() -> None:
    options = argparse.ArgumentParser(description="Methods of search on the simulation itself.")
    options.add_argument("--seeds", type=int, default=20)
    options.add_argument("--first", type=int, default=1, help="seed to begin with")
    options.add_argument("--budgets", default="1500,5000")
    options.add_argument("--methods", nargs="+", default=list(METHODS[:-1]))
    options.add_argument("--fresh", type=int, default=1000)
    options.add_argument("--workers", type=int, default=None)
    options.add_argument("--out", type=Path, default=Path("search-simulated.csv"))
    options.add_argument("--draw", type=Path, nargs="+", default=None)
    options.add_argument("--picture", type=Path, default=None)
    given = options.parse_args()
    if given.draw is not None:
        draw(given.draw, given.picture)
        return
    rows = pl.read_csv(given.out).to_dicts() if given.out.is_file() else []
    done = {(row["method"], row["budget"], row["seed"]) for row in rows}
    for seed in range(given.first, given.first + given.seeds):
        for budget in (int(text) for text in given.budgets.split(",")):
            for method in given.methods:
                if (method, budget, seed) in done:
                    continue
                rows.append(one(method, budget, seed, given.fresh, given.workers))
                print({k: rows[-1][k] for k in ("method", "budget", "seed", "true", "cpu_s")}, flush=True)
                pl.DataFrame(rows, infer_schema_length=None).write_csv(given.out)


if __name__ == "__main__":
    main()
