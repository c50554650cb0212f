"""Ask robots of ``places`` whether more than 3 % of 10 x 10 tiles vibrate: the tables of docs/places.md.

    python benchmarks/places_share.py --runs 300 --seed 9003
    python benchmarks/places_share.py --drawn 500 --seed 9102

The first measures floors of given shares: swarms in which all, or any, robots say "more", robots by what they say, and
the mean decision time (the end of the run if undecided). The second draws the number of vibrating tiles from the prior
(``place_share``), and compares how often robots that decide are right with how sure they are, with half-widths of 95 %
intervals, the run as the unit.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import betabinom

from vibroswarm.floors.floor import Floor
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.motion.source import Motion, source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of

SIDE, BOUNDARY = 10, 0.03


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=0, help="runs of floors of given shares")
    parser.add_argument("--fills", default="0,0.01,0.02,0.03,0.04,0.05,0.1", help="separated by commas")
    parser.add_argument("--drawn", type=int, default=0, help="runs of floors drawn from the prior")
    parser.add_argument("--seed", type=int, default=9003)
    parser.add_argument("--strategy", default="places")
    given = parser.parse_args()
    base = preset("paper").with_values(
        {
            "floor.rows": SIDE,
            "floor.columns": SIDE,
            "strategy.name": given.strategy,
            "decision.decision_boundary": BOUNDARY,
            "decision.boundary_of": "tiles",
        }
    )
    if given.runs:
        of_shares(base, given.runs, given.seed, [float(fill) for fill in given.fills.split(",")])
    if given.drawn:
        of_prior(base, given.drawn, given.seed)


def moved(base: Scenario, runs: int, seed: int) -> tuple[Motion, Timeline]:
    """Return the motion of some runs, and its timeline."""
    motion = source("event").batch(base, seed, range(runs), False, True)
    return motion, timeline_of(base, motion)


def of_shares(base: Scenario, runs: int, seed: int, fills: list[float]) -> None:
    """Print what robots say on random floors of given shares."""
    motion, timeline = moved(base, runs, seed)
    for fill in fills:
        scenario = base.with_values({"floor.source": f"random:{fill:g}"})
        floors = floors_of(scenario, seed, list(range(runs)))
        bits = observe(scenario, seed, motion.samples, floors, energies=False)["observation"].to_numpy()
        agents = replay_to_end(scenario, seed, timeline, bits).agents
        said = agents["decision"].reshape(runs, -1)
        time_s = np.where(agents["decision"] == -1, base.run.t_end_s, agents["decided_s"])
        shares = ", ".join(
            f"{100 * (said == k).mean():.1f} % {word}"
            for k, word in ((1, "more"), (0, "not more"), (-1, "undecided"))
        )
        print(
            f"{100 * fill:g} %: more in {(said == 1).all(axis=1).sum()} swarms, any robot in "
            f"{(said == 1).any(axis=1).sum()}; robots: {shares}; {time_s.mean():.0f} s",
            flush=True,
        )


def of_prior(base: Scenario, runs: int, seed: int) -> None:
    """Print how sure robots are when they decide, and how often they are right, on floors drawn from the prior."""
    motion, timeline = moved(base, runs, seed)
    rng, tiles = np.random.default_rng(seed), SIDE * SIDE
    counts = betabinom.rvs(tiles, 1.0, math.log(2.0) / -math.log(1.0 - BOUNDARY), size=runs, random_state=rng)
    tile_m = base.arena.width_m / SIDE
    floors = {
        run: Floor(drawn(rng, int(count)), tile_m, tile_m, 0.0, 0.0, "drawn")
        for run, count in enumerate(counts)
    }
    bits = observe(base, seed, motion.samples, floors, energies=False)["observation"].to_numpy()
    truth = (counts > BOUNDARY * tiles + 1e-9)[:, None]
    for method in ("mixture", "true"):
        scenario = base.with_values({"localisation.method": method})
        agents = replay_to_end(scenario, seed, timeline, bits).agents
        said = agents["decision"].reshape(runs, -1)
        below = agents["belief_at_decision"].reshape(runs, -1)
        decided = said != -1
        sure = np.where(decided, np.where(said == 0, below, 1.0 - below), 0.0)
        right = decided & (said == truth)
        of_all = (share_of(values.sum(axis=1), decided.sum(axis=1)) for values in (sure, right, sure - right))
        believed, correct, excess = of_all
        print(
            f"{method}: decided {100 * decided.mean():.1f} %, believed {100 * believed[0]:.2f} %, right "
            f"{100 * correct[0]:.2f} +- {100 * correct[1]:.2f} %: "
            f"{100 * excess[0]:+.2f} +- {100 * excess[1]:.2f} points",
            flush=True,
        )


def drawn(rng: np.random.Generator, count: int) -> NDArray[np.uint8]:
    """Return tiles of which ``count`` at random vibrate."""
    tiles = np.zeros(SIDE * SIDE, dtype=np.uint8)
    tiles[rng.permutation(tiles.size)[:count]] = 1
    return tiles.reshape(SIDE, SIDE)


def share_of(sums: NDArray[np.float64], counts: NDArray[np.int64]) -> tuple[float, float]:
    """Return a mean over robots that decided, and the half-width of its 95 % interval, from sums by run."""
    share = float(sums.sum() / counts.sum())
    half = 1.96 * float((sums - share * counts).std()) / math.sqrt(counts.size) / float(counts.mean())
    return share, half


if __name__ == "__main__":
    main()
