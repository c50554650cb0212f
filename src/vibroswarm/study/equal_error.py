"""Replay the cells of a study with other settings, to compare their strategies at equal error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from vibroswarm.analysis.matched_error import MatchedError, Reached, matched_error, reached
from vibroswarm.errors import InputError
from vibroswarm.simulation import steers
from vibroswarm.study.cell_comparison import Compared
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

MATCHED_CELLS: Final = 12
"""With more cells nothing is compared at equal error."""
MATCHED_RUNS: Final = 1000
MATCHED_ROBOTS: Final = 5000
"""Most robots in all runs that are replayed with each setting, unless that is less than 100 runs."""
LEAST_RUNS: Final = 20


def at_equal_error(
    result: StudyResult, compared: Sequence[Compared], progress: Callable[[float], None] | None = None
) -> dict[tuple[int, int], MatchedError]:
    """Compare each pair of cells with different strategies at equal error, by replay with other settings.

    Left out are strategies that steer, cells without enough common runs or a right answer, and studies of more than
    ``MATCHED_CELLS`` such cells.

    Args:
        progress: called with the share done.
    """
    pairs = {
        (one.cell.number, one.reference.number): (one.cell, one.reference)
        for one in compared
        if one.cell.scenario.strategy.name != one.reference.scenario.strategy.name
        and not steers(one.cell.scenario)
        and not steers(one.reference.scenario)
    }
    cells = {cell.number: cell for pair in pairs.values() for cell in pair}
    if len(cells) > MATCHED_CELLS:
        return {}
    runs = {number: _runs(result, cell) for number, cell in cells.items()}
    common = sorted(set.intersection(*map(set, runs.values()))) if runs else []
    if len(common) < LEAST_RUNS:
        return {}
    found: dict[int, Reached] = {}
    for done, (number, cell) in enumerate(cells.items()):
        try:
            found[number] = reached(cell.scenario, result.study.seed, common)
        except InputError:
            continue
        if progress is not None:
            progress((done + 1) / len(cells))
    return {(a, b): matched_error(found[a], found[b]) for a, b in pairs if a in found and b in found}


def _runs(result: StudyResult, cell: Cell) -> list[int]:
    """List the runs of a cell that are replayed."""
    return result.runs_there(
        cell.number, min(MATCHED_RUNS, max(MATCHED_ROBOTS // cell.scenario.swarm.robots, 100))
    )
