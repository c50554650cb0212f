"""What a study consists of, and what is left to do."""

from __future__ import annotations

from vibroswarm.core.numbers import count, count_of, listed
from vibroswarm.study.plan import Plan
from vibroswarm.study.precision import FIRST_LOOK
from vibroswarm.study.runner import Job
from vibroswarm.study.store import Store
from vibroswarm.study.study_result import StudyResult


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


def work_sentence(left: int, job: Job | None = None, *, further: int = 0) -> str:
    """Return how many runs a command has to do.

    Args:
        left: missing runs. job: the part of the study to which they belong; None if all of it is run. further: missing
            runs of a league's test of beliefs.
    """
    if left + further == 0:
        return f"Nothing to do: {'no run of this shard is missing' if job else 'all runs exist'}."
    words = []
    if left:
        words.append(f"{count(left, 'run')} of motion{' in this shard' if job else ''}")
    if further:
        words.append(f"{count(further, 'run')} to test beliefs")
    return f"To do: {listed(words)}"


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
