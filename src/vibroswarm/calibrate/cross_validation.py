"""Leave-one-session-out cross-validation of a fit.

Each real session is held out once: the scenario is fitted to the other sessions, and ``SIMULATED`` sessions are
simulated with it on the floor of the held-out session. A fold is the result of one such comparison. For each feature,
it has the similarity and the energy distance of the held-out session to three sources: the simulated sessions, the
other real sessions and the sessions of another simulator. All similarities of a feature are at equal sample counts. A
fold also has the error rates of the held-out session, with the mean and standard deviation of the same rates over the
simulated sessions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.classifier import classifier_accuracy
from vibroswarm.calibrate.dataset import Dataset, dataset_of
from vibroswarm.calibrate.features import FEATURES, lag_one, values_of
from vibroswarm.calibrate.fit import Fit, fit
from vibroswarm.calibrate.reading import Reading, readings_beside
from vibroswarm.calibrate.similarity import at_equal_counts, compare_distance
from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import number
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.recordings.threshold import share_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import plain

SIMULATED: Final = 40
"""Sessions simulated for each held-out one."""
CLASSIFIED: Final = 6
"""The first simulated sessions, which a classifier has to distinguish from the held-out one."""
EDGES_M: Final = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.1)
"""Limits of the classes of distance from the nearest tile of the other kind, for error rates near edges."""
_SEED: Final = 34
"""Seed of the simulations of session 0; session k has the seed ``_SEED`` + k."""


@dataclass(frozen=True)
class Score:
    """Similarity and energy distance of one feature of a held-out session to three sources; NaN if missing."""

    feature: str
    count: int
    """Number of values drawn from each source for the similarities."""
    fitted: float
    """Similarity to the simulations of the fitted scenario."""
    other_sessions: float
    """Similarity to the other real sessions."""
    other_simulator: float
    """Similarity to the sessions of another simulator."""
    distance_fitted: float
    """Energy distance to the simulations of the fitted scenario."""
    distance_sessions: float
    """Energy distance to the other real sessions."""
    distance_simulator: float
    """Energy distance to the sessions of another simulator."""


@dataclass(frozen=True)
class Fold:
    """Result for one held-out session."""

    session: int
    """Number of the held-out session."""
    fit: Fit
    """The fit to the other sessions, without errors of its estimates."""
    scores: tuple[Score, ...]
    """Comparison of each feature, in the order of ``FEATURES``."""
    readings: tuple[Reading, ...]
    """Statistics of the bits, without those that are unknown."""
    accuracy_fitted: float
    """Accuracy of a classifier between stretches (consecutive samples of one robot) of the session and of a simulated
    one, tested on other robots than trained on; mean over ``CLASSIFIED`` simulated sessions. Chance is 0.5."""
    accuracy_simulator: float
    """Accuracy of a classifier between the session's stretches and those of another simulator; NaN without one."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; null where a value is unknown.

        ``told_apart`` is ``accuracy_fitted``, and ``told_apart_other`` is ``accuracy_simulator``. ``fields`` are the
        fitted fields of the scenario; the rest of the fit is left out.
        """
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
    """Return the scenario with this floor's tiles, their size and place.

    ``floor.source`` is only the name of the floor here, because ``floor.tiles`` takes precedence over it. If the tiles
    fill the arena exactly, the fields of the tile size become None, the scenario's default: a scenario without a tile
    size has tiles that fill its arena.
    """
    rows, columns, width, height, left, bottom = floor.geometry
    # Width, height, left and bottom of all tiles together.
    tiled = (columns * width, rows * height, left, bottom)
    fills = np.allclose(tiled, (*base.arena.size_m, 0.0, 0.0))
    return base.with_values(
        {
            "floor.source": floor.name or "recorded",
            "floor.tiles": list(rows_of(floor.tiles)),
            "floor.tile_width_m": None if fills else width,
            "floor.tile_height_m": None if fills else height,
            "floor.left_m": left,
            "floor.bottom_m": bottom,
        }
    )


def simulated_by(fitted: Fit, floor: Floor, seed: int, sessions: int) -> Dataset:
    """Simulate sessions with a fitted scenario on a floor, and return them with the samples where its camera sees them.

    Positions of real sessions are those that their camera saw. Only the samples are moved, not the other tables.

    Args:
        seed, sessions: of the simulations, and their number.
    """
    dataset = dataset_of([simulate(on_floor(fitted.scenario, floor), seed, sessions)])
    return replace(dataset, samples=dataset.seen_by(fitted.camera))


def folds(
    found: Dataset,
    base: Scenario,
    other: Dataset | None = None,
    *,
    candidates: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Fold]:
    """Hold out each session once: fit the scenario to the other sessions, and compare simulations with the session.

    Args:
        found: real sessions, at least two.
        base: scenario that the fits start from.
        other: sessions of another simulator, for comparison; None: there is no other simulator.
        candidates: number of parameter vectors that each fit simulates; None: the default of ``fit.fit``.
        progress: called with the share of the work that is done, 0 to 1.
    Returns:
        One fold per session, in the order of ``found.sessions``.
    Raises:
        InputError: fewer than two sessions, or sessions that ``fit`` or ``classifier_accuracy`` refuses, such as one
            that is too short.
    """
    sessions = found.sessions
    if len(sessions) < 2:
        raise InputError("needs at least two sessions", field="--folds")
    results = []
    for k, (session, rest) in enumerate(found.held_out()):

        def report(share: float, done: int = k) -> None:
            """Report progress over all sessions, from the share of this fit that is done.

            ``done`` is the number of sessions held out before; as a default value it keeps this iteration's ``k``.
            """
            if progress is not None:
                progress((done + share) / len(sessions))

        results.append(
            _fold(
                found,
                rest,
                session,
                fit(rest, base, candidates=candidates, errors=False, progress=report),
                other,
            )
        )
    return results


def _fold(found: Dataset, rest: Dataset, session: int, fitted: Fit, other: Dataset | None) -> Fold:
    """Compare the held-out session with simulations of the scenario that was fitted to the other sessions.

    Args:
        found: all real sessions. rest: all real sessions but the held-out one.
        session: number of the held-out session. fitted: fit to ``rest``.
        other: sessions of another simulator; None: there is no other simulator.
    """
    # Each fold has a seed of its own, so that its simulations are independent of those of the other folds.
    simulated = simulated_by(fitted, found.floors[session], _SEED + session, SIMULATED)
    held_out = found.only([session]).samples
    threshold = fitted.scenario.sensor.rms_threshold
    scores = tuple(_score(feature, held_out, simulated, rest, other) for feature in FEATURES)
    by_session = [readings_of(samples, threshold) for samples in simulated.by_session]
    accuracy_simulator = np.nan if other is None else _recognised(held_out, other.by_session)
    return Fold(
        session=session,
        fit=fitted,
        scores=scores,
        readings=readings_beside(readings_of(held_out, threshold), by_session),
        accuracy_fitted=_recognised(held_out, simulated.by_session[:CLASSIFIED]),
        accuracy_simulator=accuracy_simulator,
    )


def _recognised(held: pl.DataFrame, others: list[pl.DataFrame]) -> float:
    """Return how well a classifier distinguishes one session from each of the others: mean balanced accuracy.

    Each classifier is trained and tested on the same pair of sessions, but on different robots: as only one real
    session is given, none is left for a test on another session.
    """
    return float(
        np.mean([classifier_accuracy([held], [other]).simulated_by_robot.estimate for other in others])
    )


def _score(
    feature: str, held: pl.DataFrame, simulated: Dataset, rest: Dataset, other: Dataset | None
) -> Score:
    """Compare one feature of the held-out session with simulated, other real, and another simulator's sessions.

    The sessions of each source are pooled. All similarities use the same number of values, so that they can be
    compared: the number that the held-out session or the smallest source has, whichever is smaller. Without another
    simulator, the figures of the other simulator are NaN.

    Args:
        held: samples of the held-out session. simulated: simulated sessions. rest: the other real sessions.
        other: sessions of another simulator; None: there is no other simulator.
    """
    own = values_of(held, feature)
    sources = [simulated, rest, *([] if other is None else [other])]
    pooled = [
        np.concatenate([values_of(samples, feature) for samples in source.by_session]) for source in sources
    ]
    count = min(len(own), *(len(values) for values in pooled))
    similarities = [at_equal_counts(feature, own, values, count) for values in pooled]
    distances = [_distance(feature, own, values) for values in pooled]
    if other is None:
        similarities, distances = [*similarities, np.nan], [*distances, np.nan]
    # The fields of a score are in the order of ``sources``, first all similarities, then all distances.
    return Score(feature, count, *similarities, *distances)


def _distance(feature: str, own: Floats, other: Floats) -> float:
    """Return the energy distance of one session to the pooled sessions of a source; NaN with too few values."""
    distance = compare_distance(feature, [own], [other])
    return np.nan if distance is None else distance.effect.estimate


def readings_of(samples: pl.DataFrame, threshold: float) -> dict[str, float]:
    """Return statistics of the bits (energy above the threshold) of one session, by name.

    The statistics are the false positive and false negative rates, over all samples and by distance from the edge
    (``EDGES_M``; larger distances are in no class), the share of ones, and the correlation of successive bits of a
    robot. Its deviations are from the mean bit of all robots, so differences between robots contribute to the
    correlation. A rate without samples is NaN.

    Args:
        samples: samples of one session, with ``edge_m`` (``Dataset.samples``).
        threshold: threshold theta_E of the RMS energy.
    """
    ordered = samples.sort("robot", "time_s")
    on, edge = ordered["vibrating"].to_numpy(), np.abs(ordered["edge_m"].to_numpy())
    bits = ordered["energy"].to_numpy() > threshold
    wrong = bits != on
    rates = {
        "false positive": share_of(wrong, ~on),
        "false negative": share_of(wrong, on),
        "share of ones": float(bits.mean()),
        "lag-1 correlation of bits": lag_one(bits, ordered["robot"].to_numpy()) or 0.0,
    }
    for low, high in pairwise(EDGES_M):
        inside = (edge >= low) & (edge < high)
        span = f"{number(1000 * low, 0)} to {number(1000 * high, 0)} mm from an edge"
        rates[f"false positive, {span}"] = share_of(wrong, ~on & inside)
        rates[f"false negative, {span}"] = share_of(wrong, on & inside)
    return rates
