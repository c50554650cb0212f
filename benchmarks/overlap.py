"""No two bodies overlap and none leaves the arena, at any tick, in 10^9 robot-steps of each engine: the long check.

    python benchmarks/overlap.py [--steps 1e9] [--seed 31]

The fixed-step engine is stepped tick by tick, and all walls and all pairs are looked at after each. The event-driven
engine runs as it is used; from the arcs that it writes down, where all robots are at every tick is worked out. A
quarter of the steps each: 5 robots and 10 robots in 1 m x 1 m; 30 robots in 0.5 m x 0.5 m, which touch often; and
10 robots in 0.5 m x 0.5 m that do not look where they go, and so push against walls and each other.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.motion.control_step import Swarm
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.fixed_step import FixedStepRun, steps
from vibroswarm.motion.geometry import arc
from vibroswarm.motion.recorder import Record, room
from vibroswarm.motion.robot_params import Setup
from vibroswarm.scenario.scenario import Scenario, preset

ROUNDING_M = 1e-9
"""Poses worked out from arcs are rounded: a gap above minus this is none."""

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


@kernel
def checked_steps(
    swarm: Swarm,
    setup: Setup,
    speeds: NDArray[np.float64],
    record: Record,
    seed: int,
    run: int,
    tick: int,
    until: int,
    places: NDArray[np.float64],
    least: NDArray[np.float64],
) -> int:
    """The fixed-step engine tick by tick, checked at each; gives the tick reached.

    Args:
        places: (2, robots) of scratch. least: see ``narrow``.
    """
    for now in range(tick, until):
        if room(record, swarm.size) < 1:
            record.filled[0] = 0
        steps(swarm, setup, speeds, record, seed, run, now, now + 1)
        for i in range(swarm.size):
            places[0, i], places[1, i] = swarm[i].x_m, swarm[i].y_m
        narrow(places[0], places[1], setup, least)
    return until


@kernel
def checked_arcs(
    segments: NDArray[np.void],
    setup: Setup,
    until: int,
    latest: NDArray[np.int64],
    places: NDArray[np.float64],
    least: NDArray[np.float64],
) -> None:
    """All places at every tick up to ``until``, by the segment rows of one run, sorted by tick.

    Args:
        latest: (robots,) of scratch: each robot's row at a tick.
    """
    k = 0
    for tick in range(until + 1):
        while k < segments.size and segments[k].tick <= tick:
            latest[segments[k].robot] = k
            k += 1
        for i in range(latest.size):
            row = segments[latest[i]]
            dt_s = (tick - row.tick) * setup.tick_s
            x, y, _ = arc(row.x_m, row.y_m, row.heading_rad, row.speed_m_s, row.rate_rad_s, dt_s)
            places[0, i], places[1, i] = x, y
        narrow(places[0], places[1], setup, least)


def gaps(setup: Setup, robot_steps: int, least: NDArray[np.float64]) -> Gaps:
    radius_m = float(setup["radius_m"])
    return Gaps(robot_steps, math.sqrt(least[0]) - 2.0 * radius_m, float(least[1]) - radius_m)


def check_stepped(scenario: Scenario, seed: int, run: int) -> Gaps:
    """One run of the fixed-step engine."""
    state = FixedStepRun(scenario, seed, run)
    robots, ticks = scenario.swarm.robots, scenario.ticks
    least, places = np.full(2, np.inf), np.zeros((2, robots))
    narrow(state.swarm["x_m"].copy(), state.swarm["y_m"].copy(), state.setup, least)
    checked_steps(
        state.swarm, state.setup, state.speeds, state.record, seed, run, 1, ticks, places, least
    )  # fmt: skip
    return gaps(state.setup, robots * ticks, least)


def check_jumped(scenario: Scenario, seed: int, run: int) -> Gaps:
    """One run of the event-driven engine."""
    state = EventRun(scenario, seed, run, segments=True)
    robots, ticks = scenario.swarm.robots, scenario.ticks
    rows = state.rows(scenario.run.t_end_s)
    least, places = np.full(2, np.inf), np.zeros((2, robots))
    checked_arcs(rows.segments, state.setup, ticks, np.zeros(robots, dtype=np.int64), places, least)
    return gaps(state.setup, robots * ticks, least)


CHECKS = {"fixed-step": check_stepped, "event": check_jumped}


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
