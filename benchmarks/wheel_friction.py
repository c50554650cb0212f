"""Fit the friction of robots on wheels (``mujoco``) to speed, veer and turning of recorded sessions, with errors.

    vibroswarm lab import CAL_1.csv CAL_2.csv --floor world.txt --tiles 5x5 --out sessions
    python benchmarks/wheel_friction.py sessions

| measured, mean over robots | how it depends on the model |
|---|---|
| speed at the start | on the rolling radius alone, in proportion |
| spread of veer between robots | 2 v sd(m) / drive track: on passive friction |
| avoidance time, of samples with any | on the turn track, thus on both frictions: a line |

Effective tracks are those of one robot in an open arena with misalignment 0.05; the line is through simulated
inspections. Both frictions change the same turn track, so the passive wheels' is fitted for each of several of the
driven ones': it minimises the sum of squares of the differences in standard errors (robots are the unit, sessions are
averaged first). Errors are those of 1,000 fits to values drawn about the measured ones.
"""

from __future__ import annotations

import argparse
import math
from itertools import product
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm import simulate
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.motion.fixed_step import FIXED_STEP
from vibroswarm.motion.physics import wheels_model
from vibroswarm.motion.physics.sources import WHEELS
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]

DRIVEN = (0.3, 0.5, 0.8, 1.2)
PASSIVE = (0.01, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
INSPECTED = tuple(product((0.4, 0.8), (0.05, 0.2, 0.4, 0.6)))
"""Frictions at which inspections are simulated."""
OPEN = {
    "arena.width_m": 1000.0, "arena.height_m": 1000.0, "swarm.robots": 1, "run.t_end_s": 40.0,
    "robot.speed_redraw": "robot", "robot.misalignment_min": 0.05, "robot.misalignment_max": 0.05,
}  # fmt: skip
FINE = 159
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
    start, slope = avoidance_line(scenario, arguments.runs)
    print(f"avoidance: {start:.3f} s + {slope:.1f} s/m x turn track")
    print(
        "drive friction | passive friction | drive track, mm | turn track, mm | veer, rad/s | avoidance, s | chi2"
    )
    for driven in DRIVEN:
        table = np.array([tracks(driven, passive) for passive in PASSIVE])
        assert abs(table[:, 2] - 1.0).max() < 0.005, "speed over commanded speed: change the rolling radius"
        fine = np.linspace(PASSIVE[0], PASSIVE[-1], FINE)
        drive_m, turn_m = (np.interp(fine, PASSIVE, table[:, k]) for k in (0, 1))
        print(row(driven, fine, fit(found, drive_m, turn_m, (speed, spread, start, slope))))
    used = tracks(*in_use)
    cost = costs(found, np.array(used[:1]), np.array(used[1:2]), (speed, spread, start, slope))
    print(
        f"in use: {in_use[0]:g}, {in_use[1]:g}: {1000 * used[0]:.1f} and {1000 * used[1]:.1f} mm, chi2 {cost[2][0]:.2f}"
    )


Line = tuple[float, float, float, float]
"""Speed, spread of misalignment, and the line of avoidance."""


def costs(
    found: dict[str, tuple[float, float]], drive_m: Floats, turn_m: Floats, line: Line
) -> tuple[Floats, Floats, Floats]:
    """Return veer spread, avoidance and the sum of squares at these tracks."""
    speed, spread, start, slope = line
    veer, avoidance = 2.0 * speed * spread / drive_m, start + slope * turn_m
    squares = [
        ((values - found[name][0]) / found[name][1]) ** 2
        for name, values in (("veer spread", veer), ("avoidance", avoidance))
    ]
    return veer, avoidance, np.asarray(sum(squares))


def fit(found: dict[str, tuple[float, float]], drive_m: Floats, turn_m: Floats, line: Line) -> list[Floats]:
    """Return, of the fit and then of fits to drawn values: place, drive track, turn track, veer, avoidance, cost."""
    rng = np.random.default_rng(1)
    fits = []
    for k in range(DRAWS + 1):
        values = found if k == 0 else {name: (rng.normal(*pair), pair[1]) for name, pair in found.items()}
        veer, avoidance, cost = costs(values, drive_m, turn_m, line)
        best = int(np.argmin(cost))
        fits.append(np.array([best, drive_m[best], turn_m[best], veer[best], avoidance[best], cost[best]]))
    return fits


def row(driven: float, fine: Floats, fits: list[Floats]) -> str:
    """Return a line of the table of fits, values with standard errors."""
    drawn = np.array(fits[1:])
    passive = fine[drawn[:, 0].astype(int)]
    low, high = np.quantile(passive, [0.025, 0.975])
    best = fits[0]
    return (
        f"{driven:g} | {fine[int(best[0])]:.3f} +- {passive.std():.3f} [{low:.3f}, {high:.3f}] "
        f"| {1000 * best[1]:.1f} +- {1000 * drawn[:, 1].std():.1f} "
        f"| {1000 * best[2]:.1f} +- {1000 * drawn[:, 2].std():.1f} "
        f"| {best[3]:.4f} | {best[4]:.3f} | {best[5]:.2f}"
    )


if __name__ == "__main__":
    main()
