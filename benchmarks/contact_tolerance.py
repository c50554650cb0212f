"""How far robots in MuJoCo overlap and move in stops: what the ``tolerance`` of their sources must allow.

    python benchmarks/contact_tolerance.py
    python benchmarks/contact_tolerance.py --sources mujoco --robots 5 --runs 60 --seed 7    # pushes are rare

takes the cases of the contract of motion, and inspections of 5 and 10 robots (1200 s, preset ``paper``), at every
control period. Places are those of the segments, which follow bodies to 0.1 mm. A stop is from the tick at which the
robot's program stops it to its sample. About 3 minutes of one core.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import preset
from vibroswarm.motion.physics.sources import PLANAR, WHEELS
from vibroswarm.motion.source import Motion, Source
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.motion import at_all_ticks, gap_of, tracks
from vibroswarm.testing.motion_cases import CASES, motion_of

Array = NDArray[np.float64]
SOURCES = {source.name: source for source in (PLANAR, WHEELS)}


def overlap_m(motion: Motion, scenario: Scenario, runs: list[int]) -> tuple[float, float]:
    """Return how deep bodies were in each other, and in walls, m; negative: the least gap."""
    between, beyond = -np.inf, -np.inf
    radius, arena = scenario.robot.body_radius_m, scenario.arena
    for run in runs:
        x, y = np.moveaxis(at_all_ticks(motion, scenario, run)[0][..., :2], -1, 0)
        for places, size in ((x, arena.width_m), (y, arena.height_m)):
            beyond = max(beyond, radius - places.min(), places.max() - (size - radius))
        for i in range(scenario.swarm.robots - 1):
            between = max(between, 2.0 * radius - np.hypot(x[i + 1 :] - x[i], y[i + 1 :] - y[i]).min())
    return float(between), float(beyond)


def moved_in_stops(motion: Motion, runs: list[int]) -> Array:
    """Return how far robots moved from the start of each stop to its sample, (stops, 2): m and rad."""
    found = []
    for run in runs:
        for robot, track in tracks(motion, run).items():
            rows = motion.samples.filter((pl.col("run") == run) & (pl.col("robot") == robot))
            begun = track.at(rows["stop_start_s"].to_numpy())[0]
            gap = gap_of(rows.select("x_m", "y_m", "heading_rad").to_numpy(), begun)
            found.append(np.stack([np.hypot(gap[:, 0], gap[:, 1]), np.abs(gap[:, 2])], axis=1))
    return np.concatenate(found)


def measured(
    source: Source, seed: int, runs: int, sizes: list[int]
) -> Iterator[tuple[str, tuple[float, float], Array]]:
    """Give, for the contract's cases and for inspections: a name, overlaps, and what was moved in stops."""
    of_cases = [(case, motion_of(source, case)) for case in CASES]
    deepest = np.max([overlap_m(motion, case.scenario, list(case.runs)) for case, motion in of_cases], axis=0)
    moved = np.concatenate([moved_in_stops(motion, list(case.runs)) for case, motion in of_cases])
    yield "cases of the contract", (float(deepest[0]), float(deepest[1])), moved
    for robots in sizes:
        scenario = preset("paper").with_values({"swarm.robots": robots})
        chosen = list(range(runs))
        motion = source.batch(scenario, seed, chosen, segments=True)
        yield f"{robots} robots", overlap_m(motion, scenario, chosen), moved_in_stops(motion, chosen)


def main() -> None:
    """Measure, and print a line per source and set of runs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--runs", type=int, default=2, help="inspections of each size")
    parser.add_argument("--robots", type=int, nargs="+", default=[5, 10])
    parser.add_argument("--sources", nargs="+", default=list(SOURCES), choices=list(SOURCES))
    given = parser.parse_args()
    for source in (SOURCES[name] for name in given.sources):
        for name, (between, beyond), moved in measured(source, given.seed, given.runs, given.robots):
            parts = []
            allowed = (source.tolerance.stop_m, source.tolerance.stop_rad)
            for k, unit in enumerate(("mm", "mrad")):
                values = 1000.0 * moved[:, k]
                middle, many = np.quantile(values, [0.5, 0.99])
                parts.append(
                    f"median {middle:.2f}, 99 % {many:.2f}, at most {values.max():.1f} {unit}, "
                    f"more than 1 {unit} in {100 * np.mean(values > 1.0):.2f} %, than the tolerance in "
                    f"{np.sum(values > 1000.0 * allowed[k])}"
                )
            print(
                f"{source.name}, {name}: overlap of bodies {1000 * between:.3f} mm, with walls "
                f"{1000 * beyond:.3f} mm (negative: apart); {moved.shape[0]} stops: {'; '.join(parts)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
