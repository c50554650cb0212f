"""How many robots that fail the strategies bear: the tables of docs/faults.md.

    python benchmarks/fault_curves.py [--runs 400] [--seed 1] [--cost | --gate]

Five robots at the paper's optimised settings, random floors of 48 % and 52 %; judged are the robots that work. With
``--cost``, distrust against no feedback where nobody is faulty, on the paper's floors; with ``--gate``, how
late robots have to decide for it to help.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

from vibroswarm.analysis.fault_tolerance import fault_curve
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

STRATEGIES = ("none", "positive", "soft", "distrust")
SHARES = (0.0, 0.2, 0.4)
KINDS: dict[str, tuple[str, dict[str, Any]]] = {
    "stuck at 1": ("stuck_at_1", {}),
    "stuck at 0": ("stuck_at_0", {}),
    "biased: 10 points more false positives": ("biased", {"faults.false_positive_shift": 0.1}),
    "drifting: 30 points more false positives in an hour": (
        "biased",
        {"faults.false_positive_drift_per_h": 0.3},
    ),
    "opposite bits": ("opposite", {}),
    "radio dead from 0 to 1200 s on": ("radio_dead", {"faults.radio_dead_from_s": [0.0, 1200.0]}),
    "stopped from 0 to 1200 s on": ("stopped", {"faults.stopped_from_s": [0.0, 1200.0]}),
    "battery empty from 600 to 1200 s on": ("battery_empty", {"faults.battery_life_s": [600.0, 1200.0]}),
}
FLOORS = (
    "diagonal:0.48",
    "stripe:0.48",
    "block-diagonal:0.48",
    "alternating:0.48",
    "random:0.48",
    "random:0.52",
)


def table(runs: int, seed: int) -> None:
    """Print wrong and undecided, % of the robots that work, for each fault, fill, strategy and number of robots."""
    heads = [f"{name} {round(5 * share)}" for name in STRATEGIES for share in SHARES]
    print("| fault | f | " + " | ".join(heads) + " |")
    for words, (kind, values) in KINDS.items():
        for fill in (0.48, 0.52):
            cells = []
            for name in STRATEGIES:
                own = {"strategy.name": name, "floor.source": f"random:{fill}"}
                scenario = preset("paper").with_values(own | values)
                for row in fault_curve(scenario, kind, SHARES, seed, runs).to_dicts():
                    half = 50.0 * (row["wrong_high"] - row["wrong_low"])
                    cells.append(f"{100 * row['wrong']:.1f} +- {half:.1f} / {100 * row['undecided']:.1f}")
            print(f"| {words} | {fill} | " + " | ".join(cells) + " |", flush=True)


def cost(runs: int, seed: int) -> None:
    """Print what distrust costs where nobody is faulty, at several thresholds."""
    print("| floor | rule | threshold | wrong | undecided | sources left out at the end | CPU s |")
    for floor in FLOORS:
        base = preset("paper").with_values({"floor.source": floor})
        for threshold in (None, 1e-2, 1e-4, 1e-6, 1e-9):
            name = "none" if threshold is None else "distrust"
            scenario = base.with_values({"strategy.name": name})
            if threshold is not None:
                scenario = scenario.with_values({"strategy.distrust.threshold": threshold})
            began_s = time.process_time()
            result = simulate(scenario, seed, runs, energies=False)
            took_s = time.process_time() - began_s
            robots, prior = result.robots, 2 * result.robots.height
            wrong = result.runs["wrong"].sum() / robots.height
            undecided = result.runs["undecided"].sum() / robots.height
            everything = robots["samples"].sum() + robots["messages_received"].sum()
            left_out = 1.0 - ((robots["alpha"] + robots["beta"]).sum() - prior) / everything
            print(
                f"| {floor} | {name} | {threshold or '-'} | {100 * wrong:.1f} | {100 * undecided:.1f} | "
                f"{100 * left_out:.2f} % of bits | {took_s:.2f} |",
                flush=True,
            )


def gates(runs: int, seed: int) -> None:
    """Print the robots that work and are wrong, %, with 0, 1 and 2 of five stuck at 1, f = 0.48."""
    print("| O_c | none | distrust at 1e-2 | 1e-4 | 1e-6 | 1e-9 |")
    for least in (40, 100, 150, 200, 300, 381):
        cells = []
        for threshold in (None, 1e-2, 1e-4, 1e-6, 1e-9):
            values: dict[str, Any] = {"decision.min_observations": least, "strategy.name": "none"}
            if threshold is not None:
                values |= {"strategy.name": "distrust", "strategy.distrust.threshold": threshold}
            curve = fault_curve(preset("paper").with_values(values), "stuck_at_1", SHARES, seed, runs)
            cells.append(", ".join(f"{100 * wrong:.0f}" for wrong in curve["wrong"]))
        print(f"| {least} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cost", action="store_true")
    parser.add_argument("--gate", action="store_true")
    given = parser.parse_args()
    (cost if given.cost else gates if given.gate else table)(given.runs, given.seed)
