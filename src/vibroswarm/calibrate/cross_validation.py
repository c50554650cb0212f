"""Leave-one-session-out cross-validation of a fit.

Reported for each held-out session: similarity of each feature to simulated sessions, to the other real sessions
and to
another simulator, at equal sample counts; their energy distances; and error rates, with the mean and standard
deviation of
simulated sessions: a value agrees if the real session lies within 95 % of them (t with their number minus one).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import plain
from vibroswarm.calibrate.classifier import classifier_accuracy
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.features import FEATURES, values_of
from vibroswarm.calibrate.fit import Fit, fit
from vibroswarm.calibrate.similarity import at_equal_counts, compare_distance
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate

Floats = NDArray[np.float64]
SIMULATED: Final = 40
CLASSIFIED: Final = 6
EDGES_M: Final = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.1)
_SEED: Final = 34


@dataclass(frozen=True)
class Score(NotebookView):
    """Similarity and energy distance of one feature of a held-out session to three sources, at equal counts; nan if
    missing.
    """

    feature: str
    count: int
    fitted: float
    other_sessions: float
    other_simulator: float
    distance_fitted: float
    distance_sessions: float
    distance_simulator: float


@dataclass(frozen=True)
class Reading(NotebookView):
    """A statistic of the held-out session, with mean and standard deviation over simulated sessions."""

    name: str
    recorded: float
    simulated: float
    spread: float

    @property
    def deviation(self) -> float:
        """Recorded minus simulated value, in standard deviations between simulated sessions; NaN if that is 0."""
        return (self.recorded - self.simulated) / self.spread if self.spread > 0 else np.nan


@dataclass(frozen=True)
class Fold(NotebookView):
    """Result for one held-out session."""

    session: int
    fit: Fit
    scores: tuple[Score, ...]
    readings: tuple[Reading, ...]
    accuracy_fitted: float
    """Accuracy of a classifier between the session's stretches and simulated ones, tested on other robots than
    trained on;
    mean over ``CLASSIFIED`` simulated sessions. Chance is 0.5."""
    accuracy_simulator: float
    """The same for the other simulator; nan if there is none."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; null where a value is unknown."""

        return {
            "session": self.session,
            "fields": self.fit.changed,
            "scores": [{name: plain(value) for name, value in asdict(row).items()} for row in self.scores],
            "readings": [
                {name: plain(value) for name, value in asdict(row).items()} for row in self.readings
            ],
            "told_apart": self.accuracy_fitted,
            "told_apart_other": plain(self.accuracy_simulator),
        }


def on_floor(base: Scenario, floor: Floor) -> Scenario:
    """Return the scenario on this floor."""
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
    found: Dataset,
    base: Scenario,
    other: Dataset | None = None,
    *,
    candidates: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Fold]:
    """Hold out each session in turn.

    Args:
        found: at least two sessions. other: sessions of another simulator, for comparison.
        candidates: as of ``fit.fit``. progress: called with the share that is done.
    Raises:
        InputError: fewer than two sessions.
    """
    sessions = found.sessions
    if len(sessions) < 2:
        raise InputError("needs at least two sessions", field="--folds")
    results = []
    for k, session in enumerate(sessions):

        def report(share: float, k: int = k) -> None:
            if progress is not None:
                progress((k + share) / len(sessions))

        rest = found.only([number for number in sessions if number != session])
        results.append(
            _fold(found, rest, session, fit(rest, base, candidates=candidates, progress=report), other)
        )
    return results


def _fold(found: Dataset, rest: Dataset, session: int, fitted: Fit, other: Dataset | None) -> Fold:
    """Evaluate a fit on the session that was held out."""
    scenario = on_floor(fitted.scenario, found.floors[session])
    dataset = dataset_of([simulate(scenario, _SEED + session, SIMULATED)])
    simulated = replace(dataset, samples=dataset.seen_by(fitted.camera))
    held_out = found.only([session]).samples
    threshold = scenario.sensor.rms_threshold
    scores = tuple(_score(feature, held_out, simulated, rest, other) for feature in FEATURES)
    recorded = readings_of(held_out, threshold)
    each = [readings_of(samples, threshold) for samples in simulated.by_session]
    readings = tuple(
        Reading(name, value, float(np.nanmean(own)), float(np.nanstd(own, ddof=1)))
        for name, value in recorded.items()
        if np.isfinite(own := np.array([rates[name] for rates in each])).sum() > 1 and np.isfinite(value)
    )
    accuracy_simulator = np.nan if other is None else _recognised(held_out, other.by_session)
    return Fold(
        session,
        fitted,
        scores,
        readings,
        _recognised(held_out, simulated.by_session[:CLASSIFIED]),
        accuracy_simulator,
    )


def _recognised(held: pl.DataFrame, others: list[pl.DataFrame]) -> float:
    return float(
        np.mean([classifier_accuracy([held], [other]).simulated_by_robot.estimate for other in others])
    )


def _score(
    feature: str, held: pl.DataFrame, simulated: Dataset, rest: Dataset, other: Dataset | None
) -> Score:
    """Compare one feature of the held-out session with simulated, other real, and another simulator's sessions."""
    own = values_of(held, feature)
    sources = [simulated, rest, *([] if other is None else [other])]
    pooled = [
        np.concatenate([values_of(samples, feature) for samples in source.by_session]) for source in sources
    ]
    count = min(len(own), *(len(values) for values in pooled))
    alike = [at_equal_counts(feature, own, values, count) for values in pooled]
    distances = [_distance(feature, own, values) for values in pooled]
    if other is None:
        alike, distances = [*alike, np.nan], [*distances, np.nan]
    return Score(feature, count, *alike, *distances)


def _distance(feature: str, own: Floats, other: Floats) -> float:
    """Return the energy distance of one session to the pooled sessions of a source; NaN with too few values."""
    distance = compare_distance(feature, [own], [other])
    return np.nan if distance is None else distance.effect.estimate


def readings_of(samples: pl.DataFrame, threshold: float) -> dict[str, float]:
    """Return the error rates of one session, also by distance from the edge, and the lag-1 correlation of bits.

    A rate without samples is NaN.
    """
    ordered = samples.sort("robot", "time_s")
    on, edge = ordered["vibrating"].to_numpy(), np.abs(ordered["edge_m"].to_numpy())
    bits = ordered["energy"].to_numpy() > threshold
    robot = ordered["robot"].to_numpy()
    deviation = bits - bits.mean()
    products = (deviation[1:] * deviation[:-1])[robot[1:] == robot[:-1]]
    wrong = bits != on

    def share(where: NDArray[np.bool_]) -> float:
        return float(wrong[where].mean()) if where.any() else np.nan

    rates = {
        "false positive": share(~on),
        "false negative": share(on),
        "share of ones": float(bits.mean()),
        "lag-1 correlation of bits": float(products.mean() / max((deviation**2).mean(), 1e-12)),
    }
    for low, high in pairwise(EDGES_M):
        inside = (edge >= low) & (edge < high)
        span = f"{1000 * low:.0f} to {1000 * high:.0f} mm from an edge"
        rates[f"false positive, {span}"] = share(~on & inside)
        rates[f"false negative, {span}"] = share(on & inside)
    return rates
