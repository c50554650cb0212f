"""Checks of every sensor, each a function that yields what is wrong, in words; nothing if all is well.

A sensor measures values on each kind of tile, and reads them as classes (``sensors.base``). Checks use its default
parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import combinations, product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.numbers import number, percent
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import SensorModel, sensor
from vibroswarm.sensors.base import REFERENCE_RUNS, REFERENCE_SAMPLES
from vibroswarm.testing.runs import Finding, Pieces, run_checks, same_elsewhere

U: Final = (np.arange(20_000) + 0.5) / 20_000
"""Uniform numbers at which sensors are tried."""
MARGIN: Final = 2.0 / U.size
"""How far the share of numbers of ``U`` that read as a class may be from the true share."""


def check_sensor(name: str) -> list[Finding]:
    """Run all checks of a registered sensor, and return their findings in order.

    Args:
        name: of the sensor, as in scenarios.
    """
    return run_checks(CHECKS, name, WARNINGS_ONLY)


def _model_and_params(name: str) -> tuple[SensorModel, Any]:
    """Return a sensor and its default parameters. Energies to draw from, which have no default, are made up."""
    energies = {"vibrating_energies": (1.0, 2.0, 3.0), "still_energies": (0.2, 0.8, 1.5)}
    model = sensor(name)
    section = Scenario().sensor.model_copy(update={"model": name} | energies)
    # ``params`` also gives a table the threshold of the section, if the sensor has one.
    return model, section if model.in_section else Scenario.model_construct(sensor=section).sensor.params


def _kinds(name: str) -> Iterator[tuple[SensorModel, Any, int]]:
    """Yield a sensor, its parameters and a kind of tile, for each kind."""
    model, p = _model_and_params(name)
    for kind in range(model.number_of("kinds", p)):
        yield model, p, kind


def _values(model: SensorModel, kind: int, p: Any) -> NDArray[np.float64]:
    """Return what samples on a kind of tile measure: at ``U``, or at reference places."""
    return model.values(kind, U, p) if model.sense is None else model.reference_values(p)[kind]


def _numbers_of_kinds(name: str) -> None:
    """Check that there are 2 to 16 kinds of tile, and as many classes.

    ``SensorModel.number_of`` itself raises an error at other numbers, and ``run_check`` reports it.
    """
    model, p = _model_and_params(name)
    model.number_of("kinds", p)
    model.number_of("readings", p)


def _readings(name: str) -> Iterator[str]:
    """Check that values are finite, that readings are classes, and that these never fall as u grows.

    ``SensorModel.values`` and ``classes`` themselves raise an error at other values, and ``run_check`` reports it.
    """
    for model, p, kind in _kinds(name):
        classes = model.classes(_values(model, kind, p), p)
        falls = np.flatnonzero(np.diff(classes) < 0) if model.sense is None else np.empty(0, dtype=np.int64)
        if falls.size:
            place = number(U[falls[0]], digits=4)
            yield f"on kind {kind} the reading falls from {classes[falls[0]]} as u grows beyond {place}"


def _same_again(name: str) -> Iterator[str]:
    """Check that equal numbers give equal values, readings and likelihoods, whatever else is measured beside them.

    They are tried again in parts and in another order. That they are left as they are need not be checked: they are
    read-only.
    """
    for model, p, kind in _kinds(name):
        values = _values(model, kind, p)
        if model.sense is None and not np.array_equal(
            _in_parts(partial(model.values, kind, p=p), U), values[::-1]
        ):
            yield f"on kind {kind} values depend on what else is measured"
        if not np.array_equal(_in_parts(partial(model.classes, p=p), values), model.classes(values, p)[::-1]):
            yield f"on kind {kind} readings depend on what else is measured"
        if model.likelihood is None:
            continue
        whole = model.densities(kind, values, p)
        again = _in_parts(partial(model.densities, kind, p=p), values)
        if not np.allclose(again, whole[::-1], rtol=1e-9, atol=0.0):
            yield f"on kind {kind} likelihoods depend on what else is measured"


def _in_parts(function: Callable[[NDArray[Any]], NDArray[Any]], values: NDArray[Any]) -> NDArray[Any]:
    """Return what a function of values gives from the last to the first, called for a part of them at a time."""
    cuts = range(1, len(values), 199)  # the first part is a single value
    parts = np.split(values[::-1], cuts)
    return np.concatenate([function(np.ascontiguousarray(part)) for part in parts])


def _pieces(name: str) -> Pieces:
    return {f"kind {kind}": partial(_measured, model, kind, p) for model, p, kind in _kinds(name)}


def _measured(model: SensorModel, kind: int, p: Any) -> bytes:
    """Return values and their readings, as they lie in memory."""
    values = _values(model, kind, p)
    return bytes(values.tobytes() + model.classes(values, p).tobytes())


def _shares(name: str) -> Iterator[str]:
    """Check that the shares of classes are those that are measured."""
    for model, p, kind in _kinds(name):
        classes = model.classes(_values(model, kind, p), p)
        measured = [(classes <= j).mean() for j in range(model.number_of("readings", p) - 1)]
        shares = _shares_up_to(model, kind, p)
        if np.abs(shares - measured).max() > MARGIN:
            stated_shares, found = (", ".join(map(percent, one)) for one in (shares, measured))
            yield f"on kind {kind} {stated_shares} is stated for classes up to each, and {found} is measured"


def _shares_up_to(model: SensorModel, kind: int, p: Any) -> NDArray[np.float64]:
    """Return the stated shares of readings up to each class but the last."""
    if model.share_at_most is not None:
        return np.atleast_1d(model.share_at_most(kind, np.asarray(p.rms_threshold), p))
    return np.asarray(model.shares_up_to(kind, np.ones(1), p)[0])


def _likelihoods(name: str) -> Iterator[str]:
    """Check that likelihoods are finite. ``SensorModel.densities`` itself raises an error at what is no density."""
    for (model, p, kind), (*_, measured_on) in product(_kinds(name), _kinds(name)):
        if (
            model.likelihood is not None
            and np.isinf(model.densities(kind, _values(model, measured_on, p), p)).any()
        ):
            yield f"the likelihood of kind {kind} is infinite for values on kind {measured_on}"


def _tells_kinds_apart(name: str) -> Iterator[str]:
    """Check that no two kinds of tile read alike; of ``sense`` by 4 standard errors of the reference samples."""
    shares = [_shares_up_to(model, kind, p) for model, p, kind in _kinds(name)]
    model, _ = _model_and_params(name)
    of_a_kind = REFERENCE_RUNS * REFERENCE_SAMPLES / len(shares)
    margin = 0.0 if model.sense is None else 4.0 * math.sqrt(0.5 / of_a_kind)
    for (other, first), (one, second) in combinations(enumerate(shares), 2):
        if np.abs(first - second).max() <= margin:
            yield f"kinds {other} and {one} read alike"


# Names of the checks, as ``vibroswarm check`` prints them.
CHECKS: Final[dict[str, Callable[[str], Iterator[str] | None]]] = {
    "it has 2 to 16 kinds and classes": _numbers_of_kinds,
    "readings are classes that never fall as u grows": _readings,
    "the same again for the same numbers": _same_again,
    "the same in another process": partial(same_elsewhere, "sensor", _pieces),
    "classes are as frequent as it states": _shares,
    "likelihoods are densities": _likelihoods,
    "it tells kinds of tile apart": _tells_kinds_apart,
}
"""All checks of a sensor, in order, by what each requires."""
WARNINGS_ONLY: Final = ("it tells kinds of tile apart",)
"""Checks whose failure is not an error."""
