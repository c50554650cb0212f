"""Compare two scenarios under an objective, paired on fresh runs, and again on other seeds.

Run r of both has the same motion (if they move alike), floor and noise, so that both have the same luck. A second block
of seeds has to confirm the difference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import Interval
from vibroswarm.analysis.paired import Paired, compare, side
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.inference.outcomes import Array
from vibroswarm.optimize.evaluate import derived_seed, figures_of
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.outcomes import Outcomes
from vibroswarm.optimize.validation import Scored, paired_score, scored_of, shifted_progress
from vibroswarm.scenario.presets import preset_names
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.study.executors import Workers, workers_for

FIGURES: Final = ("decision_time_s", "right_share", "wrong_share", "undecided_share")
"""Figures that are compared as well, run by run."""


@dataclass(frozen=True)
class Checked(NotebookView):
    """The comparison of two scenarios under one objective."""

    objective: Objective
    first: Scored
    second: Scored
    difference: Interval
    """Score of the first minus that of the second."""
    replicate: Interval
    """The same difference on other seeds."""
    figures: tuple[Paired, ...] = ()

    @property
    def confirmed(self) -> bool:
        """Whether both blocks of seeds show a difference of the same sign."""
        return side(self.difference) != 0 and side(self.difference) == side(self.replicate)

    @property
    def says(self) -> str:
        """The conclusion in words."""
        if self.confirmed:
            better = self.first.name if side(self.difference) < 0 else self.second.name
            return f"{better} is better, in both blocks of seeds."
        if side(self.difference):
            return "The second block of seeds does not confirm the difference."
        return "No significant difference, which does not mean that they are equal."

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "objective": self.objective.as_values(),
            "first": self.first.as_dict(),
            "second": self.second.as_dict(),
            "difference": self.difference.as_dict(),
            "again": self.replicate.as_dict(),
            "confirmed": self.confirmed,
            "says": self.says,
            "figures": [paired.as_dict() for paired in self.figures],
        }


def scenario_named(text: str, field: str) -> Scenario:
    """Load a scenario by the name of a preset or a file.

    Raises:
        InputError: neither exists.
    """
    if text in preset_names():
        return preset(text)
    if not Path(text).is_file():
        raise InputError(
            f"'{text}' is neither a file nor a preset (there are {', '.join(preset_names())})", field=field
        )
    return Scenario.read(text)


def compare_scenarios(
    first: Scenario,
    second: Scenario,
    objective: Objective | None = None,
    runs: int = 2000,
    seed: int = 1,
    *,
    names: tuple[str, str] = ("first", "second"),
    cases: Sequence[Mapping[str, Any]] = ({},),
    executor: str | Executor = "threads",
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Checked:
    """Score two scenarios on fresh runs, twice; a search with this seed used other runs.

    Args:
        first, second: the scenarios; names: theirs. objective: by default the paper's cost.
        runs: of each, in each block. executor, workers: see ``study.executors``. progress: called as runs finish.
        cases: fields to set in both, once for each case, such as several floors. The objective decides whether the
            worst case counts; the figures are means over cases.
    Raises:
        InputError: too few runs. RunError: runs failed.
    """
    objective = objective or Objective()
    if runs < 2:
        raise InputError(f"{runs} is too few; at least 2", field="runs")
    both = [
        (name, [scenario.with_values(dict(case)) for case in cases])
        for name, scenario in zip(names, (first, second), strict=True)
    ]
    blocks: list[list[tuple[Scored, pl.DataFrame]]] = []
    with workers_for(executor, workers) as pool:
        for purpose in ("check", "second check"):
            at, runs_before = derived_seed(seed, purpose), 2 * len(blocks) * runs
            blocks.append(
                [
                    _block(
                        name,
                        scenarios,
                        objective,
                        runs,
                        at,
                        pool,
                        shifted_progress(progress, runs_before + k * runs),
                    )
                    for k, (name, scenarios) in enumerate(both)
                ]
            )
    ((score_one, of_one), (score_two, of_two)), ((one_again, _), (two_again, _)) = blocks
    return Checked(
        objective,
        score_one,
        score_two,
        paired_score(objective, score_one, score_two),
        paired_score(objective, one_again, two_again),
        compare(of_one, of_two, FIGURES),
    )


def shares(outcomes: Outcomes) -> Array:
    """Compute means over robots, in the order of ``FIGURES``."""
    parts = (outcomes.time_s, outcomes.right, outcomes.wrong, outcomes.undecided)
    return np.column_stack([part.mean(axis=1) for part in parts])


SHARES: Final = Objective("shares", function=shares)


def _block(
    name: str,
    scenarios: Sequence[Scenario],
    objective: Objective,
    runs: int,
    seed: int,
    pool: Workers,
    progress: Callable[[int], None],
) -> tuple[Scored, pl.DataFrame]:
    """Simulate a scenario on a block of seeds; return its score and the figures of its runs."""
    many = figures_of(scenarios, {}, (objective, SHARES), runs, seed, pool, progress=progress)
    rows = many.rows[:, :, : -len(FIGURES)]
    figures = {name: many.rows[:, :, k - len(FIGURES)].mean(axis=1) for k, name in enumerate(FIGURES)}
    return scored_of(name, {}, objective, rows, many.runs, many.failed), pl.DataFrame(
        {"run": many.runs, **figures}
    )
