"""Fitted on all sessions but one, judged on that one, for each in turn.

Each feature's similarity of the held-out session to simulated sessions, to the other real sessions and to another
simulator, at one count of samples for all; their energy distances; and figures of reading, beside what simulated
sessions spread by: a figure is reached where the real session lies within 95 % of them (t with their number less one).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.classifier import tell_apart
from vibroswarm.calibrate.energy_distance import compare_distance
from vibroswarm.calibrate.features import FEATURES, values_of
from vibroswarm.calibrate.fit import Fit, fit
from vibroswarm.calibrate.measured import Measured, measured
from vibroswarm.calibrate.similarity import at_equal_counts
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import simulate

Floats = NDArray[np.float64]
SIMULATED: Final = 40
TOLD: Final = 6
EDGES_M: Final = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.1)
_SEED: Final = 34


@dataclass(frozen=True)
class Score:
    """A feature of one held-out session against three others, at equal counts; nan where there is none."""

    feature: str
    count: int
    fitted: float
    other_sessions: float
    other_simulator: float
    distance_fitted: float
    distance_sessions: float
    distance_simulator: float


@dataclass(frozen=True)
class Reading:
    """A figure of the held-out session, and of simulated ones: mean and standard deviation over them."""

    name: str
    recorded: float
    simulated: float
    spread: float

    @property
    def deviation(self) -> float:
        """How many standard deviations of a session the recorded one is off."""
        return (self.recorded - self.simulated) / self.spread if self.spread > 0 else np.nan


@dataclass(frozen=True)
class Fold:
    """One session held out."""

    session: int
    fit: Fit
    scores: tuple[Score, ...]
    readings: tuple[Reading, ...]
    told_fitted: float
    """Share of the session's stretches that a classifier tells from simulated ones, of other robots than it was trained
    on; mean over ``TOLD`` simulated sessions. Chance is 0.5."""
    told_simulator: float
    """The same of the other simulator's; nan where there is none."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; null where a figure is not known."""

        def plain(one: Any) -> dict[str, Any]:
            return {
                k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in one.__dict__.items()
            }

        return {
            "session": self.session,
            "fields": self.fit.changed,
            "scores": [plain(one) for one in self.scores],
            "readings": [plain(one) for one in self.readings],
            "told_apart": self.told_fitted,
            "told_apart_other": self.told_simulator if np.isfinite(self.told_simulator) else None,
        }


def on_floor(base: Scenario, floor: Floor) -> Scenario:
    """The scenario on this very floor."""
    rows, columns, width, height, left, bottom = floor.geometry
    arena = base.arena
    fills = np.allclose(
        (columns * width, rows * height, left, bottom), (arena.width_m, arena.height_m, 0.0, 0.0)
    )
    return base.with_values(
        {
            "floor.source": floor.name or "recorded",
            "floor.tiles": ["".join(str(tile) for tile in row) for row in floor.tiles.tolist()],
            "floor.tile_width_m": None if fills else width,
            "floor.tile_height_m": None if fills else height,
            "floor.left_m": left,
            "floor.bottom_m": bottom,
        }
    )


def folds(
    found: Measured,
    base: Scenario,
    other: Measured | None = None,
    *,
    candidates: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Fold]:
    """Hold each session out in turn.

    Args:
        found: at least two sessions. other: sessions of another simulator, to be compared with.
    Raises:
        InputError: fewer than two sessions.
    """
    sessions = found.sessions
    if len(sessions) < 2:
        raise InputError("needs at least two sessions", field="--folds")
    made = []
    for k, session in enumerate(sessions):

        def tell(share: float, k: int = k) -> None:
            if progress is not None:
                progress((k + share) / len(sessions))

        rest = found.only([one for one in sessions if one != session])
        made.append(_fold(found, rest, session, fit(rest, base, candidates=candidates, progress=tell), other))
    return made


def _fold(found: Measured, rest: Measured, session: int, fitted: Fit, other: Measured | None) -> Fold:
    scenario = on_floor(fitted.scenario, found.floors[session])
    there = measured([simulate(scenario, _SEED + session, SIMULATED)])
    simulated = replace(there, samples=there.seen_by(fitted.camera))
    held = found.only([session]).samples
    threshold = scenario.sensor.rms_threshold
    scores = tuple(_score(feature, held, simulated, rest, other) for feature in FEATURES)
    recorded = readings_of(held, threshold)
    each = [readings_of(one, threshold) for one in _by_session(simulated)]
    readings = tuple(
        Reading(name, value, float(np.nanmean(own)), float(np.nanstd(own, ddof=1)))
        for name, value in recorded.items()
        if np.isfinite(own := np.array([one[name] for one in each])).sum() > 1 and np.isfinite(value)
    )
    told = _told(held, _by_session(simulated)[:TOLD])
    return Fold(
        session, fitted, scores, readings, told, np.nan if other is None else _told(held, _by_session(other))
    )


def _told(held: pl.DataFrame, others: list[pl.DataFrame]) -> float:
    return float(np.mean([tell_apart([held], [one]).simulated_by_robot.estimate for one in others]))


def _by_session(found: Measured) -> list[pl.DataFrame]:
    return [found.samples.filter(pl.col("run") == run) for run in found.sessions]


def _score(
    feature: str, held: pl.DataFrame, simulated: Measured, rest: Measured, other: Measured | None
) -> Score:
    own = values_of(held, feature)
    sources = [simulated, rest, *([] if other is None else [other])]
    pooled = [np.concatenate([values_of(one, feature) for one in _by_session(each)]) for each in sources]
    count = min(len(own), *(len(one) for one in pooled))
    alike = [at_equal_counts(feature, own, one, count) for one in pooled]
    distances = [_distance(feature, own, one) for one in pooled]
    if other is None:
        alike, distances = [*alike, np.nan], [*distances, np.nan]
    return Score(feature, count, *alike, *distances)


def _distance(feature: str, own: Floats, other: Floats) -> float:
    """Of one session to a source's sessions taken together: what the source as a whole predicts."""
    found = compare_distance(feature, [own], [other])
    return np.nan if found is None else found.effect.estimate


def readings_of(samples: pl.DataFrame, threshold: float) -> dict[str, float]:
    """Errors, likeness of a robot's next bit, and errors by distance from the edge, of one session."""
    ordered = samples.sort("robot", "time_s")
    on, edge = ordered["vibrating"].to_numpy(), np.abs(ordered["edge_m"].to_numpy())
    bits = ordered["energy"].to_numpy() > threshold
    robot = ordered["robot"].to_numpy()
    deviation = bits - bits.mean()
    products = (deviation[1:] * deviation[:-1])[robot[1:] == robot[:-1]]
    wrong = bits != on

    def share(where: NDArray[np.bool_]) -> float:
        return float(wrong[where].mean()) if where.any() else np.nan

    found = {
        "false positive": share(~on),
        "false negative": share(on),
        "share of ones": float(bits.mean()),
        "lag-1 correlation of bits": float(products.mean() / max((deviation**2).mean(), 1e-12)),
    }
    for low, high in pairwise(EDGES_M):
        inside = (edge >= low) & (edge < high)
        span = f"{1000 * low:.0f} to {1000 * high:.0f} mm from an edge"
        found[f"false positive, {span}"] = share(~on & inside)
        found[f"false negative, {span}"] = share(on & inside)
    return found
