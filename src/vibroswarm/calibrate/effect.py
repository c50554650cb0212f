"""Measure the effect of simulating with other robots: two scenarios on the same floors, for each strategy.

Runs with the same number have the same floor and the same noise in both scenarios, and form a pair. All runs are
repeated with the next seed (fresh motion, fresh floors), and only a difference that both seeds show is confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from vibroswarm.analysis.figures import BY_COLUMN
from vibroswarm.analysis.intervals import Interval
from vibroswarm.analysis.paired import COMPARED, ESTIMATED, Confirmation, compare, confirmed
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.inference.outcomes import CONSENSUS
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import MAX_RUNS
from vibroswarm.study.run import run
from vibroswarm.study.runner import StudyProgress
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult

STRATEGIES: Final = ("none", "positive", "soft")
"""Strategies that are compared by default."""


@dataclass(frozen=True)
class Effect(NotebookView):
    """Effect of changing from the first scenario to the second, under one strategy."""

    strategy: str
    figures: tuple[dict[str, Interval], dict[str, Interval]]
    """Mean of each figure over runs with the first seed, in the first and the second scenario.

    The figures are those of ``paired.COMPARED``, or of ``paired.ESTIMATED`` where the task asks for a number.
    """
    consensus: tuple[dict[str, float], dict[str, float]]
    """Share of runs with each consensus outcome with the first seed, in the first and the second scenario."""
    differences: tuple[Confirmation, ...]
    """Difference of each figure, second minus first scenario, and whether the second seed confirms it."""
    scenarios: tuple[Scenario, Scenario]
    names: tuple[str, str] = ("first", "second")
    """Of the scenarios."""


def effects(
    first: Scenario,
    second: Scenario,
    runs: int,
    seed: int = 1,
    strategies: Sequence[str] = STRATEGIES,
    progress: Callable[[float], None] | None = None,
    names: tuple[str, str] = ("first", "second"),
) -> list[Effect]:
    """Estimate the effect of changing from the first scenario to the second, under each strategy.

    The strategies share the motion of each scenario.

    Args:
        first, second: the scenarios to compare. Both must have the same ``run.t_end_s``, the decision time of robots
            that do not decide. Their own strategies do not matter.
        runs: number of runs for each scenario and seed.
        seed: the seed of the estimates; ``seed`` + 1 is used to confirm the differences.
        strategies: names of the strategies.
        progress: called with the share of the work that is done, 0 to 1. names: of the scenarios, for documents.
    Returns:
        One effect per strategy, in the order of ``strategies``.
    Raises:
        InputError: ``runs`` is not a whole number from 1, the scenarios have different ``run.t_end_s``, the task of one
            alone asks for a number, or one cannot be simulated.
        RunError: runs failed.
    """
    runs = whole_number_of(runs, "runs", 1, MAX_RUNS)
    if first.run.t_end_s != second.run.t_end_s:
        raise InputError(
            f"{first.run.t_end_s:g} s in the first scenario and {second.run.t_end_s:g} s in the second; decision times "
            "can be compared only if all runs end at the same time",
            field="run.t_end_s",
        )
    if first.task.asks_number != second.task.asks_number:
        raise InputError(
            f"'{first.task.name}' in the first scenario and '{second.task.name}' in the second; decisions cannot be "
            "compared with estimates of a number",
            field="task.name",
        )
    # Each strategy in the first scenario, then each in the second: they share the motion of their scenario.
    cells = {
        f"{place} {name}": scenario.with_values({"strategy.name": name})
        for place, scenario in (("first", first), ("second", second))
        for name in strategies
    }
    blocks = []
    for block in range(2):

        def report(now: StudyProgress, block: int = block) -> None:
            if progress is not None:
                progress((block + now.share) / 2)

        blocks.append(run(Study.of_scenarios(cells, runs, seed + block), progress=report))
    return [
        replace(_effect(name, place, len(strategies), blocks), names=names)
        for place, name in enumerate(strategies)
    ]


def _effect(name: str, place: int, strategies: int, blocks: Sequence[StudyResult]) -> Effect:
    """Compare the two scenarios under one strategy, and confirm the differences with the second seed.

    Args:
        name: name of the strategy. place: its place among the ``strategies``.
        blocks: for each seed, the runs of each strategy in the first scenario, then in the second.
    """
    cells = [blocks[0].study.cells[place + strategies * second] for second in range(2)]
    t_end_s = cells[0].scenario.run.t_end_s
    names = ESTIMATED if cells[0].scenario.task.asks_number else COMPARED
    tables = [[block.figures(cell.number) for cell in cells] for block in blocks]
    # One comparison of the two scenarios (second - first) for each seed.
    comparisons = [compare(second, first, names) for first, second in tables]
    # Means and shares of outcomes, for each scenario, are those of the first seed.
    figures = [
        {
            figure: BY_COLUMN[figure].mean(table[figure].drop_nulls().to_numpy(), t_end_s=t_end_s)
            for figure in names
        }
        for table in tables[0]
    ]
    shares = [
        {kind: float((table["consensus"] == kind).mean()) for kind in CONSENSUS}  # type: ignore[arg-type]
        for table in tables[0]
    ]
    return Effect(
        strategy=name,
        figures=(figures[0], figures[1]),
        consensus=(shares[0], shares[1]),
        scenarios=(cells[0].scenario, cells[1].scenario),
        # The comparisons of both seeds list the figures in the same order.
        differences=tuple(
            confirmed(difference, repeated) for difference, repeated in zip(*comparisons, strict=True)
        ),
    )
