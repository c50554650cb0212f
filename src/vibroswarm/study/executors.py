"""Who does the work: threads, processes, a Dask cluster, or any executor of ``concurrent.futures``.

Threads are the default: the kernels hold no lock. A process that dies takes no other with it: each worker is a pool of
one process, which is replaced. What a worker does is ``work.do``; no result depends on who does it.
"""

from __future__ import annotations

import gc
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from vibroswarm.errors import InputError, RunError, nearest
from vibroswarm.simulation import versions
from vibroswarm.study.work import Cancelled, Done, Work, do

NAMES: Final = ("threads", "processes")
CONNECT_S: Final = 10.0
"""How long a scheduler may take to answer."""
CLOSE_S: Final = 5.0
WITHOUT_WORKERS_S: Final = 30.0
"""How long a cluster may be without any worker."""
ASK_EVERY_S: Final = 5.0
"""How often a cluster is asked for workers that came or went."""
GO_ON: Final = "what is done is kept; say the same again to go on from here"


class WorkerDied(RuntimeError):  # noqa: N818  (the name is what is shown)
    """The process that did a batch is gone: out of memory, killed, or crashed."""


@dataclass(frozen=True)
class Workers:
    """An executor with what the runner must know of it: how many batches it does at a time, and how it is stopped."""

    executor: Executor
    count: int
    name: str
    cancel: Any = None
    """An event that stops batches under way."""

    def submit(self, work: Work) -> Future[Done]:
        """Have a batch done."""
        if isinstance(self.executor, ThreadPoolExecutor) and self.cancel is not None:
            return self.executor.submit(do, work, self.cancel.is_set)
        return self.executor.submit(do, work)

    @property
    def width(self) -> int:
        """Batches that are done at a time, now."""
        return self.count

    def check(self) -> None:
        """Raise RunError where nobody is left who could do a batch; asked when none came back for a while."""


@contextmanager
def workers_for(
    executor: str | Executor = "threads", count: int | None = None, mixed: bool = False
) -> Iterator[Workers]:
    """Workers by name, or an executor of the caller's, which is left as it is.

    Args:
        executor: ``threads``, ``processes``, ``dask://HOST:PORT``, a Dask scheduler file, or an ``Executor``.
        count: threads or processes; all processors without. mixed: workers may have other versions.
    Raises:
        InputError: no such executor, no such file, or nobody answers there.
    """
    if count is not None and count < 1:
        raise InputError(f"{count} is too few; at least 1", field="workers")
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


def processors() -> int:
    """Processors that this process may use; a batch system gives fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _width(executor: Executor) -> int:
    return int(getattr(executor, "_max_workers", None) or 16)


def _threads(count: int) -> Iterator[Workers]:
    pool, cancel = ThreadPoolExecutor(count, thread_name_prefix="vibroswarm"), threading.Event()
    try:
        yield Workers(pool, count, f"{count} thread{'s' * (count > 1)}", cancel)
    finally:
        cancel.set()
        pool.shutdown(cancel_futures=True)


class OneEach(Executor):
    """Processes, each a pool of its own: one that dies is replaced, and only its own batch is lost."""

    def __init__(self, count: int) -> None:
        self._context = multiprocessing.get_context("spawn")  # a fork of a process with threads may hang
        self.cancel = self._context.Event()
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="vibroswarm-process")
        self._own = threading.local()
        self._pools: list[ProcessPoolExecutor] = []
        self._lock = threading.Lock()

    def submit(self, function: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        """As ``Executor.submit``; raises ``WorkerDied`` in the future where the process died."""
        return self._threads.submit(self._in_process, function, arguments, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after what they are doing."""
        self.cancel.set()
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        with self._lock:
            for pool in self._pools:
                pool.shutdown(wait=wait, cancel_futures=True)

    def _in_process(self, function: Any, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
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
            raise WorkerDied("the process that did it died (out of memory, killed, or crashed)") from None


def _hold_off_ctrl_c() -> None:
    """In a thread that starts processes: these take over what is held off, and are not hit while they begin."""
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})


_cancel: Any = None


def _begin_process(cancel: Any) -> None:
    """In a new process: Ctrl-C is for the one that started it; and when that is gone, so is this."""
    global _cancel
    _cancel = cancel
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do_in_process(work: Work) -> Done:
    return do(work, _cancel.is_set)


@dataclass(frozen=True)
class _ProcessWorkers(Workers):
    def submit(self, work: Work) -> Future[Done]:
        return self.executor.submit(_do_in_process, work)


def _processes(count: int) -> Iterator[Workers]:
    pool = OneEach(count)
    try:
        yield _ProcessWorkers(pool, count, f"{count} process{'es' * (count > 1)}", pool.cancel)
    finally:
        pool.shutdown(cancel_futures=True)


class _Seen:
    """What was last seen of a cluster."""

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.asked_s = self.some_s = time.monotonic()


@dataclass(frozen=True)
class _DaskWorkers(Workers):
    """Workers of a cluster may come and go; when none is left for a while, the study stops."""

    client: Any = None
    seen: _Seen = field(default_factory=lambda: _Seen(1))

    @property
    def width(self) -> int:
        if time.monotonic() - self.seen.asked_s > ASK_EVERY_S:
            self.check()
        return max(self.seen.threads, 1)

    def check(self) -> None:
        try:
            threads = sum(self.client.nthreads().values())
        except Exception as error:  # whatever a client says that is closed or cut off
            raise RunError(f"the Dask scheduler is gone ({type(error).__name__}); {GO_ON}") from error
        self.seen.threads, self.seen.asked_s = threads, time.monotonic()
        if threads:
            self.seen.some_s = self.seen.asked_s
        elif self.seen.asked_s - self.seen.some_s > WITHOUT_WORKERS_S:
            raise RunError(f"the Dask scheduler has had no worker for {WITHOUT_WORKERS_S:g} s; {GO_ON}")


def _dask(address: str, mixed: bool) -> Iterator[Workers]:
    """The workers of a Dask cluster that is there; they need the same version of vibroswarm."""
    try:
        import distributed
    except ImportError:
        raise InputError("needs Dask: pip install 'vibroswarm[dask]'", field="executor") from None
    for name in ("distributed.client", "distributed.core", "distributed.comm"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # what they tell is told by us, once
    client = _connected(distributed.Client, address)
    try:
        threads = client.nthreads()
        if not threads:
            raise RunError(
                f"the Dask scheduler at '{address}' has no workers; start some, and say the same again"
            )
        _check_dask_versions(client, mixed)
        pool, count = client.get_executor(pure=False), max(sum(threads.values()), 1)
        yield _DaskWorkers(pool, count, f"{len(threads)} Dask workers", client=client, seen=_Seen(count))
    finally:
        client.close(timeout=CLOSE_S)


def _connected(connect: Any, address: str) -> Any:
    """A client of the scheduler at an address, or named by a file."""
    if address.endswith(".json") and not Path(address).is_file():
        raise InputError(f"there is no scheduler file '{address}'", field="executor")
    where = (
        {"scheduler_file": address}
        if address.endswith(".json")
        else {"address": address.replace("dask://", "tcp://", 1)}
    )
    try:
        return connect(**where, timeout=CONNECT_S, set_as_default=False)
    except Exception as error:  # an address or a file may be wrong in many ways
        told = str(error).splitlines()[0] if str(error) else type(error).__name__
    gc.collect()  # of the client that came to nothing; later, while another begins, Dask would wait for itself
    raise InputError(f"no Dask scheduler answers at '{address}' ({told})", field="executor")


def _check_dask_versions(client: Any, mixed: bool) -> None:
    """Refuse workers that have no vibroswarm or another; those that come later are found by their batches."""
    for worker, found in client.run(versions, on_error="return").items():
        if isinstance(found, Exception):
            raise InputError(
                f"worker {worker} cannot import vibroswarm ({type(found).__name__}: {found}); install the same version",
                field="executor",
            )
        check_worker(found, mixed, worker)


def check_worker(theirs: dict[str, str], mixed: bool, worker: str = "a worker") -> None:
    """Refuse a worker of other versions, unless they may be mixed."""
    mine = versions()
    if mixed or theirs == mine:
        return
    different = [f"{k} {theirs.get(k)}" for k in mine if theirs.get(k) != mine[k]]
    raise InputError(
        f"{worker} has other versions than this process ({', '.join(different)}); install the same, or say --mixed",
        field="executor",
    )


__all__ = ["Cancelled", "OneEach", "WorkerDied", "Workers", "workers_for"]
