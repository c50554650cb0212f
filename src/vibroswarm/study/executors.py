"""Run batches on threads, processes, a Dask cluster, or any executor of ``concurrent.futures``.

Threads are the default, since the kernels release the GIL. Each worker process has a process pool of its own, so a
process that dies is replaced and stops no other. A worker runs ``batch.do_batch``; no result depends on the executor.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Final

from vibroswarm.core import numbers
from vibroswarm.core.child_python import MOST_WORKERS, processors, safe_start
from vibroswarm.errors import InputError, RunError, check_kind, nearest, whole_number_of
from vibroswarm.simulation import versions
from vibroswarm.study.batch import Batch, BatchResult, Cancelled, do_batch
from vibroswarm.study.work import GO_ON, WorkerDied

NAMES: Final = ("threads", "processes")
"""Executors that are given by a name."""
CONNECT_S: Final = 10.0
"""Time limit for a Dask scheduler to answer."""
ANSWER_S: Final = 20.0
"""Time limit for a Dask scheduler, once connected, to say which workers it has."""
IMPORT_S: Final = 120.0
"""Time limit for Dask workers to import vibroswarm and to send its versions."""
CLOSE_S: Final = 5.0
"""Time limit for closing the connection to a Dask scheduler."""
WITHOUT_WORKERS_S: Final = 30.0
"""A cluster that has had no worker for longer than this is an error."""
ASK_EVERY_S: Final = 5.0
"""Interval at which the number of a cluster's workers is updated."""
STUCK_S: Final = 2.0
"""Time after which a worker process ends although its call has not returned, after the work was stopped."""


@dataclass
class Workers:
    """An executor, how many batches it runs at a time, and how a batch learns that the study was stopped."""

    executor: Executor
    count: int
    """Number of batches that run at a time, as long as no workers join or leave."""
    name: str
    """Number and kind of the workers in words: ``4 threads``."""
    cancelled: tuple[Callable[[], bool], ...] = ()
    """A function that workers can call, which returns whether the study was stopped; empty: they cannot be stopped."""

    def submit(self, work: Batch) -> Future[BatchResult]:
        """Submit a batch."""
        return self.executor.submit(do_batch, work, *self.cancelled)

    @property
    def width(self) -> int:
        """Number of batches that run at a time now."""
        return self.count

    def check(self) -> None:
        """Raise RunError if no worker is left; called when no batch has finished for a while.

        Here it does nothing; ``_DaskWorkers`` overrides it.
        """


@contextmanager
def workers_for(
    executor: str | Executor = "threads", count: int | None = None, mixed: bool = False
) -> Iterator[Workers]:
    """Context manager: start workers and stop them at the end. An executor of the caller is used and not shut down.

    Args:
        executor: ``threads``, ``processes``, ``dask://HOST:PORT`` (also ``tcp://`` or ``tls://``), the path of a Dask
            scheduler file (``.json``), or an ``Executor``.
        count: number of threads or processes, or of batches that an ``Executor`` runs at a time; by default as many as
            there are processors, or as the executor has workers. Dask does not use it.
        mixed: whether Dask workers may have other versions of vibroswarm and its libraries.
    Raises:
        InputError: ``count`` is not a whole number from 1 to ``MOST_WORKERS``, there is no such executor or file, Dask
            is not installed, no scheduler answers, or a Dask worker has no vibroswarm or other versions.
        RunError: the Dask scheduler has no workers, or processes cannot be started here.
    """
    if count is not None:
        count = whole_number_of(count, "workers", 1, MOST_WORKERS)
    check_executor(executor)
    own = count or processors()
    if isinstance(executor, Executor):
        yield Workers(executor, count=count or _width(executor), name=type(executor).__name__)
    elif executor == "threads":
        cancel, threads = threading.Event(), ThreadPoolExecutor(own, "vibroswarm")
        workers = Workers(threads, own, numbers.count(own, "thread"), (cancel.is_set,))
        yield from _stopped_at_end(workers, cancel.set)
    elif executor == "processes":
        pools, name = SingleProcessPools(own), numbers.count(own, "process", "processes")
        yield from _stopped_at_end(Workers(pools, own, name, (_is_cancelled,)), pools.cancel.set)
    else:
        yield from _dask(executor, mixed)


def check_executor(executor: str | Executor) -> None:
    """Refuse what is neither an executor, nor the name of one, nor an address or file of a Dask scheduler.

    It does not connect to the scheduler.
    """
    check_kind(
        executor,
        (str, Executor),
        "executor",
        "threads, processes, the address of a Dask scheduler, or an Executor",
    )
    if isinstance(executor, Executor) or executor in NAMES:
        return
    if not (executor.startswith(("dask://", "tcp://", "tls://")) or executor.endswith(".json")):
        raise InputError(
            f"there is no executor '{executor}'{nearest(executor, NAMES)}; threads, processes, dask://HOST:PORT, or a "
            "Dask scheduler file (.json)",
            field="executor",
        )


def _width(executor: Executor) -> int:
    """Return an executor's number of workers, as ``concurrent.futures`` stores it; assume 16 if it is not there."""
    return int(getattr(executor, "_max_workers", None) or 16)


def _stopped_at_end(workers: Workers, cancel: Callable[[], None]) -> Iterator[Workers]:
    """Yield workers of this computer, once, and stop them afterwards; ``cancel`` stops their batches."""
    wait = True
    try:
        yield workers
    except KeyboardInterrupt:
        # A thread or process that compiles a kernel cannot be stopped, and may take a minute.
        wait = False
        raise
    finally:
        cancel()
        workers.executor.shutdown(wait=wait, cancel_futures=True)


class _ProcessFlag:
    """A flag that processes share: once set, it stays set. It can be passed to a process only at the process's start.

    It has no lock, unlike ``multiprocessing.Event``: a process that was killed while it held the lock would block all
    others for ever.
    """

    def __init__(self) -> None:
        self._byte = multiprocessing.get_context("spawn").RawValue(ctypes.c_bool, False)

    def set(self) -> None:
        """Set the flag."""
        self._byte.value = True

    def is_set(self) -> bool:
        """Return whether the flag is set."""
        return bool(self._byte.value)


class SingleProcessPools(Executor):
    """An executor of worker processes, each in a pool of its own.

    A pool whose process dies can no longer be used. With a pool for each process, only the call in the dead process is
    lost, and a new pool replaces it. For each process there is a thread that waits for its results.
    """

    def __init__(self, count: int) -> None:
        self._context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        if multiprocessing.current_process().daemon:
            raise RunError(
                "a daemonic process, as of multiprocessing.Pool, cannot start processes; use threads instead"
            )
        try:
            self.cancel = _ProcessFlag()
        except OSError as error:
            raise RunError(f"processes cannot share memory ({error}); use threads instead") from error
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="vibroswarm-process")
        # In each thread, ``process``: its own process. Not set before the first call; None after a death.
        self._own = threading.local()
        self._processes: list[_OneProcess] = []
        self._lock = threading.Lock()

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit a call; its future raises ``WorkerDied`` if the process dies."""
        return self._threads.submit(self._in_process, function, arguments, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Stop running batches, and end the processes when their calls have returned.

        Args:
            wait: whether to wait until the processes have ended. cancel_futures: whether to drop the calls that have
                not begun; true wherever this package calls it.
        """
        self.cancel.set()
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        with self._lock:
            for process in self._processes:
                # It has one call at most. Without ``wait`` this call may not have begun; then it is dropped.
                process.pool.shutdown(wait=wait, cancel_futures=True)

    def _in_process(self, function: Any, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        """Run a function in this thread's own worker process.

        Raises:
            WorkerDied: the process died.
            RunError: no process can be started, or none is any longer, after ``shutdown``.
        """
        process = getattr(self._own, "process", None)
        if process is None:
            with self._lock:  # a process whose parent ends while it starts prints a traceback
                if self.cancel.is_set():
                    raise RunError("stopped before its process was started")
                process = self._own.process = _OneProcess.start(self._context, self.cancel)
                self._processes.append(process)
        try:
            return process.pool.submit(function, *arguments, **named).result()
        except BrokenProcessPool:
            self._own.process = None  # so that this thread's next call starts a new process
            process.pool.shutdown(wait=False)
            if process.begun.is_set():
                raise WorkerDied("the worker process died (out of memory, killed, or crashed)") from None
            if any(other.begun.is_set() for other in self._processes):
                raise WorkerDied("the worker process died while it started") from None
            # None has started yet: another try would not help.
            raise RunError(
                "worker processes cannot start: see the error printed above. A script may start them only below "
                'the line if __name__ == "__main__": and only if it is a file, not standard input'
            ) from None


@dataclass(frozen=True)
class _OneProcess:
    """A pool of a single process."""

    pool: ProcessPoolExecutor
    begun: _ProcessFlag
    """Set by the process when it has imported what it needs and can take calls."""

    @classmethod
    def start(cls, context: Any, cancel: _ProcessFlag) -> _OneProcess:
        """Start a process that stops its batch when ``cancel`` is set."""
        begun = _ProcessFlag()
        with safe_start():
            _hold_off_ctrl_c()
            pool = ProcessPoolExecutor(1, context, _begin_process, (cancel, begun))
            pool.submit(int)  # a pool starts its process at its first call
        return cls(pool, begun)


def _hold_off_ctrl_c() -> None:
    """Block Ctrl-C for processes that this thread starts, until they ignore it themselves (``_begin_process``)."""
    if hasattr(signal, "pthread_sigmask"):
        resource_tracker.ensure_running()  # else it starts with the first process, and lets Ctrl-C through again
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


_cancel: Any = None
"""In a worker process, the flag that stops its batch. It is replaced by the parent's when the process starts."""


def _begin_process(cancel: _ProcessFlag, begun: _ProcessFlag) -> None:
    """Initialise a worker process: it keeps the flag that stops it, ignores Ctrl-C, and ends with its parent."""
    global _cancel
    _cancel = cancel
    sys.stdout = sys.stderr  # what users' code prints must not come between the results of a command
    begun.set()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_in_time, daemon=True).start()


def _end_in_time() -> None:
    """End this process, with whatever it is computing, with its parent, or ``STUCK_S`` after the work was stopped."""
    parent = multiprocessing.parent_process()
    if parent is not None:  # it is None only in a process that multiprocessing did not start
        while parent.is_alive() and not _is_cancelled():
            parent.join(timeout=STUCK_S / 4)
        parent.join(timeout=STUCK_S)
        os._exit(1)  # ends the process without waiting for its other threads


def _is_cancelled() -> bool:
    return bool(_cancel.is_set())


class _DaskExecutor(Executor):
    """An executor of a Dask client.

    A future of Dask's own ``Client.get_executor`` stays unfinished for ever if its result cannot be fetched, as when
    the scheduler ends while it sends the result.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        """Submit a call. ``pure=False``: equal calls are run again, instead of sharing one result."""
        future: Future[Any] = Future()
        self._client.loop.add_callback(
            _pass_on, self._client.submit(function, *arguments, pure=False, **named), future
        )
        return future


async def _pass_on(theirs: Any, future: Future[Any]) -> None:
    """Wait for a future of Dask, and give ``future`` its result or its exception."""
    result: Any = None
    failure: BaseException | None = None
    try:
        result = await theirs
    except CancelledError as error:
        failure = _gone(error)
    except BaseException as error:  # the task's own, or that its result cannot be fetched
        failure = error
    if not future.set_running_or_notify_cancel():  # the study was stopped
        return
    if failure is None:
        future.set_result(result)
    else:
        future.set_exception(failure)


@dataclass
class _DaskWorkers(Workers):
    """Workers of a Dask cluster, which may join and leave; the study stops if there is no worker for a while."""

    client: Any = None
    """``distributed.Client``."""
    checked_s: float = field(default_factory=time.monotonic)
    """When the cluster's threads were counted last."""
    with_workers_s: float = field(default_factory=time.monotonic)
    """When it last had a worker."""

    @property
    def width(self) -> int:
        """Number of batches that run at a time: the cluster's threads, but at least 1.

        If the last count is older than ``ASK_EVERY_S``, ``check`` counts them again, and may raise ``RunError``.
        """
        if time.monotonic() - self.checked_s > ASK_EVERY_S:
            self.check()
        return self.count

    def check(self) -> None:
        """Count the cluster's threads again; raise ``RunError`` if it has had no worker for ``WITHOUT_WORKERS_S``.

        ``RunError`` is also raised if the scheduler does not answer.
        """
        threads = sum(_threads_of(self.client).values())
        self.count, self.checked_s = max(threads, 1), time.monotonic()
        if threads:
            self.with_workers_s = self.checked_s
        elif self.checked_s - self.with_workers_s > WITHOUT_WORKERS_S:
            raise RunError(f"the Dask scheduler has had no worker for {WITHOUT_WORKERS_S:g} s; {GO_ON}")


def _threads_of(client: Any) -> dict[str, int]:
    """Return how many threads each worker of a cluster has.

    Raises:
        RunError: the scheduler does not answer.
    """
    return dict(_answer(client, ANSWER_S, client.nthreads))


def _answer(client: Any, limit_s: float, ask: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """Return what a method of a Dask client returns, which by itself would wait for the scheduler without limit.

    Raises:
        RunError: the scheduler has ended, or no answer comes within ``limit_s``.
    """

    async def answer() -> Any:
        return await ask(*arguments, **named)

    try:
        return client.sync(answer, callback_timeout=limit_s)
    except TimeoutError as error:
        raise RunError(f"the Dask cluster has not answered for {limit_s:g} s; {GO_ON}") from error
    except Exception as error:  # a closed or disconnected client may raise anything
        raise _gone(error) from error


def _gone(error: Exception) -> RunError:
    return RunError(f"the Dask scheduler is gone or has restarted ({type(error).__name__}); {GO_ON}")


def _dask(address: str, mixed: bool) -> Iterator[Workers]:
    """Connect to a running Dask cluster, yield its workers once, and close the connection afterwards.

    Args:
        address: ``dask://HOST:PORT``, also ``tcp://`` or ``tls://``, or the path of a scheduler file. mixed: whether
            workers may have other versions.
    Raises:
        InputError: Dask is not installed, there is no such file, no scheduler answers, or a worker has no vibroswarm or
            other versions.
        RunError: the scheduler has no workers.
    """
    try:
        import distributed
    except ImportError:
        raise InputError("needs Dask: pip install 'vibroswarm[dask]'", field="executor") from None
    for name in ("distributed.client", "distributed.core", "distributed.comm"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # we report their failures ourselves, once
    client = _connected(distributed.Client, address)
    try:
        threads = _threads_of(client)
        if not threads:
            raise RunError(
                f"the Dask scheduler at '{address}' has no workers; start some, and run the same command again"
            )
        _check_dask_versions(client, mixed)
        # ``count`` is at least 1, so that batches are submitted even if the workers report no threads.
        count = max(sum(threads.values()), 1)
        yield _DaskWorkers(_DaskExecutor(client), count, name=f"{len(threads)} Dask workers", client=client)
    finally:
        with suppress(Exception):  # the scheduler may have ended, or not answer
            client.close(timeout=CLOSE_S)


def _connected(connect: Any, address: str) -> Any:
    """Connect to a Dask scheduler.

    Args:
        connect: ``distributed.Client``. address: of the scheduler, or the path of its scheduler file.
    Raises:
        InputError: no such file, or no scheduler answers.
    """
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
    # The failed client is freed here. If Python freed it later, while another client starts, Dask would deadlock. The
    # error is raised below and not in ``except``, where the caught error still refers to the client.
    gc.collect()
    raise InputError(f"no Dask scheduler answers at '{address}' ({cause})", field="executor")


def _check_dask_versions(client: Any, mixed: bool) -> None:
    """Refuse a cluster if a worker has no vibroswarm, or other versions unless they may be ``mixed``.

    Workers that join later are checked when their first batch comes back.

    Raises:
        InputError: a worker is refused. RunError: the scheduler has ended, or a worker does not answer.
    """
    from distributed.comm.core import CommClosedError

    replies = _answer(client, IMPORT_S, client.run, versions, on_error="return")
    for worker, reply in replies.items():
        if isinstance(reply, CommClosedError):  # it has died since
            continue
        if isinstance(reply, Exception):
            raise InputError(
                f"worker {worker} cannot import vibroswarm ({type(reply).__name__}: {reply}); install the same version",
                field="executor",
            )
        check_worker(reply, mixed, worker)


def check_worker(theirs: Mapping[str, str], mixed: bool, worker: str = "a worker") -> None:
    """Refuse a worker with other versions than this process, unless versions may be ``mixed``.

    Args:
        theirs: ``simulation.versions`` of the worker. worker: what the message calls it.
    Raises:
        InputError: the versions differ; the message names them.
    """
    if not mixed and (different := different_versions(theirs)):
        raise InputError(
            f"{worker} has other versions than this process ({different}); install the same, or add --mixed",
            field="executor",
        )


def check_begun_by(theirs: Mapping[str, str], folder: Path) -> None:
    """Refuse to continue a study that other versions began: no single version could repeat all of its runs.

    Args:
        theirs: ``simulation.versions`` with which the study in ``folder`` was begun.
    Raises:
        InputError: the versions differ; the message names them.
    """
    if different := different_versions(theirs):
        raise InputError(
            f"was begun by other versions ({different}); continue with those, choose a new folder, or add --mixed "
            "to continue anyway",
            field=str(folder),
        )


def different_versions(theirs: Mapping[str, str]) -> str:
    """Write how other versions differ from those of this process; empty if in nothing."""
    own = versions()
    return "; ".join(f"{k} {theirs.get(k)} there, {own[k]} here" for k in own if theirs.get(k) != own[k])


__all__ = ["Cancelled", "SingleProcessPools", "WorkerDied", "Workers", "workers_for"]
