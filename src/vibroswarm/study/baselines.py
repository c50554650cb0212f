"""Compute two references for every strategy, from some of the study's runs, which are simulated again from its seed.

**Pooled counting** is a central decision-maker that has all bits (0/1 samples) of all robots at once. It decides with
the same share of errors as the strategy, so the difference in time is the cost of deciding as a swarm. See
``analysis.centralised_baseline``.

**With positions** (``known``) is the posterior over the tiles, given all readings and their positions. It gives the
time at which the side of the boundary, or the most common of several kinds, could be known with a posterior error of
5 %. Its prior "mirror" knows the distance of the fill ratio from the boundary but not the side, so even-numbered runs
keep their floor and odd-numbered runs get one of the mirrored fill ratio. Of kinds it knows the shares but not which
kind has which, and runs have floors with the shares in each order in turn. If floors are drawn from this prior, no rule
that is as sure in every run decides sooner. On other floors it is a reference and not a bound, and a note says so. If
it cannot be computed, a note says why. See ``analysis.oracle_posterior``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from vibroswarm.analysis.centralised_baseline import PooledCounting, pooled_counting
from vibroswarm.analysis.intervals import Interval, columns_of, mean_interval, within
from vibroswarm.analysis.oracle_posterior import Known, could_be_known, on_both_sides
from vibroswarm.analysis.sampling import lag_one, packet_loss
from vibroswarm.errors import InputError
from vibroswarm.inference.deliveries import needs_moves
from vibroswarm.result import Result
from vibroswarm.simulation import replay, steers
from vibroswarm.study.plan import Group
from vibroswarm.study.spec import Cell
from vibroswarm.study.study_result import StudyResult

RUNS: Final = 200
"""Most runs simulated again for each cell."""
MIN_RUNS: Final = 20
"""With fewer runs, the half on which pooled counting is tuned and the half on which it is judged are too small."""
MOST_CELLS: Final = 60
"""No references are computed for a study with more selected cells."""


@dataclass(frozen=True)
class References:
    """A cell's references: what could be decided from the same samples; times in s."""

    cell: Cell
    runs: int
    """Number of runs that were simulated again."""
    pooled: PooledCounting | None
    """None if runs ended early, there are several kinds, or no decision is right."""
    known: Known | None
    """None if it cannot be computed."""
    says: tuple[str, ...]
    """Notes in sentences: why ``known`` is missing, or where its figures do not apply."""
    lag_one: Interval
    """Correlation of one robot's consecutive readings (``sampling.lag_one``)."""
    packet_loss: Interval
    """Share of messages addressed to a robot that it did not receive; mean over runs. nan if there were none."""

    def as_row(self) -> dict[str, Any]:
        """Return a flat row for a table; figures of a missing reference (None) and the notes ``says`` are left out.

        An interval has three columns: its estimate in the figure's name, its limits in ``..._low`` and ``..._high``.
        """
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
            row["known_runs"] = self.known.runs.height
        for name, interval in figures.items():
            row |= columns_of(name, interval)
        return row


def references_of(
    result: StudyResult, progress: Callable[[float], None] = lambda share: None
) -> list[References]:
    """Compute the references of the selected cells, in the order of their numbers.

    A cell is left out if its task is neither about the fill ratio nor about the most common of several kinds, or if
    fewer than ``MIN_RUNS`` of its runs can be simulated again, because few are stored, they are long, or the source of
    motion is slow (``StudyResult.runs_again``). The list is empty if more than ``MOST_CELLS`` cells are selected.

    Args:
        progress: called after each cell, with the share of the selected cells that are done.
    """
    if len(result.selected) > MOST_CELLS:
        return []
    references = []
    for done, (cell, simulated) in enumerate(_simulated_again(result), start=1):
        if simulated is not None:
            references.append(_references(cell, simulated))
        progress(done / len(result.selected))
    return sorted(references, key=lambda reference: reference.cell.number)


def _simulated_again(result: StudyResult) -> Iterator[tuple[Cell, Result | None]]:
    """Yield each selected cell with at most ``RUNS`` of its runs, simulated again.

    Cells of a group share their motion. It is simulated for the first of them, and the others are replayed on it where
    that is possible. A cell that ``references_of`` leaves out is yielded with None instead of its runs.
    """
    for group in result.plan.groups:
        cells = [cell for cell in group.cells if cell.number in result.selected]
        simulated: Result | None = None
        for cell in cells:
            chosen = result.runs_again(cell.number, RUNS)
            # Of several kinds, what could be known is computed of the most common one.
            task = "majority" if cell.scenario.sensor.kinds > 2 else "fill_ratio"
            if len(chosen) < MIN_RUNS or cell.scenario.task.name != task:
                yield cell, None
                continue
            # ``simulated`` still has the runs of the previous cell: this cell may be replayed on their motion.
            simulated = _runs_of_cell(result, group, cell, chosen, simulated)
            yield cell, simulated


def _runs_of_cell(
    result: StudyResult, group: Group, cell: Cell, runs: list[int], earlier: Result | None
) -> Result:
    if earlier is not None and _has_motion_for(earlier, group, cell, runs):
        return replay(earlier, cell.scenario)
    return result.result(cell.number, runs)


def _has_motion_for(earlier: Result, group: Group, cell: Cell, runs: list[int]) -> bool:
    """Return whether a cell's runs can be replayed on the motion of ``earlier``, runs of another cell of the group.

    Args:
        runs: numbers of the cell's runs.
    """
    # Cells of a group share their motion, but may differ in the end of their runs and in the number of runs stored.
    is_same = earlier.scenario.run == cell.scenario.run and earlier.runs["run"].to_list() == runs
    # A run that stops when all robots have decided may be too short for another strategy.
    runs_to_end = group.first.run.stop == "t_end"
    has_moves = earlier.moves is not None or not needs_moves(cell.scenario)
    # Motion that a strategy steers is not replayed, even for an equal scenario.
    return is_same and runs_to_end and has_moves and not steers(cell.scenario)


def _references(cell: Cell, simulated: Result) -> References:
    """Compute the references of one cell from its simulated runs; its task must be ``_task_with_references``."""
    pooled = None
    # Pooled counting is of bits. It needs all samples up to the end of each run, and a right decision in each run.
    if (
        cell.scenario.sensor.kinds == 2
        and not simulated.runs["stopped_early"].any()
        and simulated.runs["truth"].null_count() == 0
    ):
        pooled = pooled_counting(simulated)
    known, notes = _could_be_known(simulated)
    loss = packet_loss(simulated)["packet_loss"].drop_nulls().to_numpy()
    return References(
        cell=cell,
        runs=simulated.runs.height,
        pooled=pooled,
        known=known,
        says=notes,
        lag_one=lag_one(simulated),
        packet_loss=within(mean_interval(loss), 0.0, 1.0),
    )


def _could_be_known(result: Result) -> tuple[Known | None, tuple[str, ...]]:
    """Compute when the side of the boundary could be known from all bits and their positions.

    Returns: the figures, or None if they cannot be computed; and notes in sentences, on why the figures cannot be
        computed or on where they do not apply.
    """
    if result.runs["truth"].null_count():
        of_kinds = result.scenario.sensor.kinds > 2
        why = "kinds are equally common" if of_kinds else "the fill ratio is on the boundary"
        return None, (f"What could be known is not computed: {why}.",)
    floor = result.scenario.floor
    try:
        # Under the prior "mirror" the fill ratio lies on either side with equal probability. Half of the runs get a
        # floor of the mirrored fill ratio, so that the floors agree with the prior; only drawn floors can be mirrored.
        result = on_both_sides(result) if floor.drawn_by_run else result
        known = could_be_known(result, prior="mirror")
    except InputError as error:
        return None, (f"What could be known is not computed: {error}.",)
    if floor.drawn_by_run:
        return known, ()
    note = (
        "The prior takes all floors of this fill ratio as equally likely, which these floors are not: what could "
        "be known is no bound here (knowing the pattern may help), its error may exceed 5 %, and "
        "`wrong when known` covers floors on this side of the boundary only."
    )
    return known, (note,)
