"""Compare strategies at equal error: what each reaches with other settings, in the same runs.

See ``analysis.forced_error`` for the method. A strategy's points are the cells of one study, which share motion and
readings.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from vibroswarm.analysis.forced_error import FEWEST, MatchedError, Reached, matched_error, settings_of
from vibroswarm.core.numbers import count
from vibroswarm.errors import InputError, RunError
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import steers
from vibroswarm.study.cell_comparison import Compared
from vibroswarm.study.run import run
from vibroswarm.study.spec import Cell, Study
from vibroswarm.study.study_result import StudyResult

MATCHED_CELLS: Final = 60
"""With more cells nothing is compared at equal error."""
MATCHED_RUNS: Final = 1000
"""Most runs of a cell that are replayed with each setting."""
MATCHED_ROBOTS: Final = 5000
"""Most robots, summed over these runs; but ``FEWEST`` runs are replayed even if they have more robots."""
LEAST_RUNS: Final = 20
"""With fewer runs in common nothing is compared at equal error."""
ENGINES: Final = ("event", "fixed-step")
"""Sources of motion whose studies are compared at equal error: both give the motion of ``event``, which is replayed."""


def pairs_at_equal_error(
    result: StudyResult, compared: Sequence[Compared]
) -> dict[tuple[int, int], tuple[Cell, Cell]]:
    """Return the pairs of cells that can be compared at equal error, by the numbers of cell and reference.

    These are cells with different strategies. Strategies that steer are left out, since their motion changes with the
    settings. There are no pairs if the cells are more than ``MATCHED_CELLS``, if one has fewer than ``LEAST_RUNS``
    runs, or if the study's source of motion is not one of ``ENGINES``.

    Args:
        compared: result of ``comparisons``.
    """
    pairs = _comparable(compared)
    return {} if _why_none(result, pairs) else pairs


def _comparable(compared: Sequence[Compared]) -> dict[tuple[int, int], tuple[Cell, Cell]]:
    """Return the pairs of different strategies that do not steer, by the numbers of their cells."""
    pairs = ((one.cell, one.reference) for one in compared)
    return {
        (one.number, other.number): (one, other)
        for one, other in pairs
        if one.scenario.strategy.name != other.scenario.strategy.name
        and not steers(one.scenario)
        and not steers(other.scenario)
    }


def _why_none(result: StudyResult, pairs: Mapping[tuple[int, int], tuple[Cell, Cell]]) -> str:
    """Return why none of some pairs can be compared at equal error; empty if they can."""
    if not pairs:
        return "no two strategies are compared whose motion can be shared"
    if result.study.motion not in ENGINES:  # settings are replayed on the motion of ``event``
        return f"the motion of '{result.study.motion}' is not simulated again"
    cells = {cell.number: cell for pair in pairs.values() for cell in pair}
    if len(cells) > MATCHED_CELLS:
        return f"{count(len(cells), 'cell')} are more than {MATCHED_CELLS}; vary fewer values in one study"
    runs = min(_runs(result, cell) for cell in cells.values())
    if runs < LEAST_RUNS:
        return f"it takes {LEAST_RUNS} successive runs of each cell, from run 0, and {count(runs, 'run')} can be used"
    return ""


def why_not_at_equal_error(
    result: StudyResult, compared: Sequence[Compared], matched: Mapping[tuple[int, int], MatchedError]
) -> str:
    """Return what is not compared at equal error, and why, in a sentence; empty if all pairs of strategies are.

    Args:
        compared: result of ``comparisons``. matched: result of ``at_equal_error``.
    """
    pairs = _comparable(compared)
    of_some = (
        "with other settings the strategy that errs less does the same (give `vibroswarm league --vary` its own "
        "parameters), a scenario is refused, or a run has no right decision"
    )
    why = _why_none(result, pairs) or of_some
    if not matched:
        return f"nothing is compared at equal error: {why}."
    missing = count(len(pairs) - len(matched), "pair")
    return f"{missing} not compared at equal error: {why}." if len(matched) < len(pairs) else ""


def at_equal_error(
    result: StudyResult, compared: Sequence[Compared], progress: Callable[[float], None] = lambda share: None
) -> dict[tuple[int, int], MatchedError]:
    """Compare pairs of cells with different strategies at equal error, by runs with other settings.

    A cell is left out if neither decision is right in one of its runs, or if its scenario cannot be run; a pair, if no
    setting changes what the strategy that errs less does.

    Args:
        compared: result of ``comparisons``. progress: called after cells were replayed, with the share of cells done.
    Returns: the comparison of each other pair of ``pairs_at_equal_error``, by the numbers of cell and reference.
    """
    pairs = pairs_at_equal_error(result, compared)
    cells = {cell.number: cell for pair in pairs.values() for cell in pair}
    if not pairs:
        return {}
    runs = min(_runs(result, cell) for cell in cells.values())
    found = _reached(list(cells.values()), result.study.seed, runs, progress)
    matched = {
        (cell, reference): matched_error(found[cell], found[reference])
        for cell, reference in pairs
        if cell in found and reference in found
    }
    # ``pair[one.of_first]`` errs less, and has to have settings at which it errs as often as the other.
    return {pair: one for pair, one in matched.items() if not found[pair[one.of_first]].is_fixed}


def _reached(
    cells: Sequence[Cell], seed: int, runs: int, progress: Callable[[float], None] = lambda share: None
) -> dict[int, Reached]:
    """Return what cells reach, by number; cells that cannot be run with other settings are left out.

    Args:
        seed, runs: of the study of the points. progress: called with the share of the runs done.
    """
    try:
        scenarios = [cell.scenario for cell in cells]
        found = reached(scenarios, seed, runs, progress=lambda now: progress(now.share))
    except (InputError, RunError):
        if len(cells) == 1:  # the scenario cannot be run, or neither decision is right in a run
            return {}
        return {k: one for cell in cells for k, one in _reached([cell], seed, runs).items()}
    return {cell.number: one for cell, one in zip(cells, found, strict=True)}


def reached(scenarios: Sequence[Scenario], seed: int, runs: int, **how: Any) -> list[Reached]:
    """Run scenarios as given and with each combination of their strategy's settings (``settings_of``).

    All points go to t_end, whenever their robots decide, and share motion and readings where they can.

    Args:
        scenarios: at least one. seed: of the runs. runs: their number.
        how: further arguments of ``study.run.run``, such as workers.
    Returns: times and errors of each scenario's points in each run; point 0 is the scenario as given.
    Raises:
        InputError: one of them cannot be run, or in some run neither decision is right. RunError: runs failed.
    """
    points = [settings_of(scenario) for scenario in scenarios]
    labelled = {f"{k} {j}": point for k, of_one in enumerate(points) for j, point in enumerate(of_one)}
    figures = run(Study.of_scenarios(labelled, runs, seed), **how).by_run(("decision_time_s", "forced_error"))
    time_s, error = figures.values()
    if np.isnan(error).any():
        raise InputError(
            "in some runs neither decision is right; give fill ratios off the boundary", field="floor"
        )
    ends = np.cumsum([len(of_one) for of_one in points])
    return [
        Reached(time_s[end - len(of_one) : end], error[end - len(of_one) : end])
        for of_one, end in zip(points, ends, strict=True)
    ]


def _runs(result: StudyResult, cell: Cell) -> int:
    """Return how many runs of a cell, from run 0, are run with other settings: those stored, up to the limits."""
    most = min(MATCHED_RUNS, max(MATCHED_ROBOTS // cell.scenario.swarm.robots, FEWEST))
    there = result.runs_there(cell.number, most)
    return next((k for k, number in enumerate(there) if k != number), len(there))
