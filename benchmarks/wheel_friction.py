"""Fit the friction of robots on wheels (``mujoco``) to speed, veer and turning of recorded sessions, with errors.

    vibroswarm lab import CAL_1.csv CAL_2.csv --floor world.txt --tiles 5x5 --out sessions
    python benchmarks/wheel_friction.py sessions

| measured, mean over robots | how it depends on the model |
|---|---|
| speed at the start | on the rolling radius alone, in proportion |
| spread of veer between robots | 2 v sd(m) / drive track: on passive friction |
| avoidance time, of samples with any | on the turn track, thus on both frictions: a line |

Effective tracks are those of one robot in an open arena with misalignment 0.05, on a grid of frictions; the line is
through simulated inspections. The fit minimises the sum of squares of the differences in standard errors (robots are
the unit, sessions are averaged first) on a fine grid between; errors of its parameters are those of 1,000 fits to
values drawn about the measured ones.
"""

from __future__ import annotations

import argparse
import math
from itertools import product
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from vibroswarm import simulate
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.physics import wheels_model
from vibroswarm.motion.physics.sources import WHEELS
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]

DRIVEN = (0.2, 0.4, 0.8, 1.2)
PASSIVE = (0.01, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6)
INSPECTED = tuple(product((0.4, 0.8), (0.05, 0.2, 0.4, 0.6)))
"""Frictions at which inspections are simulated."""
OPEN = {
    "arena.width_m": 1000.0, "arena.height_m": 1000.0, "swarm.robots": 1, "run.t_end_s": 40.0,
    "robot.speed_redraw": "robot", "robot.misalignment_min": 0.05, "robot.misalignment_max": 0.05,
}  # fmt: skip
FINE = 61
DRAWS = 1000
LEAST_DRIVES = 10


def measured(recording: Result) -> dict[str, tuple[float, float]]:
    """Return what robots did, with standard errors: speed, m/s; spread of veer, rad/s; avoidance, s."""
    found = dataset_of([recording])
    rows = []
    for (robot,), own in found.drives.sort("run", "time_s").group_by("robot", maintain_order=True):
        starts, veers = [], []
        for (_,), drives in own.group_by("run"):
            time_s, speed = (drives[name].to_numpy() for name in ("time_s", "speed_m_s"))
            starts.append(np.polyfit(time_s, speed, 1)[1])
            if (known := drives["veer_rad_s"].drop_nulls()).len() >= LEAST_DRIVES:
                veers.append(known.mean())
        avoided = found.samples.filter((pl.col("robot") == robot) & (pl.col("avoid_s") > 1e-9))
        by_session = avoided.group_by("run").agg(pl.col("avoid_s").mean())["avoid_s"]
        rows.append((np.mean(starts), np.mean(veers), by_session.mean()))
    speed, veer, avoid = np.array(rows, dtype=np.float64).T
    n = speed.size
    without_one = np.array([np.std(np.delete(veer, i), ddof=1) for i in range(n)])
    jackknife = math.sqrt((n - 1) / n * float(((without_one - without_one.mean()) ** 2).sum()))
    return {
        "speed": (float(speed.mean()), float(speed.std(ddof=1)) / math.sqrt(n)),
        "veer spread": (float(veer.std(ddof=1)), jackknife),
        "avoidance": (float(avoid.mean()), float(avoid.std(ddof=1)) / math.sqrt(n)),
    }


def with_friction(driven: float, passive: float) -> None:
    """Make models with these frictions from now on."""
    wheels_model.DRIVEN, wheels_model.PASSIVE = driven, passive  # type: ignore[misc]


def tracks(driven: float, passive: float) -> tuple[float, float, float]:
    """Return the effective tracks of drives and of turns, m, and speed over commanded speed."""
    with_friction(driven, passive)
    scenario = Scenario().with_values(OPEN)
    rolled, stepped = (
        source.batch(scenario, 5, [0, 1], segments=True).segments for source in (WHEELS, FIXED_STEP)
    )
    assert rolled is not None
    assert stepped is not None

    def rate(segments: pl.DataFrame, kind: str) -> float:
        rates = segments.filter(pl.col("kind") == kind)["turn_rate_rad_s"].abs()
        return float(rates.median() if kind == "drive" else rates.max())  # type: ignore[arg-type]

    speeds = [each.filter(pl.col("kind") == "drive")["speed_m_s"].max() for each in (rolled, stepped)]
    return (
        scenario.robot.drive_track_m * rate(stepped, "drive") / rate(rolled, "drive"),
        scenario.robot.turn_track_m * rate(stepped, "turn") / rate(rolled, "turn"),
        speeds[0] / speeds[1],  # type: ignore[operator]
    )


def avoidance_line(scenario: Scenario, runs: int) -> tuple[float, float]:
    """Return avoidance time of samples with any, at track 0, s, and its slope in the turn track, s/m."""
    rows = []
    for driven, passive in INSPECTED:
        turn_m = tracks(driven, passive)[1]
        result = simulate(scenario, 7, range(runs), motion="mujoco")
        avoid = result.motion.filter(pl.col("avoid_s") > 1e-9)["avoid_s"]
        rows.append((turn_m, avoid.mean()))
        print(
            f"  friction {driven:g}, {passive:g}: turn track {1000 * turn_m:.1f} mm, avoidance {avoid.mean():.3f} s"
        )
    slope, start = np.polyfit(*np.array(rows, dtype=np.float64).T, 1)
    return float(start), float(slope)


def main() -> None:
    """Fit, and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("recording", type=Path, help="folder of lab import, of the sessions to fit")
    parser.add_argument("--runs", type=int, default=1, help="simulated inspections per friction")
    arguments = parser.parse_args()
    recording = Result.read(arguments.recording)
    in_use = wheels_model.DRIVEN, wheels_model.PASSIVE
    scenario = recording.scenario.with_values(
        {"run.stop": "t_end", "strategy.name": "none", "run.t_end_s": 1200.0}
    )
    found = measured(recording)
    for name, (value, error) in found.items():
        print(f"measured {name}: {value:.4g} +- {error:.2g}")
    spread = (scenario.robot.misalignment_max - scenario.robot.misalignment_min) / math.sqrt(12.0)
    speed = found["speed"][0]
    table = np.array([[tracks(driven, passive) for passive in PASSIVE] for driven in DRIVEN])
    print(f"speed over commanded speed: {table[..., 2].min():.4f} to {table[..., 2].max():.4f}")
    start, slope = avoidance_line(scenario, arguments.runs)
    print(f"avoidance: {start:.3f} s + {slope:.1f} s/m x turn track")
    fine = np.linspace(DRIVEN[0], DRIVEN[-1], FINE), np.linspace(PASSIVE[0], PASSIVE[-1], FINE)
    mesh = np.stack(np.meshgrid(*fine, indexing="ij"), axis=-1)
    drive_m, turn_m = (RegularGridInterpolator((DRIVEN, PASSIVE), table[..., k])(mesh) for k in (0, 1))
    predicted = {"veer spread": 2.0 * speed * spread / drive_m, "avoidance": start + slope * turn_m}

    def fitted(values: dict[str, float]) -> tuple[int, ...]:
        cost = sum(((predicted[name] - values[name]) / found[name][1]) ** 2 for name in predicted)
        return tuple(int(k) for k in np.unravel_index(np.argmin(cost), mesh.shape[:2]))

    best = fitted({name: found[name][0] for name in predicted})
    rng = np.random.default_rng(1)
    again = np.array([fitted({name: rng.normal(*found[name]) for name in predicted}) for _ in range(DRAWS)])
    for k, name in enumerate(("drive friction", "passive friction")):
        draws = fine[k][again[:, k]]
        low, high = np.quantile(draws, [0.025, 0.975])
        at_edge = ((again[:, k] == 0) | (again[:, k] == FINE - 1)).mean()
        print(
            f"{name}: {fine[k][best[k]]:.3f} +- {draws.std():.3f} [{low:.3f}, {high:.3f}], "
            f"{100 * at_edge:.0f} % of fits at an end of the grid; in use {in_use[k]:g}"
        )
    for name, field in (("drive track", drive_m), ("turn track", turn_m)):
        draws = np.array([field[tuple(place)] for place in again])
        print(f"{name}: {1000 * field[best]:.1f} +- {1000 * draws.std():.1f} mm")
    used = RegularGridInterpolator((DRIVEN, PASSIVE), table)(in_use)[0]
    print(f"in use: drive track {1000 * used[0]:.1f} mm, turn track {1000 * used[1]:.1f} mm")
    for name, values in predicted.items():
        at_use = {"veer spread": 2.0 * speed * spread / used[0], "avoidance": start + slope * used[1]}[name]
        print(
            f"{name}: measured {found[name][0]:.4g} +- {found[name][1]:.2g}, fitted {values[best]:.4g}, "
            f"in use {at_use:.4g}"
        )


if __name__ == "__main__":
    main()
