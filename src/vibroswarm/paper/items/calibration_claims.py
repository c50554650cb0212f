"""What the calibration's claims are decided by: similarities, error rates, the battery.

A similarity of a simulation is one of three simulated sessions to the recordings, over sets of three.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibroswarm.calibrate.compare import Comparison
from vibroswarm.calibrate.features import FEATURES, WORDS, sessions_of
from vibroswarm.calibrate.similarity import null, similarity
from vibroswarm.paper.columns import EMPIRICAL
from vibroswarm.paper.item import Settings
from vibroswarm.paper.measure import Row, exact, mean
from vibroswarm.paper.published import published
from vibroswarm.paper.real_floor import real_floor
from vibroswarm.result import Result
from vibroswarm.simulation import simulate

SESSIONS: Final = 3
"""Of the recordings, and in a set."""
THEIR_SETS: Final = 1
"""Of three sessions, behind each printed similarity."""
NAMES: Final = {
    "avoidance": "state_times",
    "vibrating": "energy_vibrating",
    "still": "energy_non_vibrating",
    "places": "sample_positions",
    "distances": "distance_over_time",
    "steps": "distance_and_angle",
}
"""The features, and what the paper calls them."""
Sets = dict[str, list[tuple[float, float]]]


def alike_by_set(real: Result, simulated: Result) -> Sets:
    """Similarity of each set of three sessions to the recordings, and of even scatter, by feature."""
    there, here = sessions_of(real), sessions_of(simulated)
    found: Sets = {}
    for feature in FEATURES:
        all_real = np.concatenate(there.values(feature))
        even: dict[int, float] = {}
        values = here.values(feature)
        for first in range(0, len(values), SESSIONS):
            some = np.concatenate(values[first : first + SESSIONS])
            count = min(len(all_real), len(some))
            if count not in even:
                even[count] = null(feature, all_real, count)
            found.setdefault(feature, []).append((similarity(feature, all_real, some), even[count]))
    return found


def printed(feature: str) -> float:
    """The similarity that the paper prints for a feature."""
    return float(published(f"calibration.cosine_similarity.{NAMES[feature]}"))


def authors_rows(found: Comparison) -> list[Row]:
    """The authors' own simulator against the recordings, less what is printed."""
    return [
        exact("calibration-printed", "paper", WORDS[one.feature], one.as_published - printed(one.feature))
        for one in found.similarities
    ]


def column_rows(settings: Settings, column: str, sets: Sets) -> list[Row]:
    """All that is asked of a preset; ``sets`` are those of its simulation."""
    rows = []
    for feature, pairs in sets.items():
        alike, even = np.array(pairs).T
        there = printed(feature)
        rows.append(mean("calibration-ours", column, WORDS[feature], alike, there, published_runs=THEIR_SETS))
        rows.append(mean("calibration-tells", column, WORDS[feature], alike - even))
    return rows + error_rows(settings, column) + battery_rows(settings, column)


def error_rows(settings: Settings, column: str) -> list[Row]:
    """Error rates of each run on the real floor, at the column's own threshold; no recordings are needed."""
    scenario = settings.scenario(column, real_floor(), with_=EMPIRICAL)
    result = simulate(scenario, settings.seed, min(settings.runs, 100), energies=False)
    kinds = np.array([int(tile) for row in real_floor()["floor.tiles"] for tile in row])
    tile, read = (result.observations[name].to_numpy() for name in ("tile", "observation"))
    run, kind = result.observations["run"].to_numpy(), kinds[tile]
    shares = [np.bincount(run[kind == k], read[kind == k] != k) / np.bincount(run[kind == k]) for k in (0, 1)]
    names = ("false_positive", "false_negative")
    return [
        mean(
            "calibration-errors",
            column,
            name,
            share,
            less=float(published(f"calibration.{name}_share")),
            published_runs=SESSIONS,
        )
        for name, share in zip(names, shares, strict=True)
    ]


def battery_rows(settings: Settings, column: str) -> list[Row]:
    """The battery's factor at both ends of a run, less what is printed."""
    scenario = settings.scenario(column)
    ends = zip((0.0, scenario.run.t_end_s), published("calibration.battery_first_last"), strict=True)
    return [
        exact("battery", column, f"at {t_s:g} s", 1.0 - t_s / scenario.robot.battery_life_s - printed)
        for t_s, printed in ends
    ]
