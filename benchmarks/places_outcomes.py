"""Measure what places decide, beside soft feedback on the same motion and readings: the tables of docs/places.md.

    python benchmarks/places_outcomes.py --runs 1000 --seed 9001
    python benchmarks/places_outcomes.py --runs 1000 --seed 9002 --cases "speed told 0.9,speed told 1.3"

Floors of 12 and 13 vibrating tiles of 25. Each cell: mean decision time in s (end of the run if undecided), % of robots
wrong, % undecided. Half: that of the 95 % interval of % wrong over both floors, with the run as the unit. Forced: %
whose belief at the end of the run is on the wrong side, decided or not. Less: % wrong of places less that of soft, over
both floors, paired by run, with its 95 % interval. A case that has a threshold "felt" is told the preset's error rates.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.replay import replay_to_end
from vibroswarm.motion.source import Motion, source
from vibroswarm.observation.observe import observe
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import floors_of, summarise

POOR = {"odometry.level": "poor"}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "paper": ("paper", {}),
    "poor gyro": ("paper", POOR),
    "poor told good": ("paper", POOR | {"localisation.assumed_level": "good"}),
    "constant speed": ("paper", {"robot.speed_redraw": "robot"}),
    "calibrated": ("calibrated", {}),
    "calibrated with reach told": ("calibrated", {"strategy.places.edge_reach_m": 0.01}),
    "10 % loss": ("paper", {"network.name": "loss", "network.loss.share": 0.1}),
    "optimised-places": ("optimised-places", {}),
    "optimised-places with poor gyro": ("optimised-places", POOR),
    "ten robots": ("paper", {"swarm.robots": 10}),
    "speed told 0.9": ("paper", {"localisation.assumed_speed_factor": 0.9}),
    "speed told 1.3": ("paper", {"localisation.assumed_speed_factor": 1.3}),
    "spread told 0.03": ("paper", {"localisation.assumed_speed_spread": 0.03}),
    "wheels slip 10 %": ("paper", {"localisation.assumed_speed_factor": 1.2}),
    "theta_E 1.55 felt": ("paper", {}),
    "theta_E 1.15 felt": ("paper", {}),
    "one stuck at 1": ("paper", {"faults.stuck_at_1": 0.2}),
}
FELT = {"theta_E 1.55 felt": 1.55, "theta_E 1.15 felt": 1.15}
FLOORS = ((0.48, 0), (0.52, 1))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=9001)
    parser.add_argument("--cases", help=f"separated by commas: {', '.join(CASES)}")
    parser.add_argument("--v", default="1,2", help="values of strategy.places.variance_factor")
    parser.add_argument("--pairs", action="store_true", help="also with strategy.places.rate_pairs")
    parser.add_argument("--without-monitor", action="store_true", help="also with localisation.monitor off")
    given = parser.parse_args()
    print(f"{given.runs} runs, seed {given.seed}; .48, .52: time s / % wrong / % undecided")
    for name in given.cases.split(",") if given.cases else CASES:
        of, values = CASES[name]
        base = preset(of).with_values({"strategy.name": "places", "localisation.method": "mixture"} | values)
        felt = {"sensor.rms_threshold": FELT[name]} if name in FELT else {}
        motion = source("event").batch(base, given.seed, range(given.runs), False, True)
        soft, _, text = outcome(base.with_values({"strategy.name": "soft"}), base, felt, given, motion)
        print(f"{name:28s} {'soft':24s} {text}", flush=True)
        for monitor in (True, False) if given.without_monitor else (True,):
            for pairs in (False, True) if given.pairs else (False,):
                for v in map(float, given.v.split(",")):
                    options = {
                        "strategy.places.variance_factor": v,
                        "strategy.places.rate_pairs": pairs,
                        "localisation.monitor": monitor,
                    }
                    wrong, _, text = outcome(base.with_values(options), base, felt, given, motion)
                    less = 100.0 * (wrong - soft)
                    half = 1.96 * less.std() / np.sqrt(less.size)
                    label = f"v = {v:g}{', pairs' if pairs else ''}{'' if monitor else ', no monitor'}"
                    print(f"{name:28s} {label:24s} {text}  less {less.mean():+.1f} +- {half:.1f}", flush=True)


def outcome(
    scenario: Scenario, base: Scenario, felt: dict[str, float], given: argparse.Namespace, motion: Motion
) -> tuple[NDArray[np.float64], NDArray[np.float64], str]:
    """Return by run over both floors which share of robots is wrong, and would be if forced; and both in words."""
    runs, robots, end_s = list(range(given.runs)), base.swarm.robots, base.run.t_end_s
    timeline = timeline_of(scenario, motion)
    cells, all_wrong, all_forced = [], [], []
    for fill, truth in FLOORS:
        floor = base.with_values({"floor.source": f"random:{fill}"} | felt)
        floors = floors_of(floor, given.seed, runs)
        observations = observe(floor, given.seed, motion.samples, floors, energies=False)
        found, _ = summarise(scenario, given.seed, floors, timeline, observations)
        decision, time_s = found["decision"].to_numpy(), found["decision_time_s"].fill_null(end_s).to_numpy()
        wrong = decision == 1 - truth
        cells.append(f"{time_s.mean():.0f}/{100 * wrong.mean():.1f}/{100 * (decision == -1).mean():.0f}")
        swarm = replay_to_end(scenario, given.seed, timeline, observations["observation"].to_numpy())
        below = swarm.agents["belief"] > 0.5
        all_wrong.append(wrong.reshape(-1, robots).mean(axis=1))
        all_forced.append((below != (truth == 0)).reshape(-1, robots).mean(axis=1))
    wrong, forced = np.concatenate(all_wrong), np.concatenate(all_forced)
    half = 196.0 * wrong.std() / np.sqrt(wrong.size)
    text = f"{'  '.join(f'{cell:14s}' for cell in cells)} half {half:.1f}  forced {100 * forced.mean():.1f}"
    return wrong, forced, text


if __name__ == "__main__":
    main()
