"""What a study consists of, what is left to do, and how long the command that runs it may take."""

from __future__ import annotations

from typing import Final

from vibroswarm.core.numbers import count, count_of, duration, listed
from vibroswarm.study.plan import Plan
from vibroswarm.study.precision import FIRST_LOOK
from vibroswarm.study.runner import Expected, Job
from vibroswarm.study.store import Store
from vibroswarm.study.study_result import StudyResult

PAGE_S: Final = 0.8
"""Processor time of a page without cells, s: imports, and figures of all cells."""
PAGE_OF_CELL_S: Final = 0.8
"""Processor time of a cell's references and figures, s, of up to ``PAGE_SAMPLES`` samples."""
ROW_OF_CELL_S: Final = 0.004
"""Processor time of a cell's figures with their intervals, and of its rows of tables, s."""
PAGE_SAMPLES: Final = 250_000
"""Samples of 200 of the paper's runs; more, of longer runs or more robots, take longer in proportion."""
CELLS_DRAWN: Final = 12
"""Of more cells, a page has fewer figures."""


def plan_sentence(plan: Plan) -> str:
    """Return how many cells and runs there are, and what the cells share in each run."""
    study = plan.study
    # With --until, intervals are computed after 100 runs for the first time.
    runs = count(study.runs, "run") if study.runs else f"{FIRST_LOOK} or more runs"
    return f"{count(len(study.cells), 'cell')}, {runs} each, seed {study.seed}{_shared(plan)}"


def _shared(plan: Plan) -> str:
    """Return what the cells share in each run; empty if there is one cell, or they share nothing."""
    cells, motions, sets = len(plan.study.cells), len(plan.groups), plan.observations
    if motions == cells:
        return ""
    if motions == 1:
        return f"; all see the same paths{' and readings' if sets == 1 else ''}"
    return (
        f"; each run has {count(motions, 'motion')} and {count(sets, 'set')} of readings, which cells share"
    )


def work_sentence(
    left: Expected, job: Job | None = None, *, page_cells: int | None = None, again_samples: float = 0.0
) -> str:
    """Return what a command has to do, and how much processor time that takes in all.

    Args:
        left: the runs that are missing (``runner.expected``); further ones are of a league's tests. job: the part of
            the study to which they belong; None if all of it is run.
        page_cells: number of cells on the page that is written, of which ``CELLS_DRAWN`` have references and figures of
            their own; None: no page is. again_samples: samples of a cell that are simulated again for these.
    """
    if left.runs + left.again_runs + left.further_runs == 0:
        return f"Nothing to do: {'no run of this shard is missing' if job else 'all runs exist'}."
    words, page_s = [], 0.0
    if left.runs:
        words.append(f"{count(left.runs, 'run')} of motion{' in this shard' if job else ''}")
    if left.again_runs:
        words.append(f"{count(left.again_runs, 'run')} on other seeds")
    if page_cells is not None:
        cell_s = PAGE_OF_CELL_S * max(1.0, again_samples / PAGE_SAMPLES)
        page_s = PAGE_S + cell_s * min(page_cells, CELLS_DRAWN) + ROW_OF_CELL_S * page_cells
        words.append("the report")
    if left.further_runs:
        words.append(f"{count(left.further_runs, 'run')} to test beliefs and faults")
    seconds = max(left.core_s + left.again_s + left.further_s + page_s, 0.1)
    how = f"estimated from {count(left.tried, 'trial run')}" if left.tried else "a rough estimate"
    return f"To do: {listed(words)}; about {duration(seconds)} of one core in all ({how})"


def batch_sentence(batch: str, store: Store) -> str:
    """Say that a batch is done."""
    return f"Batch {batch} is done; saved in {store.folder}"


def shard_sentences(result: StudyResult, job: Job) -> tuple[str, ...]:
    """Say how much of a shard is done, and how shards are joined."""
    done, wanted = int(result.cells["there"].sum()), int(result.cells["wanted"].sum())
    return (
        f"Shard {job.number} of {job.of} is done: {count_of(done, wanted, 'run')} in {result.store.folder}",
        "After all shards: vibroswarm evaluate merge OUT SHARD ...",
    )
