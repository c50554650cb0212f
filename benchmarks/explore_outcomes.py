"""Measure robots that steer (``explore``) beside robots of ``places`` that walk, and soft feedback, on the same seeds.

    python benchmarks/explore_outcomes.py --runs 300 --seed 9302 --out out/explore

5 robots, 1200 s, v = 2, the grid is known; floors of 12 and 13 vibrating tiles of 25, or a pattern of the paper. Robots
of soft feedback and places share their motion, those of explore drive elsewhere. A cell: mean decision time s (end of
the run if undecided)/% of robots wrong +- half-width of its 95 % interval, with the run as the unit/% undecided. A case
that OUT holds is not measured again.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.optimize.outcomes import outcomes_of
from vibroswarm.scenario.scenario import preset

HARD = ("random:0.48", "random:0.52")
GRID = {"floor.rows": 10, "floor.columns": 10}
POOR = {"odometry.level": "poor"}
FALLS = {"strategy.{name}.falls_from": 0.5, "strategy.{name}.variance_factor": 1.0}
CASES: dict[str, tuple[str, dict[str, Any], tuple[str, ...]]] = {
    "motion that suits": ("optimised-places", {}, HARD),
    "motion that suits; poor gyro": ("optimised-places", POOR, HARD),
    "motion that suits; one robot stuck at 1": ("optimised-places", {"faults.stuck_at_1": 0.2}, HARD),
    "`calibrated`; reach told": ("calibrated", {"strategy.{name}.edge_reach_m": 0.01}, HARD),
    "`paper`": ("paper", {}, HARD),
    "motion that suits; patterns; falling v = 1": (
        "optimised-places",
        GRID | FALLS,
        ("diagonal:0.48", "stripe:0.48", "block-diagonal:0.48", "alternating:0.48", "random-fixed:0.48"),
    ),
    "motion that suits; true places": ("optimised-places", {"localisation.method": "true"}, HARD),
}
STRATEGIES = ("soft", "places", "explore")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=9302)
    parser.add_argument("--out", type=Path, required=True, help="folder of one CSV file per case")
    parser.add_argument("--cases", help=f"separated by commas: {', '.join(CASES)}")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for number, (name, (of, values, floors)) in enumerate(CASES.items()):
        if given.cases is not None and name not in given.cases.split(","):
            continue
        file = given.out / f"{number}-{given.runs}-{given.seed}.csv"
        if not file.exists():
            rows = [
                row(name, of, values, floor, strategy, given.runs, given.seed)
                for floor in floors
                for strategy in STRATEGIES
            ]
            write_file(file, csv_bytes(pl.DataFrame(rows)))
        found = pl.read_csv(file)
        for floor in floors:
            cells = [
                f"{r['time_s']:.0f}/{r['wrong']:.1f} +- {r['half']:.1f}/{r['undecided']:.1f}"
                for r in found.filter(floor=floor).iter_rows(named=True)
            ]
            print(f"| {name} | {floor} | {' | '.join(cells)} |", flush=True)


def row(
    case: str, of: str, values: dict[str, Any], floor: str, strategy: str, runs: int, seed: int
) -> dict[str, Any]:
    """Simulate one strategy on one kind of floor."""
    mine = {} if strategy == "soft" else {f"strategy.{strategy}.variance_factor": 2.0}
    mine |= {
        key.format(name=strategy): value
        for key, value in values.items()
        if strategy != "soft" or not key.startswith("strategy.")
    }
    scenario = preset(of).with_values(
        {"localisation.method": "mixture", "strategy.name": strategy, "floor.source": floor} | mine
    )
    (found,) = outcomes_of([scenario], seed, range(runs))
    truth = int(float(floor.partition(":")[2]) > 0.5)
    decision = np.asarray(found.decision).reshape(runs, -1)
    time_s = np.where(
        decision == -1, scenario.run.t_end_s, np.nan_to_num(found.decision_time_s).reshape(runs, -1)
    )
    wrong = (decision == 1 - truth).mean(axis=1)
    return {
        "case": case,
        "floor": floor,
        "strategy": strategy,
        "runs": runs,
        "seed": seed,
        "time_s": float(time_s.mean()),
        "wrong": 100.0 * float(wrong.mean()),
        "half": 196.0 * float(wrong.std()) / runs**0.5,
        "undecided": 100.0 * float((decision == -1).mean()),
    }


if __name__ == "__main__":
    main()
