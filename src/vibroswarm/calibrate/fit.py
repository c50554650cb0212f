"""Fit a scenario to recordings: in closed form where possible, otherwise by simulation.

The robots' properties are fitted. What the robots were programmed to do (sample interval, leg times, decisions,
strategy) and theta_E are taken from the base scenario. Positions are corrected first if the camera saw robots too far
from the centre (``fit_camera``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from scipy.special import stdtrit

from vibroswarm.calibrate.camera import Camera
from vibroswarm.calibrate.dataset import Dataset
from vibroswarm.calibrate.drive import calm_intervals
from vibroswarm.calibrate.few_groups import limits_of, limits_of_bootstrap
from vibroswarm.calibrate.fit_avoidance import CANDIDATES, PRIOR, AvoidanceFit, fields_of, fit_avoidance
from vibroswarm.calibrate.fit_camera import fit_camera
from vibroswarm.calibrate.fit_drive import fit_drive, timed_drive_ms
from vibroswarm.calibrate.fit_rays import GRID_DEG, fit_rays
from vibroswarm.calibrate.fit_sensor import DIGITS, SPREADS, fit_sensor
from vibroswarm.calibrate.fit_sensor import FIELDS as LAWS
from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import listed, stated
from vibroswarm.errors import check_kind
from vibroswarm.recordings.threshold import robot_clusters
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

LACKS: Final = (
    "Speed that changes slowly within a robot: its wandering is new at every sample.",
    "Drives without any veer: one undisturbed interval in eighteen of the study's recordings is straight.",
    "Small turns that overshoot: a turn takes the time that its angle takes.",
    "Tiles that read surer in their middle than near their rim.",
    "Samples between two kinds of tile that read neither: near an edge a sample is of one kind or the other.",
    "Packets lost in bursts: losses are independent.",
)
"""Known differences between real robots and every fitted scenario, as sentences."""


INTERRUPTED_BELOW: Final = 0.02
"""If a smaller share of the avoidance times exceeds the sample interval, samples are taken to interrupt avoidance."""


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
    """The fitted scenario, the estimates behind it, and checks."""

    scenario: Scenario
    changed: dict[str, Any]
    """The fitted fields, by dotted name."""
    figures: tuple[Fitted, ...]
    """All estimates with their standard errors and intervals."""
    predicted: dict[str, tuple[float, float, float]]
    """By statistic of avoidance: its recorded value, and the limits of its 95 % posterior prediction for a session."""
    motion_runs: int
    """Number of runs that the fit of avoidance simulated."""
    sessions: int
    """Number of recorded sessions."""
    camera: Camera
    """How positions were seen in the recordings; the scenario uses corrected positions."""

    def as_dict(self) -> dict[str, Any]:
        """Return all results but the scenario as nested plain values for JSON, with ``LACKS``.

        ``LACKS`` are the known differences between real robots and every fitted scenario.
        """
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
    errors: bool = True,
    progress: Callable[[float], None] | None = None,
) -> Fit:
    """Fit a scenario to the sessions of a dataset.

    Args:
        found: the sessions, with positions as the camera saw them (``dataset``).
        base: scenario of what the robots were programmed to do, and of all that is not fitted. Its fields of individual
            robots and of variations are reset where the fit gives none.
        candidates: number of parameter vectors that the fit of avoidance simulates; None: its default.
        errors: whether bootstraps find the errors of estimates; if not, the fit is the same some seconds sooner, and
            lists only the estimates that have errors without them.
        progress: called with the share of the avoidance simulations that is done, 0 to 1.
    Raises:
        InputError: too few robots or drives, or all samples lie on one kind of tile.
    """
    check_kind(found, Dataset, "found", "a Dataset, as dataset_of() returns")
    # The base may have been fitted to other recordings, with another camera.
    base = base.with_values({f"camera.{name}": None for name in Camera.__dataclass_fields__})
    work = _Work(
        found, base, candidates=CANDIDATES if candidates is None else candidates,
        of_errors={} if errors else {"draws": 0}, progress=progress,
    )  # fmt: skip
    parts = [_part_of(source, work) for source in FITS]
    return Fit(
        scenario=_fitted(base, work.fields),
        changed=_without_missing(work.fields),
        figures=tuple(figure for part in parts for figure in part.figures),
        predicted=work.avoidance.predicted,
        motion_runs=work.avoidance.runs,
        sessions=len(found.sessions),
        camera=work.camera,
    )


@dataclass
class _Work:
    """What the fits work on, and what later ones need of earlier ones."""

    found: Dataset
    """The sessions; with the places of robots corrected once the camera is fitted."""
    base: Scenario
    candidates: int
    of_errors: dict[str, int]
    """Number of bootstrap draws, if it is not the default of each fit."""
    progress: Callable[[float], None] | None
    fields: dict[str, Any] = field(default_factory=dict)
    """Fields of the fits so far, by dotted name; None for what these robots do not have."""
    camera: Camera = field(default_factory=Camera)
    speed_m_s: float = math.nan
    """Mean speed of the scenario's robots at the start."""
    avoidance: AvoidanceFit = field(init=False)

    @property
    def robots(self) -> int:
        """Number of robots, which count once in each session: the groups of bootstraps."""
        return int(robot_clusters(self.found.samples).max()) + 1


class _Part(NamedTuple):
    """What one fit gives to the scenario, and its estimates."""

    fields: dict[str, Any]
    """Fitted fields, by dotted name; None for what these robots do not have."""
    figures: Sequence[Fitted] = ()


@dataclass(frozen=True)
class Source:
    """A fit: what it estimates, and from what."""

    name: str
    fields: tuple[str, ...]
    """Fields of the scenario that it gives, by dotted name; a name that ends with a point is all of a section."""
    intervals: str
    """Samples, or intervals between two samples of a robot, that it uses."""
    error: str
    """How the errors of its estimates are found; "none: ..." if it has none."""
    estimate: Callable[[_Work], _Part] = field(repr=False)
    """Does the fit."""


def _part_of(source: Source, work: _Work) -> _Part:
    """Return what a fit gives, and add its fields to those of the fits before it.

    Raises:
        AssertionError: it gives a field that its row in ``FITS`` does not name, or errors where that has none.
    """
    part = source.estimate(work)
    sections = tuple(name for name in source.fields if name.endswith("."))
    others = [name for name in part.fields if name not in source.fields and not name.startswith(sections)]
    assert not others, f"the fit of {source.name} gives {', '.join(others)}"
    assert not (part.figures and source.error.startswith("none: ")), f"the fit of {source.name} has errors"
    work.fields |= part.fields
    return part


def _without_missing(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def _fitted(base: Scenario, fields: Mapping[str, Any]) -> Scenario:
    """Return the base with fitted fields, and without what these robots do not have: it may be of other robots."""
    without = base.with_values({name: None for name, value in fields.items() if value is None})
    return without.with_values(_without_missing(fields))


def _of_camera(work: _Work) -> _Part:
    """Fit the camera, and correct the places; an exact camera has no draws, and gives no estimates."""
    found = fit_camera(work.found, **work.of_errors)
    work.camera, work.found = found.camera, work.found.corrected(found.camera)
    values = {name: getattr(found.camera, name) for name in found.draws}
    return _Part(found.camera.fields(), _estimates("camera.", values, found.draws, found.draws, work.robots))


def _of_drive(work: _Work) -> _Part:
    found = fit_drive(work.found, work.base, **work.of_errors)
    work.speed_m_s = found.distance_ratio * found.values["start_speed_m_s"]
    fields = found.fields(work.base)
    # Where a law is fitted, values of individual robots in the base would be used instead of it.
    fields.setdefault("robot.speed_factors", None)
    if "robot.misalignment_min" in fields:
        fields.setdefault("robot.misalignments", None)
    return _Part(fields, _estimates("", found.values, found.draws, ("slow_share",), work.robots))


def _of_sensor(work: _Work) -> _Part:
    if work.base.sensor.model == "acceleration":
        return _Part({})
    found = fit_sensor(work.found, **work.of_errors)
    # A spread field must be positive, and is absent without a spread.
    fields = {
        f"sensor.{name}": value if name not in SPREADS or value > 0 else None
        for name, value in found.rounded(found.values).items()
    }
    return _Part(fields, _estimates("sensor.", found.values, found.draws, LAWS, work.robots))


def _of_interruption(work: _Work) -> _Part:
    beyond = avoidance_beyond(work.found, work.base)
    return _Part({"sample.interrupts_avoidance": beyond < INTERRUPTED_BELOW})


def _of_rays(work: _Work) -> _Part:
    found = fit_rays(work.found, work.base, **work.of_errors)
    # Without an own start of each robot's rays, ``fit_avoidance`` fits the rays.
    fields = {"rays.forward_each_m": None} | found.fields(work.base)
    return _Part(fields, _estimates("", found.values, found.draws))


def _of_stop(work: _Work) -> _Part:
    stop_ms = stop_of(work.found, work.base)
    return _Part({} if stop_ms is None else {"sample.stop_ms": stop_ms})


def _of_loss(work: _Work) -> _Part:
    found = fit_loss(work.found)
    if found is None:
        return _Part({})
    return _Part({"network.name": "loss", "network.loss.share": round(found.value, DIGITS)}, [found])


def avoidance_beyond(found: Dataset, base: Scenario) -> float:
    """Return how often avoidance takes longer than the sample interval, as a share of the intervals with avoidance.

    This shows whether samples interrupt avoidance: the sampling timer runs on during avoidance, so a robot that
    interrupts avoidance to sample hardly ever avoids for longer than the sample interval. The share is computed for
    each robot in each session, and averaged; it is 0 without any avoidance.
    """
    limit_s = base.sample.sample_interval_ms / 1000.0 + 0.06  # with a margin of three ticks of 20 ms
    avoided = found.samples.filter(pl.col("avoid_s") > 1e-9).group_by("run", "robot", maintain_order=True)
    shares = avoided.agg(beyond=(pl.col("avoid_s") > limit_s).mean())["beyond"].to_numpy()
    return float(shares.mean()) if shares.size else 0.0


def stop_of(found: Dataset, base: Scenario) -> float | None:
    """Return the duration of a stop, ms, as a multiple of the control period; None if it cannot be estimated.

    The time between two samples, without avoidance or turn, is the drive (``fit_drive.timed_drive_ms``), the stop and
    a control period. At least 50 such times are needed. The result is also None unless the stop is between half and
    twice the stop of the base: otherwise the robots were programmed with another tau than the base.
    """
    calm = calm_intervals(found.samples)["spacing_s"]
    if calm.len() < 50:
        return None
    usual = float(calm.mean())  # type: ignore[arg-type]  # to polars a mean may be of dates too
    period = base.run.control_period_ms
    stop_ms = 1000.0 * usual - timed_drive_ms(base) - period
    rounded = period * round(stop_ms / period)
    base_stop_ms = max(base.sample.stop_ms, 1.0)  # at least 1 ms, to divide by it
    return float(rounded) if 0.5 < rounded / base_stop_ms < 2.0 else None


def fit_loss(found: Dataset) -> Fitted | None:
    """Return the share of messages lost on their way, over all sessions, with an interval from the sessions' scatter.

    Sessions are weighted by the number of their messages. The error is that of the unweighted mean over sessions, the
    interval is the share -+ so many errors as Student's law has for these sessions, but not below 0, and both are NaN
    with one session. The result is None if no session's log counts the received messages.
    """
    known = found.exchange.drop_nulls("packet_loss")  # the sessions whose loss is known
    if known.height == 0:
        return None
    shares = known["packet_loss"].to_numpy()
    weights = known["addressed"].to_numpy().astype(float)
    # A session's share is below 0 if it received more messages than are counted as addressed; the estimate is not.
    value = max(float(weights @ shares / weights.sum()), 0.0)
    error = float(shares.std(ddof=1)) / math.sqrt(shares.size) if shares.size > 1 else math.nan
    half = float(stdtrit(max(shares.size - 1, 1), 0.975)) * error
    return Fitted("network.loss.share", value, error, max(value - half, 0.0), value + half)


def _estimates(
    section: str,
    values: Mapping[str, float],
    draws: Mapping[str, Floats],
    resampled: Collection[str] = (),
    groups: int = 0,
) -> list[Fitted]:
    """Return estimates with standard errors and 95 % intervals from their draws, (draws,) each.

    Args:
        section: begins their names: of the scenario if they are its fields, else empty.
        resampled: names of those whose draws are a bootstrap of so many ``groups``.
    Returns:
        Those that have draws.
    """
    figures = []
    for name, value in values.items():
        if not draws[name].size:
            continue
        own = draws[name]
        low, high = limits_of_bootstrap(own, groups) if name in resampled else limits_of(own)
        error = float(draws[name].std(ddof=1))
        figures.append(Fitted(f"{section}{name}", value, error, float(low), float(high)))
    return figures


def _of_avoidance(work: _Work) -> _Part:
    """Fit avoidance by simulations with all other fields fitted; estimates are posterior means.

    The posterior is a weighted sample, so the quantiles are interpolated on the cumulative weights.
    """
    fitted = _fitted(work.base, work.fields)
    found = work.avoidance = fit_avoidance(
        work.found, fitted, work.speed_m_s, candidates=work.candidates, progress=work.progress
    )
    figures = []
    for name, draws in found.draws.items():
        mean = float(found.weights @ draws)
        order = np.argsort(draws)
        low, high = np.interp([0.025, 0.975], np.cumsum(found.weights[order]), draws[order])
        error = math.sqrt(float(found.weights @ (draws - mean) ** 2))
        figures.append(Fitted(name, mean, error, float(low), float(high)))
    return _Part(fields_of(found.values, fitted, work.speed_m_s), figures)


FITS: Final = (
    Source(
        "camera", ("camera.",), "all samples: where energies change", "bootstrap over robots in sessions",
        _of_camera,
    ),
    Source(
        "driving",
        (
            "robot.speed_factor_shape", "robot.speed_factor_scale", "robot.speed_factor_location",
            "robot.speed_factor_min", "robot.speed_factor_max", "robot.speed_factors", "robot.speed_redraw",
            "robot.speed_wander", "robot.speed_run_spread", "robot.battery_life_s", "robot.misalignment_min",
            "robot.misalignment_max", "robot.misalignments", "robot.misalignment_wander",
            "robot.misalignment_drift", "robot.misalignment_run_spread",
        ),
        "undisturbed: the robot only drove",
        "t and chi-square of the robots; of the slow share of veers, bootstrap over robots in sessions", _of_drive,
    ),
    Source(
        "laws of energy", tuple(f"sensor.{name}" for name in (*LAWS, *SPREADS)), "all samples",
        "bootstrap over robots in sessions, with the error of the mean factor; of spreads, chi-square of the groups",
        _of_sensor,
    ),
    Source(
        "interruption", ("sample.interrupts_avoidance",), "with avoidance", "none: yes or no", _of_interruption
    ),
    Source(
        "rays", ("rays.angle_deg", "rays.forward_m", "rays.forward_each_m", "walk.turn_max_deg"),
        "with a turn away from a wall, or at the end of a leg",
        "bootstrap of the approaches of each robot, and of turns; of the spread of robots, chi-square", _of_rays,
    ),
    Source(
        "stop", ("sample.stop_ms",), "without avoidance or turn", "none: whole control periods", _of_stop
    ),
    Source(
        "losses", ("network.name", "network.loss.share"), "none: counted messages", "scatter of sessions",
        _of_loss,
    ),
    Source(
        "avoidance",
        (
            "robot.turn_track_m", "walk.turn_gain_percent_per_deg", "walk.blind_after_turn_ms", "walk.leg_max_ms",
            "robot.body_radius_m", "rays.disc_radius_m", "walk.avoidance_threshold_mm", "rays.angle_deg",
        ),
        "all, compared with 4,000 simulated runs", "posterior sample, checked with 40 more runs", _of_avoidance,
    ),
)  # fmt: skip
"""The fits in their order: the table of docs/calibration.md."""


TAU: Final = "sample.sample_interval_ms"
"""The setting that is inferred from recordings, and with which the robots of the base must run too."""
AROUND: Final = ("swarm.robots", "arena.width_m", "arena.height_m")
"""What decides how often robots meet each other and walls."""


def contradictions(results: Sequence[Result], base: Scenario) -> list[str]:
    """Return sentences about the base: settings that recordings contradict, and ``other_robots``.

    Of settings, only those of the walk count that determine what robots meet (``AROUND``) and when they sample
    (``TAU``): others are the user's choice.
    """
    found = []
    for name in AROUND:
        there = sorted({result.scenario[name] for result in results})
        if len(there) == 1 and there[0] != base[name]:
            found.append(_differs(name, base[name], there[0]))
        elif there and base[name] not in there:
            found.append(
                f"{name} is {base[name]} in the base, but {listed(map(str, there))} in the recordings."
            )
    inferred = [one for result in results for one in getattr(result, "inferred", ()) if one["name"] == TAU]
    for one in inferred:
        if one["value"] is not None and not one["low"] <= base[TAU] <= one["high"]:
            found.append(_differs(TAU, base[TAU], one["value"]))
            break
    return found + other_robots(base)


def _differs(name: str, own: object, other: object) -> str:
    return f"{name} is {own} in the base, but {other} in the recordings; add --set {name}={other}."


def other_robots(base: Scenario) -> list[str]:
    """Return a sentence if robots of the base are of another kind than those for which avoidance can be fitted."""
    outermost_deg = max(abs(angle_deg) for angle_deg in base.rays.angle_deg)
    searched = {
        "robot.body_radius_m": (base.robot.body_radius_m, *PRIOR["radius_m"]),
        "rays.disc_radius_m": (base.rays.disc_radius_m, *PRIOR["seen_m"]),
        "outermost of rays.angle_deg": (outermost_deg, 0.0, float(GRID_DEG[-1])),
    }
    beyond = [
        f"{name} {stated(value)}, searched from {stated(low)} to {stated(high)}"
        for name, (value, low, high) in searched.items()
        if not low <= value <= high
    ]
    if not beyond:
        return []
    return [
        f"Avoidance is fitted to robots of another kind than those of the base ({'; '.join(beyond)}); replace "
        "[rays], [walk], robot.body_radius_m and robot.turn_track_m of the fitted scenario by those of the base."
    ]
