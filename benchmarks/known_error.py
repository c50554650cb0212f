"""How often is the test that knows positions wrong? Over the prior that it states, at its nominal posterior error.

Floors lie on both sides of the boundary equally often: half of the runs have the preset's fill ratio, half its mirror.
Of each preset it prints the share wrong with its interval, what the test itself claimed, and whether both lie at 3 to
7 % for the nominal 5 %. ``product form`` is the likelihood that takes each reading as of the tile below and all tiles
and robots as alike: on `calibrated` it has to fail.

    python benchmarks/known_error.py [--runs 1000] [--seed 1]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

from vibroswarm.analysis.intervals import mean_interval, wilson
from vibroswarm.analysis.oracle_posterior import Known, could_be_known
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate

ALPHA, LOW, HIGH = 0.05, 0.03, 0.07
PLAIN = dict.fromkeys(
    ("sensor.edge_reach_m", "sensor.edge_blur_m", "sensor.tile_spread", "sensor.robot_spread")
)
BATCH = 50


def without(*names: str) -> Scenario:
    return preset("calibrated").with_values({f"sensor.{name}": None for name in names})


def measure(name: str, scenario: Scenario, runs: int, seed: int, product_form: bool = False) -> None:
    began, found = time.process_time(), list[Known]()
    for side, fill in enumerate((0.48, 0.52)):
        of_side = scenario.with_values({"floor.source": f"random:{fill}"})
        for first in range(0, runs // 2, BATCH):
            numbers = range(first, min(first + BATCH, runs // 2))
            result = simulate(of_side, 2 * seed + side, numbers, energies=False)
            if product_form:
                result = replace(result, scenario=of_side.with_values(PLAIN))
            found.append(could_be_known(result, "mirror", ALPHA))
    cpu_s = time.process_time() - began
    decided = [one.runs.filter(one.runs["decision"] != -1) for one in found]
    by_side = [
        wilson(
            sum(int((one["decision"] != one["truth"]).sum()) for one in half), sum(one.height for one in half)
        )
        for half in (decided[: len(decided) // 2], decided[len(decided) // 2 :])
    ]
    wrong = wilson(round(sum(one.estimate * one.n for one in by_side)), sum(one.n for one in by_side))
    claimed = mean_interval([value for one in decided for value in one["claimed_error"]])
    taken = mean_interval([v for one in found for v in one.runs["known_s"].fill_null(scenario.run.t_end_s)])
    holds = wrong.high >= LOW and wrong.low <= HIGH and wrong.low <= claimed.estimate <= wrong.high
    print(
        f"{name:28} wrong {wrong.estimate:6.1%} [{wrong.low:.1%}, {wrong.high:.1%}] of {wrong.n} "
        f"(f = 0.48: {by_side[0].estimate:.1%}, 0.52: {by_side[1].estimate:.1%}); claimed {claimed.estimate:.1%}; "
        f"Monte Carlo error of a posterior up to {max(one.monte_carlo_error for one in found):.3f}, "
        f"{sum(one.unsettled for one in found)} runs unsettled; known after {taken.estimate:.0f} s "
        f"[{taken.low:.0f}, {taken.high:.0f}]; {cpu_s / runs:.2f} s of CPU a run: "
        f"{'holds' if holds else 'FAILS'}",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=1000, help="runs of each, half on either side")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    edges, tile, robot = ("edge_reach_m", "edge_blur_m"), ("tile_spread",), ("robot_spread",)
    calibrated = preset("calibrated")
    for name, scenario, product_form in (
        ("paper", preset("paper"), False),
        ("calibrated", calibrated, False),
        ("calibrated, Gammas alone", without(*edges, *tile, *robot), False),
        ("calibrated, edges", without(*tile, *robot), False),
        ("calibrated, tile spread", without(*edges, *robot), False),
        ("calibrated, robot spread", without(*edges, *tile), False),
        ("product form on calibrated", calibrated, True),
        ("product form, edges", without(*tile, *robot), True),
        ("product form, tile spread", without(*edges, *robot), True),
        ("product form, robot spread", without(*edges, *tile), True),
    ):
        measure(name, scenario, arguments.runs, arguments.seed, product_form)


if __name__ == "__main__":
    main()
