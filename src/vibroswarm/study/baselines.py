"""Compute two references for every strategy, from some runs that are simulated again from the seed.

**Pooled counting** has all bits in one place at once and decides at the strategy's own error: it shows the cost of
deciding as a swarm. **With positions** is the posterior over tiles from all bits and their positions: what could be
known at a posterior error of 5 %, given the fill ratio but not the side ("mirror"), on floors from alternating sides.
No rule that is as sure in every run decides sooner, if floors are drawn from that prior; on other floors it is a
reference and not a bound, and a note says so. If it cannot be computed, a note says why. See
``analysis.centralised_baseline`` and ``analysis.oracle_posterior``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.centralised_baseline import PooledCounting, pooled_counting
from vibroswarm.analysis.intervals import Interval, mean_interval, plain
from vibroswarm.analysis.oracle_posterior import Known, could_be_known, on_both_sides
from vibroswarm.analysis.sampling import lag_one, packet_loss
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import needs_moves
from vibroswarm.posterior.boundary_side import needs_chains
from vibroswarm.result import Result
from vibroswarm.simulation import replay
from vibroswarm.study.plan import Group
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

RUNS: Final = 200
"""Runs simulated again for each cell."""
MIN_RUNS: Final = 20
"""With fewer runs, one half is too few to tune on and the other too few to judge."""
RUNS_BY_CHAINS: Final = 40
"""Runs if the posterior must be sampled, which takes some tenths of a second a run; half as many on large floors."""
LARGE_FLOOR: Final = 50
"""Number of tiles from which a run takes seconds."""
MOST_CELLS: Final = 60


@dataclass(frozen=True)
class References:
    """A cell's references: what could be decided from the same samples; times in s."""

    cell: Cell
    runs: int
    pooled: PooledCounting | None
    """None if no decision is right or runs ended early."""
    known: Known | None
    """None if it cannot be computed."""
    says: tuple[str, ...]
    """Why ``known`` is missing, or where its figures do not apply."""
    lag_one: Interval
    """Correlation of one robot's consecutive bits."""
    packet_loss: Interval
    """Share of messages addressed to a robot that it did not receive; mean over runs."""

    def as_row(self) -> dict[str, Any]:
        """Return a flat row for a table."""
        row: dict[str, Any] = {"cell": self.cell.number, "name": self.cell.name, "runs": self.runs}
        figures = {"lag_one": self.lag_one, "packet_loss": self.packet_loss}
        if self.pooled is not None:
            figures |= {
                "strategy_time_s": self.pooled.strategy_time_s,
                "strategy_error": self.pooled.strategy_error,
                "pooled_time_s": self.pooled.time_s,
                "pooled_error": self.pooled.error,
                "slower_than_pooled_s": self.pooled.time_difference_s,
            }
        if self.known is not None:
            figures |= {
                "known_time_s": self.known.time_s,
                "known": self.known.known,
                "known_wrong": self.known.wrong,
                "known_claimed": self.known.claimed,
            }
            row |= {"known_runs": self.known.runs.height, "known_how": self.known.how}
            row["known_monte_carlo_error"] = self.known.monte_carlo_error
        for name, interval in figures.items():
            row[name], row[f"{name}_low"], row[f"{name}_high"] = (plain(value) for value in interval[:3])
        return row


def references_of(
    result: StudyResult, runs: int = RUNS, progress: Callable[[float], None] | None = None
) -> list[References]:
    """Compute the references of the selected cells; none for more than ``MOST_CELLS`` cells or too few runs."""
    if len(result.selected) > MOST_CELLS:
        return []
    references = []
    for done, (cell, simulated) in enumerate(_again(result, runs)):
        if simulated is not None:
            references.append(_references(cell, simulated))
        if progress is not None:
            progress((done + 1) / len(result.selected))
    return sorted(references, key=lambda reference: reference.cell.number)


def _again(result: StudyResult, runs: int) -> Iterator[tuple[Cell, Result | None]]:
    """Yield each selected cell with its simulated runs; cells that share motion share its simulation.

    None takes the place of the runs if they are fewer than ``MIN_RUNS``, or if the task is not about the fill ratio.
    """
    for group in result.plan.groups:
        cells = [cell for cell in group.cells if cell.number in result.selected]
        simulated: Result | None = None
        for cell in cells:
            chosen = result.runs_again(cell.number, runs)
            if len(chosen) < MIN_RUNS or cell.scenario.task.name != "fill_ratio":
                yield cell, None
                continue
            simulated = _runs_of_cell(result, group, cell, chosen, simulated)
            yield cell, simulated


def _runs_of_cell(
    result: StudyResult, group: Group, cell: Cell, runs: list[int], made: Result | None
) -> Result:
    """Return a cell's runs: replayed on the motion of ``made``, runs of another cell, if possible; else simulated."""
    if made is not None and _serves(made, group, cell, runs):
        return replay(made, cell.scenario)
    return result.result(cell.number, runs)


def _serves(made: Result, group: Group, cell: Cell, runs: list[int]) -> bool:
    """Return whether a cell can be replayed on the motion of ``made``, runs of another cell of its group."""
    # Cells of a group may differ in their end, and in how many runs they have.
    is_same = made.scenario.run == cell.scenario.run and made.runs["run"].to_list() == runs
    # A run that ends when all have decided is as long as its own strategy needs.
    is_whole = group.first.run.stop == "t_end"
    return is_same and is_whole and (made.moves is not None or not needs_moves(cell.scenario))


def _references(cell: Cell, made: Result) -> References:
    """Compute the references of one cell."""
    pooled = None
    if not made.runs["stopped_early"].any() and made.runs["truth"].null_count() == 0:
        pooled = pooled_counting(made)
    known, says = _could_be_known(made)
    loss = mean_interval(packet_loss(made)["packet_loss"].drop_nulls().to_numpy())
    return References(cell, made.runs.height, pooled, known, says, lag_one(made), loss)


def _could_be_known(made: Result) -> tuple[Known | None, tuple[str, ...]]:
    """Compute what could be known, None if that is impossible, with notes on what is missing or limited."""
    if made.runs["truth"].null_count():
        return None, ("What could be known is not computed: the fill ratio is on the boundary.",)
    floor, sensor = made.scenario.floor, made.scenario.sensor
    try:
        made = on_both_sides(made) if floor.drawn_by_run else made
        if needs_chains(sensor):
            large = made.floor(int(made.runs["run"][0])).tiles.size >= LARGE_FLOOR
            some = RUNS_BY_CHAINS // 2 if large else RUNS_BY_CHAINS
            made = replace(made, runs=made.runs.sort("run").head(some))
        known = could_be_known(made, prior="mirror")
    except InputError as error:
        return None, (f"What could be known is not computed: {error}.",)
    says = []
    if not floor.drawn_by_run:
        says.append(
            "The prior takes all floors of this fill ratio as equally likely, which these floors are not: what could "
            "be known is no bound here (knowing the pattern may help), its error may exceed 5 %, and "
            "`known wrong` covers floors on this side of the boundary only."
        )
    elif sensor.tile_spread is not None or sensor.robot_spread is not None:
        says.append("Tiles and robots are new in each run; their factors are not known, their spread is.")
    if known.unsettled:
        says.append(
            f"In {known.unsettled} of {known.runs.height} runs a posterior stayed too uncertain to be used."
        )
    return known, tuple(says)


def reference_table(references: list[References]) -> pl.DataFrame:
    """Tabulate references, one row per cell."""
    return pl.DataFrame([reference.as_row() for reference in references], infer_schema_length=None)
