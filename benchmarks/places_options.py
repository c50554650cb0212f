"""Measure the options of places beside places without them, on the same motion and readings: tables of docs/places.md.

    python benchmarks/places_options.py --runs 300 --seed 9003
    python benchmarks/places_options.py --runs 300 --seed 9003 --options bits,draws --v 1 --gyro poor

Floors of 12 and 13 vibrating tiles of 25. Each cell: mean decision time in s (end of the run if undecided), % of
robots wrong, % undecided. Less: time and % wrong less those of the first option with the same v, over both floors,
paired by run, with 95 % intervals. Last: kB sent by a robot in the run. Prior: on floors whose every tile is drawn by a
coin, how often decided robots are right, with a 95 % interval, how often they believe to be, and % undecided.
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import strategy_used
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.replay import bits_and_energies, replay_to_end
from vibroswarm.motion.source import Motion, source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of

OPTIONS: dict[str, dict[str, Any]] = {
    "bits": {},
    "energies": {"energies": True},
    "draws 2": {"draws": 2},
    "draws 3": {"draws": 3},
    "draws 4": {"draws": 4},
    "energies, draws 4": {"energies": True, "draws": 4},
    "maps": {"share_map": True},
    "maps, every 4th": {"share_map": True, "map_every": 4},
    "energies, maps": {"share_map": True, "energies": True},
    "no trust": {"broken_prior": 0.0, "trust_limit": 1000.0},
}
Array = NDArray[np.float64]


class Found(NamedTuple):
    """By run: mean time, share wrong and undecided; by robot: belief that it is below, decision."""

    time_s: Array
    wrong: Array
    undecided: Array
    belief: Array
    decision: NDArray[np.int64]
    bytes_sent: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=9003)
    parser.add_argument("--options", help=f"separated by semicolons: {'; '.join(OPTIONS)}")
    parser.add_argument("--v", default="1,2", help="values of strategy.places.variance_factor")
    parser.add_argument("--gyro", default="good")
    parser.add_argument("--loss", type=float, default=0.0, help="share of messages lost")
    parser.add_argument("--preset", default="paper")
    parser.add_argument("--set", action="append", default=[], help="field=number, for all cases")
    parser.add_argument("--prior", type=int, default=0, help="runs on floors drawn from the prior")
    given = parser.parse_args()
    more = {part.partition("=")[0]: float(part.partition("=")[2]) for part in given.set}
    loss = {"network.name": "loss", "network.loss.share": given.loss} if given.loss else {}
    base = preset(given.preset).with_values(
        {"strategy.name": "places", "localisation.method": "mixture", "odometry.level": given.gyro}
        | loss
        | more
    )
    runs = max(given.runs, given.prior)
    motion = source("event").batch(base, given.seed, range(runs), False, True)
    timeline = timeline_of(base, motion)
    truths = floors_by(base, given)
    names = given.options.split(";") if given.options else list(OPTIONS)
    for v in map(float, given.v.split(",")):
        plain: list[Found] = []
        for name in map(str.strip, names):
            values = {f"strategy.places.{key}": value for key, value in OPTIONS[name].items()}
            scenario = base.with_values({"strategy.places.variance_factor": v} | values)
            found = [outcome(scenario, given.seed, motion, timeline, floors) for floors, _, _ in truths]
            print(f"v = {v:g}, {name:20s} {row(found, truths, plain or found, given)}", flush=True)
            plain = plain or found


def floors_by(
    base: Scenario, given: argparse.Namespace
) -> list[tuple[dict[int, Floor], NDArray[np.int64], str]]:
    """Return floors by run, the right decision on each, and their name."""
    runs, made = max(given.runs, given.prior), []
    for fill, truth in ((0.48, 0), (0.52, 1)) if given.runs else ():
        floors = floors_of(base.with_values({"floor.source": f"random:{fill}"}), given.seed, range(runs))
        made.append((floors, np.full(runs, truth), str(fill)))
    if given.prior:
        rng = np.random.default_rng(given.seed)
        tiles = rng.integers(0, 2, (runs, 5, 5))
        made.append(
            (
                {r: Floor.filling(tiles[r]) for r in range(runs)},
                (tiles.sum(axis=(1, 2)) > 12).astype(int),
                "prior",
            )
        )
    return made


def outcome(
    scenario: Scenario, seed: int, motion: Motion, timeline: Timeline, floors: dict[int, Floor]
) -> Found:
    """Replay a strategy on the floors; the caller knows the right decisions."""
    robots, end_s = scenario.swarm.robots, scenario.run.t_end_s
    observations = observe(scenario, seed, motion.samples, floors, energies=False)
    swarm = replay_to_end(scenario, seed, timeline, *bits_and_energies(observations))
    agents = swarm.agents.reshape(-1, robots)
    decision = agents["decision"].copy()
    time_s = np.where(decision == -1, end_s, np.nan_to_num(agents["decided_s"]))
    size = strategy_used(scenario).bytes_on_air
    return Found(
        time_s.mean(axis=1),
        np.zeros(len(floors)),
        (decision == -1).mean(axis=1),
        agents["belief_at_decision"].copy(),
        decision,
        float(agents["sent"].mean() * size),
    )


def row(
    found: list[Found],
    truths: list[tuple[dict[int, Floor], NDArray[np.int64], str]],
    plain: list[Found],
    given: argparse.Namespace,
) -> str:
    """Return the cells of one option in words."""
    cells, less_s, less_wrong = [], [], []
    for mine, theirs, (_, truth, name) in zip(found, plain, truths, strict=True):
        if name == "prior":
            decided = mine.decision != -1
            right = (mine.decision == truth[:, None])[decided]
            believed = np.where(mine.decision == 0, mine.belief, 1.0 - mine.belief)[decided]
            by_run = np.where(decided.any(axis=1), (mine.decision == truth[:, None]).sum(axis=1), 0)
            half = 196.0 * by_run.std() / mine.decision.shape[1] / np.sqrt(by_run.size)
            cells.append(
                f"prior: right {100 * right.mean():.1f} +- {half:.1f}, believed {100 * believed.mean():.1f}, undecided "
                f"{100 * mine.undecided.mean():.0f}, {mine.time_s.mean():.0f} s"
            )
            continue
        some = slice(0, given.runs)
        wrong, of_plain = (
            (each.decision == 1 - truth[:, None]).mean(axis=1)[some] for each in (mine, theirs)
        )
        cells.append(
            f"{mine.time_s[some].mean():.0f}/{100 * wrong.mean():.1f}/{100 * mine.undecided[some].mean():.0f}"
        )
        less_s.append(mine.time_s[some] - theirs.time_s[some])
        less_wrong.append(100.0 * (wrong - of_plain))
    if less_s:
        cells += [f"less {interval(less_s)} s, {interval(less_wrong)} %"]
    return f"{'  '.join(cells)}  {found[0].bytes_sent / 1000:.1f} kB"


def interval(parts: list[Array]) -> str:
    """Return a mean with its 95 % interval, runs being the unit."""
    values = np.concatenate(parts)
    return f"{values.mean():+.1f} +- {1.96 * values.std() / np.sqrt(values.size):.1f}"


if __name__ == "__main__":
    main()
