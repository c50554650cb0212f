"""What settings of ``forget`` and ``reset`` do where a floor changes, and where it does not.

    python benchmarks/change_settings.py

Prints two tables: shares of swarms that leave the right side and delays after an
inversion of .40 to .60 over p_c (as ``change_delay.py``, 200 runs of seed 43), and the share of runs of 1200 s in which
any of five robots tells of a change on a still floor (300 runs of seed 1, task ``changed``).
"""

from __future__ import annotations

import argparse
from typing import Final

import polars as pl

from change_delay import GRIDS, at_threshold, base, beliefs_of, settings, words
from vibroswarm import preset, replay, simulate
from vibroswarm.statistics.intervals import mean_interval, wilson

P_C: Final = (0.6, 0.8, 0.9, 0.95)
SETTINGS: Final[tuple[tuple[str, dict[str, float]], ...]] = (
    ("forget", {"memory": 160.0}),
    ("forget", {"memory": 400.0}),
    ("reset", {"threshold": 10.5, "least": 0.12}),
    ("reset", {"threshold": 8.0, "least": 0.05}),
)
STILL: Final = ((8.0, 0.05), (12.0, 0.05), (14.0, 0.05), (12.0, 0.12), (16.0, 0.12))
"""Threshold and least distance."""


def print_delays() -> None:
    moved = simulate(base(0.4), 43, 200, energies=False, moves=True)
    print("| strategy |", " | ".join(f"p_c {p_c}" for p_c in P_C), "|\n|---|---|---|---|---|")
    for name, values in SETTINGS:
        scenario = base(0.4).with_values(settings(GRIDS[name], values, 0.95))
        runs, cells = beliefs_of(replay(moved, scenario)), []
        for p_c in P_C:
            left, delay_s = at_threshold(runs, p_c, scenario.swarm.robots)
            share = words(wilson(int(left.sum()), left.size), 100.0, 1)
            cells.append(f"{share} %, {words(mean_interval(delay_s))} s")
        print("|", " | ".join([f"`{name}` {values}", *cells]), "|")


def print_false_changes() -> None:
    print("| fill ratio |", " | ".join(f"threshold {t:g}, least {least:g}" for t, least in STILL), "|")
    print("|---" * 6 + "|")
    for fill in (0.3, 0.4, 0.45):
        scenario = preset("paper").with_values({
            "floor.source": f"random:{fill}", "floor.rows": 10, "floor.columns": 10, "task.name": "changed",
            "strategy.name": "reset", "strategy.reset.tells_change": True,
        })  # fmt: skip
        moved, cells = simulate(scenario, 1, 300, energies=False), []
        for threshold, least in STILL:
            values = {"strategy.reset.threshold": threshold, "strategy.reset.least": least}
            told = replay(moved, scenario.with_values(values)).inference.filter(pl.col("decision") == 1)
            cells.append(words(wilson(told["run"].n_unique(), 300), 100.0, 1) + " %")
        print("|", " | ".join([f"{fill:g}", *cells]), "|")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    print_delays()
    print_false_changes()
