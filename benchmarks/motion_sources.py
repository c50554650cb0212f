"""Which simplification of motion matters: the kinematic engine beside robots in MuJoCo, by features and decisions.

    python benchmarks/motion_sources.py --motions 20 --floors 50 --out out.json

Each motion (a run of a source) serves all floors: readings and decisions are replayed on it. Runs of one motion are
not independent, so intervals are over motions: a difference is that of the means of two sets of motions, by the
bootstrap over motions (BCa would need more of them; percentiles of 10,000 draws). Two sources are called equivalent
where the whole 90 % interval of the relative difference lies within 5 % (two one-sided tests at 5 %).
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import preset, replay, simulate
from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.physics.wheels_run import WheelsRun
from vibroswarm.motion.source import Source, register
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario


class SingleRays(WheelsRun):
    """Robots on wheels whose distance sensors are single rays, as in the kinematic engines."""

    cone_rad = (0.0,)


register(Source("mujoco-rays", SingleRays, partial(batch_of, SingleRays), is_ours=True))
SOURCES = ("event", "mujoco-planar", "mujoco-rays", "mujoco")
FLOORS_SEED = 1000
MARGIN = 0.05
DRAWS = 10_000


def of_motion(result: Result) -> pl.DataFrame:
    """One row per run: its features of motion."""
    samples = result.motion.sort("run", "robot", "sample")
    own = ["run", "robot"]
    steps = samples.with_columns(
        step_m=((pl.col("x_m").diff() ** 2 + pl.col("y_m").diff() ** 2) ** 0.5).over(own),
        spacing_s=pl.col("time_s").diff().over(own),
    )
    width, height = result.scenario.arena.width_m, result.scenario.arena.height_m
    wall = pl.min_horizontal("x_m", width - pl.col("x_m"), "y_m", height - pl.col("y_m"))
    return (
        steps.group_by("run")
        .agg(
            samples=pl.len().cast(pl.Float64),
            spacing_s=pl.col("spacing_s").mean(),
            step_m=pl.col("step_m").mean(),
            drive_s=pl.col("drive_s").mean().cast(pl.Float64),
            turn_s=pl.col("turn_s").mean().cast(pl.Float64),
            avoid_s=pl.col("avoid_s").mean().cast(pl.Float64),
            from_wall_m=wall.mean(),
        )
        .sort("run")
    )


def decisions(result: Result, floors: int, *, own_readings: bool = False) -> pl.DataFrame:
    """One row per run and floor: mean decision time (undecided: the end), the shares of robots that decided, and wrong.

    Args:
        own_readings: draw the noise of readings for each floor, not once per motion.
    """
    rows = []
    for k in range(floors):
        scenario = result.scenario.with_values({"floor.redraw": "study"})
        tiles = scenario.floor.tiles_for(FLOORS_SEED + k, 0)[0]
        fixed = scenario.with_values({"floor.tiles": tuple("".join(map(str, row)) for row in tiles.tolist())})
        replayed = replay(replace(result, seed=FLOORS_SEED + k) if own_readings else result, fixed)
        end_s = scenario.run.t_end_s
        wrong = replayed.runs.select("run", wrong=pl.col("wrong") / scenario.swarm.robots)
        rows.append(
            replayed.robots.group_by("run")
            .agg(
                decision_time_s=pl.col("decision_time_s").fill_null(end_s).mean(),
                decided=(pl.col("decision") >= 0).mean(),
            )
            .join(wrong, on="run")
            .with_columns(floor=pl.lit(k))
        )
    return pl.concat(rows).sort("run", "floor")


def relative(
    one: NDArray[np.float64], other: NDArray[np.float64], *, paired: bool = False
) -> dict[str, float | bool]:
    """The relative difference of the means of two sets of motions, with its 90 % interval over motions.

    Args:
        paired: the sets are of the same motions (runs), in the same order.
    """
    rng = np.random.default_rng(7)
    if not other.mean() > 0:
        raise SystemExit("nothing to compare: the first source's mean is 0")
    drawn = rng.integers(0, one.size, (DRAWS, one.size))
    a = one[drawn].mean(axis=1)
    b = other[drawn if paired else rng.integers(0, other.size, (DRAWS, other.size))].mean(axis=1)
    low, high = np.quantile(a / b - 1.0, [0.05, 0.95]).tolist()
    estimate = float(one.mean() / other.mean() - 1.0)
    return {
        "estimate": estimate, "low": low, "high": high,
        "equivalent": bool(low > -MARGIN and high < MARGIN), "told_apart": bool(low > 0 or high < 0),
    }  # fmt: skip


def measured(
    scenario: Scenario, source: str, motions: int, floors: int
) -> tuple[dict[str, NDArray[np.float64]], float]:
    """Figures of a source by motion, (motions,) each, and simulated seconds per CPU second."""
    simulate(scenario.with_values({"run.t_end_s": 20.0}), 7, 1, motion=source)  # compile
    begin = time.process_time()
    result = simulate(scenario, 7, motions, motion=source)
    speed = motions * scenario.run.t_end_s / (time.process_time() - begin)
    table = of_motion(result)
    table = table.join(
        decisions(result, floors).group_by("run").agg(pl.col("decision_time_s", "decided").mean()), on="run"
    )
    return {name: table[name].to_numpy() for name in table.columns if name != "run"}, speed


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--motions", type=int, default=20)
    parser.add_argument("--floors", type=int, default=50)
    parser.add_argument("--strategy", default="soft")
    parser.add_argument("--sources", nargs="+", default=SOURCES)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    scenario = preset("paper").with_values({"strategy.name": arguments.strategy})
    figures = {}
    for source in arguments.sources:
        figures[source], speed = measured(scenario, source, arguments.motions, arguments.floors)
        print(f"{source}: {speed:.0f} simulated s per CPU s", flush=True)
    first, *others = arguments.sources
    rows = {}
    for name, values in figures[first].items():
        rows[name] = {first: float(values.mean())}
        for other in others:
            rows[name][other] = relative(figures[other][name], values)
        words = [f"{name}: {values.mean():.4g}"]
        for other in others:
            found = rows[name][other]
            verdict = (
                "equivalent"
                if found["equivalent"]
                else "told apart"
                if found["told_apart"]
                else "inconclusive"
            )
            words.append(
                f"{other} {100 * found['estimate']:+.2f} % "
                f"[{100 * found['low']:+.2f}, {100 * found['high']:+.2f}] {verdict}"
            )
        print("; ".join(words), flush=True)
    if arguments.out is not None:
        arguments.out.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
