"""Measure the effect of simulating with other robots: two scenarios on the same floors, for each strategy.

Runs of the same number have the same floor and the same noise in both, and form a pair. Notable differences are
checked on other seeds (fresh motion, fresh floors).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.cell_summary import run_figures
from vibroswarm.analysis.intervals import Interval, mean_interval
from vibroswarm.analysis.paired import FIGURES, Confirmation, compare, confirmed
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import replay, simulate

STRATEGIES: Final = ("none", "positive", "soft")
CONSENSUS: Final = ("right", "wrong", "split", "incomplete")
BATCH: Final = 100


@dataclass(frozen=True)
class Effect(NotebookView):
    """One strategy: figures and shares of each consensus for both scenarios, and the differences (second - first)."""

    strategy: str
    figures: tuple[dict[str, Interval], dict[str, Interval]]
    consensus: tuple[dict[str, float], dict[str, float]]
    differences: tuple[Confirmation, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
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

    Args:
        runs: number for each scenario; as many again are run on other seeds, to confirm what is found.
    """
    blocks = []
    done, all_of = 0, 4 * -(-runs // BATCH)
    for block in range(2):
        cells: list[dict[str, tuple[pl.DataFrame, pl.DataFrame]]] = []
        for scenario in (first, second):
            pieces: dict[str, list[tuple[pl.DataFrame, pl.DataFrame]]] = {name: [] for name in strategies}
            for start in range(0, runs, BATCH):
                chosen = list(range(start, min(start + BATCH, runs)))
                shared = simulate(scenario, seed + block, chosen, energies=False)
                for name in strategies:
                    replayed = replay(shared, scenario.with_values({"strategy.name": name}))
                    pieces[name].append((replayed.robots, replayed.runs))
                done += 1
                if progress is not None:
                    progress(done / all_of)
            cells.append(
                {
                    name: (
                        pl.concat([part[0] for part in parts]),
                        pl.concat([part[1] for part in parts]),
                    )
                    for name, parts in pieces.items()
                }
            )
        blocks.append(cells)
    return [_effect(name, blocks, first.run.t_end_s) for name in strategies]


def _effect(
    name: str, blocks: list[list[dict[str, tuple[pl.DataFrame, pl.DataFrame]]]], t_end_s: float
) -> Effect:
    """Compare the two scenarios under one strategy, in both blocks of seeds."""
    tables = [[run_figures(*cell[name], t_end_s) for cell in cells] for cells in blocks]
    comparisons = [compare(second, first) for first, second in tables]
    figures = [
        {figure: mean_interval(table[figure].drop_nulls().to_numpy()) for figure in FIGURES}
        for table in tables[0]
    ]
    shares = [
        {kind: float((cell[name][1]["consensus"] == kind).mean()) for kind in CONSENSUS}  # type: ignore[arg-type]
        for cell in blocks[0]
    ]
    return Effect(
        name,
        (figures[0], figures[1]),
        (shares[0], shares[1]),
        tuple(confirmed(a, b) for a, b in zip(*comparisons, strict=True)),
    )
