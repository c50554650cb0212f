"""The columns of the reproduction: the presets, each with P* or P0, and the negative controls."""

from __future__ import annotations

from typing import Any, Final

from vibroswarm.errors import InputError, nearest
from vibroswarm.paper.published import parameters, published
from vibroswarm.presets import preset
from vibroswarm.scenario import Scenario

COLUMNS: Final = ("paper", "text", "calibrated")
OPTIMISED, EMPIRICAL = "P*", "P0"
STRATEGIES: Final = ("none", "positive", "soft")

CONTROLS: Final = {
    "labels": "the energies of vibrating and still tiles are swapped, as the paper prints them",
    "threshold": "the sensor's threshold is 1.55, as Algorithm 2 has it",
    "false-positives": "24 % of the still tiles read as vibrating and 4.5 % of the vibrating ones as still, as many "
    "errors as before together",
    "standstill": "robots hardly leave their place (a twentieth of their speed, turns as ever) and never avoid",
    "no-messages": "no message arrives",
    "losses": "a tenth of the messages is lost, each at each receiver",
}
"""Changes of every scenario with which the verdicts must turn."""

FALSE: Final = (0.24, 0.045)
"""Shares of false positives and negatives under the control of that name; as the simulations ran, both are 14 %."""
SLOWER: Final = 0.05

_THRESHOLD: Final = "walk.avoidance_threshold_mm"
_KINDS: Final = ("shape", "scale", "location")


def scenario_of(
    column: str, values: dict[str, Any] | None = None, *, with_: str = OPTIMISED, control: str | None = None
) -> Scenario:
    """The scenario of a column.

    Args:
        column: of ``COLUMNS``. values: fields to be set. with_: the parameters, P* or P0. control: of ``CONTROLS``.
    """
    base = preset(column)
    found: dict[str, Any] = {}
    if with_ == EMPIRICAL:
        found |= parameters("P0")
        # Robots that turn at another distance than they are told do so for P0 as for P*.
        told = parameters("P_star")[_THRESHOLD]
        found[_THRESHOLD] = float(found[_THRESHOLD]) * base.walk.avoidance_threshold_mm / told
    found |= values or {}
    if control is not None:
        found |= _controlled(base.with_values(found), control)
    return base.with_values(found)


def _controlled(scenario: Scenario, control: str) -> dict[str, Any]:
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
    """The fields by which robots hardly leave their place: as the tracks shrink with the speed, they turn as before."""
    names = ("full_speed_m_s", "drive_track_m", "turn_track_m")
    found = {f"robot.{name}": getattr(scenario.robot, name) * SLOWER for name in names}
    return found | {_THRESHOLD: 0.0}


def with_errors(scenario: Scenario, false_positive: float, false_negative: float) -> dict[str, Any]:
    """The fields by which the sensor errs so often: both distributions of energies are shifted, at their own shapes."""
    from scipy.stats import gamma

    sensor, found = scenario.sensor, {}
    for kind, above in (("still", false_positive), ("vibrating", 1.0 - false_negative)):
        shape, scale = (float(getattr(sensor, f"{kind}_{name}")) for name in _KINDS[:2])
        found[f"sensor.{kind}_location"] = sensor.rms_threshold - float(gamma.isf(above, shape, scale=scale))
    return found


def swapped_labels(scenario: Scenario) -> dict[str, Any]:
    """The fields by which vibrating tiles feel as still ones do, and the other way round."""
    sensor = scenario.sensor
    found = {f"sensor.vibrating_{kind}": getattr(sensor, f"still_{kind}") for kind in _KINDS}
    return found | {f"sensor.still_{kind}": getattr(sensor, f"vibrating_{kind}") for kind in _KINDS}


def fills() -> list[float]:
    """The fill ratios of the paper's simulations."""
    return [float(value) for value in published("simulation.fill_ratios")]


def sizes() -> list[int]:
    """The swarm sizes of the paper."""
    return [int(value) for value in published("simulation.swarm_sizes")]
