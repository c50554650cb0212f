"""How often intervals hold the truth, by simulated studies of known truth, as in statistics.md and calibration.md.

    python benchmarks/intervals_hold.py runs [--studies 2000]         # mean decision time of few runs
    python benchmarks/intervals_hold.py margin [--studies 600]        # "equivalent" where the difference is the margin
    python benchmarks/intervals_hold.py sessions [--studies 6000]     # energy distance among recorded sessions
    python benchmarks/intervals_hold.py fit [--studies 33] [--sessions 1]  # camera and laws of `calibrate fit`
    python benchmarks/intervals_hold.py rays [--studies 60] [--sessions 3] # its rays and turns
    python benchmarks/intervals_hold.py slow [--studies 60] [--sessions 1] # its slow share of veers

Laws of runs, differences and speeds are drawn in place of simulated swarms; ``fit``, ``rays`` and ``slow`` simulate
presets and fit them, in .3 to three seconds of CPU for each session.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from vibroswarm.calibrate.camera import Camera, seen_through
from vibroswarm.calibrate.dataset import dataset_of
from vibroswarm.calibrate.few_groups import limits_of, limits_of_bootstrap
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_drive import fit_drive
from vibroswarm.calibrate.fit_rays import fit_rays
from vibroswarm.calibrate.fit_sensor import FIELDS, SPREADS, fit_sensor
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import Interval, bounded_mean, mean_interval, pseudo_values
from vibroswarm.statistics.paired import difference, equivalent

Values = np.ndarray[Any, np.dtype[np.float64]]
T_END_S = 1200.0
MANY = 2_000_000
"""Values whose mean is the truth."""
CAMERA = Camera(1.035, 0.003, -0.0064)


def main() -> None:
    """Print the figures of one part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parts: dict[str, tuple[Callable[..., None], int]] = {
        "runs": (of_runs, 2000), "margin": (at_margin, 600), "sessions": (among_sessions, 6000), "fit": (of_fit, 33),
        "rays": (of_rays, 60), "slow": (of_slow_share, 60),
    }  # fmt: skip
    parser.add_argument("part", choices=parts)
    parser.add_argument("--studies", type=int, help="how many; more than 0")
    parser.add_argument("--sessions", type=int, help="of each study of fit, rays and slow")
    options = parser.parse_args()
    function, studies = parts[options.part]
    if options.sessions and options.part not in ("fit", "rays", "slow"):
        parser.error(f"--sessions is not for {options.part}")
    more = {"sessions": options.sessions} if options.sessions else {}
    function(options.studies or studies, np.random.default_rng(5), **more)


def held(intervals: list[Interval], truth: float) -> str:
    """Return the share of intervals that hold the truth, in percent."""
    return f"{100 * np.mean([not found.excludes(truth) for found in intervals]):.0f} %"


def of_runs(studies: int, random: np.random.Generator) -> None:
    """Mean decision times: log-normal and cut at t_end, or alike but for 3 % of late runs."""

    def cut(spread: float) -> Callable[[int], Values]:
        return lambda n: np.minimum(300.0 * np.exp(spread * random.normal(size=n)), T_END_S)

    def late(n: int) -> Values:
        usual = 100.0 + random.gamma(4.0, 5.0, n)
        return np.where(random.random(n) < 0.03, random.uniform(400.0, T_END_S, n), usual)

    laws = {f"log-normal, {spread}": cut(spread) for spread in (0.5, 0.8, 1.2)} | {"3 % late": late}
    for name, law in laws.items():
        truth = float(law(MANY).mean())
        for runs in (2, 3, 5, 20, 100, 300):
            found = [bounded_mean(law(runs), 0.0, T_END_S) for _ in range(studies)]
            print(f"{name}, {runs} runs: {held(found, truth)}")


def at_margin(studies: int, random: np.random.Generator) -> None:
    """How often differences whose mean is the margin are "equivalent"."""
    skewed = np.exp(0.5)  # mean of the log-normal law
    laws: dict[str, tuple[Callable[[int], Values], float]] = {
        "normal": (random.standard_normal, 1.0),
        "Student's with 3 degrees of freedom": (lambda n: random.standard_t(3, n), np.sqrt(3.0)),
        "log-normal, tail away from 0": (lambda n: random.lognormal(size=n) - skewed, 2.16),
        "log-normal, tail through 0": (lambda n: skewed - random.lognormal(size=n), 2.16),
    }
    for name, (law, deviation) in laws.items():
        for pairs in (12, 20, 60, 300):
            margin = 4.0 * deviation / np.sqrt(pairs)
            found = {
                level: np.mean(
                    [
                        equivalent(difference(law(pairs) + margin, np.zeros(pairs), level).interval, margin)
                        for _ in range(studies)
                    ]
                )
                for level in (0.95, 0.90)
            }
            print(f"{name}, {pairs} pairs:", *(f"{100 * of:.1f} % at {at}" for at, of in found.items()))


def among_sessions(studies: int, random: np.random.Generator) -> None:
    """Energy distances of sessions that differ by chance in some directions: squared distances of normal values."""
    for sessions in (3, 5, 10, 20):
        for directions in (1, 2, 10):
            found = []
            for _ in range(studies):
                at = random.normal(size=(sessions, directions))
                squared = ((at[:, None] - at[None]) ** 2).sum(axis=2)
                found.append(mean_interval(pseudo_values(squared.sum(axis=1) / (sessions - 1))))
            above = np.mean([one.low > 2.0 * directions for one in found])
            print(
                f"{sessions} sessions, directions: {directions}; {held(found, 2.0 * directions)}; too large {above:.3f}"
            )


def of_fit(studies: int, random: np.random.Generator, sessions: int = 1) -> None:
    """Camera and laws of energy, fitted to simulated sessions of five robots each."""
    base = preset("calibrated")
    truth = {f"sensor.{name}": getattr(base.sensor, name) for name in (*FIELDS, *SPREADS)}
    truth |= {f"camera.{name}": value for name, value in vars(CAMERA).items()}
    rows: dict[str, list[tuple[float, bool, bool]]] = {name: [] for name in truth}
    for _ in range(studies):
        result = simulate(base, runs=sessions, seed=int(random.integers(2**31)))
        groups = sessions * base.swarm.robots
        sensor = fit_sensor(dataset_of([result]))
        camera = fit_camera(dataset_of([seen_through(result, CAMERA)]))
        draws = {f"sensor.{name}": own for name, own in sensor.draws.items()}
        draws |= {f"camera.{name}": own for name, own in camera.draws.items()}
        values = {f"sensor.{name}": value for name, value in sensor.values.items()}
        values |= {f"camera.{name}": value for name, value in vars(camera.camera).items()}
        for name, own in draws.items():
            limits = limits_of(own), limits_of_bootstrap(own, groups)
            hold = [bool(low <= truth[name] <= high) for low, high in limits]
            rows[name].append((values[name], hold[0], hold[1]))
    for name, row in rows.items():
        mean, plain, wider = np.mean(row, axis=0)
        print(
            f"{name}: {truth[name]:.4f}, fitted {mean:.4f}; plain draws hold {plain:.2f}, wider {wider:.2f}"
        )


def of_rays(studies: int, random: np.random.Generator, sessions: int = 3) -> None:
    """Angles and starts of rays, and largest turns, of five robots whose starts differ by 10 mm."""
    base, between_m = preset("paper"), 0.01
    rows: dict[str, list[tuple[bool, float]]] = {}
    for _ in range(studies):
        starts_m = np.clip(random.normal(0.035, between_m, base.swarm.robots), 0.0, None).round(4)
        angle_deg, turn_deg = random.uniform((30.0, 100.0), (60.0, 170.0)).round(2).tolist()
        robots = base.with_values(
            {
                "rays.forward_each_m": starts_m.tolist(),
                "rays.angle_deg": [0.0, angle_deg, -angle_deg],
                "walk.turn_max_deg": turn_deg,
            }
        )
        result = simulate(robots, runs=sessions, seed=int(random.integers(2**31)), poses=True)
        found = fit_rays(dataset_of([result]), base)
        truth = {
            "ray_deg": angle_deg,
            "forward_m": float(starts_m.mean()),
            "forward_between_m": between_m,
            "turn_max_deg": turn_deg,
        }
        for name, true in truth.items():
            low, high = limits_of(found.draws[name])
            rows.setdefault(name, []).append((bool(low <= true <= high), found.values[name] - true))
    for name, row in rows.items():
        hold, error = np.mean(row, axis=0)
        print(f"{name}: hold {hold:.2f}, mean error {error:.4f}")


def of_slow_share(studies: int, random: np.random.Generator, sessions: int = 1) -> None:
    """Slow shares of the variance of five robots' veers, at the spread of preset calibrated."""
    spread = 0.01  # of turns, as a misalignment
    for slow in (0.0, 0.3, 0.6):
        robots = preset("calibrated").with_values(
            {
                "robot.speed_wander": None,  # distances that vary are turns that vary
                "robot.misalignment_wander": spread * math.sqrt(2.0 * (1.0 - slow)),
                "robot.misalignment_drift": spread * math.sqrt(slow) or None,
            }
        )
        groups, rows = sessions * robots.swarm.robots, []
        for _ in range(studies):
            result = simulate(robots, runs=sessions, seed=int(random.integers(2**31)), poses=True)
            found = fit_drive(dataset_of([result]), robots, draws=60)
            draws = found.draws["slow_share"]
            limits = limits_of(draws), limits_of_bootstrap(draws, groups)
            rows.append((found.values["slow_share"], *(bool(low <= slow <= high) for low, high in limits)))
        mean, plain, wider = np.mean(rows, axis=0)
        print(f"slow share {slow}: fitted {mean:.3f}; plain draws hold {plain:.2f}, wider {wider:.2f}")


if __name__ == "__main__":
    main()
