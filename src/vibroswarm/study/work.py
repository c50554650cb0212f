"""The one loop over runs: work is submitted to workers, tried again where it failed, and taken as it is finished.

A piece of work is some successive runs of some scenarios, in plain values, so that it can be sent to a worker process.
There are two kinds, by what is kept of the runs: tables (``batch.Batch``), which a study saves, and the figures of a
cost (``optimize.evaluate.Piece``), for which a run ends with its last decision.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, TypeVar

from vibroswarm.errors import CodeError, InputError, RunError

if TYPE_CHECKING:
    from vibroswarm.study.executors import Workers

T = TypeVar("T")
R = TypeVar("R")
W = TypeVar("W", bound="Work")


@dataclass(frozen=True, kw_only=True)
class Work:
    """Successive runs of some scenarios, in plain values."""

    first: int
    """Number of the first run."""
    last: int
    """One past the number of the last run."""
    seed: int
    """Seed of all runs."""
    motion: str
    """Name of the source of motion."""
    code: tuple[tuple[str, str], ...] = ()
    """The files of user code that the scenarios need: reference to code (``plugins``) and text of each."""

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.last - self.first

    @property
    def numbers(self) -> range:
        """Numbers of the runs."""
        return range(self.first, self.last)


class WorkerDied(RuntimeError):  # noqa: N818  (the name is what is shown)
    """The process that ran a batch died: out of memory, killed, or crashed."""


LOST: Final = (WorkerDied, MemoryError, OSError)
"""Errors of the machine, which say nothing of the runs of a task."""


def parts_of(work: W, count: int) -> list[W]:
    """Divide work into ``count`` parts of nearly equal size; into one per run if it has fewer runs than that."""
    count = min(count, work.runs)
    bounds = [work.first + work.runs * k // count for k in range(count + 1)]
    return [replace(work, first=first, last=last) for first, last in pairwise(bounds)]


GO_ON: Final = "finished work is saved; run the same command again to continue"
"""End of messages about workers that are gone: how to go on."""
TRIES: Final = 2
"""How often a task is tried before it counts as failed."""


def do_all(
    workers: Workers,
    tasks: Sequence[T],
    submit: Callable[[T], Future[R]],
    take: Callable[[R, T], None],
    failed: Callable[[T, BaseException], list[T]],
    *,
    ahead: Callable[[], int],
    progress: Callable[[], None],
    rescue: Callable[[R], None] = lambda result: None,
) -> None:
    """Submit tasks and process their results in the order in which they finish.

    A task that fails is tried again, ``TRIES`` times in all, unless user code fails in it, which would fail again.

    Args:
        workers: checked if no task has finished for a second.
        tasks: submitted in this order.
        submit: starts a task. take: processes the result of a task.
        failed: called with a task that failed for good, and why; returns tasks to do in its place, first of all others.
        ahead: returns how many tasks should be submitted and unfinished now, at least 1; it may change while the work
            runs.
        progress: called each time that tasks have finished, and at least once a second.
        rescue: if an exception ends the work, called with each result that was not yet given to ``take``, so that it
            can be saved.
    Raises:
        RunError: the executor is closed, no worker is left, or a task raised it.
        InputError: a task raised it.
    """
    pending: dict[Future[R], tuple[T, int]] = {}
    left = [(task, 1) for task in reversed(tasks)]  # with the number of the try; the last one is next
    try:
        while left or pending:
            while left and len(pending) < ahead():
                task, tries = left.pop()
                try:
                    pending[submit(task)] = task, tries
                except Exception as error:  # an executor that is closed or disconnected may raise anything
                    raise workers_gone(error) from error
            finished = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED).done
            if not finished:
                workers.check()
            for future in finished:
                left += _taken(future, *pending.pop(future), take, failed)
            progress()
    except BaseException:
        for future in pending:
            was_cancelled = future.cancel()  # impossible if it runs or is done
            if not was_cancelled and future.done():
                with suppress(Exception):
                    rescue(future.result())
        raise


def _taken(
    future: Future[R],
    task: T,
    tries: int,
    take: Callable[[R, T], None],
    failed: Callable[[T, BaseException], list[T]],
) -> list[tuple[T, int]]:
    """Take the result of a finished task; return what is to be done in its place if it failed, the first one last."""
    try:
        result = future.result()
    except (BrokenExecutor, CancelledError) as error:
        raise workers_gone(error) from error
    except CodeError as error:
        return [(other, 1) for other in reversed(failed(task, error))]
    except (InputError, RunError, KeyboardInterrupt, SystemExit):
        raise  # another try would not help, or the user wants to stop
    except BaseException as error:  # a panic in polars is a BaseException, but not an Exception
        if tries < TRIES:
            return [(task, tries + 1)]
        return [(other, 1) for other in reversed(failed(task, error))]
    take(result, task)
    return []


def workers_gone(error: BaseException) -> RunError:
    """Return the error to raise when an executor broke or was closed."""
    cause = f"{type(error).__name__}: {error}".rstrip(": ")
    return RunError(f"the workers are gone ({cause}); {GO_ON}")


def results_of(
    workers: Workers,
    function: Callable[..., R],
    works: Sequence[W],
    *arguments: Any,
    progress: Callable[[int], None],
) -> list[R | str]:
    """Call a function with each piece of work, in the workers; return its results in the order of ``works``.

    The text of the exception of a piece that failed for good is its result, but not if its worker was lost: other
    workers would have given another.

    Args:
        function: importable by its name; it takes a piece, and then ``arguments``.
        progress: called with the number of finished runs.
    Raises:
        CodeError: user code failed. InputError: see ``do_all``. RunError: see ``do_all``; or the workers of a piece
            died again and again, or had no memory.
    """
    results: dict[int, R | str] = {}
    finished = 0

    def take(result: R | str, k: int) -> None:
        nonlocal finished
        results[k] = result
        finished += works[k].runs

    def failed(k: int, error: BaseException) -> list[int]:
        if isinstance(error, CodeError):
            raise error
        is_of_dask = type(error).__module__.startswith("distributed")  # its own are of lost workers
        if is_of_dask or isinstance(error, LOST):
            raise workers_gone(error) from error
        take(f"{type(error).__name__}: {error}", k)
        return []

    do_all(
        workers,
        range(len(works)),
        submit=lambda k: workers.executor.submit(function, works[k], *arguments),
        take=take,
        failed=failed,
        ahead=lambda: 4 * workers.width,  # several pieces per worker, so that none becomes idle
        progress=lambda: progress(finished),
    )
    return [results[k] for k in range(len(works))]
