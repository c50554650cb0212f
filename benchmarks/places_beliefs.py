"""Measure whether robots of ``places`` that decide are right as often as they believe.

    python benchmarks/places_beliefs.py --runs 1000 --seed 9002

Floors are those that the map presumes: each of 25 tiles vibrates by a coin. Floors of 5 to 20 vibrating tiles are
simulated on the same motion and weighed by how often a coin throws them. A line: % of the robots that decide, how sure
they are in the mean when they do, % of their decisions that are right, with the half-width of its 95 % interval (by
the jackknife over motions), and what they believe too much, in points. v = 1, the grid is known.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from scipy.stats import binom

from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.motion.source import source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import floors_of

TILES = 25
COUNTS = range(5, 21)
CASES: dict[str, dict[str, Any]] = {
    "true places": {"localisation.method": "true"},
    "good gyro": {},
    "poor gyro": {"odometry.level": "poor"},
    "poor gyro without monitor": {"odometry.level": "poor", "localisation.monitor": False},
    "poor gyro told good": {"odometry.level": "poor", "localisation.assumed_level": "good"},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=9002)
    parser.add_argument("--cases", default=",".join(CASES), help="separated by commas")
    given = parser.parse_args()
    base = preset("paper").with_values({"strategy.name": "places", "localisation.method": "mixture"})
    motion = source("event").batch(base, given.seed, range(given.runs), False, True)
    timeline = timeline_of(base, motion)
    weights = binom.pmf(np.array(COUNTS), TILES, 0.5)
    for name in given.cases.split(","):
        scenario = base.with_values(CASES[name])
        sums = np.zeros((given.runs, 4))  # robots, decided, how sure, right
        for weight, count in zip(weights, COUNTS, strict=True):
            floor = scenario.with_values({"floor.source": f"random:{count / TILES}"})
            floors = floors_of(floor, given.seed, list(range(given.runs)))
            readings = observe(floor, given.seed, motion.samples, floors, energies=False)["observation"]
            agents = replay_to_end(scenario, given.seed, timeline, readings.to_numpy()).agents
            decided, below = agents["decision"] != -1, agents["belief_at_decision"]
            sure = np.where(decided, np.where(agents["decision"] == 0, below, 1.0 - below), 0.0)
            right = agents["decision"] == int(count > TILES / 2)
            columns = np.stack([np.ones(below.size), decided, sure, decided & right], axis=-1)
            sums += weight * columns.reshape(given.runs, -1, 4).sum(axis=1)
        total = sums.sum(axis=0)
        robots, decided, sure, right = total
        without = total - sums
        shares = 100.0 * (without[:, 2] - without[:, 3]) / without[:, 1]
        half = 1.96 * np.sqrt((given.runs - 1) * shares.var())
        print(
            f"{name:24s} decided {100 * decided / robots:.1f} %, believed {100 * sure / decided:.1f} %, "
            f"right {100 * right / decided:.1f} %: {100 * (sure - right) / decided:+.1f} +- {half:.1f} points",
            flush=True,
        )


if __name__ == "__main__":
    main()
