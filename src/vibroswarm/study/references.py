"""Two references beside every strategy, from some runs made again from the seed.

**Pooled counting** has all bits in one place at once and decides at the strategy's own error: what the swarm pays for
its way of deciding. **With positions** is the posterior over tiles from all bits with their places: what could be
known with a posterior error of 5 %, by who knows the fill ratio but not the side ("mirror"), on floors of both sides by
turns. No rule that is as sure
in every run decides sooner, on floors drawn as that prior has them; where they are not, it is a reference and no bound,
and its words say so. Where it cannot be computed, they say why. See ``analysis.pooled`` and ``analysis.known``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import polars as pl

from vibroswarm.analysis.both_sides import on_both_sides
from vibroswarm.analysis.correlation import lag_one, packet_loss
from vibroswarm.analysis.intervals import Interval, mean_interval, plain
from vibroswarm.analysis.known import Known, could_be_known
from vibroswarm.analysis.pooled import PooledCounting, pooled_counting
from vibroswarm.errors import InputError
from vibroswarm.posterior.sides import needs_chains
from vibroswarm.result import Result
from vibroswarm.simulation import replay
from vibroswarm.study.plan import Group
from vibroswarm.study.result import StudyResult
from vibroswarm.study.spec import Cell

RUNS: Final = 200
"""Runs made again for each cell."""
FEWEST: Final = 20
"""With fewer, half to tune and half to judge say nothing."""
RUNS_BY_CHAINS: Final = 40
"""So many where the posterior has to be sampled, some tenths of a second a run; half of them on larger floors."""
LARGE_FLOOR: Final = 50
"""Tiles from which on a run takes seconds."""
MOST_CELLS: Final = 60


@dataclass(frozen=True)
class References:
    """A cell beside what could be done with the same samples; times in s."""

    cell: Cell
    runs: int
    pooled: PooledCounting | None
    """None where no decision is right, or runs ended early."""
    known: Known | None
    """None where it cannot be computed."""
    says: tuple[str, ...]
    """Of ``known``: why there is none, or what its figures do not hold for."""
    lag_one: Interval
    """Correlation of one robot's consecutive bits."""
    packet_loss: Interval
    """Share of the messages addressed to a robot that it did not hear; a mean over runs."""

    def as_row(self) -> dict[str, Any]:
        """Flat, for a table."""
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
    result: StudyResult, runs: int = RUNS, tell: Callable[[float], None] | None = None
) -> list[References]:
    """The references of the selected cells; none for more than ``MOST_CELLS`` cells or too few runs."""
    if len(result.selected) > MOST_CELLS:
        return []
    found = []
    for done, (cell, made) in enumerate(_again(result, runs)):
        if made is not None:
            found.append(_references(cell, made))
        if tell is not None:
            tell((done + 1) / len(result.selected))
    return sorted(found, key=lambda one: one.cell.number)


def _again(result: StudyResult, runs: int) -> Iterator[tuple[Cell, Result | None]]:
    """Each cell with its runs; motion is made once for all cells that share it."""
    for group in result.plan.groups:
        cells = [cell for cell in group.cells if cell.number in result.selected]
        made: Result | None = None
        for cell in cells:
            chosen = result.runs_there(cell.number, runs)
            if len(chosen) < FEWEST or cell.scenario.task.name != "fill_ratio":
                yield cell, None
                continue
            made = _one(result, group, cell, chosen, made)
            yield cell, made


def _one(result: StudyResult, group: Group, cell: Cell, runs: list[int], made: Result | None) -> Result:
    # Cells of a group may differ in their end, and in how many runs they have.
    if made is None or made.scenario.run != cell.scenario.run or made.runs["run"].to_list() != runs:
        return result.result(cell.number, runs)
    if group.first.run.stop != "t_end":
        return result.result(cell.number, runs)
    return replay(made, cell.scenario)


def _references(cell: Cell, made: Result) -> References:
    pooled = None
    if not made.runs["stopped_early"].any() and made.runs["truth"].null_count() == 0:
        pooled = pooled_counting(made)
    known, says = _known(made)
    loss = mean_interval(packet_loss(made)["packet_loss"].drop_nulls().to_numpy())
    return References(cell, made.runs.height, pooled, known, says, lag_one(made), loss)


def _known(made: Result) -> tuple[Known | None, tuple[str, ...]]:
    """What could be known, and what is to be said of it."""
    if made.runs["truth"].null_count():
        return None, ("What could be known is not computed: the fill ratio lies on the boundary.",)
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
            "The prior takes all floors of this fill ratio as equally likely, and these are not drawn so: what could "
            "be known is no bound here (who knows the pattern may know sooner), its error is not held to 5 %, and "
            "`known wrong` is of floors on this side of the boundary alone."
        )
    elif sensor.tile_spread is not None or sensor.robot_spread is not None:
        says.append("Tiles and robots are new in each run; their factors are not known, their spread is.")
    if known.unsettled:
        says.append(
            f"In {known.unsettled} of {known.runs.height} runs a posterior stayed too uncertain to be used."
        )
    return known, tuple(says)


def reference_table(references: list[References]) -> pl.DataFrame:
    """One row a cell."""
    return pl.DataFrame([one.as_row() for one in references], infer_schema_length=None)
