"""Run a study: submit what is missing in its store to workers, and save what they return.

The duration of a study is estimated from a few trial runs.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.jit import is_cached
from vibroswarm.errors import CodeError, InputError, RunError
from vibroswarm.study.batch import Batch, BatchResult, Cancelled, batch_of, do_batch
from vibroswarm.study.executors import Workers, check_worker, do_all, workers_for
from vibroswarm.study.plan import Group, Plan, plan_of
from vibroswarm.study.precision import FIRST_LOOK, Precision, settled
from vibroswarm.study.spec import MOST_RUNS, Study
from vibroswarm.study.store import Store

TRIES: Final = 2
MOST_HALVINGS: Final = 100
"""Most halvings of batches to find the runs in which user code fails."""


class Job(NamedTuple):
    """One of ``of`` jobs into which a study is divided, numbered from 1."""

    number: int
    of: int

    @classmethod
    def from_words(cls, text: str) -> Job:
        """Parse ``"3/16"``."""
        number, _, total = text.partition("/")
        if not (number.isdecimal() and total.isdecimal() and 1 <= int(number) <= int(total)):
            raise InputError(f"'{text}' is not a job; give one such as 3/16", field="--shard")
        return cls(int(number), int(total))

    def has(self, group: Group, block: int) -> bool:
        """Tell whether a block belongs to this job; each block belongs to exactly one."""
        return (group.number + block) % self.of == self.number - 1


class StudyProgress(NamedTuple):
    """Runs done, runs wanted (summed over groups), and batches failed."""

    done: int
    wanted: int
    failed: int


Progress = Callable[[StudyProgress], None]


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
        executor, workers: see ``executors.workers_for``.
        job: only this part of the batches. mixed: continue even if other versions started the study.
        progress: called as batches finish. allow_failures: return the store even if runs failed; it lists them.
    Raises:
        InputError: the folder holds another study, no scheduler answers, or a worker has other versions.
        RunError: the disk is full, the cluster is gone, or batches failed twice; finished batches are saved.
    """
    check_threads()
    if job is not None and study.until is not None:
        raise InputError(
            "needs a number of runs, not a precision: jobs do not see each other's runs",
            field="--shard",
        )
    plan, store = plan_of(study), Store.existing(folder, study)
    if store is None or not _all_there(store, plan, job):
        if store is not None and not mixed:
            store.check_versions()
        # Connect to the workers before creating the folder: they may be unavailable.
        with workers_for(executor, workers, mixed) as crew:
            store = Store.open_or_create(folder, study)
            if not isinstance(executor, str) or executor != "threads":
                _compile_first(study, plan)
            runner = _Runner(store, crew, mixed, progress or (lambda done: None))
            if study.until is None:
                runner.do([(group, study.runs or 0) for group in plan.groups], job)
            else:
                _until_settled(runner, plan, study.until)
    # A complete study may lie in a read-only folder.
    with suppress(InputError, RunError):
        store.write_head()
    if store.failures and not allow_failures:
        raise RunError(failures_in_words(store))
    return store


def _until_settled(runner: _Runner, plan: Plan, precision: Precision) -> None:
    """Run look by look; a settled group gets no more runs. Stop after a failure."""
    left = list(plan.groups)
    for runs in precision.looks():
        runner.do([(group, runs) for group in left], None)
        if runner.failed:
            return
        left = [group for group in left if settled(runner.store, group, precision) is None]


def _compile_first(study: Study, plan: Plan) -> None:
    """Compile the kernels here, so that not every worker process compiles them; skip it if they are cached."""
    if not is_cached():
        with suppress(CodeError):
            do_batch(batch_of(study, plan.groups[0], 0, 1))


def run_batch(study: Study, folder: str | Path, batch: str) -> Store:
    """Run one batch, ``GROUP:FIRST-LAST`` as failures are listed, in this process; its exceptions are not caught."""
    match = re.fullmatch(r"(\d+):(\d+)-(\d+)", batch)
    group, first, last = map(int, match.groups()) if match else (0, 0, 0)
    if not first < last <= MOST_RUNS:
        raise InputError(f"'{batch}' is not a batch; GROUP:FIRST-LAST, such as 0:200-400", field="--batch")
    groups = plan_of(study).groups
    if group >= len(groups):
        raise InputError(f"there is no group {group}; the study has {len(groups)}, from 0", field="--batch")
    store = Store.open_or_create(folder, study)
    store.add(do_batch(batch_of(study, groups[group], first, last)))
    return store


def _all_there(store: Store, plan: Plan, job: Job | None) -> bool:
    runs, until = store.study.runs, store.study.until
    if until is not None:
        return all(settled(store, group, until) is not None for group in plan.groups)
    return not any(_works(store, [(group, runs or 0) for group in plan.groups], job))


def _works(store: Store, wanted: Sequence[tuple[Group, int]], job: Job | None) -> Iterator[Batch]:
    for group, runs in wanted:
        for block, first, last in store.missing(group, runs):
            if job is None or job.has(group, block):
                yield batch_of(store.study, group, first, last)


class _Runner:
    """Submits batches and saves their results."""

    def __init__(self, store: Store, crew: Workers, mixed: bool, progress: Progress) -> None:
        self.store, self.crew, self.mixed, self.progress = store, crew, mixed, progress
        self.done = self.wanted = self.failed = self.halvings = 0

    def do(self, wanted: Sequence[tuple[Group, int]], job: Job | None) -> None:
        """Run what is missing of the wanted runs."""
        works = list(_works(self.store, wanted, job))
        self.wanted += sum(work.last - work.first for work in works)
        self.progress(StudyProgress(self.done, self.wanted, self.failed))
        do_all(
            self.crew,
            [(work, 1) for work in reversed(works)],
            lambda task: self.crew.submit(task[0]),
            self._take,
            ahead=lambda: 2 * self.crew.width + 1,
            progress=lambda: self.progress(StudyProgress(self.done, self.wanted, self.failed)),
            rescue=lambda future: self._save(future.result()),
        )

    def _take(self, future: Future[BatchResult], task: tuple[Batch, int]) -> list[tuple[Batch, int]]:
        """Save a finished batch; return what must be done again, whole or in halves, or nothing."""
        work, tries = task
        try:
            done = future.result()
        except CodeError as error:
            return self._halves(work, str(error))
        except (InputError, RunError, BrokenExecutor, CancelledError, KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # a panic of polars is no Exception
            if tries < TRIES:
                return [(work, tries + 1)]
            self._fail(work, f"{type(error).__name__}: {error}")
            return []
        self._save(done)
        self.done += work.last - work.first
        return []

    def _save(self, done: BatchResult) -> None:
        check_worker(done.versions, self.mixed)
        self.store.add(done)

    def _fail(self, work: Batch, why: str) -> None:
        self.store.add_failure(work, why)
        self.failed += 1

    def _halves(self, work: Batch, why: str) -> list[tuple[Batch, int]]:
        """Halve a batch in which user code failed, so that runs in which it does not fail are saved."""
        middle = (work.first + work.last) // 2
        if middle > work.first and self.halvings < MOST_HALVINGS:
            self.halvings += 1
            return [(replace(work, first=middle), 1), (replace(work, last=middle), 1)]
        self._fail(work, why)
        return []


def failures_in_words(store: Store, kept: bool = True) -> str:
    """Write how many runs of a store failed, with the first cause and what to do."""
    failures = store.failures
    first, runs = failures[0], sum(failure["last"] - failure["first"] for failure in failures)
    batches = "1 batch" if len(failures) == 1 else f"{len(failures)} batches"
    words = f"{runs:,} run{'s' * (runs != 1)} failed, in {batches}"
    if not kept:
        return f"{words}; the first is run {first['first']} with seed {first['seed']} ({first['why']})."
    return (
        f"{words}; all others are saved. The first is batch {first['batch']} with seed {first['seed']} "
        f"({first['why']}). Run it alone with --batch {first['batch']}; run the same command again to "
        f"retry all. They are listed in '{store.folder}/failures'."
    )


__all__ = ["Cancelled", "Job", "StudyProgress", "failures_in_words", "run_batch", "run_study"]


TRIED_GROUPS: Final = 3
FEW: Final = 2
MORE: Final = 22
"""Trial batches of two sizes separate the cost of a batch from that of a run."""
LONG_S: Final = 1.0
"""If a few runs take longer, the cost of a batch is negligible, and no more are tried; if one is expected to, none."""


class Expected(NamedTuple):
    """Remaining work: runs of motion, and seconds on one core as estimated from some trial runs."""

    runs: int
    core_s: float
    tried: int


def expected(store: Store, plan: Plan) -> Expected:
    """Estimate the remaining work of a study; with a precision, of its first look.

    Some groups are tried with batches of two sizes, which separates the cost of a batch from that of a run. A group
    whose runs are expected to take longer than ``LONG_S`` is not tried: ``Group.run_s`` is taken for its cost.
    """
    runs = plan.study.runs or FIRST_LOOK
    left = {group.number: store.missing(group, runs) for group in plan.groups}
    chosen = [group for group in plan.groups if left[group.number]]
    if not chosen:
        return Expected(0, 0.0, 0)
    count = {number: sum(last - first for _, first, last in blocks) for number, blocks in left.items()}
    tried = chosen[:: max(len(chosen) // TRIED_GROUPS, 1)][:TRIED_GROUPS]
    a_run, a_batch, count_tried = 0.0, 0.0, 0
    for group in tried:
        if group.run_s > LONG_S:
            a_run += 1.0 / len(tried)  # a trial would take too long: run_s is taken as it is
            continue
        _time_s(plan, group, FEW)  # tables and kernels are loaded
        few_s = _time_s(plan, group, FEW)
        long = few_s > LONG_S
        count_tried += 2 * FEW + (0 if long else MORE)
        slope = few_s / FEW if long else max(_time_s(plan, group, MORE) - few_s, 0.0) / (MORE - FEW)
        a_run += slope / group.run_s / len(tried)
        a_batch += max(few_s - FEW * slope, 0.0) / group.inferences / len(tried)
    core_s = sum(
        a_run * count[group.number] * group.run_s + a_batch * len(left[group.number]) * group.inferences
        for group in chosen
    )
    return Expected(sum(count.values()), core_s, count_tried)


def _time_s(plan: Plan, group: Group, runs: int) -> float:
    before_s = time.process_time()  # not of the clock: others may be at work here
    with suppress(CodeError):  # the study will say so, and go on
        do_batch(batch_of(plan.study, group, 0, runs))
    return time.process_time() - before_s
