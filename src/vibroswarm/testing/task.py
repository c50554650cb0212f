"""Checks of every task, on the same floors of two and four kinds, each a function that yields what is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np

from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import NAMES, pattern
from vibroswarm.inference.outcomes import fills_and_truth, truth_of_robot
from vibroswarm.scenario.choices import TaskChoice
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.tasks import task
from vibroswarm.testing.runs import Check, Finding, Pieces, run_checks, same_in_plain_python

SIZES: Final = ((1, 1), (5, 5), (3, 7))
"""Rows and columns of random floors."""
KINDS: Final = 4
"""Number of kinds of tile."""


def check_task(name: str) -> list[Finding]:
    """Run all checks of a registered task, and return their findings in order."""
    return run_checks(CHECKS, name)


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
CHECKS: Final[dict[str, Check]] = {
    "it gives an answer, None, or a number on every floor, and the same again": _same_again,
    "the same in another process, in plain Python": partial(same_in_plain_python, "task", _pieces),
}
"""All checks of a task, in order, by what each requires."""
