"""What a fit of speeds and distances carries over to a recorded session that it has not seen.

    python benchmarks/carried_over.py DIR [--candidates 1000] [--sessions 16] [--seed 5]

DIR is the folder of the study's recordings. Each session is held out, a scenario is fitted to the other two, and it is
simulated as fitted and with one thing changed. Printed are, as means over the held-out sessions: the similarity of a
simulated and the held-out session, and of all simulated sessions together and the held-out one, for the distance over
time and for distance and angle; and the number of samples relative to the recorded one. Beside these stand the study's
own simulator and the other real sessions. Before that: each robot's speed and loss of speed by session.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.cross_validation import on_floor
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.features import values_of
from vibroswarm.calibrate.fit import Fit, fit
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.similarity import at_equal_counts
from vibroswarm.paper.columns import EMPIRICAL, scenario_of
from vibroswarm.paper.real_data import AUTHORS, REAL, read_recordings, real_floor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate

SHOWN: Final = ("distances", "steps")
"""Features: distance over time, and distance and angle."""
SPEED_SPREAD, LOSS_SPREAD = 0.02, 0.03
"""What robots differ by between sessions: relative speed, and share of it lost in 1200 s."""
SAME_DAY: Final = {"robot.speed_run_spread": None}
"""Fields of robots that have the same speed in all sessions."""
Change = Callable[[Scenario, np.random.Generator], dict[str, Any]]


def speeds_by_session(scenario: Scenario, random: np.random.Generator) -> dict[str, Any]:
    """Return fields with each robot's speed drawn about the fitted one, in place of the fitted spread."""
    factors = [
        factor * (1.0 + SPEED_SPREAD * random.normal()) for factor in scenario.robot.speed_factors or ()
    ]
    return {
        "robot.speed_factors": factors,
        "robot.speed_factor_min": 0.5,
        "robot.speed_factor_max": 2.0,
    } | SAME_DAY


def losses_by_session(scenario: Scenario, random: np.random.Generator) -> dict[str, Any]:
    """Return fields with the battery drawn about the fitted one."""
    lost = 1200.0 / scenario.robot.battery_life_s + LOSS_SPREAD * random.normal()
    return {"robot.battery_life_s": 1200.0 / float(np.clip(lost, 0.02, 0.3))}


CHANGES: Final[dict[str, Change]] = {
    "as fitted": lambda scenario, random: {},
    "robots drawn from the fitted law": lambda scenario, random: {
        "robot.speed_factors": None,
        "robot.misalignments": None,
    },
    "speeds are the same in all sessions": lambda scenario, random: SAME_DAY,
    "speeds differ by 2 % from session to session": speeds_by_session,
    "losses of speed differ by session": losses_by_session,
    "speed wanders by a fifth more": lambda scenario, random: {
        "robot.speed_wander": 1.2 * (scenario.robot.speed_wander or 0.0)
    },
    "speed does not wander": lambda scenario, random: {"robot.speed_wander": None},
    "speed is not lost": lambda scenario, random: {"robot.battery_life_s": 1e6},
}
"""What is changed in the fitted scenario, drawn for each simulated session."""


def sessions_of(
    fitted: Fit, found: Dataset, session: int, change: Change, count: int, seed: int
) -> list[pl.DataFrame]:
    """Return the samples of simulated sessions on the floor of the held-out one, as the fitted camera sees them."""
    scenario, random = on_floor(fitted.scenario, found.floors[session]), np.random.default_rng(seed)
    results = [simulate(scenario.with_values(change(scenario, random)), seed, [run]) for run in range(count)]
    datasets = [dataset_of([result]) for result in results]
    return [one for data in datasets for one in replace(data, samples=data.seen_by(fitted.camera)).by_session]


def compared(own: pl.DataFrame, others: Sequence[pl.DataFrame]) -> list[float]:
    """Return the similarities, by session and together, of both features, and the relative number of samples."""
    row = []
    for feature in SHOWN:
        held, each = values_of(own, feature), [values_of(other, feature) for other in others]
        count = min(len(held), *(len(values) for values in each))
        row.append(float(np.mean([at_equal_counts(feature, held, values, count) for values in each])))
        row.append(at_equal_counts(feature, held, np.concatenate(each), count))
    return [*row, float(np.mean([other.height for other in others])) / own.height]


def print_robots(found: Dataset) -> None:
    """Print speed at the start and loss of speed of each robot by session, with the standard errors of the losses."""
    print("session robot  speed at the start, mm/s  lost in 1200 s, %")
    for (run, robot), own in found.drives.sort("run", "robot").group_by("run", "robot", maintain_order=True):
        line, covariance = np.polyfit(own["time_s"].to_numpy(), own["speed_m_s"].to_numpy(), 1, cov=True)
        lost, error = (120_000.0 * value / line[1] for value in (-line[0], np.sqrt(covariance[0, 0])))
        print(f"{int(run) + 1:7d} {robot:5d} {1000 * line[1]:25.1f} {lost:11.1f} +- {error:.1f}")


def main() -> None:
    """Hold out each session, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
    parser.add_argument("folder", metavar="DIR", type=Path)
    parser.add_argument("--candidates", type=int, default=1000)
    parser.add_argument("--sessions", type=int, default=16)
    parser.add_argument("--seed", type=int, default=5)
    asked = parser.parse_args()
    found, theirs = (dataset_of([read_recordings(asked.folder, names)]) for names in (REAL, AUTHORS))
    print_robots(found.corrected(fit_camera(found).camera))
    base = scenario_of("paper", real_floor(), parameter_set=EMPIRICAL)
    rows: dict[str, list[list[float]]] = {}
    for session in found.sessions:
        (own,) = found.only([session]).by_session
        rest = found.only([number for number in found.sessions if number != session])
        fitted = fit(rest, base, candidates=asked.candidates)
        for name, change in CHANGES.items():
            simulated = sessions_of(fitted, found, session, change, asked.sessions, asked.seed)
            rows.setdefault(name, []).append(compared(own, simulated))
        rows.setdefault("the study's simulator", []).append(compared(own, theirs.by_session))
        rows.setdefault("the other two real sessions", []).append(compared(own, rest.by_session))
    print("scenario; distance over time, by session and together; distance and angle, likewise; samples")
    for name, values in rows.items():
        print(
            f"| {name} | " + " | ".join(f"{value:.3f}" for value in np.mean(values, axis=0)) + " |",
            flush=True,
        )


if __name__ == "__main__":
    main()
