"""The paper's own numbers, printed or read off its figures, and the columns of the reproduction.

``published.json`` holds the only numbers that were typed in. The columns are presets, each with P* or P0, with or
without a negative control.
"""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any, Final

from vibroswarm.errors import InputError, nearest
from vibroswarm.networks.loss_by_size import MOST
from vibroswarm.scenario.scenario import Scenario, preset

FIELDS: Final = {
    "gamma0_ms": "walk.walk_duration_location_ms",
    "gamma_ms": "walk.walk_duration_scale_ms",
    "tau_ms": "sample.sample_interval_ms",
    "theta_c_mm": "walk.avoidance_threshold_mm",
    "O_c": "decision.min_observations",
}
"""Names of the optimised parameters in the paper, and the fields of a scenario."""


@cache
def _all() -> dict[str, Any]:
    text = files("vibroswarm.paper").joinpath("published.json").read_text(encoding="utf-8")
    values: dict[str, Any] = json.loads(text)
    return values


def published(path: str) -> Any:
    """Return the number or list under a dotted name in ``published.json``, such as ``simulation.fill_ratios``.

    Raises:
        InputError: there is no such name.
    """
    node: Any = _all()
    for name in path.split("."):
        if not isinstance(node, dict) or name not in node:
            raise InputError("is not a number of the paper", field=path)
        node = node[name]
    return node


def parameters(name: str) -> dict[str, Any]:
    """Return the fields set by ``P0`` or ``P_star``."""
    values = zip(published("parameters.names"), published(f"parameters.{name}"), strict=True)
    return {FIELDS[key]: value for key, value in values}


COLUMNS: Final = ("paper", "text", "calibrated")
OPTIMISED, EMPIRICAL = "P*", "P0"
STRATEGIES: Final = ("none", "positive", "soft")

CONTROLS: Final = {
    "labels": "the energies of vibrating and still tiles are swapped, as the paper prints them",
    "threshold": "the sensor's threshold is 1.55, as in Algorithm 2",
    "false-positives": "24 % of the still tiles read as vibrating and 4.5 % of the vibrating ones as still, with the "
    "same total number of errors",
    "standstill": "robots hardly move (a twentieth of their speed, with normal turns) and never avoid",
    "no-messages": "no message arrives",
    "losses": "a tenth of the messages is lost, independently at each receiver",
}
"""Negative controls: changes of every scenario that must change the verdicts."""

RECORDED_ROBOTS: Final = 5
"""In the recordings to which `calibrated` is fitted, its share of lost messages included."""

FALSE: Final = (0.24, 0.045)
"""Rates of false positives and false negatives under the control of that name; both are 14 % in the simulations."""
SLOWER: Final = 0.05

_THRESHOLD: Final = "walk.avoidance_threshold_mm"
_KINDS: Final = ("shape", "scale", "location")


def scenario_of(
    column: str,
    values: dict[str, Any] | None = None,
    *,
    parameter_set: str = OPTIMISED,
    control: str | None = None,
) -> Scenario:
    """Return the scenario of a column.

    Args:
        column: one of ``COLUMNS``; `calibrated` with more robots than were recorded loses messages by swarm size.
        values: fields to set. parameter_set: P* or P0. control: one of ``CONTROLS``.
    """
    base = preset(column)
    changes: dict[str, Any] = {}
    robots = (values or {}).get("swarm.robots", base.swarm.robots)
    if column == "calibrated" and RECORDED_ROBOTS < robots <= MOST and "network.name" not in (values or {}):
        changes["network.name"] = "loss_by_size"
    if parameter_set == EMPIRICAL:
        changes |= parameters("P0")
        # Robots turn at a distance that differs from the commanded one by the same factor for P0 as for P*.
        commanded = parameters("P_star")[_THRESHOLD]
        changes[_THRESHOLD] = float(changes[_THRESHOLD]) * base.walk.avoidance_threshold_mm / commanded
    changes |= values or {}
    if control is not None:
        changes |= _controlled(base.with_values(changes), control)
    return base.with_values(changes)


def _controlled(scenario: Scenario, control: str) -> dict[str, Any]:
    """Return the fields that a negative control sets."""
    if control not in CONTROLS:
        raise InputError(
            f"there is no control '{control}'{nearest(control, CONTROLS)} ({', '.join(CONTROLS)})",
            field="--control",
        )
    match control:
        case "labels":
            return swapped_labels(scenario)
        case "threshold":
            return {"sensor.rms_threshold": 1.55}
        case "false-positives":
            return with_errors(scenario, *FALSE)
        case "standstill":
            return standing(scenario)
        case "no-messages":
            return {"network.name": "loss", "network.loss.share": 1.0}
        case "losses":
            return {"network.name": "loss", "network.loss.share": 0.1}
    raise AssertionError(control)


def standing(scenario: Scenario) -> dict[str, Any]:
    """Return the fields of robots that hardly move: the tracks shrink with the speed, so they turn as before."""
    names = ("full_speed_m_s", "drive_track_m", "turn_track_m")
    slowed = {f"robot.{name}": getattr(scenario.robot, name) * SLOWER for name in names}
    return slowed | {_THRESHOLD: 0.0}


def with_errors(scenario: Scenario, false_positive: float, false_negative: float) -> dict[str, Any]:
    """Return the fields that give the sensor these error rates: both energy distributions are shifted, their shapes
    unchanged."""
    from scipy.stats import gamma

    sensor, changes = scenario.sensor, {}
    for kind, above in (("still", false_positive), ("vibrating", 1.0 - false_negative)):
        shape, scale = (float(getattr(sensor, f"{kind}_{name}")) for name in _KINDS[:2])
        changes[f"sensor.{kind}_location"] = sensor.rms_threshold - float(
            gamma.isf(above, shape, scale=scale)
        )
    return changes


def swapped_labels(scenario: Scenario) -> dict[str, Any]:
    """Return the fields that swap the energies of vibrating and still tiles."""
    sensor = scenario.sensor
    swapped = {f"sensor.vibrating_{kind}": getattr(sensor, f"still_{kind}") for kind in _KINDS}
    return swapped | {f"sensor.still_{kind}": getattr(sensor, f"vibrating_{kind}") for kind in _KINDS}


def fills() -> list[float]:
    """Return the fill ratios of the paper's simulations."""
    return [float(value) for value in published("simulation.fill_ratios")]


def sizes() -> list[int]:
    """Return the swarm sizes of the paper."""
    return [int(value) for value in published("simulation.swarm_sizes")]
