"""Leave-one-session-out cross-validation of a fit.

Each real session is held out once: the scenario is fitted to the other sessions, and ``SIMULATED`` sessions are
simulated with it on the floor of the held-out session, and seen through the fitted camera. For each feature, a fold has
the similarity and the energy distance of the held-out session to the simulated sessions and to the other real ones. All
similarities of a feature are at equal sample counts. A fold also has the error rates of the held-out session, with the
mean and standard deviation of the same rates over the simulated sessions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.lab.calibrate.camera import seen_through
from vibroswarm.lab.calibrate.classifier import recognised
from vibroswarm.lab.calibrate.compare import at_equal_counts, compare_feature
from vibroswarm.lab.calibrate.dataset import Dataset
from vibroswarm.lab.calibrate.features import FEATURES, values_of
from vibroswarm.lab.calibrate.fit import Fit, fit
from vibroswarm.lab.calibrate.samples import by_session
from vibroswarm.lab.recordings.threshold import share_of
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate

SIMULATED: Final = 40
"""Sessions simulated for each held-out one."""
CLASSIFIED: Final = 6
"""The first simulated sessions, which a classifier has to distinguish from the held-out one."""
_SEED: Final = 34
"""Seed of the simulations of session 0; session k has the seed ``_SEED`` + k."""


@dataclass(frozen=True)
class Fold:
    """Result for one held-out session."""

    session: int
    fit: Fit
    """The fit to the other sessions, without errors of its estimates."""
    scores: pl.DataFrame
    """By feature: fitted, other_sessions (similarities) and distance_fitted, distance_sessions (energy distances)."""
    rates: pl.DataFrame
    """By statistic of bits: recorded; simulated and spread, mean and standard deviation over simulated sessions."""
    accuracy: float
    """Accuracy of a classifier between stretches (consecutive samples of one robot) of the session and of a simulated
    one, tested on other robots than trained on; mean over ``CLASSIFIED`` simulated sessions. Chance is 0.5."""


def on_floor(base: Scenario, floor: Floor) -> Scenario:
    """Return the scenario with this floor's tiles, their size and place."""
    rows, columns, width, height, left, bottom = floor.geometry
    # A scenario without a tile size has tiles that fill its arena.
    fills = np.allclose((columns * width, rows * height, left, bottom), (*base.arena.size_m, 0.0, 0.0))
    return base.with_values(
        {
            "floor.source": floor.name or "recorded",  # only its name: tiles take precedence
            "floor.tiles": list(rows_of(floor.tiles)),
            "floor.tile_width_m": None if fills else width,
            "floor.tile_height_m": None if fills else height,
            "floor.left_m": left,
            "floor.bottom_m": bottom,
        }
    )


def folds(
    found: Dataset,
    base: Scenario,
    *,
    candidates: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Fold]:
    """Hold out each session once: fit the scenario to the other sessions, and compare simulations with the session.

    Args:
        found: real sessions, at least two.
        base: scenario that the fits start from.
        candidates: number of parameter vectors that each fit simulates; None: the default of ``fit.fit``.
        progress: called with the share of the work that is done, 0 to 1.
    Raises:
        InputError: fewer than two sessions, or sessions that ``fit`` refuses.
    """
    sessions = found.sessions
    if len(sessions) < 2:
        raise InputError("needs at least two sessions", field="--folds")
    results = []
    for k, (session, rest) in enumerate(found.held_out()):

        def report(share: float, done: int = k) -> None:
            if progress is not None:
                progress((done + share) / len(sessions))

        fitted = fit(rest, base, candidates=candidates, errors=False, progress=report)
        results.append(_fold(found, rest, session, fitted))
    return results


def _fold(found: Dataset, rest: Dataset, session: int, fitted: Fit) -> Fold:
    scenario = on_floor(fitted.scenario, found.floors[session])
    simulated = by_session(seen_through(simulate(scenario, _SEED + session, SIMULATED), fitted.camera))
    held = found.only([session]).samples
    scores: list[dict[str, object]] = []
    for feature in FEATURES:
        own = values_of(held, feature)
        pools = {
            "fitted": np.concatenate([values_of(samples, feature) for samples in simulated]),
            "other_sessions": np.concatenate([values_of(samples, feature) for samples in rest.by_session]),
        }
        count = min(len(own), *(len(pool) for pool in pools.values()))
        similarities = {name: at_equal_counts(feature, own, pool, count) for name, pool in pools.items()}
        distances = [compare_feature(feature, [own], [pool]).distance.estimate for pool in pools.values()]
        of_distances = dict(zip(("distance_fitted", "distance_sessions"), distances, strict=True))
        scores.append({"feature": feature, **similarities, **of_distances})
    threshold = scenario.sensor.rms_threshold
    by_run = pl.DataFrame([error_rates(samples, threshold) for samples in simulated])
    rates = [
        {
            "statistic": name,
            "recorded": value,
            "simulated": by_run[name].drop_nans().mean(),
            "spread": by_run[name].drop_nans().std(),
        }
        for name, value in error_rates(held, threshold).items()
    ]
    accuracies = [recognised([held], [samples]) for samples in simulated[:CLASSIFIED]]
    known = [one.estimate for one in accuracies if one is not None]
    return Fold(
        session,
        fitted,
        pl.DataFrame(scores),
        pl.DataFrame(rates),
        float(np.mean(known)) if known else math.nan,
    )


def error_rates(samples: pl.DataFrame, threshold: float) -> dict[str, float]:
    """Return error rates of the bits (energy above the threshold) of one session, and their share of ones."""
    on, bits = samples["vibrating"].to_numpy(), samples["energy"].to_numpy() > threshold
    return {
        "false positive": share_of(bits, ~on),
        "false negative": share_of(~bits, on),
        "share of ones": float(bits.mean()),
    }
