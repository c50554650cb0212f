"""Run batches on threads, processes, a Dask cluster, or any executor of ``concurrent.futures``.

Threads are the default, since the kernels release the GIL. Each worker process is a pool of its own, so that one that
dies is replaced and stops no other. A worker runs ``batch.do_batch``; no result depends on the executor.
"""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
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
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

from vibroswarm.errors import InputError, RunError, check_kind, nearest, whole_number_of
from vibroswarm.simulation import versions
from vibroswarm.study.batch import Batch, BatchResult, Cancelled, do_batch

T = TypeVar("T")
R = TypeVar("R")

NAMES: Final = ("threads", "processes")
MOST_WORKERS: Final = 4096
CONNECT_S: Final = 10.0
"""Time limit for a scheduler to answer."""
CLOSE_S: Final = 5.0
WITHOUT_WORKERS_S: Final = 30.0
"""Time limit for a cluster to have no worker."""
ASK_EVERY_S: Final = 5.0
"""Interval at which the number of a cluster's workers is updated."""
GO_ON: Final = "finished work is saved; run the same command again to continue"


class WorkerDied(RuntimeError):  # noqa: N818  (the name is what is shown)
    """The process that ran a batch died: out of memory, killed, or crashed."""


@dataclass(frozen=True)
class Workers:
    """An executor, how many batches it runs at a time, and how it is stopped."""

    executor: Executor
    count: int
    name: str
    cancel: Any = None
    """Event that, once set, stops running batches; None if they cannot be stopped."""

    def submit(self, work: Batch) -> Future[BatchResult]:
        """Submit a batch."""
        if isinstance(self.executor, ThreadPoolExecutor) and self.cancel is not None:
            return self.executor.submit(do_batch, work, self.cancel.is_set)
        return self.executor.submit(do_batch, work)

    @property
    def width(self) -> int:
        """Number of batches that run at a time now."""
        return self.count

    def check(self) -> None:
        """Raise RunError if no worker is left; called when no batch has finished for a while."""


@contextmanager
def workers_for(
    executor: str | Executor = "threads", count: int | None = None, mixed: bool = False
) -> Iterator[Workers]:
    """Start workers by name, or use an executor of the caller, which is not shut down.

    Args:
        executor: ``threads``, ``processes``, ``dask://HOST:PORT``, a Dask scheduler file, or an ``Executor``.
        count: threads or processes; all processors by default. mixed: workers may have other versions.
    Raises:
        InputError: no such executor or file, or no scheduler answers.
    """
    if count is not None:
        count = whole_number_of(count, "workers", 1, MOST_WORKERS)
    check_kind(executor, (str, Executor), "executor", "the name of an executor, or an Executor")
    if isinstance(executor, Executor):
        yield Workers(executor, count or _width(executor), type(executor).__name__)
    elif executor == "threads":
        yield from _threads(count or processors())
    elif executor == "processes":
        yield from _processes(count or processors())
    elif executor.startswith(("dask://", "tcp://", "tls://")) or executor.endswith(".json"):
        yield from _dask(executor, mixed)
    else:
        raise InputError(
            f"there is no executor '{executor}'{nearest(executor, NAMES)}; threads, processes, dask://HOST:PORT, or a "
            "Dask scheduler file (.json)",
            field="executor",
        )


def do_all(
    workers: Workers,
    tasks: list[T],
    submit: Callable[[T], Future[R]],
    take: Callable[[Future[R], T], list[T]],
    *,
    ahead: Callable[[], int],
    progress: Callable[[], None],
    rescue: Callable[[Future[R]], None] = lambda future: None,
) -> None:
    """Submit tasks, starting with the last of the list, and process results in the order in which they finish.

    Args:
        take: handles a finished future; returns the tasks to submit again. ahead: how many tasks to have submitted.
        rescue: called with each future that is done but not yet taken when an exception ends the work.
    Raises:
        RunError: the executor is closed, or no worker is left.
    """
    pending: dict[Future[R], T] = {}
    try:
        while tasks or pending:
            while tasks and len(pending) < ahead():
                task = tasks.pop()
                try:
                    pending[submit(task)] = task
                except Exception as error:  # an executor that is closed or cut off may raise anything
                    raise workers_gone(error) from error
            finished = wait(pending, timeout=1.0, return_when=FIRST_COMPLETED).done
            if not finished:
                workers.check()
            for future in finished:
                try:
                    tasks += take(future, pending.pop(future))
                except (BrokenExecutor, CancelledError) as error:
                    raise workers_gone(error) from error
            progress()
    except BaseException:
        for future in pending:
            if not future.cancel() and future.done():
                with suppress(Exception):
                    rescue(future)
        raise


def workers_gone(error: BaseException) -> RunError:
    """Explain that an executor broke or was closed."""
    cause = f"{type(error).__name__}: {error}".rstrip(": ")
    return RunError(f"the workers are gone ({cause}); {GO_ON}")


def processors() -> int:
    """Return the number of processors that this process may use; a batch system may grant fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _width(executor: Executor) -> int:
    return int(getattr(executor, "_max_workers", None) or 16)


def _threads(count: int) -> Iterator[Workers]:
    """Yield workers that are threads."""
    pool, cancel = ThreadPoolExecutor(count, thread_name_prefix="vibroswarm"), threading.Event()
    wait_for_threads = True
    try:
        yield Workers(pool, count, f"{count} thread{'s' * (count > 1)}", cancel)
    except KeyboardInterrupt:
        wait_for_threads = False  # one that compiles cannot be stopped, and may take a minute
        raise
    finally:
        cancel.set()
        pool.shutdown(wait=wait_for_threads, cancel_futures=True)


class SingleProcessPools(Executor):
    """Worker processes, each a pool of its own: one that dies is replaced, and only its batch is lost."""

    def __init__(self, count: int) -> None:
        self._context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        self.cancel = self._context.Event()
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="vibroswarm-process")
        self._own = threading.local()
        self._pools: list[ProcessPoolExecutor] = []
        self._lock = threading.Lock()

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit a call; its future raises ``WorkerDied`` if the process dies."""
        return self._threads.submit(self._in_process, function, arguments, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop the processes when they have finished their calls."""
        self.cancel.set()
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        with self._lock:
            for pool in self._pools:
                pool.shutdown(wait=wait, cancel_futures=True)

    def _in_process(self, function: Any, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        """Run a function in this thread's own worker process. Raises ``WorkerDied`` if the process dies."""
        _hold_off_ctrl_c()
        pool = getattr(self._own, "pool", None)
        if pool is None:
            pool = self._own.pool = ProcessPoolExecutor(1, self._context, _begin_process, (self.cancel,))
            with self._lock:
                self._pools.append(pool)
        try:
            return pool.submit(function, *arguments, **named).result()
        except BrokenProcessPool:
            self._own.pool = None
            pool.shutdown(wait=False)
            raise WorkerDied("the worker process died (out of memory, killed, or crashed)") from None


def _hold_off_ctrl_c() -> None:
    """Block Ctrl-C in this thread: processes that it starts inherit the block, until they ignore Ctrl-C themselves."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


_cancel: Any = None


def _begin_process(cancel: Any) -> None:
    """Initialise a worker process: it ignores Ctrl-C and ends when its parent ends."""
    global _cancel
    _cancel = cancel
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do_in_process(work: Batch) -> BatchResult:
    return do_batch(work, _cancel.is_set)


@dataclass(frozen=True)
class _ProcessWorkers(Workers):
    def submit(self, work: Batch) -> Future[BatchResult]:
        return self.executor.submit(_do_in_process, work)


def _processes(count: int) -> Iterator[Workers]:
    """Yield workers that are processes."""
    pool = SingleProcessPools(count)
    wait_for_processes = True
    try:
        yield _ProcessWorkers(pool, count, f"{count} process{'es' * (count > 1)}", pool.cancel)
    except KeyboardInterrupt:
        wait_for_processes = False
        raise
    finally:
        pool.shutdown(wait=wait_for_processes, cancel_futures=True)


class _ClusterState:
    """Last known number of threads of a cluster, with the times of the last check and of the last one with workers."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.checked_s = self.with_workers_s = time.monotonic()


@dataclass(frozen=True)
class _DaskWorkers(Workers):
    """Workers of a cluster, which may join and leave; the study stops if there is none for a while."""

    client: Any = None
    seen: _ClusterState = field(default_factory=lambda: _ClusterState(1))

    @property
    def width(self) -> int:
        if time.monotonic() - self.seen.checked_s > ASK_EVERY_S:
            self.check()
        return max(self.seen.threads, 1)

    def check(self) -> None:
        """Raise ``RunError`` if the scheduler is gone or has had no worker for ``WITHOUT_WORKERS_S``."""
        try:
            threads = sum(self.client.nthreads().values())
        except Exception as error:  # a closed or disconnected client may raise anything
            raise RunError(f"the Dask scheduler is gone ({type(error).__name__}); {GO_ON}") from error
        self.seen.threads, self.seen.checked_s = threads, time.monotonic()
        if threads:
            self.seen.with_workers_s = self.seen.checked_s
        elif self.seen.checked_s - self.seen.with_workers_s > WITHOUT_WORKERS_S:
            raise RunError(f"the Dask scheduler has had no worker for {WITHOUT_WORKERS_S:g} s; {GO_ON}")


def _dask(address: str, mixed: bool) -> Iterator[Workers]:
    """Connect to the workers of a running Dask cluster, which need the same version of vibroswarm."""
    try:
        import distributed
    except ImportError:
        raise InputError("needs Dask: pip install 'vibroswarm[dask]'", field="executor") from None
    for name in ("distributed.client", "distributed.core", "distributed.comm"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # we report their failures ourselves, once
    client = _connected(distributed.Client, address)
    try:
        threads = client.nthreads()
        if not threads:
            raise RunError(
                f"the Dask scheduler at '{address}' has no workers; start some, and run the same command again"
            )
        _check_dask_versions(client, mixed)
        pool, count = client.get_executor(pure=False), max(sum(threads.values()), 1)
        yield _DaskWorkers(
            pool, count, f"{len(threads)} Dask workers", client=client, seen=_ClusterState(count)
        )
    finally:
        client.close(timeout=CLOSE_S)


def _connected(connect: Any, address: str) -> Any:
    """Connect to the scheduler at an address, or the one that a file names."""
    if address.endswith(".json") and not Path(address).is_file():
        raise InputError(f"there is no scheduler file '{address}'", field="executor")
    address_or_file = (
        {"scheduler_file": address}
        if address.endswith(".json")
        else {"address": address.replace("dask://", "tcp://", 1)}
    )
    try:
        return connect(**address_or_file, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # an address or a file may be wrong in many ways
        cause = str(error).splitlines()[0] if str(error) else type(error).__name__
    gc.collect()  # of the failed client; if it ran later, while another client starts, Dask would deadlock
    raise InputError(f"no Dask scheduler answers at '{address}' ({cause})", field="executor")


def _check_dask_versions(client: Any, mixed: bool) -> None:
    """Refuse workers without vibroswarm or with another version; those that join later are checked by their batches."""
    for worker, reply in client.run(versions, on_error="return").items():
        if isinstance(reply, Exception):
            raise InputError(
                f"worker {worker} cannot import vibroswarm ({type(reply).__name__}: {reply}); install the same version",
                field="executor",
            )
        check_worker(reply, mixed, worker)


def check_worker(theirs: Mapping[str, str], mixed: bool, worker: str = "a worker") -> None:
    """Refuse a worker with other versions, unless they may be mixed."""
    if not mixed and (different := _different_versions(theirs)):
        raise InputError(
            f"{worker} has other versions than this process ({different}); install the same, or add --mixed",
            field="executor",
        )


def check_begun_by(theirs: Mapping[str, str], folder: Path) -> None:
    """Refuse to continue a study that other versions began: no single version could repeat all of its runs.

    Raises:
        InputError: the versions differ; the message names them.
    """
    if different := _different_versions(theirs):
        raise InputError(
            f"was begun by other versions ({different}); continue with those, choose a new folder, or add --mixed "
            "to continue anyway",
            field=str(folder),
        )


def _different_versions(theirs: Mapping[str, str]) -> str:
    own = versions()
    return "; ".join(f"{k} {theirs.get(k)} there, {own[k]} here" for k in own if theirs.get(k) != own[k])


__all__ = ["Cancelled", "SingleProcessPools", "WorkerDied", "Workers", "workers_for"]
