"""Measure what a wrong grid costs robots of the strategy places: floors of 5 x 5 tiles, other grids assumed.

    python benchmarks/wrong_grid.py --runs 300 --seed 9003

Readings and truth are of floors of 12 and 13 vibrating tiles of 25; robots presume so many tiles a side of the same
arena. ``field`` presumes none, ``soft`` counts. Forced: sign of the score at the end of the run, decided or not.
"""

from __future__ import annotations

import argparse

import numpy as np

from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import floors_of, summarise

CASES = (
    *((f"places, {side} x {side}", {"strategy.name": "places", "floor.rows": side, "floor.columns": side,
      "floor.source": f"random:{side * side // 2 / side**2!r}"})
      for side in (5, 10, 7, 6)),
    ("field", {"strategy.name": "field"}),
    ("soft", {"strategy.name": "soft"}),
)  # fmt: skip
V = (1.0, 2.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=9003)
    parser.add_argument("--method", default="mixture", help="of localisation")
    given = parser.parse_args()
    base = Scenario().with_values({"localisation.method": given.method})
    runs = list(range(given.runs))
    motion = source("event").batch(base, given.seed, runs, False, True)
    timeline = timeline_of(base, motion)
    robots = base.swarm.robots
    print(f"{given.runs} runs, seed {given.seed}, places {given.method}; time s / % wrong / % undecided")
    for name, values in CASES:
        for v in V if values["strategy.name"] == "places" else (1.0,):
            cells, forced = [], []
            for fill, truth in ((0.48, 0), (0.52, 1)):
                floor = base.with_values({"floor.source": f"random:{fill}"})
                floors = floors_of(floor, given.seed, runs)
                observations = observe(floor, given.seed, motion.samples, floors, energies=False)
                scenario = base.with_values(  # whose own floors are not used
                    values | ({"strategy.places.variance_factor": v} if "places" in name else {})
                )
                found, _ = summarise(scenario, given.seed, floors, timeline, observations)
                decision = found["decision"].to_numpy()
                time_s = found["decision_time_s"].fill_null(base.run.t_end_s).to_numpy()
                wrong, undecided = (decision == 1 - truth).mean(), (decision == -1).mean()
                cells.append(f"{time_s.mean():.0f}/{100 * wrong:.1f}/{100 * undecided:.0f}")
                reading = observations["observation"].to_numpy()
                swarm = replay_to_end(scenario, given.seed, timeline, reading)
                below = swarm.agents["belief"] > 0.5
                forced.append((below != (truth == 0)).reshape(-1, robots).mean(axis=1))
            each = np.concatenate(forced)
            half = 1.96 * each.std() / np.sqrt(each.size)
            label = f"{name}, v = {v:g}" if "places" in name else name
            print(
                f"{label:24s} {'  '.join(cells)}  forced {100 * each.mean():.1f} +- {100 * half:.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
