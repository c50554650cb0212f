"""A study is done: what is missing in its store is given to workers, and what comes back is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from vibroswarm.compiled import is_cached
from vibroswarm.errors import CodeError, InputError, RunError
from vibroswarm.forked import check_threads
from vibroswarm.study.executors import GO_ON, Workers, check_worker, workers_for
from vibroswarm.study.looks import settled
from vibroswarm.study.plan import Group, Plan, plan_of
from vibroswarm.study.precision import Precision
from vibroswarm.study.spec import MOST_RUNS, Study
from vibroswarm.study.store import Store
from vibroswarm.study.work import Cancelled, Done, Work, do, work_of

TRIES: Final = 2
MOST_HALVINGS: Final = 100
"""How often batches are cut in half to find the runs in which the user's code fails."""


class Share(NamedTuple):
    """One of so many shares of a study: number 1 to ``of``."""

    number: int
    of: int

    @classmethod
    def from_words(cls, text: str) -> Share:
        """From ``"3/16"``."""
        number, _, of = text.partition("/")
        if not (number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)):
            raise InputError(f"'{text}' is no share; such as 3/16", field="--shard")
        return cls(int(number), int(of))

    def has(self, group: Group, block: int) -> bool:
        """Whether a block is of this share; each block is of one."""
        return (group.number + block) % self.of == self.number - 1


class Told(NamedTuple):
    """How far the work is: runs done, runs to do (of groups, all told), batches failed."""

    done: int
    wanted: int
    failed: int


Tell = Callable[[Told], None]


def run_study(
    study: Study,
    folder: str | Path,
    *,
    executor: str | Executor = "threads",
    workers: int | None = None,
    share: Share | None = None,
    mixed: bool = False,
    tell: Tell | None = None,
    bear_failures: bool = False,
) -> Store:
    """Do what is missing of a study, and keep it in ``folder``; may be stopped and called again at any moment.

    Args:
        executor, workers: see ``executors.workers_for``.
        share: only this share of the blocks. mixed: also go on where other versions began.
        tell: called as batches come back. bear_failures: give the store also where runs failed, which it tells.
    Raises:
        InputError: another study is there, nobody answers at ``executor``, or a worker has other versions.
        RunError: the disk is full, the cluster is gone, or batches failed twice; what was done is kept.
    """
    check_threads()
    if share is not None and study.until is not None:
        raise InputError(
            "goes with a number of runs, not with a precision: shares know nothing of each other",
            field="--shard",
        )
    plan, there = plan_of(study), Store.existing(folder, study)
    if there is None or not _all_there(there, plan, share):
        if there is not None and not mixed:
            there.check_versions()
        with workers_for(
            executor, workers, mixed
        ) as crew:  # before the folder is made: they may not be there
            there = Store.open_or_create(folder, study)
            if not isinstance(executor, str) or executor != "threads":
                _compile_first(study, plan)
            runner = _Runner(there, crew, mixed, tell or (lambda told: None))
            if study.until is None:
                runner.do([(group, study.runs or 0) for group in plan.groups], share)
            else:
                _until_settled(runner, plan, study.until)
    store = Store.open_or_create(folder, study) if there is None else there
    with suppress(
        InputError, RunError
    ):  # a number of runs that is there already, in a folder that is only read
        store.write_head()
    if store.failures and not bear_failures:
        raise RunError(failures_in_words(store))
    return store


def _until_settled(runner: _Runner, plan: Plan, precision: Precision) -> None:
    """Look by look; a group that is settled gets no more runs. After a failure there is nothing to look at."""
    left = list(plan.groups)
    for runs in precision.looks():
        runner.do([(group, runs) for group in left], None)
        if runner.failed:
            return
        left = [group for group in left if settled(runner.store, group, precision) is None]


def _compile_first(study: Study, plan: Plan) -> None:
    """Compile here what several processes would each compile for themselves; nothing where it is kept already."""
    if not is_cached():
        with suppress(CodeError):
            do(work_of(study, plan.groups[0], 0, 1))


def run_batch(study: Study, folder: str | Path, batch: str) -> Store:
    """Do one batch here and now, ``GROUP:FIRST-LAST`` as failures are told; what goes wrong is raised as it is."""
    group, _, runs = batch.partition(":")
    first, _, last = runs.partition("-")
    if not (
        group.isdecimal() and first.isdecimal() and last.isdecimal() and int(first) < int(last) <= MOST_RUNS
    ):
        raise InputError(f"'{batch}' is no batch; GROUP:FIRST-LAST, such as 0:200-400", field="--batch")
    groups = plan_of(study).groups
    if int(group) >= len(groups):
        raise InputError(f"there is no group {group}; the study has {len(groups)}, from 0", field="--batch")
    store = Store.open_or_create(folder, study)
    store.add(do(work_of(study, groups[int(group)], int(first), int(last))))
    return store


def _all_there(store: Store, plan: Plan, share: Share | None) -> bool:
    runs, until = store.study.runs, store.study.until
    if until is not None:
        return all(settled(store, group, until) is not None for group in plan.groups)
    return not any(_works(store, [(group, runs or 0) for group in plan.groups], share))


def _works(store: Store, wanted: Sequence[tuple[Group, int]], share: Share | None) -> Iterator[Work]:
    for group, runs in wanted:
        for block, first, last in store.missing(group, runs):
            if share is None or share.has(group, block):
                yield work_of(store.study, group, first, last)


class _Runner:
    """Gives out batches and keeps what comes back."""

    def __init__(self, store: Store, crew: Workers, mixed: bool, tell: Tell) -> None:
        self.store, self.crew, self.mixed, self.tell = store, crew, mixed, tell
        self.done = self.wanted = self.failed = self.halvings = 0

    def do(self, wanted: Sequence[tuple[Group, int]], share: Share | None) -> None:
        """Do what is missing of the runs wanted."""
        works = list(_works(self.store, wanted, share))
        self.wanted += sum(work.last - work.first for work in works)
        self.tell(Told(self.done, self.wanted, self.failed))
        waiting = [(work, 1) for work in reversed(works)]
        under_way: dict[Future[Done], tuple[Work, int]] = {}
        try:
            while waiting or under_way:
                while waiting and len(under_way) < 2 * self.crew.width + 1:
                    work, tries = waiting.pop()
                    under_way[self._submit(work)] = work, tries
                finished = wait(under_way, timeout=1.0, return_when=FIRST_COMPLETED).done
                if not finished:
                    self.crew.check()
                for future in finished:
                    waiting += self._keep(future, *under_way.pop(future))
                self.tell(Told(self.done, self.wanted, self.failed))
        except BaseException:
            self._keep_what_is_done(under_way)
            raise

    def _submit(self, work: Work) -> Future[Done]:
        try:
            return self.crew.submit(work)
        except Exception as error:  # whatever an executor says when it is closed or cut off
            raise _gone(error) from error

    def _keep(self, future: Future[Done], work: Work, tries: int) -> list[tuple[Work, int]]:
        """Keep a batch that came back; what is to be done again, whole or in halves."""
        try:
            done = future.result()
        except CodeError as error:
            return self._halves(work, str(error))
        except (InputError, RunError):
            raise
        except (BrokenExecutor, CancelledError) as error:
            raise _gone(error) from error
        except (KeyboardInterrupt, SystemExit):
            raise
        except BaseException as error:  # a panic of polars is no Exception
            if tries < TRIES:
                return [(work, tries + 1)]
            self.store.add_failure(work, f"{type(error).__name__}: {error}")
            self.failed += 1
            return []
        check_worker(done.versions, self.mixed)
        self.store.add(done)
        self.done += work.last - work.first
        return []

    def _halves(self, work: Work, why: str) -> list[tuple[Work, int]]:
        """A batch in which the user's code failed, in halves, so that the runs in which it does not are kept."""
        middle = (work.first + work.last) // 2
        if middle > work.first and self.halvings < MOST_HALVINGS:
            self.halvings += 1
            return [(replace(work, first=middle), 1), (replace(work, last=middle), 1)]
        self.store.add_failure(work, why)
        self.failed += 1
        return []

    def _keep_what_is_done(self, under_way: dict[Future[Done], tuple[Work, int]]) -> None:
        for future in under_way:
            if not future.cancel() and future.done():
                with suppress(Exception):
                    done = future.result()
                    check_worker(done.versions, self.mixed)
                    self.store.add(done)


def _gone(error: BaseException) -> RunError:
    why = f"{type(error).__name__}: {error}".rstrip(": ")
    return RunError(f"the workers are gone ({why}); {GO_ON}")


def failures_in_words(store: Store, kept: bool = True) -> str:
    """How many runs of a store failed, why the first of them did, and what can be done."""
    failures = store.failures
    first, runs = failures[0], sum(one["last"] - one["first"] for one in failures)
    batches = "1 batch" if len(failures) == 1 else f"{len(failures)} batches"
    words = f"{runs:,} run{'s' * (runs != 1)} failed, in {batches}"
    if not kept:
        return f"{words}; the first is run {first['first']} with seed {first['seed']} ({first['why']})."
    return (
        f"{words}; all else is kept. The first is batch {first['batch']} with seed {first['seed']} ({first['why']}). "
        f"Run it alone with --batch {first['batch']}; say the same again to try all of them again. They are listed "
        f"in '{store.folder}/failures'."
    )


__all__ = ["Cancelled", "Share", "Told", "failures_in_words", "run_batch", "run_study"]
