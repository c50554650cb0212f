"""Find what makes robots on wheels (``mujoco``) decide at other times than those of the event engine.

    python benchmarks/wheels_explained.py --out explained

measures every case of ``CASES``, most of the time wheels (11 minutes per 60 motions), and prints the tables of
docs/mujoco.md. A case that OUT holds is not measured again: remove its file. ``--cases event,turns`` measures some.

| case | what differs from ``event`` |
|---|---|
| turns | `robot.turn_track_m` is the effective track of turns on wheels |
| veer | `robot.drive_track_m` is that of drives |
| cones | each distance sensor is a fan of rays, as on wheels |
| all three | these together |
| as long | all three, and turns slower still, until avoidance takes as long as on wheels |
| planar | mass, finite forces, contact |
| planar cones, planar three | planar robots with cones, and with all three |
| wheels | robots on wheels |

The motion (a run) is the unit: its figures are means over FLOORS random floors (0.48), on each of which readings are
drawn again, since those of one motion would otherwise share their noise, which is most of what tells motions apart.
Intervals (90 %) and verdicts are those of ``motion_sources.py``, paired by run where both cases have the same runs.

Chance: event against itself. 60 of its motions, drawn at random, against its others must be told apart in 10 % of the
draws; ``before`` is ``motion_sources.py`` as it is: 50 floors, the same noise on all.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from motion_sources import decisions, of_motion, relative
from vibroswarm import preset, simulate
from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.motion.kernel_run import batch_of
from vibroswarm.motion.physics import wheels_model
from vibroswarm.motion.physics.planar import PlanarRun
from vibroswarm.motion.source import Source, register
from vibroswarm.result import Result
from wheel_friction import tracks

Array = NDArray[np.float64]


class PlanarCones(PlanarRun):
    """Planar robots whose distance sensors are cones, as those of robots on wheels."""

    cone_rad = wheels_model.CONE_RAD


register(Source("planar-cones", PlanarCones, partial(batch_of, PlanarCones), is_ours=True))

SEED = 7
FLOORS = 100
FLOORS_BEFORE = 50
AS_LONG = 1.07
"""Turn track of the case "as long", relative to that of wheels: avoidance then takes as long as theirs."""
SPLITS = 1000


@cache
def wheels_tracks() -> tuple[float, float]:
    """Return the effective tracks of drives and turns on wheels, m."""
    return tracks(wheels_model.DRIVEN, wheels_model.PASSIVE)[:2]


def changes(names: tuple[str, ...]) -> dict[str, Any]:
    """Return the fields of a scenario that change the event engine towards wheels."""
    drive_m, turn_m = wheels_tracks()
    rays = preset("paper").rays
    cone_deg = [math.degrees(part) for part in wheels_model.CONE_RAD]
    fields = {
        "turns": {"robot.turn_track_m": turn_m},
        "longer turns": {"robot.turn_track_m": AS_LONG * turn_m},
        "veer": {"robot.drive_track_m": drive_m},
        "cones": {
            "rays.side_m": [side for side in rays.side_m for _ in cone_deg],
            "rays.angle_deg": [axis + part for axis in rays.angle_deg for part in cone_deg],
        },
    }
    return {key: value for name in names for key, value in fields[name].items()}


@dataclass(frozen=True)
class Case:
    """A source of motion, what is changed of the scenario, and how many motions there are by default."""

    source: str
    changed: tuple[str, ...] = field(default=())
    motions: str = "motions"


CASES = {
    "event": Case("event"),
    "turns": Case("event", ("turns",)),
    "veer": Case("event", ("veer",)),
    "cones": Case("event", ("cones",)),
    "all three": Case("event", ("turns", "veer", "cones")),
    "as long": Case("event", ("longer turns", "veer", "cones")),
    "planar": Case("mujoco-planar", (), "planar"),
    "planar cones": Case("planar-cones", (), "planar"),
    "planar three": Case("planar-cones", ("turns", "veer"), "planar"),
    "wheels": Case("mujoco", (), "wheels"),
}
COMPARED = (
    ("turns", "event"), ("veer", "event"), ("cones", "event"), ("all three", "event"), ("as long", "event"),
    ("planar", "event"), ("planar cones", "event"), ("planar three", "event"), ("planar three", "all three"),
    ("wheels", "event"), ("wheels", "all three"), ("wheels", "as long"), ("wheels", "planar three"),
)  # fmt: skip


def where(result: Result) -> pl.DataFrame:
    """One row per run: how samples lie in the tiles.

    ``same_tile`` is the share of samples in the tile of the robot's sample before. ``share_spread`` is the standard
    deviation, over random floors, of the share of samples on vibrating tiles: with N tiles of fill ratio f and shares w
    of samples, the root of f (1 - f) N / (N - 1) sum (w - 1/N)^2.
    """
    arena, floor = result.scenario.arena, result.scenario.floor
    columns, rows = floor.columns, floor.rows
    column = (pl.col("x_m") / arena.width_m * columns).floor().clip(0, columns - 1)
    row = (pl.col("y_m") / arena.height_m * rows).floor().clip(0, rows - 1)
    samples = result.motion.sort("run", "robot", "sample").with_columns(
        tile=(row * columns + column).cast(pl.Int32)
    )
    same = samples.with_columns(same=(pl.col("tile").diff() == 0).over("run", "robot"))
    fill, tiles = 0.48, rows * columns
    shares = (
        samples.group_by("run", "tile").len().with_columns(w=pl.col("len") / pl.col("len").sum().over("run"))
    )
    # Tiles without a sample have no row, so the sum of squares is taken, less 1 / N.
    spread = (fill * (1.0 - fill) * tiles / (tiles - 1) * ((pl.col("w") ** 2).sum() - 1.0 / tiles)).sqrt()
    return (
        same.group_by("run").agg(same_tile=pl.col("same").mean())
        .join(shares.group_by("run").agg(share_spread=spread), on="run")
        .sort("run")
    )  # fmt: skip


def by_run(table: pl.DataFrame, *names: str) -> pl.DataFrame:
    """Return the means over floors, a row per run."""
    return table.group_by("run").agg(pl.col(*names).mean()).sort("run")


def measured(case: Case, motions: int, floors: int) -> pl.DataFrame:
    """Return the figures of a case, a row per motion."""
    scenario = preset("paper").with_values({"strategy.name": "soft"} | changes(case.changed))
    result = simulate(scenario, SEED, motions, motion=case.source)
    if result.failures is not None:
        raise SystemExit(f"runs of {case.source} failed")
    return figures(result, floors, as_before=case.source in ("event", "mujoco") and not case.changed)


def figures(result: Result, floors: int, *, as_before: bool) -> pl.DataFrame:
    """Return the figures of motions, a row per motion."""
    table = of_motion(result).join(where(result), on="run")
    own = decisions(result, floors, own_readings=True)
    table = table.join(by_run(own, "decision_time_s", "decided", "wrong"), on="run")
    if as_before:
        before = by_run(decisions(result, FLOORS_BEFORE), "decision_time_s")
        table = table.join(before.rename({"decision_time_s": "before_s"}), on="run")
    return table


FIGURES = {
    "samples": ("samples", 1.0, ""),
    "spacing_s": ("time between samples", 1.0, "s"),
    "step_m": ("distance between samples", 1e3, "mm"),
    "drive_s": ("driving per sample", 1.0, "s"),
    "turn_s": ("turning per sample", 1.0, "s"),
    "avoid_s": ("avoidance per sample", 1.0, "s"),
    "from_wall_m": ("distance from the nearest wall", 1e3, "mm"),
    "same_tile": ("samples in the tile of the one before", 100.0, "%"),
    "share_spread": ("spread of the share seen to vibrate", 100.0, "%"),
    "decision_time_s": ("decision time (undecided: the end)", 1.0, "s"),
    "decided": ("robots that decided", 100.0, "%"),
    "wrong": ("robots that decided wrong", 100.0, "%"),
    "before_s": ("decision time, as before", 1.0, "s"),
}


def compared(one: pl.DataFrame, other: pl.DataFrame, name: str) -> dict[str, float | bool]:
    """Compare a figure of two cases, paired where both have the same runs."""
    a, b = (table[name].to_numpy() for table in (one, other))
    return relative(a, b, paired=one["run"].equals(other["run"]))


def words(found: dict[str, float | bool]) -> str:
    """Return a difference with its interval and verdict."""
    if found["equivalent"]:
        verdict = "both" if found["told_apart"] else "equivalent"
    else:
        verdict = "told apart" if found["told_apart"] else "inconclusive"
    low, middle, high = (100.0 * float(found[key]) for key in ("low", "estimate", "high"))
    return f"{middle:+.1f} % [{low:+.1f}, {high:+.1f}] {verdict}"


def print_table(tables: dict[str, pl.DataFrame], pairs: list[tuple[str, str]]) -> None:
    """Print differences as a Markdown table; ``both``: told apart, and equivalent within 5 %."""
    heads = [f"{one} - {other}" for one, other in pairs]
    print(f"\n| | {' | '.join(heads)} |\n|{'---|' * (1 + len(heads))}")
    for name, (label, _, _) in FIGURES.items():
        if all(name in tables[case].columns for pair in pairs for case in pair):
            cells = [words(compared(tables[one], tables[other], name)) for one, other in pairs]
            print(f"| {label} | {' | '.join(cells)} |")


def adjusted(few: Array, same: Array, event: Array) -> str:
    """Return the difference of a few motions from event, corrected by how the ``same`` runs of event lie in all.

    The correction is by regression (a control variate): as much of their deviation as the correlation says.
    """
    rng = np.random.default_rng(SEED)

    def estimate(drawn: NDArray[np.int64], others: Array) -> float:
        slope = np.cov(few[drawn], same[drawn])[0, 1] / same[drawn].var(ddof=1)
        whole = (same[drawn].sum() + others.sum()) / (same.size + others.size)
        return float((few[drawn].mean() - slope * (same[drawn].mean() - whole)) / whole - 1.0)

    others = event[same.size :]
    found = [
        estimate(rng.integers(0, same.size, same.size), others[rng.integers(0, others.size, others.size)])
        for _ in range(SPLITS)
    ]
    low, high = 100.0 * np.quantile(found, [0.05, 0.95])
    return f"{100.0 * estimate(np.arange(same.size), others):+.1f} % [{low:+.1f}, {high:+.1f}]"


def print_chance(tables: dict[str, pl.DataFrame]) -> None:
    """Print how often as many motions of event as there are of wheels are told apart from its others."""
    event, few = tables["event"], tables["wheels"].height
    rng = np.random.default_rng(SEED)
    for name in ("decision_time_s", "before_s", "wrong"):
        values = event[name].to_numpy()
        apart, drawn = [], []
        for _ in range(SPLITS):
            mixed = rng.permutation(values)
            one, other = mixed[:few], mixed[few:]
            error = math.sqrt(one.var(ddof=1) / one.size + other.var(ddof=1) / other.size)
            apart.append(abs(one.mean() - other.mean()) > 1.645 * error)
            drawn.append(mixed[:few].mean() / mixed[few : 2 * few].mean() - 1.0)
        low, high = (100.0 * x for x in np.quantile(drawn, [0.05, 0.95]))
        first = relative(values[:few], values[few:])
        print(
            f"{FIGURES[name][0]}, event: {values.mean():.4g}, sd of motions {values.std(ddof=1):.3g}; "
            f"{few} motions told apart from the others in {100 * np.mean(apart):.1f} % of draws (10 % expected); "
            f"{few} from {few} others: 90 % within [{low:+.1f}, {high:+.1f}] %; "
            f"the first {few} from the others: {words(first)}"
        )
        wheels, same = tables["wheels"][name].to_numpy(), values[:few]
        print(
            f"  wheels from the same {few} motions of event: {words(relative(wheels, same))}, "
            f"paired: {words(relative(wheels, same, paired=True))} "
            f"(correlation {np.corrcoef(wheels, same)[0, 1]:+.2f}); "
            f"from all {values.size}: {words(relative(wheels, values))}, "
            f"adjusted by those {few}: {adjusted(wheels, same, values)}"
        )


def print_spread(tables: dict[str, pl.DataFrame]) -> None:
    """Print how much of a case's change of decision time its spread of the share seen to vibrate predicts.

    Motions of event whose spread is larger decide sooner: a line through them, without any case.
    """
    event = tables["event"]
    spread, time_s = event["share_spread"].to_numpy(), event["decision_time_s"].to_numpy()
    slope, start = np.polyfit(spread, time_s, 1)
    rng = np.random.default_rng(SEED)
    drawn = rng.integers(0, spread.size, (SPLITS, spread.size))
    error = np.std([np.polyfit(spread[own], time_s[own], 1)[0] for own in drawn])
    print(f"\nper % of spread, over motions of event: {slope / 100.0:+.1f} +- {error / 100.0:.1f} s")
    for name, table in tables.items():
        if name != "event":
            predicted = start + slope * table["share_spread"].to_numpy().mean()
            found = table["decision_time_s"].to_numpy().mean()
            changes_of = [100.0 * (value / time_s.mean() - 1.0) for value in (predicted, found)]
            print(f"{name}: {changes_of[0]:+.1f} % by its spread, {changes_of[1]:+.1f} % measured")


def main() -> None:
    """Measure the cases that are missing, and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--motions", type=int, default=600, help="of the event engine")
    parser.add_argument("--planar", type=int, default=60)
    parser.add_argument("--wheels", type=int, default=60)
    parser.add_argument("--floors", type=int, default=FLOORS)
    parser.add_argument("--cases", default=",".join(CASES), help="to measure, separated by commas")
    parser.add_argument("--out", type=Path, required=True, help="folder of one CSV file per case")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    drive_m, turn_m = wheels_tracks()
    print(f"on wheels: drive track {1000 * drive_m:.1f} mm, turn track {1000 * turn_m:.1f} mm")
    tables = {}
    for name, case in CASES.items():
        file = given.out / f"{name.replace(' ', '-')}.csv"
        if name in given.cases.split(",") and not file.exists():
            begin = time.process_time()
            write_file(file, csv_bytes(measured(case, getattr(given, case.motions), given.floors)))
            print(f"{name}: {time.process_time() - begin:.0f} CPU s", flush=True)
        if file.exists():
            tables[name] = pl.read_csv(file)
    print("\n| | " + " | ".join(f"{name}, {table.height}" for name, table in tables.items()) + " |")
    for name, (label, factor, unit) in FIGURES.items():
        cells = [
            f"{factor * table[name].mean():.4g} {unit}" if name in table.columns else "-"  # type: ignore[operator]
            for table in tables.values()
        ]
        print(f"| {label} | {' | '.join(cells)} |")
    pairs = [pair for pair in COMPARED if set(pair) <= set(tables)]
    for k in range(0, len(pairs), 5):
        print_table(tables, pairs[k : k + 5])
    if "event" in tables:
        print_spread(tables)
    if {"event", "wheels"} <= set(tables):
        print_chance(tables)


if __name__ == "__main__":
    main()
