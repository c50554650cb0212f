"""Measure which part of the physics of robots on wheels changes when they decide, on equal floors and starts.

    python benchmarks/decide_sooner.py --motions 24 --floors 50

Rows: sources of motion against the event engine. Intervals are 90 %, by a bootstrap over motions, which are paired by
their numbers; every motion is replayed on the same random floors with 12 of 25 tiles vibrating.
"""

from __future__ import annotations

import argparse
from functools import partial

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import preset, replay, simulate
from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.physics.wheels_run import WheelsRun
from vibroswarm.motion.source import Source, register
from vibroswarm.scenario.scenario import Scenario

SEED = 7
TRACKS = {"robot.drive_track_m": 0.0949, "robot.turn_track_m": 0.0545}
"""Effective tracks of robots on wheels (docs/figures/mujoco.md)."""


class SingleRays(WheelsRun):
    """Robots on wheels whose distance sensors are single rays, as those of the other sources."""

    cone_rad = (0.0,)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=24)
    parser.add_argument("--floors", type=int, default=50)
    given = parser.parse_args()
    register(Source("single-rays", SingleRays, partial(batch_of, SingleRays), is_ours=True))
    base = preset("paper").with_values({"strategy.name": "soft"})
    cases = {
        "event": ("event", base),
        "event, tracks of wheels": ("event", base.with_values(TRACKS)),
        "event, track of wheels in turns": (
            "event",
            base.with_values({"robot.turn_track_m": TRACKS["robot.turn_track_m"]}),
        ),
        "mujoco-planar": ("mujoco-planar", base),
        "mujoco": ("mujoco", base),
        "mujoco, single rays": ("single-rays", base),
    }
    chance = np.random.default_rng(SEED)
    floors = [chance.permutation(np.arange(25) < 12).astype(int).reshape(5, 5) for _ in range(given.floors)]
    times: dict[str, NDArray[np.float64]] = {}
    for name, (source, scenario) in cases.items():
        times[name], avoids_s = decided(scenario, source, given.motions, floors)
        change = compared(times[name], times["event"])
        print(
            f"{name:32s} {times[name].mean():6.1f} s  {change}  avoids {1000 * avoids_s:.0f} ms a sample",
            flush=True,
        )


def decided(
    scenario: Scenario, source: str, motions: int, floors: list[NDArray[np.int64]]
) -> tuple[NDArray[np.float64], float]:
    """Return the mean decision time of each motion over floors and robots, (motions,), s, and the avoidance time, s.

    Robots that do not decide count with the whole time.
    """
    result = simulate(scenario, SEED, motions, motion=source)
    of_floors = []
    for tiles in floors:
        rows = tuple("".join(map(str, row)) for row in tiles.tolist())
        robots = replay(result, scenario.with_values({"floor.tiles": rows})).robots
        time_s = pl.col("decision_time_s").fill_null(scenario.run.t_end_s)
        of_floors.append(robots.group_by("run").agg(time_s.mean()).sort("run")["decision_time_s"].to_numpy())
    return np.mean(of_floors, axis=0), float(result.motion["avoid_s"].mean() or 0.0)  # type: ignore[arg-type]


def compared(times_s: NDArray[np.float64], event_s: NDArray[np.float64]) -> str:
    """Return the change of the mean against the event engine, with its interval, in words."""
    chance = np.random.default_rng(1)
    drawn = chance.integers(times_s.size, size=(4000, times_s.size))
    change = 100 * (times_s[drawn].mean(axis=1) / event_s[drawn].mean(axis=1) - 1)
    low, high = np.quantile(change, (0.05, 0.95))
    return f"{100 * (times_s.mean() / event_s.mean() - 1):+5.1f} % [{low:+.1f}, {high:+.1f}]"


if __name__ == "__main__":
    main()
