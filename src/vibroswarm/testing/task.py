"""Checks of every task, each a function that yields what is wrong, in words; nothing if all is well.

A task gives the right decision of a floor, such as 0 or 1, or None if no decision is right, or a number, or both. All
checks try the same floors, of two and of four kinds of tile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from vibroswarm.core.numbers import percent
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import NAMES, pattern
from vibroswarm.inference.outcomes import fills_and_truth, truth_of_robot
from vibroswarm.scenario.choices import TaskChoice
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.tasks import task
from vibroswarm.testing.runs import Finding, Pieces, run_checks, same_elsewhere

SIZES: Final = ((1, 1), (5, 5), (10, 10), (3, 7))
"""Rows and columns of random floors."""
SHARES: Final = (0.2, 0.45, 0.55, 0.8)
"""Shares of tiles that vibrate."""
KINDS: Final = 4
"""Number of kinds of tile."""


def check_task(name: str) -> list[Finding]:
    """Run all checks of a registered task, and return their findings in order.

    Args:
        name: of the task, as in scenarios.
    Raises:
        InputError: there is no such task.
    """
    task(name)  # refuses an unknown name
    return run_checks(CHECKS, name, WARNINGS_ONLY)


def floors(scenario: Scenario) -> dict[str, Floor]:
    """Return floors that cover the whole arena, by description; each call makes new but equal floors.

    They are all patterns and, for each size of ``SIZES``, random floors with each share of ``SHARES``, one of all
    kinds, and for each kind a floor of it alone.
    """
    tiles = {name: pattern(name) for name in NAMES}
    for rows, columns in SIZES:
        size = f"{rows} x {columns}"
        for k, share in enumerate(SHARES):
            # The seed is made of size and index of the share, so that a floor does not depend on the other floors.
            drawn = np.random.default_rng([rows, columns, k]).random((rows, columns)) < share
            tiles[f"{size}, {percent(share, 0)} at random"] = drawn.astype(np.uint8)
        for kind in range(KINDS):
            tiles[f"{size}, all of kind {kind}"] = np.full((rows, columns), kind, np.uint8)
        kinds = np.random.default_rng([rows, columns]).integers(KINDS, size=(rows, columns))
        tiles[f"{size}, all kinds at random"] = kinds.astype(np.uint8)
    arena = scenario.arena
    return {
        words: Floor(grid, arena.width_m / grid.shape[1], arena.height_m / grid.shape[0])
        for words, grid in tiles.items()
    }


def _scenario(name: str) -> Scenario:
    """Return the default scenario with the task ``name`` and four kinds of tile.

    No strategy is asked, so it need not be able to answer.
    """
    sensor = Sensor.model_validate({"model": "confusion", "confusion": {"kinds": KINDS}})
    task_of_name = TaskChoice.model_validate({"name": name})
    return Scenario().model_copy(update={"sensor": sensor, "task": task_of_name})


def given_on(scenario: Scenario, floor: Floor) -> Any:
    """Return what the scenario's task gives on a floor: the right decision or the number, or both as a pair.

    Raises:
        CodeError: it gives anything else, or raises an error.
    """
    asks, given = task(scenario.task.name), list[float | None]()
    if not asks.estimated:
        truth = float(truth_of_robot(scenario, floor, ())[1][0])
        given.append(None if math.isnan(truth) else int(truth))
    if asks.estimated or asks.scored is not None:
        given.append(float(fills_and_truth(scenario, {0: floor}, [0])[0][0]))
    return given[0] if len(given) == 1 else tuple(given)


def _pieces(name: str) -> Pieces:
    scenario = _scenario(name)
    return {words: partial(given_on, scenario, floor) for words, floor in floors(scenario).items()}


def _answers(name: str) -> None:
    """Check that the task gives one of its answers, or None, or a number, on all floors.

    ``given_on`` itself raises an error at any other answer (``Task.answer``), and ``run_check`` reports it.
    """
    scenario = _scenario(name)
    for floor in floors(scenario).values():
        given_on(scenario, floor)


def _same_again(name: str) -> Iterator[str]:
    """Check that the task gives the same answer for an equal floor, in another order of floors, and twice in a row."""
    scenario = _scenario(name)
    first = {words: given_on(scenario, floor) for words, floor in floors(scenario).items()}
    floors_by_name = floors(scenario)
    for words in reversed(floors_by_name):
        for _ in range(2):
            again = given_on(scenario, floors_by_name[words])
            if again != first[words]:
                yield f"on the floor {words} it gives {first[words]}, and another time {again}"


def _leaves_floors(name: str) -> Iterator[str]:
    """Check that the task changes neither the tiles nor the geometry of a floor."""
    scenario = _scenario(name)
    for words, floor in floors(scenario).items():
        before, geometry = floor.tiles.copy(), floor.geometry
        given_on(scenario, floor)
        if not np.array_equal(floor.tiles, before) or floor.geometry != geometry:
            yield f"it changes the floor {words}"


def _tells_floors_apart(name: str) -> Iterator[str]:
    """Check that the task does not give the same answer on every floor."""
    scenario = _scenario(name)
    answers = {given_on(scenario, floor) for floor in floors(scenario).values()}
    if len(answers) < 2:
        yield f"it gives {answers.pop()} on every floor"


# Names of the checks, as ``vibroswarm check`` prints them.
CHECKS: Final[dict[str, Callable[[str], Iterator[str] | None]]] = {
    "it gives one of its answers, None, or a number on every floor": _answers,
    "the same again for the same floor": _same_again,
    "the same in another process": partial(same_elsewhere, "task", _pieces),
    "it leaves floors as they are": _leaves_floors,
    "it tells floors apart": _tells_floors_apart,
}
"""All checks of a task, in order, by what each requires."""
WARNINGS_ONLY: Final = ("it tells floors apart",)
"""Checks whose failure is not an error."""
