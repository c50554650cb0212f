"""A scenario fitted to recordings: what can be had in closed form, and by simulation what cannot.

Fitted is what robots *are* (``FITTED``); what they were told to do (sampling interval, leg times, decisions, strategy) and
theta_E are the base's. Positions are put right first, where the camera saw robots too far out (``fit_camera``).
"""  # noqa: E501

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.calibrate.camera import Camera
from vibroswarm.calibrate.fit_avoidance import AvoidanceFit, fit_avoidance
from vibroswarm.calibrate.fit_camera import CameraFit, fit_camera
from vibroswarm.calibrate.fit_drive import DriveFit, fit_drive
from vibroswarm.calibrate.fit_sensor import SensorFit, fit_sensor
from vibroswarm.calibrate.fit_sight import SightFit, fit_sight
from vibroswarm.calibrate.measured import Measured
from vibroswarm.scenario import Scenario

Floats = NDArray[np.float64]

LACKS: Final = (
    "Speed that changes slowly within a robot: its wandering is new at every sample.",
    "Veer that wanders within a robot (4 deg/s in the study's recordings, with 2.7 between robots).",
    "Small turns that overshoot: a turn takes the time that its angle takes.",
    "Tiles that read surer in their middle than near their rim.",
    "Samples between two kinds of tile that read neither: near an edge a sample is of one kind or the other.",
    "Packets lost in bursts: each is lost by itself.",
)


INTERRUPTED_BELOW: Final = 0.02
"""With a smaller share of avoidance beyond the sampling interval, samples are taken to interrupt it."""


@dataclass(frozen=True)
class Fitted:
    """A figure, its standard error and 95 % interval (bootstrap over robots and sessions, or posterior)."""

    name: str
    value: float
    error: float
    low: float
    high: float

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return dict(self.__dict__)


@dataclass(frozen=True)
class Fit:
    """The scenario, the figures it was made from, and the checks."""

    scenario: Scenario
    changed: dict[str, Any]
    """The fields that were fitted, by dotted name."""
    figures: tuple[Fitted, ...]
    predicted: dict[str, tuple[float, float, float]]
    """Of avoidance: recorded, and 95 % of what the posterior predicts for a session."""
    motion_runs: int
    sessions: int
    camera: Camera
    """How the recordings' positions were seen; the scenario is of where robots were."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "fields": self.changed,
            "figures": [one.as_dict() for one in self.figures],
            "predictive_check": {
                name: dict(zip(("recorded", "low", "high"), one, strict=True))
                for name, one in self.predicted.items()
            },
            "camera": dict(self.camera.__dict__),
            "motion_runs": self.motion_runs,
            "sessions": self.sessions,
            "lacks": list(LACKS),
        }


def fit(
    found: Measured,
    base: Scenario,
    *,
    candidates: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Fit a scenario.

    Args:
        found: the sessions (``measured``). base: what the robots were told, and all that is not fitted.
        candidates: runs of the simulation-based part.
    Raises:
        InputError: too few robots or drives.
    """
    camera = fit_camera(found)
    found = found.corrected(camera.camera)
    drive, sensor, sight = fit_drive(found, base), fit_sensor(found), fit_sight(found, base)
    loss = fit_loss(found)
    changed: dict[str, Any] = {name: value for name, value in drive.fields(base).items() if value is not None}
    changed |= {f"sensor.{name}": round(value, 5) for name, value in sensor.values.items()}
    for name in ("tile_spread", "robot_spread"):
        if changed[f"sensor.{name}"] <= 0:
            del changed[f"sensor.{name}"]
    beyond = avoidance_beyond(found, base)
    changed["sample.interrupts_avoidance"] = beyond.value < INTERRUPTED_BELOW
    changed |= sight.fields(base)
    stop_ms = stop_of(found, base)
    if stop_ms is not None:
        changed["sample.stop_ms"] = stop_ms
    if loss is not None:
        changed["network.name"], changed["network.loss.share"] = "loss", round(loss.value, 5)
    speed_m_s = drive.whole * drive.values["start_speed_m_s"]
    tried = {} if candidates is None else {"candidates": candidates}
    avoidance = fit_avoidance(found, base.with_values(changed), speed_m_s, progress=progress, **tried)
    changed |= avoidance.fields(base.with_values(changed), speed_m_s)
    figures = [
        *_of_camera(camera),
        *_of_drive(drive),
        *_of_sensor(sensor),
        *_of_sight(sight),
        *([] if loss is None else [loss]),
        *_of_avoidance(avoidance),
    ]
    return Fit(
        base.with_values(changed),
        changed,
        tuple(figures),
        avoidance.predicted,
        avoidance.runs,
        len(found.sessions),
        camera.camera,
    )


def avoidance_beyond(found: Measured, base: Scenario) -> Fitted:
    """Share of intervals with avoidance in which it took longer than the sampling interval.

    The timer counts avoidance, so that a robot that interrupts its turn to sample has next to none of these.
    """
    shares = []
    limit_s = base.sample.sample_interval_ms / 1000.0 + 0.06
    for _, own in found.samples.group_by("run", "robot", maintain_order=True):
        avoid = own["avoid_s"].drop_nulls().to_numpy()
        some = avoid[avoid > 1e-9]
        if some.size:
            shares.append(float((some > limit_s).mean()))
    each = np.array(shares)
    error = float(each.std(ddof=1)) / math.sqrt(each.size) if each.size > 1 else math.nan
    mean = float(each.mean()) if each.size else 0.0
    return Fitted(
        "avoidance_beyond_interval", mean, error, max(mean - 1.96 * error, 0.0), mean + 1.96 * error
    )


def stop_of(found: Measured, base: Scenario) -> float | None:
    """How long robots stand, ms, in whole control periods: of the intervals in which nothing happened.

    They are tau, the stop and two control periods long. None where there are too few, or tau is another one.
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


def fit_loss(found: Measured) -> Fitted | None:
    """Share of addressed messages that were lost; None where no log tells. Interval over sessions."""
    known = found.exchange.drop_nulls("packet_loss")
    if known.height == 0:
        return None
    shares = known["packet_loss"].to_numpy()
    weights = known["addressed"].to_numpy().astype(float)
    value = max(float(weights @ shares / weights.sum()), 0.0)
    error = float(shares.std(ddof=1)) / math.sqrt(shares.size) if shares.size > 1 else math.nan
    return Fitted("network.loss.share", value, error, max(value - 1.96 * error, 0.0), value + 1.96 * error)


def _figure(name: str, value: float, draws: Floats) -> Fitted:
    low, high = np.quantile(draws, [0.025, 0.975])
    return Fitted(name, value, float(draws.std(ddof=1)), float(low), float(high))


def _of_camera(found: CameraFit) -> Sequence[Fitted]:
    return [
        _figure(f"camera.{name}", getattr(found.camera, name), draws) for name, draws in found.draws.items()
    ]


def _of_drive(found: DriveFit) -> Sequence[Fitted]:
    return [_figure(name, value, found.draws[name]) for name, value in found.values.items()]


def _of_sensor(found: SensorFit) -> Sequence[Fitted]:
    return [_figure(f"sensor.{name}", value, found.draws[name]) for name, value in found.values.items()]


def _of_sight(found: SightFit) -> Sequence[Fitted]:
    return [_figure(name, value, found.draws[name]) for name, value in found.values.items()]


def _of_avoidance(found: AvoidanceFit) -> Sequence[Fitted]:
    figures = []
    for name, draws in found.draws.items():
        mean = float(found.weights @ draws)
        order = np.argsort(draws)
        low, high = np.interp([0.025, 0.975], np.cumsum(found.weights[order]), draws[order])
        error = math.sqrt(float(found.weights @ (draws - mean) ** 2))
        figures.append(Fitted(name, mean, error, float(low), float(high)))
    return figures
