"""Checks of every sensor, by its default parameters, each a function that yields what is wrong, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import SensorModel, sensor
from vibroswarm.testing.runs import Check, Finding, run_checks

U: Final = (np.arange(20_000) + 0.5) / 20_000
"""Uniform numbers at which sensors are tried."""
MARGIN: Final = 2.0 / U.size
"""How far the share of numbers of ``U`` that read as a class may be from the true share."""


def check_sensor(name: str) -> list[Finding]:
    """Run all checks of a registered sensor, and return their findings in order."""
    return run_checks(CHECKS, name)


def _model_and_params(name: str) -> tuple[SensorModel, Any]:
    """Return a sensor and its default parameters. Energies to draw from, which have no default, are made up."""
    energies = {"vibrating_energies": (1.0, 2.0, 3.0), "still_energies": (0.2, 0.8, 1.5)}
    model = sensor(name)
    section = Scenario().sensor.model_copy(update={"model": name} | energies)
    # ``params`` also gives a table the threshold of the section, if the sensor has one.
    return model, section if model.in_section else Scenario.model_construct(sensor=section).sensor.params


def _kinds(name: str) -> Iterator[tuple[SensorModel, Any, int]]:
    model, p = _model_and_params(name)
    for kind in range(model.number_of("kinds", p)):
        yield model, p, kind


def _values(model: SensorModel, kind: int, p: Any) -> NDArray[np.float64]:
    """Return what samples on a kind of tile measure: at ``U``, or at reference places."""
    return model.values(kind, U, p) if model.sense is None else model.reference_values(p)[kind]


def _readings(name: str) -> Iterator[str]:
    for model, p, kind in _kinds(name):
        falls = np.diff(model.classes(_values(model, kind, p), p)) < 0
        if model.sense is None and falls.any():
            yield f"on kind {kind} a reading falls as u grows"


def _same_again(name: str) -> Iterator[str]:
    """Check that equal numbers give equal values and readings, in parts and in another order."""
    for model, p, kind in _kinds(name):
        values = _values(model, kind, p)
        again = values if model.sense else _in_parts(partial(model.values, kind, p=p), U)[::-1]
        classes = _in_parts(partial(model.classes, p=p), values)[::-1]
        if not (np.array_equal(again, values) and np.array_equal(classes, model.classes(values, p))):
            yield f"on kind {kind} values or readings depend on what else is measured"


def _in_parts(function: Callable[[NDArray[Any]], NDArray[Any]], values: NDArray[Any]) -> NDArray[Any]:
    """Return what a function of values gives from the last to the first, called for a part of them at a time."""
    cuts = range(1, len(values), 199)  # the first part is a single value
    parts = np.split(values[::-1], cuts)
    return np.concatenate([function(np.ascontiguousarray(part)) for part in parts])


def _shares(name: str) -> Iterator[str]:
    for model, p, kind in _kinds(name):
        classes = model.classes(_values(model, kind, p), p)
        measured = [(classes <= j).mean() for j in range(model.number_of("readings", p) - 1)]
        shares = _shares_up_to(model, kind, p)
        if np.abs(shares - measured).max() > MARGIN:
            yield f"on kind {kind} shares {shares} are stated for classes up to each, and {measured} are measured"


def _shares_up_to(model: SensorModel, kind: int, p: Any) -> NDArray[np.float64]:
    if model.share_at_most is not None:
        return np.atleast_1d(model.share_at_most(kind, np.asarray(p.rms_threshold), p))
    return np.asarray(model.shares_up_to(kind, np.ones(1), p)[0])


def _likelihoods(name: str) -> Iterator[str]:
    for (model, p, kind), (*_, measured_on) in product(_kinds(name), _kinds(name)):
        values = _values(model, measured_on, p)
        if model.likelihood is not None and np.isinf(model.densities(kind, values, p)).any():
            yield f"the likelihood of kind {kind} is infinite for values on kind {measured_on}"


# Names of the checks, as ``vibroswarm check`` prints them.
CHECKS: Final[dict[str, Check]] = {
    "readings are classes that never fall as u grows": _readings,
    "the same again for the same numbers": _same_again,
    "classes are as frequent as it states": _shares,
    "likelihoods are densities": _likelihoods,
}
"""All checks of a sensor, in order, by what each requires."""
