"""Compare two scenarios under an objective, paired on fresh runs, and again on runs of another seed.

Run r has the same floor and noise in both scenarios, and the same motion if their settings of motion are equal. So
chance favours neither scenario. The comparison is repeated on a second block of runs with another seed, which has to
confirm the difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.figures import BY_COLUMN
from vibroswarm.analysis.intervals import Interval
from vibroswarm.analysis.paired import Paired, compare, confirms, side
from vibroswarm.errors import InputError, check_kind, whole_number_of
from vibroswarm.inference.outcomes import Array
from vibroswarm.optimize.evaluate import derived_seed, figures_of
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.outcomes import Outcomes
from vibroswarm.optimize.validation import Scored, paired_score, scored_of, shifted_progress
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_scenario, check_seed
from vibroswarm.study.cell_comparison import FIGURES
from vibroswarm.study.executors import Workers, workers_for


@dataclass(frozen=True)
class Checked:
    """The comparison of two scenarios under one objective."""

    objective: Objective
    """Computes the scores."""
    first: Scored
    """Name and score of the first scenario, on the first block of runs; ``values`` is empty."""
    second: Scored
    """Name and score of the second scenario, on the first block of runs; ``values`` is empty."""
    difference: Interval
    """Score of the first scenario minus score of the second, on the first block of runs."""
    replicate: Interval
    """The same difference on the second block of runs."""
    figures: tuple[Paired, ...] = ()
    """Comparisons of the ``FIGURES``, run by run, on the first block."""
    scenarios: tuple[Scenario, ...] = ()
    """The two scenarios, in the first case."""
    seed: int = 1
    """From which the seeds of both blocks are derived."""

    @property
    def confirmed(self) -> bool:
        """Whether both blocks show a significant difference of the same sign."""
        return confirms(self.replicate, self.difference)

    @property
    def says(self) -> str:
        """The conclusion in words; lower scores are better."""
        if self.confirmed:
            better = self.first.name if side(self.difference) < 0 else self.second.name
            return f"{better} is better, in both blocks of seeds."
        if side(self.difference):  # significant, but not in the second block, or with the other sign there
            return "The second block of seeds does not confirm the difference."
        without_limits = math.isinf(self.difference.low) or math.isinf(self.replicate.low)
        few = " Too few runs, or too few that differ, for limits." if without_limits else ""
        return f"No significant difference, which does not mean that they are equal.{few}"


def compare_scenarios(
    first: Scenario,
    second: Scenario,
    objective: Objective | None = None,
    runs: int = 2000,
    seed: int = 1,
    *,
    names: tuple[str, str] = ("first", "second"),
    cases: Sequence[Mapping[str, Any]] = ({},),
    motion: str = "event",
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Checked:
    """Score two scenarios on the same runs, in two blocks of runs.

    The runs differ from those of a search with the same seed, so that a scenario that a search found is not favoured.

    Args:
        first, second: the scenarios. names: of the scenarios, for the result.
        objective: by default the cost of the paper's program. runs: of each scenario in each block.
        seed: from which the seeds of both blocks are derived.
        cases: fields to set in both scenarios, one table for each case, such as several floors; at least one. By
            default there is one case, in which no field is set. The objective decides whether the worst case counts;
            the ``FIGURES`` are means over cases.
        motion: the motion source.
        executor, workers: see ``study.executors``. progress: called as runs finish, with the number done so far.
    Raises:
        InputError: fewer than 2 runs, a wrong seed, no case, a case has a wrong field or value, a cost gives no number
            for a run, or no run of the first block succeeded in both scenarios.
        RunError: all runs of a scenario failed in a block.
    """
    objective = objective or Objective()
    runs, seed = whole_number_of(runs, "runs", 2, 10**9), check_seed(seed)
    check_kind(objective, Objective, "objective", "an Objective")
    cases = list(cases)
    named_cases = [
        (name, _in_cases(scenario, cases)) for name, scenario in zip(names, (first, second), strict=True)
    ]
    # For each block and each scenario, the result of ``_block``.
    blocks: list[list[tuple[Scored, pl.DataFrame]]] = []
    with workers_for(executor, workers) as pool:
        for purpose in ("check", "second check"):
            block_seed = derived_seed(seed, purpose)
            runs_before = 2 * len(blocks) * runs  # those of both scenarios in the blocks before
            blocks.append(
                [
                    _block(
                        name=name,
                        scenarios=scenarios,
                        objective=objective,
                        runs=runs,
                        seed=block_seed,
                        motion=motion,
                        pool=pool,
                        progress=shifted_progress(progress, runs_before + k * runs),
                    )
                    for k, (name, scenarios) in enumerate(named_cases)
                ]
            )
    first_block, second_block = blocks
    (scored_first, figures_first), (scored_second, figures_second) = first_block
    (again_first, _), (again_second, _) = second_block
    return Checked(
        objective=objective,
        first=scored_first,
        second=scored_second,
        difference=paired_score(objective, scored_first, scored_second),
        replicate=paired_score(objective, again_first, again_second),
        figures=compare(figures_first, figures_second, FIGURES),
        scenarios=tuple(of_cases[0] for _, of_cases in named_cases),
        seed=seed,
    )


def _in_cases(scenario: Scenario, cases: Sequence[Mapping[str, Any]]) -> list[Scenario]:
    check_scenario(scenario)
    if not cases:
        raise InputError("is empty; give at least one case, such as {}", field="cases")
    for case in cases:
        check_kind(case, Mapping, "cases", "tables of fields and their values")
    return [scenario.with_values(dict(case)) for case in cases]


def figure_by_run(column: str, outcomes: Outcomes) -> Array:
    """Return a figure of each run, (runs,), by its name in ``figures.run_figures``."""
    return BY_COLUMN[column].of_run(outcomes.swarms)


OF_FIGURES: Final = tuple(Objective(column, function=partial(figure_by_run, column)) for column in FIGURES)
"""The ``FIGURES`` as objectives, so that they are computed in the same simulation as the score."""


def _block(
    name: str,
    scenarios: Sequence[Scenario],
    objective: Objective,
    runs: int,
    seed: int,
    motion: str,
    pool: Workers,
    progress: Callable[[int], None],
) -> tuple[Scored, pl.DataFrame]:
    """Simulate a block of runs of one scenario in its cases.

    Args:
        name: of the scenario. scenarios: the scenario in each case. objective: computes the score.
        runs: number of runs. seed, motion: seed and motion source of the runs. pool: the workers.
        progress: called with the number of finished runs.
    Returns:
        The score, and a table with one row per run that succeeded: its number ``run``, and the ``FIGURES``, averaged
        over the cases.
    """
    no_values: dict[str, Any] = {}  # the scenarios are complete: no fields are set in them
    simulated = figures_of(
        scenarios, no_values, (objective, *OF_FIGURES), runs, seed, pool, motion=motion, progress=progress
    )
    # ``OF_FIGURES`` have the last columns, one each; all columns before them, one or several, are of ``objective``.
    rows, share_rows = simulated.rows[:, :, : -len(FIGURES)], simulated.rows[:, :, -len(FIGURES) :]
    figures = {figure: share_rows[:, :, k].mean(axis=1) for k, figure in enumerate(FIGURES)}
    scored = scored_of(name, no_values, objective, rows, simulated.runs, simulated.failed)
    return scored, pl.DataFrame({"run": simulated.runs, **figures})
