"""Fit a scenario to recordings: in closed form where possible, otherwise by simulation.

Fitted are the robots' properties; what they were told to do (sampling interval, leg times, decisions, strategy) and
theta_E are those of the base. Positions are corrected first if the camera saw robots too far out (``fit_camera``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.camera import Camera
from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.fit_avoidance import AvoidanceFit, fit_avoidance
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_drive import fit_drive
from vibroswarm.calibrate.fit_rays import fit_rays
from vibroswarm.calibrate.fit_sensor import SPREADS, fit_sensor
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]

LACKS: Final = (
    "Speed that changes slowly within a robot: its wandering is new at every sample.",
    "Drives without any veer: one undisturbed interval in eighteen of the study's recordings is straight.",
    "Small turns that overshoot: a turn takes the time that its angle takes.",
    "Tiles that read surer in their middle than near their rim.",
    "Samples between two kinds of tile that read neither: near an edge a sample is of one kind or the other.",
    "Packets lost in bursts: each is lost by itself.",
)


INTERRUPTED_BELOW: Final = 0.02
"""With a smaller share of avoidance longer than the sampling interval, samples are assumed to interrupt it."""


@dataclass(frozen=True)
class Fitted(NotebookView):
    """An estimate with its standard error and 95 % interval (bootstrap over robots and sessions, or posterior)."""

    name: str
    value: float
    error: float
    low: float
    high: float


@dataclass(frozen=True)
class Fit(NotebookView):
    """The fitted scenario, the estimates behind it, and checks."""

    scenario: Scenario
    changed: dict[str, Any]
    """The fitted fields, by dotted name."""
    figures: tuple[Fitted, ...]
    predicted: dict[str, tuple[float, float, float]]
    """Avoidance statistics: recorded value, and 95 % posterior prediction for a session."""
    motion_runs: int
    sessions: int
    camera: Camera
    """How positions were seen in the recordings; the scenario uses corrected positions."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "fields": self.changed,
            "figures": [asdict(figure) for figure in self.figures],
            "predictive_check": {
                name: dict(zip(("recorded", "low", "high"), limits, strict=True))
                for name, limits in self.predicted.items()
            },
            "camera": asdict(self.camera),
            "motion_runs": self.motion_runs,
            "sessions": self.sessions,
            "lacks": list(LACKS),
        }


def fit(
    found: Dataset,
    base: Scenario,
    *,
    candidates: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Fit a scenario.

    Args:
        found: the sessions (``dataset``). base: what the robots were told, and all that is not fitted.
        candidates: number of runs for the simulation-based part.
    Raises:
        InputError: too few robots or drives.
    """
    camera = fit_camera(found)
    found = found.corrected(camera.camera)
    base = base.with_values({f"camera.{name}": None for name in Camera.__dataclass_fields__})
    drive, sensor, sight = fit_drive(found, base), fit_sensor(found), fit_rays(found, base)
    loss = fit_loss(found)
    changed: dict[str, Any] = {name: value for name, value in drive.fields(base).items() if value is not None}
    rounded = {name: round(value, 5) for name, value in sensor.values.items()}
    changed |= {f"sensor.{n}": value for n, value in rounded.items() if n not in SPREADS or value > 0}
    changed["sample.interrupts_avoidance"] = avoidance_beyond(found, base).value < INTERRUPTED_BELOW
    changed |= sight.fields(base)
    stop_ms = stop_of(found, base)
    if stop_ms is not None:
        changed["sample.stop_ms"] = stop_ms
    if loss is not None:
        changed["network.name"], changed["network.loss.share"] = "loss", round(loss.value, 5)
    speed_m_s = drive.distance_ratio * drive.values["start_speed_m_s"]
    tried = {} if candidates is None else {"candidates": candidates}
    avoidance = fit_avoidance(found, base.with_values(changed), speed_m_s, progress=progress, **tried)
    changed |= avoidance.fields(base.with_values(changed), speed_m_s)
    changed |= camera.camera.fields()
    camera_values = {name: getattr(camera.camera, name) for name in camera.draws}
    figures = [
        _estimate(f"{section}{name}", value, draws[name])
        for section, values, draws in (
            ("camera.", camera_values, camera.draws),
            ("", drive.values, drive.draws),
            ("sensor.", sensor.values, sensor.draws),
            ("", sight.values, sight.draws),
        )
        for name, value in values.items()
    ]
    figures += [*([] if loss is None else [loss]), *_of_avoidance(avoidance)]
    return Fit(
        base.with_values(changed),
        changed,
        tuple(figures),
        avoidance.predicted,
        avoidance.runs,
        len(found.sessions),
        camera.camera,
    )


def avoidance_beyond(found: Dataset, base: Scenario) -> Fitted:
    """Return the share of intervals with avoidance in which it took longer than the sampling interval; 0 without any.

    The timer counts avoidance, so a robot that interrupts its turn to sample has almost none of these.
    """
    shares = []
    limit_s = base.sample.sample_interval_ms / 1000.0 + 0.06
    for _, own in found.samples.group_by("run", "robot", maintain_order=True):
        avoid = own["avoid_s"].drop_nulls().to_numpy()
        some = avoid[avoid > 1e-9]
        if some.size:
            shares.append(float((some > limit_s).mean()))
    each = np.array(shares)
    return _share("avoidance_beyond_interval", float(each.mean()) if each.size else 0.0, each)


def _share(name: str, value: float, each: Floats) -> Fitted:
    """Return a share with its standard error and 95 % interval, from the scatter of ``each``, one value per cluster.

    They are NaN with fewer than two clusters.
    """
    error = float(each.std(ddof=1)) / math.sqrt(each.size) if each.size > 1 else math.nan
    return Fitted(name, value, error, max(value - 1.96 * error, 0.0), value + 1.96 * error)


def stop_of(found: Dataset, base: Scenario) -> float | None:
    """Return the duration of a stop, ms, in whole control periods, from the intervals without avoidance or turn.

    These last tau, the stop and two control periods. None with fewer than 50 of them, or if the stop would not be
    between half and twice the base's: tau is then another one than the base's.
    """
    calm = found.samples.filter((pl.col("avoid_s") < 1e-9) & pl.col("spacing_s").is_not_null())["spacing_s"]
    if calm.len() < 50:
        return None
    usual = float(calm.median())  # type: ignore[arg-type]
    usual = float(calm.filter((calm - usual).abs() < 0.3).mean())  # type: ignore[arg-type]
    period = base.run.control_period_ms
    stop_ms = 1000.0 * usual - base.sample.sample_interval_ms - 2 * period
    rounded = period * round(stop_ms / period)
    return float(rounded) if 0.5 < rounded / max(base.sample.stop_ms, 1.0) < 2.0 else None


def fit_loss(found: Dataset) -> Fitted | None:
    """Return the share of addressed messages that were lost, with an interval over sessions; None if no log counts
    them."""
    known = found.exchange.drop_nulls("packet_loss")
    if known.height == 0:
        return None
    shares = known["packet_loss"].to_numpy()
    weights = known["addressed"].to_numpy().astype(float)
    return _share("network.loss.share", max(float(weights @ shares / weights.sum()), 0.0), shares)


def _estimate(name: str, value: float, draws: Floats) -> Fitted:
    """Return an estimate with error and interval from its bootstrap draws."""
    low, high = np.quantile(draws, [0.025, 0.975])
    return Fitted(name, value, float(draws.std(ddof=1)), float(low), float(high))


def _of_avoidance(found: AvoidanceFit) -> Sequence[Fitted]:
    """Return the estimates of the avoidance parameters with weighted quantiles of the posterior."""
    figures = []
    for name, draws in found.draws.items():
        mean = float(found.weights @ draws)
        order = np.argsort(draws)
        low, high = np.interp([0.025, 0.975], np.cumsum(found.weights[order]), draws[order])
        error = math.sqrt(float(found.weights @ (draws - mean) ** 2))
        figures.append(Fitted(name, mean, error, float(low), float(high)))
    return figures
