"""Run a study: submit the batches whose runs are missing in its store to workers, and save what they return.

A batch that fails is tried again (``work.do_all``). A batch in which user code fails is halved instead, so that
only the runs in which it fails are lost. A study with a precision runs up to a number of runs (a look, see
``precision``), and adds runs until the figure is precise enough.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from vibroswarm.core.jit import is_cached
from vibroswarm.core.numbers import count
from vibroswarm.errors import CodeError, InputError, RunError, warn_once
from vibroswarm.study.batch import Batch, BatchResult, Cancelled, batch_of, do_batch
from vibroswarm.study.executors import Workers, check_worker, workers_for
from vibroswarm.study.plan import Group, Plan, plan_of
from vibroswarm.study.precision import FIRST_LOOK, Precision
from vibroswarm.study.settled import settled
from vibroswarm.study.spec import MOST_RUNS, Study
from vibroswarm.study.store import Store
from vibroswarm.study.work import do_all, parts_of

MOST_HALVINGS: Final = 100
"""Most halvings of batches to find the runs in which user code fails."""


class Job(NamedTuple):
    """One of the ``of`` jobs into which a study is divided; jobs are numbered from 1."""

    number: int
    of: int

    @classmethod
    def from_words(cls, text: str) -> Job:
        """Parse ``"3/16"``: job 3 of 16."""
        number, _, total = text.partition("/")
        if not (number.isdecimal() and total.isdecimal() and 1 <= int(number) <= int(total)):
            raise InputError(f"'{text}' is not a job; give one such as 3/16", field="--shard")
        return cls(int(number), int(total))

    def has(self, group: Group, block: int) -> bool:
        """Return whether a block of a group's runs belongs to this job; each block belongs to exactly one job."""
        # Block 0 of successive groups belongs to successive jobs. So the work is spread over the jobs even if each
        # group has few blocks.
        return (group.number + block) % self.of == self.number - 1


class StudyProgress(NamedTuple):
    """Progress of one call: runs done, runs wanted (both summed over groups), and batches that failed for good."""

    done: int
    wanted: int
    failed: int

    @property
    def share(self) -> float:
        """Share of the wanted runs that is done; 0 if none is wanted."""
        return self.done / max(self.wanted, 1)


Progress = Callable[[StudyProgress], None]
"""A function that is called as batches finish."""


def run_study(
    study: Study,
    folder: str | Path,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    job: Job | None = None,
    mixed: bool = False,
    progress: Progress | None = None,
    allow_failures: bool = False,
) -> Store:
    """Run the missing runs of a study and save them in ``folder``; may be interrupted and called again at any time.

    Args:
        executor, workers: see ``executors.workers_for``; ``workers`` is its ``count``.
        job: run only the batches of this job; None: all batches.
        mixed: continue even if other versions started the study, and accept workers with other versions.
        progress: called as batches finish.
        allow_failures: return the store even if runs failed (the store lists them), instead of raising RunError.
    Raises:
        InputError: the folder holds something else or another study, a job of a study with a precision is given, no
            scheduler answers, or, unless ``mixed``, stored runs or a worker have other versions than this process.
        RunError: the disk is full, the cluster is gone, or runs failed for good; finished batches are saved.
    """
    if job is not None and study.until is not None:
        raise InputError(
            "needs a number of runs, not a precision: jobs do not see each other's runs",
            field="--shard",
        )
    plan, store = plan_of(study), Store.existing(folder, study)
    for damage in [] if store is None else store.damaged:
        warn_once(f"damaged, will be recomputed: {damage}")
    if store is None or not _all_there(store, plan, job):
        if store is not None and not mixed:
            store.check_versions()
        # Connect to the workers before creating the folder: they may be unavailable.
        with workers_for(executor, workers, mixed) as crew:
            store = Store.open_or_create(folder, study)
            # Worker processes load compiled kernels from the cache on disk. Without this step, each process that starts
            # with an empty cache would compile the same kernels. Threads need no such step: they are in one process,
            # which compiles each kernel once for all of them.
            if executor != "threads":
                _compile_first(study, plan)
            runner = _Runner(store, crew, mixed, progress or (lambda done: None))
            if study.until is None:  # then the study has a number of runs
                runner.do([(group, study.runs or 0) for group in plan.groups], job)
            else:
                _until_settled(runner, plan, study.until)
    # The number of runs in ``study.toml`` is updated. This fails without harm if a complete study is in a read-only
    # folder.
    with suppress(InputError, RunError):
        store.write_head()
    if store.failures and not allow_failures:
        raise RunError(failures_in_words(store))
    return store


def _until_settled(runner: _Runner, plan: Plan, precision: Precision) -> None:
    """Run groups from look to look until each is settled, or until a batch has failed.

    A look is a number of runs after which the precision is checked. A group is settled if its figure is precise enough,
    or if it has the most runs that are allowed.
    """
    left = list(plan.groups)
    for runs in precision.looks():
        # All batches, since a study with a precision is not divided into jobs.
        runner.do([(group, runs) for group in left], job=None)
        if runner.failed:
            return
        left = [group for group in left if settled(runner.store, group, precision) is None]


def _compile_first(study: Study, plan: Plan) -> None:
    """Compile the kernels in this process unless they are on disk, so that not every worker compiles them."""
    if not is_cached():
        # User code that fails in this run fails again in its batch, which reports it.
        with suppress(CodeError):
            do_batch(batch_of(study, plan.groups[0], first=0, last=1))


def run_batch(study: Study, folder: str | Path, batch: str, *, mixed: bool = False) -> Store:
    """Run one batch in this process and save it; exceptions of the simulation are not caught, so that a user sees them.

    Args:
        batch: ``GROUP:FIRST-LAST``, as failures are listed: the runs FIRST to LAST - 1 of the group.
        mixed: continue a study that other versions of the software began.
    Raises:
        InputError: there is no such batch, the folder holds another study, or versions differ.
    """
    match = re.fullmatch(r"(\d+):(\d+)-(\d+)", batch)
    group, first, last = map(int, match.groups()) if match else (0, 0, 0)  # an empty range is refused below
    if not first < last <= MOST_RUNS:
        raise InputError(f"'{batch}' is not a batch; GROUP:FIRST-LAST, such as 0:200-400", field="--batch")
    groups = plan_of(study).groups
    if group >= len(groups):
        raise InputError(f"there is no group {group}; the study has {len(groups)}, from 0", field="--batch")
    store = Store.open_or_create(folder, study)
    if not mixed:
        store.check_versions()
    store.add(do_batch(batch_of(study, groups[group], first, last)))
    return store


def _all_there(store: Store, plan: Plan, job: Job | None) -> bool:
    """Return whether all runs of the study or the job are stored, or, with a precision, all groups are settled."""
    runs, until = store.study.runs, store.study.until
    if until is not None:
        return all(settled(store, group, until) is not None for group in plan.groups)
    return not any(_missing_batches(store, [(group, runs or 0) for group in plan.groups], job))


def _missing_batches(store: Store, wanted: Sequence[tuple[Group, int]], job: Job | None) -> Iterator[Batch]:
    for group, runs in wanted:
        for block, first, last in store.missing(group, runs):
            if job is None or job.has(group, block):
                yield batch_of(store.study, group, first, last)


class _Runner:
    """Submits batches and saves their results.

    It counts the runs done and wanted, the batches that failed for good, and the halvings of batches.
    """

    def __init__(self, store: Store, crew: Workers, mixed: bool, progress: Progress) -> None:
        self.store, self.crew, self.mixed, self.progress = store, crew, mixed, progress
        self.done = self.wanted = self.failed = self.halvings = 0

    def do(self, wanted: Sequence[tuple[Group, int]], job: Job | None) -> None:
        """Run the wanted runs that are not stored.

        Args:
            wanted: pairs of a group and the number of its runs that are wanted. job: only batches of this job; None:
                all.
        """
        batches = list(_missing_batches(self.store, wanted, job))
        self.wanted += sum(batch.runs for batch in batches)
        self.progress(StudyProgress(self.done, self.wanted, self.failed))
        do_all(
            self.crew,
            batches,
            submit=self.crew.submit,
            take=self._take,
            failed=self._failed,
            # More than twice as many batches as workers are submitted, so that a worker that becomes free finds another
            # batch in the queue.
            ahead=lambda: 2 * self.crew.width + 1,
            progress=lambda: self.progress(StudyProgress(self.done, self.wanted, self.failed)),
            rescue=self._save,
        )

    def _take(self, done: BatchResult, work: Batch) -> None:
        """Save a finished batch, and count its runs."""
        self._save(done)
        self.done += work.runs

    def _failed(self, work: Batch, error: BaseException) -> list[Batch]:
        """Return the halves of a batch in which user code failed; otherwise record that it failed for good.

        A batch of one run, or one too many, is not halved.
        """
        is_code = isinstance(error, CodeError)
        if is_code and work.runs > 1 and self.halvings < MOST_HALVINGS:
            self.halvings += 1
            return parts_of(work, 2)
        self.store.add_failure(work, str(error) if is_code else f"{type(error).__name__}: {error}")
        self.failed += 1
        return []

    def _save(self, done: BatchResult) -> None:
        """Save a finished batch; raises InputError if its worker has other versions and they may not be mixed."""
        check_worker(done.versions, self.mixed)
        self.store.add(done)


def failures_in_words(store: Store, kept: bool = True) -> str:
    """Write how many runs of a store failed, with the first cause and what to do.

    Args:
        store: with at least one failure. kept: whether the store's folder stays; if not, the text does not say how to
            run a failed batch alone.
    """
    failures = store.failures
    first, runs = failures[0], len(store.lost_runs)
    words = f"{count(runs, 'run')} failed, in {count(len(failures), 'batch', 'batches')}"
    if not kept:
        return f"{words}; the first is run {first['first']} with seed {first['seed']} ({first['why']})."
    return (
        f"{words}; all others are saved. The first is batch {first['batch']} with seed {first['seed']} "
        f"({first['why']}). Run it alone with --batch {first['batch']}; run the same command again to retry all. They "
        f"are listed in '{store.folder}/failures'."
    )


def runs_left(store: Store, job: Job | None = None) -> int:
    """Return how many runs of a study or a job are missing, summed over groups.

    With a precision, these are the runs up to the first look.
    """
    return sum(
        last - first
        for group in plan_of(store.study).groups
        for block, first, last in store.missing(group, store.study.runs or FIRST_LOOK)
        if job is None or job.has(group, block)
    )


__all__ = ["Cancelled", "Job", "StudyProgress", "failures_in_words", "run_batch", "run_study", "runs_left"]
