"""The one loop over runs: blocks that are missing are submitted to any executor, and saved as they finish.

Blocks are taken in random order, and skipped if another process has written them: the same command on several machines
with one folder shares the work. No result depends on the executor.
"""

from __future__ import annotations

import multiprocessing
import os
import random
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import polars as pl

from vibroswarm.core.atomic_io import make_folder
from vibroswarm.core.child_python import processors, safe_start
from vibroswarm.core.jit import is_cached
from vibroswarm.errors import InputError, RunError, whole_number_of
from vibroswarm.result import write_code
from vibroswarm.scenario import plugins
from vibroswarm.simulation import check_seed, versions
from vibroswarm.study.batch import Task, block_size, simulate_runs
from vibroswarm.study.cells import Cell
from vibroswarm.study.precision import Precision
from vibroswarm.study.runs import Runs, groups_of
from vibroswarm.study.store import Store, key_of

MOST_RUNS: Final = 100_000_000
"""Most runs of a cell."""
T = TypeVar("T")
R = TypeVar("R")


class StudyProgress(NamedTuple):
    """Progress of one call: runs of motion done, and wanted."""

    done: int
    wanted: int
    kept: int = 0
    """Runs of cells that were in the folder before; told once, before the first look."""
    of: int = 0
    """Runs of cells of the first look."""


Progress = Callable[[StudyProgress], None]


def run(
    cells: Sequence[Cell],
    runs: int = 100,
    seed: int = 1,
    *,
    motion: str = "event",
    until: Precision | None = None,
    name: str = "",
    folder: Path | None = None,
    executor: str | Executor = "threads",
    workers: int | None = None,
    shard: tuple[int, int] = (1, 1),
    progress: Progress = lambda now: None,
) -> Runs:
    """Simulate the runs of cells that a folder does not hold yet.

    Args:
        runs: of each cell; with ``until``, runs are added until a figure is precise enough.
        name: a title. folder: where blocks are saved; None: they are removed with the result. They are also if the
            source text of code that a program registered is not known, by which its runs could be known again.
        executor, workers: see ``pool_for``. shard: only part K of N of the blocks, (K, N).
        progress: called as blocks finish.
    Raises:
        InputError: a value is wrong. CodeError: user code failed. RunError: the workers are gone, or the disk is full.
            Finished blocks are saved.
    """
    whole_number_of(runs, "runs", 1, MOST_RUNS)
    check_seed(seed)
    found = opened(cells, runs, seed, motion=motion, until=until, name=name, folder=folder)
    store = found.store
    store.remove_damaged()

    def take(frame: pl.DataFrame, task: Task) -> None:
        store.put(frame, task.keys, task.first, task.last)
        now.append(task.last - task.first)
        progress(StudyProgress(sum(now), wanted))

    def is_done(task: Task) -> bool:
        return store.has(task.keys, task.first, task.last)

    if found.folder:
        make_folder(found.folder)
        write_code(found.folder, (cell.scenario for cell in cells), motion)
        store.put_scenarios({found.keys[cell.number]: cell.scenario for cell in cells})
    looks = [runs] if until is None else [*until.looks()]
    kept = sum(store.there(key, 0, looks[0]) for key in found.keys.values())
    progress(StudyProgress(0, 0, kept, looks[0] * len(cells)))
    with pool_for(executor, workers) as pool:
        for look in looks:
            found = replace(found)  # which has read nothing of the store yet
            tasks = [*_missing(found, look)][shard[0] - 1 :: shard[1]]
            if not is_cached() and tasks:  # kernels are compiled here, and not by every worker
                simulate_runs(tasks[0]._replace(last=tasks[0].first + 1))
            random.shuffle(tasks)
            now, wanted = list[int](), sum(task.last - task.first for task in tasks)
            progress(StudyProgress(0, wanted))
            do_all(pool, simulate_runs, tasks, take, is_done=is_done)
            store.refresh()
    return replace(found)


def opened(
    cells: Sequence[Cell],
    runs: int,
    seed: int,
    *,
    motion: str,
    until: Precision | None,
    name: str,
    folder: Path | None,
) -> Runs:
    """Return those runs of cells that a folder holds; the arguments are those of ``run``."""
    keys = {cell.number: key_of(cell.scenario, motion) for cell in cells}
    folder = None if None in keys.values() else folder
    known = {number: key or f"cell {number}" for number, key in keys.items()}
    return Runs(tuple(cells), runs, seed, motion, Store(folder, seed, motion), known, until, name, folder)


def _missing(found: Runs, runs: int) -> Iterator[Task]:
    """Yield what is missing: for each motion and block of runs the scenarios that have not all of its runs."""
    store, code = found.store, versions()["code"]
    for group in groups_of(found.cells):
        scenarios = {found.keys[cell.number]: cell.scenario for cell in group}
        settled = found.settled.get(group[0].number)
        if settled is not None and settled.reached:
            continue
        size = block_size([*scenarios.values()], store.world["motion"], runs)
        files = plugins.texts_of({found.motion, *(code for one in scenarios.values() for code in one.codes)})
        texts = {key: scenario.to_toml() for key, scenario in scenarios.items()}
        for first in range(0, runs, size):
            last = min(first + size, runs)
            absent = [(key, texts[key]) for key in texts if store.there(key, first, last) < last - first]
            if absent:
                yield Task(tuple(absent), first, last, found.seed, found.motion, code, files)


class Pool(NamedTuple):
    """An executor, and how many calls it runs at a time."""

    executor: Executor
    width: int


def do_all(
    pool: Pool,
    function: Callable[..., R],
    tasks: Sequence[T],
    take: Callable[[R, T], None],
    *arguments: Any,
    is_done: Callable[[T], bool] = lambda task: False,
) -> None:
    """Call a function with each task that is not done, and further arguments; take results as they finish."""
    left, pending = list(reversed(tasks)), dict[Future[R], T]()
    try:
        while left or pending:
            while left and len(pending) < 2 * pool.width + 1:
                task = left.pop()
                if not is_done(task):
                    pending[pool.executor.submit(function, task, *arguments)] = task
            # Short, so that Ctrl-C is noticed.
            for future in wait(pending, timeout=1.0, return_when=FIRST_COMPLETED).done:
                take(future.result(), pending.pop(future))
    except (BrokenExecutor, CancelledError) as error:
        raise RunError(
            f"the workers are gone ({type(error).__name__}: {error}); finished work is saved, run again to continue"
        ) from error
    finally:
        for future in pending:
            future.cancel()


@contextmanager
def pool_for(executor: str | Executor = "threads", workers: int | None = None) -> Iterator[Pool]:
    """Start workers, and stop them at the end; an executor of the caller is used and not shut down.

    Args:
        executor: ``threads``, ``processes``, ``dask://HOST:PORT``, or an ``Executor``.
        workers: by default as many as processors.
    """
    count = workers or processors()
    if isinstance(executor, Executor):
        yield Pool(executor, workers or int(getattr(executor, "_max_workers", None) or 16))
    elif executor == "threads":
        with ThreadPoolExecutor(count, "vibroswarm") as threads:
            yield Pool(threads, count)
    elif executor == "processes":
        with safe_start():
            processes = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), _begin_process)
            for _ in range(count):  # each starts a process
                processes.submit(int)
        with processes:
            yield Pool(processes, count)
    elif executor.startswith("dask://"):
        yield from _dask(executor.replace("dask://", "tcp://", 1))
    else:
        raise InputError(
            f"there is no executor '{executor}'; threads, processes or dask://HOST:PORT", field="executor"
        )


def _begin_process() -> None:
    """Make a worker process ignore Ctrl-C, and end with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout = sys.stderr  # what users' code prints must not come between the results of a command
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def _dask(address: str) -> Iterator[Pool]:
    try:
        import distributed
    except ImportError:
        raise InputError("needs Dask: pip install 'vibroswarm[dask]'", field="executor") from None
    try:
        connect: Any = distributed.Client
        client = connect(address, timeout=10, set_as_default=False)
    except OSError as error:
        raise RunError(f"no Dask scheduler answers at '{address}' ({error})") from None
    with client:
        if not (threads := client.nthreads()):
            raise RunError(f"the Dask scheduler at '{address}' has no workers; start some, and run again")
        yield Pool(client.get_executor(pure=False), sum(threads.values()))
