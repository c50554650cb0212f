"""Fit a scenario to recordings, and judge fits by sessions that were held out of them.

The robots' properties are fitted. What the robots were programmed to do (sample interval, leg times, decisions,
strategy) and theta_E are taken from the base scenario. ``FITS`` are functions that are called in order; each adds its
fields to the scenario, which the next one works with.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.camera import RIGHT, Camera, corrected_sessions, fit_camera, seen_through
from vibroswarm.calibrate.compare import at_equal_counts, compare_feature, recognised
from vibroswarm.calibrate.dataset import Dataset, calm_intervals
from vibroswarm.calibrate.few_groups import limits_of, limits_of_bootstrap
from vibroswarm.calibrate.fit_avoidance import CANDIDATES, fields_of, fit_avoidance
from vibroswarm.calibrate.fit_drive import fit_drive, timed_drive_ms
from vibroswarm.calibrate.fit_rays import fit_rays
from vibroswarm.calibrate.fit_sensor import DIGITS, FIELDS, SPREADS, fit_sensor
from vibroswarm.calibrate.samples import FEATURES, ROUNDING_S, by_session, values_of
from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import listed
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.recordings.threshold import robot_clusters
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import mean_interval

TAU: Final = "sample.sample_interval_ms"
_SEED: Final = 34
"""Seed of the simulations of session 0; session k has the seed ``_SEED`` + k."""


@dataclass(frozen=True)
class Fitted:
    """An estimate with its standard error and the limits ``low`` and ``high`` of its 95 % interval.

    They come from a bootstrap, from the scatter between robots or sessions, or from a posterior sample.
    """

    name: str
    value: float
    error: float
    low: float
    high: float


@dataclass(frozen=True)
class Fit:
    """The fitted scenario, the estimates behind it, and checks; also what the next fit starts from."""

    scenario: Scenario
    found: Dataset
    """The sessions; with the places of robots corrected once the camera is fitted."""
    changed: dict[str, Any] = field(default_factory=dict)
    """The fitted fields, by dotted name."""
    figures: tuple[Fitted, ...] = ()
    """All estimates with their standard errors and intervals."""
    camera: Camera = RIGHT
    """How positions were seen in the recordings; the scenario uses corrected positions."""
    speed_m_s: float = math.nan
    """Mean speed of the scenario's robots at the start."""
    predicted: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    """By statistic of avoidance: its recorded value, and the limits of its 95 % posterior prediction for a session."""

    def with_fields(self, fields: Mapping[str, Any], figures: Sequence[Fitted] = (), **more: Any) -> Fit:
        """Return this fit with further fields, by dotted name (None: these robots have none), and estimates."""
        # A field may exclude one that these robots do not have, so that those go first.
        missing = {name: value for name, value in fields.items() if value is None}
        known = {name: value for name, value in fields.items() if value is not None}
        return replace(
            self,
            scenario=self.scenario.with_values(missing).with_values(known),
            changed={name: value for name, value in self.changed.items() if name not in missing} | known,
            figures=(*self.figures, *figures),
            **more,
        )


def fit(
    found: Dataset,
    base: Scenario,
    *,
    candidates: int = CANDIDATES,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Fit a scenario to the sessions of a dataset.

    Args:
        found: the sessions, with positions as the camera saw them (``dataset``).
        base: scenario of what the robots were programmed to do, and of all that is not fitted. Its fields of individual
            robots and of variations are reset where the fit gives none.
        candidates: number of parameter vectors that the fit of avoidance simulates.
        progress: called with the share of the avoidance simulations that is done, 0 to 1.
    Raises:
        InputError: too few robots or drives, or all samples lie on one kind of tile.
    """
    # The base may have been fitted to other recordings, with another camera.
    fitted = Fit(base.with_values({f"camera.{name}": None for name in vars(RIGHT)}), found)
    for step in FITS:
        fitted = step(fitted)
    return avoidance(fitted, candidates, progress)


def _camera(fit: Fit) -> Fit:
    """Where energies change, of all samples."""
    camera = fit_camera(fit.found)
    return fit.with_fields(camera.fields(), camera=camera, found=corrected_sessions(fit.found, camera))


def _driving(fit: Fit) -> Fit:
    """Speeds, battery and veers, of undisturbed intervals; errors by t and chi-square of the robots."""
    found = fit_drive(fit.found, fit.scenario)
    figures = _estimates("", found.values, found.draws)
    return fit.with_fields(found.fields, figures, speed_m_s=found.speed_m_s)


def _sensor(fit: Fit) -> Fit:
    """Laws of energy, of all samples; errors by a bootstrap over robots in sessions, of spreads by chi-square."""
    if fit.scenario.sensor.model == "acceleration":
        return fit
    found = fit_sensor(fit.found)
    # A spread field must be positive, and is absent without a spread.
    fields = {
        f"sensor.{name}": value if name not in SPREADS or value > 0 else None
        for name, value in found.rounded(found.values).items()
    }
    figures = _estimates(
        "sensor.", found.values, found.draws, groups=int(robot_clusters(fit.found.samples).max()) + 1
    )
    return fit.with_fields(fields, figures)


def _interruption(fit: Fit) -> Fit:
    """Whether samples interrupt avoidance: then it hardly ever takes longer than the sample interval.

    The share of longer times is computed for each robot in each session, and averaged.
    """
    limit_s = fit.scenario.sample.sample_interval_ms / 1000.0 + 0.06  # with a margin of three ticks of 20 ms
    avoided = fit.found.samples.filter(pl.col("avoid_s") > ROUNDING_S).group_by("run", "robot")
    beyond = avoided.agg((pl.col("avoid_s") > limit_s).mean())["avoid_s"].mean() or 0.0
    return fit.with_fields({"sample.interrupts_avoidance": beyond < 0.02})  # type: ignore[operator]  # to polars a mean may be of dates


def _rays(fit: Fit) -> Fit:
    """Rays and largest turn, of turns away from walls and at the ends of legs."""
    return fit.with_fields(fit_rays(fit.found, fit.scenario))


def _stop(fit: Fit) -> Fit:
    """The stop, in whole control periods, of the times between samples without avoidance or turn.

    Such a time is the drive, the stop and a control period. A stop below half or above twice that of the base means
    that the robots were programmed with another tau.
    """
    calm, base = calm_intervals(fit.found.samples)["spacing_s"], fit.scenario
    period = base.run.control_period_ms
    if calm.len() < 50:
        return fit
    usual = float(calm.mean())  # type: ignore[arg-type]  # to polars a mean may be of dates too
    stop_ms = float(period * round((1000.0 * usual - timed_drive_ms(base) - period) / period))
    is_plausible = 0.5 < stop_ms / max(base.sample.stop_ms, 1.0) < 2.0
    return fit.with_fields({"sample.stop_ms": stop_ms} if is_plausible else {})


def _loss(fit: Fit) -> Fit:
    """Share of lost messages, of sessions weighted by their messages; errors by the scatter of sessions."""
    known = fit.found.exchange.drop_nulls("packet_loss")  # the sessions whose loss is known
    if known.is_empty():
        return fit
    shares, weights = known["packet_loss"].to_numpy(), known["addressed"].to_numpy().astype(float)
    # A session's share is below 0 if it received more messages than are counted as addressed; the estimate is not.
    value = max(float(weights @ shares / weights.sum()), 0.0)
    low, high = (value + end - shares.mean() for end in mean_interval(shares)[1:3])
    error = float(shares.std(ddof=1)) / math.sqrt(shares.size) if shares.size > 1 else math.nan
    return fit.with_fields(
        {"network.name": "loss", "network.loss.share": round(value, DIGITS)},
        [Fitted("network.loss.share", value, error, max(low, 0.0), high)],
    )


def avoidance(fit: Fit, candidates: int, progress: Callable[[float], None] | None) -> Fit:
    """Avoidance, by simulations with all other fields fitted; estimates are means of a posterior sample."""
    draws, weights, predicted = fit_avoidance(
        fit.found, fit.scenario, fit.speed_m_s, candidates=candidates, progress=progress
    )
    values = {name: float(weights @ own) for name, own in draws.items()}
    figures = []
    for name, own in draws.items():
        order = np.argsort(own)
        low, high = np.interp([0.025, 0.975], np.cumsum(weights[order]), own[order])
        error = math.sqrt(float(weights @ (own - values[name]) ** 2))
        figures.append(Fitted(name, values[name], error, float(low), float(high)))
    return fit.with_fields(fields_of(values, fit.scenario, fit.speed_m_s), figures, predicted=predicted)


FITS: Final = (_camera, _driving, _sensor, _interruption, _rays, _stop, _loss)
"""The fits before that of avoidance, in their order."""


def _estimates(
    section: str, values: Mapping[str, float], draws: Mapping[str, Floats], groups: int = 0
) -> list[Fitted]:
    """Return the estimates that have draws, (draws,) each, with standard errors and 95 % intervals from them.

    ``section`` begins their names. Draws of the laws are a bootstrap of so many ``groups``.
    """
    figures = []
    for name, own in draws.items():
        low, high = limits_of_bootstrap(own, groups) if name in FIELDS else limits_of(own)
        error = float(own.std(ddof=1))
        figures.append(Fitted(f"{section}{name}", values[name], error, float(low), float(high)))
    return figures


def contradictions(results: Sequence[Result], base: Scenario) -> list[str]:
    """Return sentences about settings of the base that recordings contradict.

    Only those count that determine how often robots meet each other and walls, and when they sample.
    """
    there = {
        name: sorted({result.scenario[name] for result in results})
        for name in ("swarm.robots", "arena.width_m", "arena.height_m")
    }
    for one in (one for result in results for one in getattr(result, "inferred", ())):
        if one["name"] == TAU and one["value"] is not None and not one["low"] <= base[TAU] <= one["high"]:
            there[TAU] = [one["value"]]
    return [
        f"{name} is {base[name]} in the base, but {listed(map(str, values))} in the recordings; see --set."
        for name, values in there.items()
        if values and base[name] not in values
    ]


@dataclass(frozen=True)
class Fold:
    """How a session is like simulations with the fit to the other sessions."""

    session: int
    scores: pl.DataFrame
    """By feature: similarity at equal counts, and energy distance, of the session to the simulated sessions (fitted,
    distance_fitted) and to the other real ones (other_sessions, distance_other_sessions)."""
    accuracy: float
    """Accuracy of a classifier between stretches (consecutive samples of one robot) of the session and of a simulated
    one, tested on other robots than trained on; mean over simulated sessions. Chance is 0.5."""


def on_floor(base: Scenario, floor: Floor) -> Scenario:
    """Return the scenario with this floor's tiles, their size and place."""
    _, _, width, height, left, bottom = floor.geometry
    return base.with_values(
        {
            "floor.source": floor.name or "recorded",  # only its name: tiles take precedence
            "floor.tiles": list(rows_of(floor.tiles)),
            "floor.tile_width_m": width,
            "floor.tile_height_m": height,
            "floor.left_m": left,
            "floor.bottom_m": bottom,
        }
    )


def folds(
    found: Dataset,
    base: Scenario,
    *,
    candidates: int = CANDIDATES,
    progress: Callable[[float], None] | None = None,
) -> list[Fold]:
    """Hold out each session once: fit the scenario to the other sessions, and compare simulations with the session.

    The simulations are on the floor of the held-out session, and seen through the fitted camera.

    Args:
        found: real sessions, at least two.
        base: scenario that the fits start from.
        candidates: number of parameter vectors that each fit simulates.
        progress: called with the share of the sessions that is done, 0 to 1.
    Raises:
        InputError: fewer than two sessions, or sessions that ``fit`` refuses.
    """
    if len(found.sessions) < 2:
        raise InputError("needs at least two sessions", field="--folds")
    results = []
    for session in found.sessions:
        rest = found.only([other for other in found.sessions if other != session])
        fitted = fit(rest, base, candidates=candidates)
        results.append(_fold(found, rest, session, fitted))
        if progress is not None:
            progress(len(results) / len(found.sessions))
    return results


def _fold(found: Dataset, rest: Dataset, session: int, fitted: Fit) -> Fold:
    scenario = on_floor(fitted.scenario, found.floors[session])
    simulated = by_session(seen_through(simulate(scenario, _SEED + session, 40), fitted.camera))
    held = found.only([session]).samples
    scores: list[dict[str, object]] = []
    for feature in FEATURES:
        own = values_of(held, feature)
        pools = [
            np.concatenate([values_of(one, feature) for one in sessions])
            for sessions in (simulated, rest.samples.partition_by("run"))
        ]
        count = min(len(own), *map(len, pools))
        row: dict[str, object] = {"feature": feature}
        for name, pool in zip(("fitted", "other_sessions"), pools, strict=True):
            row[name] = at_equal_counts(feature, own, pool, count)
            row[f"distance_{name}"] = compare_feature(feature, [own], [pool]).distance.estimate
        scores.append(row)
    accuracies = [recognised([held], [samples]) for samples in simulated[:6]]
    known = [one.estimate for one in accuracies if one is not None]
    return Fold(session, pl.DataFrame(scores), float(np.mean(known)) if known else math.nan)
