"""No two bodies overlap and none leaves the arena, at any tick, in 10^9 robot-steps of each engine: the long check.

    python benchmarks/overlap.py [--steps 1e9] [--seed 31]

The engines are advanced tick by tick, and all walls and all pairs are looked at after each. A quarter of the steps
each: 5 robots and 10 robots in 1 m x 1 m; 30 robots in 0.5 m x 0.5 m, which touch often; and 10 in 0.5 m x 0.5 m that
do not look where they go, and so push against walls and each other.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun
from vibroswarm.motion.kernel_run import KernelRun
from vibroswarm.motion.motion_tables import Collected
from vibroswarm.motion.robot_params import Setup
from vibroswarm.scenario.scenario import Scenario, preset

ROUNDING_M = 1e-9
"""Poses are rounded: a gap above minus this is none."""

SWARMS = ((5, 1.0, 50.0), (10, 1.0, 50.0), (30, 0.5, 50.0), (10, 0.5, 0.0))
"""Robots, the arena's side, m, and the avoidance threshold theta_c, mm."""


class Gaps(NamedTuple):
    """What a check has found."""

    robot_steps: int
    between_m: float
    """The least gap between two bodies at any tick; below 0 they overlap."""
    to_wall_m: float
    """The least gap between a body and a wall; below 0 it is outside."""

    def and_also(self, other: Gaps) -> Gaps:
        return Gaps(
            self.robot_steps + other.robot_steps,
            min(self.between_m, other.between_m),
            min(self.to_wall_m, other.to_wall_m),
        )

    @property
    def good(self) -> bool:
        return min(self.between_m, self.to_wall_m) >= -ROUNDING_M


@kernel
def narrow(
    x_m: NDArray[np.float64], y_m: NDArray[np.float64], setup: Setup, least: NDArray[np.float64]
) -> None:
    """Keep the least squared distance of two centres, m^2, and of a centre from a wall, m, in ``least``."""
    for i in range(x_m.size):
        wall = min(min(x_m[i], setup.width_m - x_m[i]), min(y_m[i], setup.height_m - y_m[i]))
        least[1] = min(least[1], wall)
        for j in range(i):
            dx, dy = x_m[i] - x_m[j], y_m[i] - y_m[j]
            least[0] = min(least[0], dx * dx + dy * dy)


def gaps(setup: Setup, robot_steps: int, least: NDArray[np.float64]) -> Gaps:
    radius_m = float(setup["radius_m"])
    return Gaps(robot_steps, math.sqrt(least[0]) - 2.0 * radius_m, float(least[1]) - radius_m)


def checked(engine: type[KernelRun], scenario: Scenario, seed: int, run: int) -> Gaps:
    """One run, tick by tick."""
    state, taken, least = engine(scenario), Collected(), np.full(2, np.inf)
    state.begin(seed, run)
    for tick in range(scenario.ticks + 1):
        state.advance(tick, taken.sink)
        poses = state.poses()
        narrow(poses[:, 0].copy(), poses[:, 1].copy(), state.setup, least)
    return gaps(state.setup, scenario.swarm.robots * scenario.ticks, least)


CHECKS = {"fixed-step": partial(checked, FixedStepRun), "event": partial(checked, EventRun)}


def check(engine: str, scenario: Scenario, seed: int, robot_steps: float) -> Gaps:
    """So many robot-steps or a few more, run by run; a line on stderr now and then."""
    found, run, told_s = Gaps(0, math.inf, math.inf), 0, time.monotonic()
    while found.robot_steps < robot_steps:
        found = found.and_also(CHECKS[engine](scenario, seed, run))
        run += 1
        if time.monotonic() - told_s > 10.0:
            told_s = time.monotonic()
            print(f"  {found.robot_steps:.3g} of {robot_steps:.3g}", file=sys.stderr, flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=float, default=1e9, help="robot-steps of each engine (default 1e9)")
    parser.add_argument("--seed", type=int, default=31)
    options = parser.parse_args()
    failed = False
    for engine in CHECKS:
        found = Gaps(0, math.inf, math.inf)
        for robots, side_m, threshold_mm in SWARMS:
            part = check(
                engine, swarm(robots, side_m, threshold_mm), options.seed, options.steps / len(SWARMS)
            )
            found = found.and_also(part)
            what = f"{robots} robots in {side_m:g} m x {side_m:g} m, theta_c {threshold_mm:g} mm"
            print(
                f"{engine}, {what}: {part.robot_steps:,} robot-steps; least gap between bodies "
                f"{part.between_m:.3g} m, to a wall {part.to_wall_m:.3g} m",
                flush=True,
            )
        failed |= not found.good
        verdict = "no overlap, no escape" if found.good else "FAILED"
        print(f"{engine}: {found.robot_steps:,} robot-steps, {verdict}", flush=True)
    return 1 if failed else 0


def swarm(robots: int, side_m: float, threshold_mm: float) -> Scenario:
    """Preset paper-empirical with so many robots in an arena of that side, m, and that theta_c, mm."""
    values = {
        "swarm.robots": robots,
        "arena.width_m": side_m,
        "arena.height_m": side_m,
        "walk.avoidance_threshold_mm": threshold_mm,
    }
    return preset("paper-empirical").with_values(values)


if __name__ == "__main__":
    sys.exit(main())
