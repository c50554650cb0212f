"""Many runs, some at a time: results stream through in the order of the runs, on as many threads as wanted.

Engine and replay are compiled and hold no lock, so threads do; no result depends on how many there are, or on
the size of a batch.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import check_runs, simulate


def in_batches(
    scenario: Scenario,
    seed: int = 1,
    runs: int | Sequence[int] = 1,
    *,
    batch: int = 200,
    workers: int = 1,
    motion: str = "event",
    energies: bool = False,
) -> Iterator[Result]:
    """Results of ``batch`` runs at a time, in the order of the runs.

    At most two batches a worker are in memory. What is not yet begun when the iterator is closed is not done.

    Args:
        scenario, seed, runs, motion, energies: as ``simulate`` has them.
        batch: runs in a result; the last may hold fewer. workers: threads.
    Raises:
        InputError: as ``simulate``; a batch or a number of workers below 1.
    """
    for name, value in (("batch", batch), ("workers", workers)):
        if value < 1:
            raise InputError(f"{value} is too few; at least 1", field=name)
    chosen = check_runs(seed, runs)
    parts = (chosen[first : first + batch] for first in range(0, len(chosen), batch))
    pool = ThreadPoolExecutor(workers, thread_name_prefix="vibroswarm")
    under_way: deque[Future[Result]] = deque()
    try:
        for part in parts:
            under_way.append(pool.submit(simulate, scenario, seed, part, motion=motion, energies=energies))
            if len(under_way) >= 2 * workers:
                yield under_way.popleft().result()
        while under_way:
            yield under_way.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
