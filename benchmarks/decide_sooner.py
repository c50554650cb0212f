"""Measure whether robots on wheels decide sooner than the event engine's, and by what: where they sample, or when.

    python benchmarks/decide_sooner.py --motions 88 --keep motions

A decision follows from where a robot samples and when, so each row replays samples whose places are of one engine and
whose times are of the other, robot by robot and sample by sample, or whose avoidance lasts as long as the other's.
Every motion is replayed on the same random floors with 12 of 25 tiles vibrating, on each with other readings and
messages: all engines share the chance of these, which would otherwise be most of the scatter between motions. The
reference has many more motions, which cost little; rows are adjusted by regression on the motions of the same numbers.
Intervals are 90 %, by a bootstrap over motions and over floors. ``--keep`` keeps motions in a folder, and goes on where
it was interrupted.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import Scenario, preset, simulate
from vibroswarm import replay as replayed
from vibroswarm.motion.physics.wheels_run import WheelsRun
from vibroswarm.motion.source import Source, register

SEED = 7
PIECE = 4
"""Motions simulated at a time."""
BEYOND_S = 60.0
"""Motions last longer than the inspection, so that they have enough samples with the times of the other engine too."""
KEY = ("run", "robot", "sample")
TRACKS = {"robot.drive_track_m": 0.0949, "robot.turn_track_m": 0.0545}
"""Effective tracks of robots on wheels (tests/contract/test_mujoco.py)."""
BASE = preset("paper").with_values({"strategy.name": "soft"})

Floats = NDArray[np.float64]


class SingleRays(WheelsRun):
    """Robots on wheels whose distance sensors are single rays, as those of the other sources."""

    cone_rad = (0.0,)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--motions", type=int, default=88, help="of robots on wheels")
    parser.add_argument("--rays", type=int, default=0, help="motions of robots on wheels with single rays")
    parser.add_argument("--reference", type=int, default=500, help="motions of the event engine")
    parser.add_argument("--floors", type=int, default=200)
    parser.add_argument("--keep", type=Path, help="folder of motions")
    given = parser.parse_args()
    register(Source("single-rays", SingleRays, is_ours=True))
    chance = np.random.default_rng(SEED)
    floors = [chance.permutation(np.arange(25) < 12).astype(int).reshape(5, 5) for _ in range(given.floors)]
    event = simulated({}, "event", given.reference)
    reference_s = decided_s(event, floors)
    print(
        f"event: {reference_s.mean():.1f} s, {reference_s.shape[1]} motions, {described(event)}", flush=True
    )

    def print_row(name: str, motion: pl.DataFrame) -> None:
        print(f"{name}: {compared(decided_s(motion, floors), reference_s)}, {described(motion)}", flush=True)

    for name, value in TRACKS.items():
        print_row(f"event, {name} of wheels", simulated({name: value}, "event", given.reference))
    print_row("event, both tracks of wheels", simulated(TRACKS, "event", given.reference))
    wheels = kept(given.keep, "mujoco", given.motions)
    own = event.filter(pl.col("run") < given.motions)
    shorter = mean_s(own, "avoid_s") / mean_s(wheels, "avoid_s")
    print_row("wheels", wheels)
    print_row("times of wheels, places of event", with_times(own, wheels))
    print_row("places of wheels, times of event", with_times(wheels, own))
    print_row(f"wheels, avoidance {shorter:.2f} as long", with_avoidance(wheels, shorter))
    print_row(f"event, avoidance {1 / shorter:.2f} as long", with_avoidance(own, 1 / shorter))
    if given.rays:
        print_row("wheels, single rays", kept(given.keep, "single-rays", given.rays))


def simulated(values: Mapping[str, float], source: str, runs: int | range) -> pl.DataFrame:
    """Return the samples of some motions (``Result.motion``), which last ``BEYOND_S`` longer than an inspection."""
    longer = {"run.t_end_s": BASE.run.t_end_s + BEYOND_S}
    return simulate(BASE.with_values({**values, **longer}), SEED, runs, motion=source, energies=False).motion


def kept(folder: Path | None, source: str, motions: int) -> pl.DataFrame:
    """Return the samples of motions of MuJoCo, and print how fast those were simulated that were not in the folder."""
    pieces, cpu_s, simulated_s = [], 0.0, 0.0
    if folder is not None:
        folder.mkdir(exist_ok=True)
    for first in range(0, motions, PIECE):
        path = folder / f"{source}_{first:03d}.parquet" if folder is not None else None
        if path is not None and path.exists():
            pieces.append(pl.read_parquet(path))
            continue
        begun_s = process_time()
        pieces.append(simulated({}, source, range(first, first + PIECE)))
        cpu_s, simulated_s = (
            cpu_s + process_time() - begun_s,
            simulated_s + PIECE * (BASE.run.t_end_s + BEYOND_S),
        )
        if path is not None:
            pieces[-1].write_parquet(path)
    if cpu_s:
        print(f"{source}: {simulated_s / cpu_s:.0f} simulated s per CPU s")
    return pl.concat(pieces).filter(pl.col("run") < motions)


def with_times(places: pl.DataFrame, times: pl.DataFrame) -> pl.DataFrame:
    """Return samples at the places of one table and the times of another, sample by sample of each robot."""
    moved = places.drop("stop_start_s", "time_s").join(times.select(*KEY, "stop_start_s", "time_s"), on=KEY)
    return moved.select(places.columns)


def with_avoidance(motion: pl.DataFrame, factor: float) -> pl.DataFrame:
    """Return samples before which robots avoid ``factor`` times as long; later ones come earlier or later by it."""
    tick_s = BASE.run.control_period_ms / 1000
    saved_s = ((factor - 1) * pl.col("avoid_s").cast(pl.Float64)).cum_sum().over("run", "robot")
    whole_s = (saved_s / tick_s).round() * tick_s
    return motion.sort(KEY).with_columns(pl.col("stop_start_s", "time_s") + whole_s)


def decided_s(motion: pl.DataFrame, floors: list[NDArray[np.int64]]) -> Floats:
    """Return the mean decision time of the robots on each floor, in each motion, (floors, motions), s.

    Robots that do not decide count with the whole time.
    """
    motion = motion.filter(pl.col("time_s") <= BASE.run.t_end_s).sort("run", "time_s", "robot")
    whole = simulate(BASE, SEED, motion["run"].unique().sort().to_list(), energies=False)
    result = replace(whole, motion=motion.select(whole.motion.columns).cast(dict(whole.motion.schema)))
    of_floors = []
    for k, tiles in enumerate(floors):
        rows = tuple("".join(map(str, row)) for row in tiles.tolist())
        robots = replayed(replace(result, seed=SEED + k), scenario_on(rows)).robots
        time_s = pl.col("decision_time_s").fill_null(BASE.run.t_end_s)
        of_floors.append(robots.group_by("run").agg(time_s.mean()).sort("run")["decision_time_s"].to_numpy())
    return np.array(of_floors)


def scenario_on(rows: tuple[str, ...]) -> Scenario:
    return BASE.with_values({"floor.tiles": rows})


def compared(times_s: Floats, reference_s: Floats) -> str:
    """Return the change of the mean against the reference, with its interval, in words.

    Args:
        times_s: of motions 0, 1, ... by floor; reference_s: of as many motions or more, of the same numbers and floors.
    """
    (floors, few), many = times_s.shape, reference_s.shape[1]
    slope = np.polyfit(reference_s[:, :few].mean(axis=0), times_s.mean(axis=0), 1)[0]
    chance = np.random.default_rng(1)
    drawn = np.vstack([np.ones(floors), chance.multinomial(floors, np.full(floors, 1 / floors), size=4000)])
    times_s, reference_s = drawn @ times_s / floors, drawn @ reference_s / floors
    own = np.vstack([np.arange(few), chance.integers(few, size=(4000, few))])
    rest = np.vstack(
        [np.arange(few, many), chance.integers(few, max(many, few + 1), size=(4000, many - few))]
    )
    own_s, rest_s = (np.take_along_axis(reference_s, those, axis=1) for those in (own, rest))
    all_s = (own_s.sum(axis=1) + rest_s.sum(axis=1)) / many
    adjusted_s = np.take_along_axis(times_s, own, axis=1).mean(axis=1) - slope * (own_s.mean(axis=1) - all_s)
    change = 100 * (adjusted_s / all_s - 1)
    low, high = np.quantile(change[1:], (0.05, 0.95))
    return f"{change[0]:+.1f} % [{low:+.1f}, {high:+.1f}], {few} motions"


def mean_s(motion: pl.DataFrame, column: str) -> float:
    """Return the mean of a duration over samples, s."""
    return float(motion[column].cast(pl.Float64).drop_nulls().to_numpy().mean())


def described(motion: pl.DataFrame) -> str:
    """Return how robots walk: avoidance, samples near walls, and samples on the tile of the one before."""
    ordered = motion.filter(pl.col("time_s") <= BASE.run.t_end_s).sort(KEY)
    x, y = (ordered[name].to_numpy() for name in ("x_m", "y_m"))
    wall_m = np.minimum.reduce([x, 1.0 - x, y, 1.0 - y])
    tile = pl.Series(np.clip(5 * x, 0, 4).astype(int) * 5 + np.clip(5 * y, 0, 4).astype(int))
    again = (
        ordered.with_columns(same=tile).select(pl.col("same").diff().over("run", "robot") == 0).to_series()
    )
    return (
        f"avoids {1000 * mean_s(ordered, 'avoid_s'):.0f} ms a sample, near walls (5 cm) {np.mean(wall_m < 0.05):.1%}, "
        f"same tile again {again.mean():.1%}"
    )


if __name__ == "__main__":
    main()
