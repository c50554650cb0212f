"""Measure how far robots are from where they believe they are: the tables of place errors of docs/places.md.

    python benchmarks/place_errors.py --runs 100 --seed 101
    python benchmarks/place_errors.py --runs 100 --start unknown --components 16,48 --cases paper

Errors are of the smoothed places. Lost: % of robots off by over 20 cm in the median of their last 40 samples. rms z: of
errors in x and y in units of their stated spread, without the largest 1 %, and with. At an unknown start a square arena
looks the same after a quarter turn: found is the % of robots within 15 cm, in the median of their last 40 samples, in
the best of the four turns, and at sample 50, 100 and 150 so of the ten samples before. ms: processor time of a run.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

import vibroswarm.simulation  # noqa: F401  registers the sources of motion
from vibroswarm.localisation.locate import locate
from vibroswarm.motion.source import source
from vibroswarm.scenario.scenario import preset

POOR = {"odometry.level": "poor"}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "paper": ("paper", {}),
    "Kalman filter": ("paper", {"localisation.method": "kalman"}),
    "dead reckoning": ("paper", {"localisation.method": "dead_reckoning"}),
    "poor gyro": ("paper", POOR),
    "poor gyro told good": ("paper", POOR | {"localisation.assumed_level": "good"}),
    "mean speed told 0.9": ("paper", {"localisation.assumed_speed_factor": 0.9}),
    "mean speed told 1.3": ("paper", {"localisation.assumed_speed_factor": 1.3}),
    "spread told 0.03": ("paper", {"localisation.assumed_speed_spread": 0.03}),
    "constant speed": ("paper", {"robot.speed_redraw": "robot"}),
    "calibrated": ("calibrated", {}),
    "optimised-places": ("optimised-places", {}),
}
LAST = 40
LOST_M = 0.2
FOUND_M = 0.15
Array = NDArray[np.float64]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=101)
    parser.add_argument("--cases", default=",".join(CASES), help="separated by commas")
    parser.add_argument("--components", default="16", help="separated by commas")
    parser.add_argument("--start", choices=("known", "unknown"), default="known")
    parser.add_argument("--without-monitor", action="store_true", help="with localisation.monitor off")
    given = parser.parse_args()
    for name in given.cases.split(","):
        of, values = CASES[name]
        scenario = preset(of).with_values({"localisation.method": "mixture"} | values)
        motion = source("event").batch(scenario, given.seed, range(given.runs), False, True)
        for components in map(int, given.components.split(",")):
            told = {
                "localisation.components": components,
                "localisation.start": given.start,
                "localisation.monitor": not given.without_monitor,
            }
            robots = scenario.with_values(told)
            locate(robots, given.seed, motion)
            start_s = time.process_time()
            places = locate(robots, given.seed, motion)
            cost_ms = 1000.0 * (time.process_time() - start_s) / given.runs
            text = (
                unknown(motion.samples, places) if given.start == "unknown" else known(motion.samples, places)
            )
            print(f"{name:20s} {components:4d} components  {text}  {cost_ms:.1f} ms", flush=True)


def by_robot(samples: pl.DataFrame, places: pl.DataFrame) -> tuple[Array, Array, Array]:
    """Return true places, believed places and stated spreads, (robots of all runs, samples, 2), nan where unknown."""
    whose = samples.select(pl.struct("run", "robot").rank("dense")).to_series().to_numpy() - 1
    number = samples["sample"].to_numpy().astype(np.int64)
    shape = (int(whose.max()) + 1, int(number.max()) + 1, 2)
    true, believed, spread = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
    true[whose, number] = samples.select("x_m", "y_m").to_numpy()
    late = places["lagged_sample"].is_not_null().to_numpy()
    at = whose[late], places["lagged_sample"].drop_nulls().to_numpy().astype(np.int64)
    believed[at] = places.select("lagged_x_m", "lagged_y_m").to_numpy()[late]
    spread[at] = places.select("lagged_spread_x_m", "lagged_spread_y_m").to_numpy()[late]
    return true, believed, spread


def at_end(errors_m: Array) -> Array:
    """Return the median of each robot's last errors."""
    return np.array([np.median(row[np.isfinite(row)][-LAST:]) for row in errors_m])


def known(samples: pl.DataFrame, places: pl.DataFrame) -> str:
    """Return errors in words."""
    true, believed, spread = by_robot(samples, places)
    error = believed - true
    distance = np.hypot(error[..., 0], error[..., 1])
    of = distance[np.isfinite(distance)]
    squares = np.sort(((error / spread) ** 2)[np.isfinite(error)])
    most = int(0.99 * squares.size)
    lost = at_end(distance) > LOST_M
    return (
        f"median {100 * np.median(of):.1f} cm, 90 % below {100 * np.quantile(of, 0.9):.1f} cm, "
        f"over 20 cm {100 * (of > LOST_M).mean():.1f} %, lost {100 * lost.mean():.1f} %, "
        f"rms z {np.sqrt(squares[:most].mean()):.2f} ({np.sqrt(squares.mean()):.1f})"
    )


def unknown(samples: pl.DataFrame, places: pl.DataFrame) -> str:
    """Return in words how many robots found their place up to a quarter turn about the middle of an arena of 1 m."""
    true, believed, spread = by_robot(samples, places)
    x, y = believed[..., 0] - 0.5, believed[..., 1] - 0.5
    turned = ((x, y), (-y, x), (-x, -y), (y, -x))
    errors = [np.hypot(a + 0.5 - true[..., 0], b + 0.5 - true[..., 1]) for a, b in turned]
    shares = [
        100.0 * np.mean(np.min([np.nanmedian(e[:, n - 10 : n], axis=1) for e in errors], axis=0) < FOUND_M)
        for n in (50, 100, 150)
    ]
    found = np.min([at_end(e) for e in errors], axis=0) < FOUND_M
    unsure = at_end(np.sqrt(0.5 * (spread**2).sum(axis=2))) > FOUND_M
    half = 196.0 * found.reshape(-1, 5).mean(axis=1).std() / np.sqrt(found.size / 5)
    return (
        f"found {100 * found.mean():.1f} % +- {half:.1f} at the end; "
        f"{' '.join(f'{share:.0f}' for share in shares)} % at samples 50, 100, 150; stated spread over 15 cm: "
        f"{100 * unsure[found].mean():.0f} % of these, {100 * unsure[~found].mean():.0f} % of the others"
    )


if __name__ == "__main__":
    main()
