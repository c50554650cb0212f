"""Any parameters against any others: paired on fresh runs, and once more on other seeds.

Run r of both has the same motion (where they move alike), floor and noise, so that luck is the same for both. A second
block of seeds has to bear the difference out.
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
from vibroswarm.errors import InputError
from vibroswarm.inference.cost_outcomes import Outcomes
from vibroswarm.inference.outcomes import Array
from vibroswarm.optimize.evaluate import derived_seed, figures_of
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.truth import Scored, after, paired_score, scored_of
from vibroswarm.presets import preset, preset_names
from vibroswarm.scenario import Scenario
from vibroswarm.study.executors import Workers, workers_for

FIGURES: Final = ("decision_time_s", "right_share", "wrong_share", "undecided_share")
"""What else is compared, run by run."""


@dataclass(frozen=True)
class Checked:
    """Two scenarios under one objective."""

    objective: Objective
    first: Scored
    second: Scored
    difference: Interval
    """Score of the first less that of the second."""
    again: Interval
    """The same on other seeds."""
    figures: tuple[Paired, ...] = ()

    @property
    def confirmed(self) -> bool:
        """Whether both blocks of seeds say the same."""
        return side(self.difference) != 0 and side(self.difference) == side(self.again)

    @property
    def says(self) -> str:
        """What may be said, and no more."""
        if self.confirmed:
            better = self.first.name if side(self.difference) < 0 else self.second.name
            return f"{better} is better, in both blocks of seeds."
        if side(self.difference):
            return "The second block of seeds does not bear the difference out."
        return "They are not told apart, which is not equal."

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "objective": self.objective.as_values(),
            "first": self.first.as_dict(),
            "second": self.second.as_dict(),
            "difference": self.difference.as_dict(),
            "again": self.again.as_dict(),
            "confirmed": self.confirmed,
            "says": self.says,
            "figures": [paired.as_dict() for paired in self.figures],
        }


def scenario_named(text: str, field: str) -> Scenario:
    """A scenario by preset or file.

    Raises:
        InputError: neither is there.
    """
    if text in preset_names():
        return preset(text)
    if not Path(text).is_file():
        raise InputError(
            f"'{text}' is no file and no preset (there are {', '.join(preset_names())})", field=field
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
    tell: Callable[[int], None] = lambda done: None,
) -> Checked:
    """Score two scenarios on fresh runs, twice; the runs are none that a search with this seed was made on.

    Args:
        first, second: what is scored; names: what they are called. objective: without, the paper's cost.
        runs: of each, in each block. executor, workers: see ``study.executors``. tell: called as runs come back.
        cases: fields that are set in both, once for each case: several floors, say. The objective says whether the
            worst counts; the figures are means over cases.
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
    with workers_for(executor, workers) as hands:
        for purpose in ("check", "second check"):
            at, told = derived_seed(seed, purpose), 2 * len(blocks) * runs
            blocks.append(
                [
                    _block(name, scenarios, objective, runs, at, hands, after(tell, told + k * runs))
                    for k, (name, scenarios) in enumerate(both)
                ]
            )
    ((one, of_one), (two, of_two)), ((one_again, _), (two_again, _)) = blocks
    return Checked(
        objective,
        one,
        two,
        paired_score(objective, one, two),
        paired_score(objective, one_again, two_again),
        compare(of_one, of_two, FIGURES),
    )


def shares(outcomes: Outcomes) -> Array:
    """Mean over robots, in the order of ``FIGURES``."""
    parts = (outcomes.time_s, outcomes.right, outcomes.wrong, outcomes.undecided)
    return np.column_stack([part.mean(axis=1) for part in parts])


SHARES: Final = Objective("shares", function=shares)


def _block(
    name: str,
    scenarios: Sequence[Scenario],
    objective: Objective,
    runs: int,
    seed: int,
    hands: Workers,
    tell: Callable[[int], None],
) -> tuple[Scored, pl.DataFrame]:
    """One scenario on one block of seeds: its score, and the figures of its runs."""
    many = figures_of(scenarios, {}, (objective, SHARES), runs, seed, hands, tell=tell)
    rows = many.rows[:, :, : -len(FIGURES)]
    figures = {name: many.rows[:, :, k - len(FIGURES)].mean(axis=1) for k, name in enumerate(FIGURES)}
    return scored_of(name, {}, objective, rows, many.runs, many.failed), pl.DataFrame(
        {"run": many.runs, **figures}
    )
