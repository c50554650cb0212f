"""Measure the effect of simulating with other robots: two scenarios on the same floors, for each strategy.

Runs with the same number have the same floor and the same noise in both scenarios, and form a pair. All runs are
repeated with the next seed (fresh motion, fresh floors), and only a difference that both seeds show is confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.figures import run_figures
from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.analysis.paired import COMPARED, Confirmation, compare, confirmed
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError, whole_number_of
from vibroswarm.inference.outcomes import CONSENSUS
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import MAX_RUNS, refuse_steering, replay, simulate

STRATEGIES: Final = ("none", "positive", "soft")
"""Strategies that are compared by default."""
BATCH: Final = 100
"""Runs that are simulated at once."""
Tables = tuple[pl.DataFrame, pl.DataFrame]
"""The tables ``robots`` and ``runs`` of a result."""


@dataclass(frozen=True)
class Effect(NotebookView):
    """Effect of changing from the first scenario to the second, under one strategy."""

    strategy: str
    figures: tuple[dict[str, Interval], dict[str, Interval]]
    """Mean of each figure (``paired.COMPARED``) over runs with the first seed, in the first and the second scenario."""
    consensus: tuple[dict[str, float], dict[str, float]]
    """Share of runs with each consensus outcome with the first seed, in the first and the second scenario."""
    differences: tuple[Confirmation, ...]
    """Difference of each figure, second minus first scenario, and whether the second seed confirms it."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; ``figures`` and ``consensus`` list the first and the second scenario."""
        return {
            "strategy": self.strategy,
            "figures": [
                {name: interval.as_dict() for name, interval in figures_of.items()}
                for figures_of in self.figures
            ],
            "consensus": list(self.consensus),
            "differences": [interval.as_dict() for interval in self.differences],
        }


def effects(
    first: Scenario,
    second: Scenario,
    runs: int,
    seed: int = 1,
    strategies: Sequence[str] = STRATEGIES,
    progress: Callable[[float], None] | None = None,
) -> list[Effect]:
    """Estimate the effect of changing from the first scenario to the second, under each strategy.

    The motion of each scenario is simulated once for each seed, and replayed under each strategy.

    Args:
        first, second: the scenarios to compare. Both must have the same ``run.t_end_s``, the decision time of robots
            that do not decide. Their own strategies do not matter, but must not steer.
        runs: number of runs for each scenario and seed.
        seed: the seed of the estimates; ``seed`` + 1 is used to confirm the differences.
        strategies: names of the strategies, none of which steers.
        progress: called with the share of the work that is done, 0 to 1.
    Returns:
        One effect per strategy, in the order of ``strategies``.
    Raises:
        InputError: ``runs`` is not a whole number from 1, the scenarios have different ``run.t_end_s``, a strategy
            steers, a scenario cannot be simulated, or it cannot be replayed (``simulation.replay``) under one of the
            strategies, such as one whose runs stop before t_end.
    """
    runs = whole_number_of(runs, "runs", 1, MAX_RUNS)
    if first.run.t_end_s != second.run.t_end_s:
        raise InputError(
            f"{first.run.t_end_s:g} s in the first scenario and {second.run.t_end_s:g} s in the second; decision times "
            "can be compared only if all runs end at the same time",
            field="run.t_end_s",
        )
    # ``replay`` refuses steering too, but only after the first simulation.
    for scenario in (first, second):
        refuse_steering(scenario)
        for name in strategies:
            refuse_steering(scenario.with_values({"strategy.name": name}))
    blocks = []  # blocks[block][scenario][strategy]: the tables of robots and of runs; block k has the seed seed + k
    done, batches = 0, 4 * -(-runs // BATCH)  # 2 seeds x 2 scenarios; the division rounds up
    for block in range(2):
        cells: list[dict[str, Tables]] = []
        for scenario in (first, second):
            pieces: dict[str, list[Tables]] = {name: [] for name in strategies}
            for start in range(0, runs, BATCH):
                chosen = list(range(start, min(start + BATCH, runs)))
                # The tables of robots and of runs depend on bits, so energies are not kept.
                shared = simulate(scenario, seed + block, chosen, energies=False)
                for name in strategies:
                    replayed = replay(shared, scenario.with_values({"strategy.name": name}))
                    pieces[name].append((replayed.robots, replayed.runs))
                done += 1
                if progress is not None:
                    progress(done / batches)
            cells.append(
                {
                    name: (
                        pl.concat([robots_table for robots_table, _ in parts]),
                        pl.concat([runs_table for _, runs_table in parts]),
                    )
                    for name, parts in pieces.items()
                }
            )
        blocks.append(cells)
    return [_effect(name, blocks, first.run.t_end_s) for name in strategies]


def _effect(name: str, blocks: list[list[dict[str, Tables]]], t_end_s: float) -> Effect:
    """Compare the two scenarios under one strategy, and confirm the differences with the second seed.

    Args:
        name: name of the strategy.
        blocks: tables of robots and of runs by strategy, for each seed (first index) and scenario (second index).
        t_end_s: end of a run, which is the decision time of a robot that does not decide.
    """
    tables = [[run_figures(*cell[name], t_end_s) for cell in cells] for cells in blocks]
    # One comparison of the two scenarios (second - first) for each seed.
    comparisons = [compare(second, first) for first, second in tables]
    # Means and shares of outcomes, for each scenario, are those of the first seed, ``tables[0]`` and ``blocks[0]``.
    figures = [
        {figure: mean_interval(table[figure].drop_nulls().to_numpy()) for figure in COMPARED}
        for table in tables[0]
    ]
    runs_tables = [cell[name][1] for cell in blocks[0]]
    shares = [
        {kind: float((table["consensus"] == kind).mean()) for kind in CONSENSUS}  # type: ignore[arg-type]
        for table in runs_tables
    ]
    return Effect(
        strategy=name,
        figures=(figures[0], figures[1]),
        consensus=(shares[0], shares[1]),
        # The comparisons of both seeds list the figures in the same order.
        differences=tuple(
            confirmed(difference, repeated) for difference, repeated in zip(*comparisons, strict=True)
        ),
    )
