"""Checks of every task, on the same floors, and of every sensor, by its default parameters: what is wrong, in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import NAMES, pattern
from vibroswarm.inference.outcomes import fills_and_truth, truth_of_robot
from vibroswarm.scenario.choices import TaskChoice
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.sensors import SensorModel, sensor
from vibroswarm.tasks import task
from vibroswarm.testing.runs import Check, Finding, Pieces, run_checks, same_in_plain_python

SIZES: Final = ((1, 1), (5, 5), (3, 7))
"""Rows and columns of random floors."""
KINDS: Final = 4
"""Number of kinds of tile."""


def check_task(name: str) -> list[Finding]:
    """Run all checks of a registered task, and return their findings in order."""
    return run_checks(TASK_CHECKS, name)


def floors(scenario: Scenario) -> dict[str, Floor]:
    """Return floors that cover the whole arena, by description: all patterns, floors of one kind, and random ones."""
    tiles = {name: pattern(name) for name in NAMES}
    for rows, columns in SIZES:
        for kinds in range(1, KINDS + 1):
            drawn = np.random.default_rng([rows, columns, kinds]).integers(kinds, size=(rows, columns))
            tiles[f"{rows} x {columns}, {kinds} kinds at random"] = drawn.astype(np.uint8)
            tiles[f"{rows} x {columns}, all of kind {kinds - 1}"] = np.full_like(drawn, kinds - 1, np.uint8)
    arena = scenario.arena
    return {
        words: Floor(grid, arena.width_m / grid.shape[1], arena.height_m / grid.shape[0])
        for words, grid in tiles.items()
    }


def _scenario(name: str) -> Scenario:
    sensor = Sensor.model_validate({"model": "confusion", "confusion": {"kinds": KINDS}})
    task_of_name = TaskChoice.model_validate({"name": name})
    return Scenario().model_copy(update={"sensor": sensor, "task": task_of_name})


def given_on(scenario: Scenario, floor: Floor) -> tuple[str, ...]:
    """Return what the scenario's task gives on a floor: the right decision (nan: none), the number, or both."""
    asks, given = task(scenario.task.name), list[float]()
    if not asks.estimated:
        given.append(float(truth_of_robot(scenario, floor, ())[1][0]))
    if asks.estimated or asks.scored is not None:
        given.append(float(fills_and_truth(scenario, {0: floor}, [0])[0][0]))
    return tuple(map(repr, given))  # nan equals itself


def _pieces(name: str) -> Pieces:
    scenario = _scenario(name)
    return {words: partial(given_on, scenario, floor) for words, floor in floors(scenario).items()}


def _same_again(name: str) -> Iterator[str]:
    scenario = _scenario(name)
    first = {words: given_on(scenario, floor) for words, floor in floors(scenario).items()}
    for words, floor in reversed(floors(scenario).items()):
        before = floor.tiles.copy()
        again = [given_on(scenario, floor) for _ in range(2)]
        if again != [first[words]] * 2:
            yield f"on the floor {words} it gives {first[words]}, and later {again}"
        if not np.array_equal(floor.tiles, before):
            yield f"it changes the floor {words}"


# Names of the checks, as ``vibroswarm check`` prints them.
TASK_CHECKS: Final[dict[str, Check]] = {
    "it gives an answer, None, or a number on every floor, and the same again": _same_again,
    "the same in another process, in plain Python": partial(same_in_plain_python, "task", _pieces),
}
"""All checks of a task, in order, by what each requires."""


U: Final = (np.arange(20_000) + 0.5) / 20_000
"""Uniform numbers at which sensors are tried."""
MARGIN: Final = 2.0 / U.size
"""How far the share of numbers of ``U`` that read as a class may be from the true share."""


def check_sensor(name: str) -> list[Finding]:
    """Run all checks of a registered sensor, and return their findings in order."""
    return run_checks(SENSOR_CHECKS, name)


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


def _same_sensor_again(name: str) -> Iterator[str]:
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
SENSOR_CHECKS: Final[dict[str, Check]] = {
    "readings are classes that never fall as u grows": _readings,
    "the same again for the same numbers": _same_sensor_again,
    "classes are as frequent as it states": _shares,
    "likelihoods are densities": _likelihoods,
}
"""All checks of a sensor, in order, by what each requires."""
