"""How decisions depend on how far vibration reaches beyond edges, on tiles of 20 cm and, extrapolated, of 10 cm.

    python benchmarks/edge_reach.py [--runs 300] [--seed 1]

Preset `calibrated`, no feedback, random floors of f = 0.48, 5 x 5 tiles of 20 cm and 10 x 10 of 10 cm. The fit has 10.4
mm [8.4, 12.2]. Everything else, the blur too, stays as fitted. Motion is shared by the reaches of one floor size.
"""

from __future__ import annotations

import argparse

import numpy as np

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import replay, simulate

REACHES_MM = (0.0, 5.0, 8.4, 10.4, 12.2, 15.0, 20.0)
SIZES = (5, 10)


def main() -> None:
    options = argparse.ArgumentParser(description="Sensitivity to the reach of vibration beyond edges.")
    options.add_argument("--runs", type=int, default=300)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    for tiles in SIZES:
        base = preset("calibrated").with_values({"floor.rows": tiles, "floor.columns": tiles})
        moved = simulate(base, given.seed, given.runs, energies=False)
        for reach_mm in REACHES_MM:
            scenario = base.with_values({"sensor.edge_reach_m": reach_mm / 1000.0})
            found = replay(moved, scenario)
            time_s = found.robots["decision_time_s"].fill_null(scenario.run.t_end_s).to_numpy()
            by_run = time_s.reshape(given.runs, -1).mean(axis=1)
            time = mean_interval(by_run)
            right = mean_interval(
                found.robots["belief_in_truth"].to_numpy().reshape(given.runs, -1).mean(axis=1)
            )
            ones = float(np.mean(found.observations["observation"].to_numpy()))
            shares = {
                kind: float(np.mean(found.robots["decision"].to_numpy() == code))
                for kind, code in (("below", 0), ("above", 1), ("undecided", -1))
            }
            print(
                f"{100 // tiles} cm, reach {reach_mm:4.1f} mm: ones {100 * ones:.1f} %, time {time.estimate:.0f} "
                f"[{time.low:.0f}, {time.high:.0f}] s, belief in the truth {right.estimate:.3f} [{right.low:.3f}, "
                f"{right.high:.3f}], right {100 * shares['below']:.0f} %, wrong {100 * shares['above']:.0f} %, "
                f"undecided {100 * shares['undecided']:.0f} %",
                flush=True,
            )


if __name__ == "__main__":
    main()
