"""Checks of every task."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from vibroswarm.errors import shown
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import NAMES, pattern
from vibroswarm.inference.outcomes import truth_on
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.testing.runs import Finding, run_checks

SIZES: Final = ((1, 1), (5, 5), (10, 10), (3, 7))
"""Rows and columns of random floors."""
SHARES: Final = (0.2, 0.45, 0.55, 0.8)
"""Shares of tiles that vibrate."""


def check_task(name: str) -> list[Finding]:
    """Run all checks of a registered task.

    Args:
        name: as scenarios call it.
    """
    return run_checks(CHECKS, name, WARNINGS_ONLY)


def floors(scenario: Scenario) -> dict[str, Floor]:
    """Return new floors over the whole arena, by description: patterns, random ones, all still, all vibrating."""
    tiles = {name: pattern(name) for name in NAMES}
    for rows, columns in SIZES:
        size = f"{rows} x {columns}"
        for k, share in enumerate(SHARES):
            drawn = np.random.default_rng([rows, columns, k]).random((rows, columns)) < share
            tiles[f"{size}, {share:.0%} at random"] = drawn.astype(np.uint8)
        for value, words in ((0, "still"), (1, "vibrating")):
            tiles[f"{size}, all {words}"] = np.full((rows, columns), value, np.uint8)
    arena = scenario.arena
    return {
        words: Floor(grid, arena.width_m / grid.shape[1], arena.height_m / grid.shape[0])
        for words, grid in tiles.items()
    }


def _scenario(name: str) -> Scenario:
    return Scenario().with_values({"task.name": name})


def _answers(name: str) -> Iterator[str]:
    """Check that the task answers 0, 1 or None on all floors."""
    scenario = _scenario(name)
    for words, floor in floors(scenario).items():
        answer = truth_on(scenario, floor)
        if answer not in (0, 1, None):  # ``Task.answer`` refuses it too
            yield f"on the floor {words} it gives {shown(answer)}; 0, 1 or None"


def _same_again(name: str) -> Iterator[str]:
    """Check that the task gives the same answer again."""
    scenario = _scenario(name)
    first = {words: truth_on(scenario, floor) for words, floor in floors(scenario).items()}
    floors_by_name = floors(scenario)
    for words in reversed(floors_by_name):
        # An equal floor, in another order, twice.
        for _ in range(2):
            again = truth_on(scenario, floors_by_name[words])
            if again != first[words]:
                yield f"on the floor {words} it gives {first[words]}, and another time {again}"


def _leaves_floors(name: str) -> Iterator[str]:
    """Check that the task does not change the floors."""
    scenario = _scenario(name)
    for words, floor in floors(scenario).items():
        before, geometry = floor.tiles.copy(), floor.geometry
        truth_on(scenario, floor)
        if not np.array_equal(floor.tiles, before) or floor.geometry != geometry:
            yield f"it changes the floor {words}"


def _tells_floors_apart(name: str) -> Iterator[str]:
    """Yield what is wrong if the right answer is the same on every floor."""
    scenario = _scenario(name)
    answers = {truth_on(scenario, floor) for floor in floors(scenario).values()}
    if len(answers) < 2:
        yield f"it gives {answers.pop()} on every floor"


CHECKS: Final[dict[str, Callable[[str], Iterator[str]]]] = {
    "it gives 0, 1 or None on every floor": _answers,
    "the same again for the same floor": _same_again,
    "it leaves floors as they are": _leaves_floors,
    "it tells floors apart": _tells_floors_apart,
}
WARNINGS_ONLY: Final = ("it tells floors apart",)
"""Checks whose failure is not an error."""
