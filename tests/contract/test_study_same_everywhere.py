"""The same study gives the same tables, bit by bit, whoever does it, in whatever pieces, however it is broken off."""

from __future__ import annotations

import multiprocessing
import random
import signal
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from helpers.dask_cluster import Cluster
from helpers.forked import FORKED, begin, run_study
from vibroswarm.errors import InputError, RunError
from vibroswarm.study import executors
from vibroswarm.study.batch import Batch, BatchResult, batch_of, do_batch
from vibroswarm.study.plan import plan_of
from vibroswarm.study.precision import Precision
from vibroswarm.study.run import merge
from vibroswarm.study.runner import Job, StudyProgress, run_batch
from vibroswarm.study.spec import Study
from vibroswarm.study.store import SHARDS, Store
from vibroswarm.study.study_result import StudyResult

BASE = {"run": {"t_end_s": 60.0}, "decision": {"min_observations": 5}}
GRID = {
    "swarm.robots": [2, 4],
    "floor.source": ["random:0.44", "diagonal:0.46"],
    "strategy.name": ["none", "positive"],
}
RUNS = 400
STUDY = Study(BASE, {"grid": GRID}, RUNS, seed=11)
UNTIL = Study(BASE, {"grid": GRID}, None, Precision(0.06, max_runs=800), seed=11)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    """One thread, never broken off."""
    return STUDY.run(tmp_path_factory.mktemp("alone") / "s", workers=1)


@pytest.fixture(scope="module")
def alone_until(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    return UNTIL.run(tmp_path_factory.mktemp("until") / "s", workers=1)


def assert_same(mine: StudyResult, theirs: StudyResult) -> None:
    for table in ("robots", "runs", "cells"):
        a, b = (getattr(result, table) for result in (mine, theirs))
        a, b = (t() if callable(t) else t for t in (a, b))
        assert_frame_equal(a, b, check_exact=True)
    assert mine.store.damaged == []


def once_done(share: float, act: Callable[[], None]) -> Callable[[StudyProgress], None]:
    """Do something in the middle of a study, once."""
    did: list[bool] = []

    def progress(told: StudyProgress) -> None:
        if not did and told.done >= share * told.wanted > 0:
            did.append(True)
            act()

    return progress


def test_the_tables_are_what_single_runs_give(alone: StudyResult) -> None:
    assert alone.runs().height == RUNS * 8
    for cell, run in ((0, 0), (3, 17), (5, 399), (7, 200)):
        made = alone.result(cell, [run])
        robots, runs = alone.tables(cell)
        assert_frame_equal(made.robots, robots.filter(pl.col("run") == run), check_exact=True)
        assert_frame_equal(
            made.runs, runs.filter(pl.col("run") == run).select(made.runs.columns), check_exact=True
        )


def test_two_threads(alone: StudyResult, tmp_path: Path) -> None:
    assert_same(STUDY.run(tmp_path / "s", workers=2), alone)


def test_another_seed_is_another_study(alone: StudyResult) -> None:
    """Negative control."""
    other = Study(BASE, {"grid": GRID}, RUNS, seed=12).run()
    assert not other.runs().equals(alone.runs())


@pytest.mark.slow
def test_a_process_that_dies_is_replaced(
    alone: StudyResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors.multiprocessing, "get_context", lambda method: FORKED)
    killed: list[int | None] = []

    def kill_one() -> None:
        process = multiprocessing.active_children()[0]
        killed.append(process.pid)
        process.kill()

    result = STUDY.run(tmp_path / "s", executor="processes", workers=1, progress=once_done(0.2, kill_one))
    assert killed
    assert result.store.failures == []
    assert_same(result, alone)
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_dask_worker_is_killed_in_the_middle(alone: StudyResult, tmp_path: Path) -> None:
    with Cluster(tmp_path, 2) as cluster:
        progress = once_done(0.2, cluster.workers[1].kill)
        result = STUDY.run(tmp_path / "s", executor=str(cluster.scheduler_file), progress=progress)
        assert cluster.workers[1].exitcode == -signal.SIGKILL
        assert_same(result, alone)
        tables = STUDY.with_runs(50).run(tmp_path / "t", executor=cluster.address).runs()
        assert_frame_equal(tables, alone.runs().filter(pl.col("run") < 50), check_exact=True)
        what_happens_when_all_are_gone(cluster, tmp_path)


def what_happens_when_all_are_gone(cluster: Any, tmp_path: Path) -> None:
    more = STUDY.with_runs(40_000)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(executors, "WITHOUT_WORKERS_S", 1.5)

        def kill_workers() -> None:
            for worker in cluster.workers:
                worker.kill()

        with pytest.raises(RunError, match="no worker for"):
            more.run(tmp_path / "gone", executor=cluster.address, progress=once_done(0.01, kill_workers))
    with pytest.raises(RunError, match="has no workers"):
        more.run(tmp_path / "gone", executor=cluster.address)
    cluster.add_worker()
    with pytest.raises(RunError, match="gone"):
        more.run(
            tmp_path / "gone", executor=cluster.address, progress=once_done(0.01, cluster.scheduler.kill)
        )
    store = Store.open(tmp_path / "gone")
    assert store.damaged == []
    assert 0 < sum(last - first for first, last in store.ranges(0)) < 40_000


def test_four_shares_merged(alone: StudyResult, tmp_path: Path) -> None:
    shares = [tmp_path / f"share {k}" for k in range(4)]
    for k, folder in enumerate(shares):
        STUDY.run(folder, job=Job(k + 1, 4))
    there = [
        sum(last - first for group in (0, 1) for first, last in Store.open(f).ranges(group)) for f in shares
    ]
    assert sum(there) == 2 * RUNS
    assert min(there) > 0.15 * sum(there)
    with pytest.raises(RunError, match="is incomplete"):
        merge(tmp_path / "out", shares[:3])
    merge(tmp_path / "out", shares[::-1])
    assert_same(StudyResult.open(tmp_path / "out"), alone)


class Backwards(ThreadPoolExecutor):
    """Does the latest first, as far as it can, and some things twice."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        if random.Random(str(args[0])).random() < 0.2:
            super().submit(fn, *args, **kwargs)
        time.sleep(random.Random(repr(args[0].first)).random() * 0.01)
        return super().submit(fn, *args, **kwargs)


def test_any_executor_may_be_passed_in(alone: StudyResult, tmp_path: Path) -> None:
    with Backwards(3) as pool:
        assert_same(STUDY.run(tmp_path / "s", executor=pool), alone)
        assert (
            pool.submit(
                max,
                Batch(study="", group=0, observed=(), first=1, last=2, seed=1, motion="", keep=()),
                key=str,
            )
            is not None
        ), "it is left open"


def test_several_writers_at_once_who_know_nothing_of_each_other(alone: StudyResult, tmp_path: Path) -> None:
    with ThreadPoolExecutor(3) as pool:
        writers = [pool.submit(STUDY.run, tmp_path / "s", workers=1) for _ in range(3)]
        for writer in writers:
            assert_same(writer.result(), alone)
    assert_same(StudyResult.open(tmp_path / "s"), alone)
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.slow
def test_order_and_size_of_the_batches_do_not_matter(alone: StudyResult, tmp_path: Path) -> None:
    store, groups = Store.open_or_create(tmp_path / "s", STUDY), plan_of(STUDY).groups
    dice = random.Random(4)
    for _ in range(12):
        first = dice.randrange(RUNS)
        store.add(
            do_batch(
                batch_of(STUDY, groups[dice.randrange(2)], first, min(first + dice.randrange(1, 90), RUNS))
            )
        )
    for runs in (10, 11, 300, 299, RUNS):
        result = STUDY.with_runs(runs).run(tmp_path / "s", workers=2)
        assert_frame_equal(result.runs(), alone.runs().filter(pl.col("run") < runs), check_exact=True)
    assert_same(result, alone)


def killed(study: Path, folder: Path, executor: str, after_s: float) -> Any:
    """Begin the study, or go on with it, and kill it some time after it has added something; gives its exit code."""
    process = begin(run_study, study, folder, executor)
    before = set((folder / SHARDS).glob("*"))
    while process.exitcode is None and not set((folder / SHARDS).glob("*")) - before:
        time.sleep(0.002)
    time.sleep(after_s)
    process.kill()
    process.join()
    return process.exitcode


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "executor", "kills"), [("runs", "threads", 2), ("runs", "processes", 1), ("until", "threads", 1)]
)
def test_a_study_killed_and_resumed(
    what: str, executor: str, kills: int, alone: StudyResult, alone_until: StudyResult, tmp_path: Path
) -> None:
    study, whole = (STUDY, alone) if what == "runs" else (UNTIL, alone_until)
    dice, file, folder = random.Random(5), tmp_path / "a study.toml", tmp_path / "a folder"
    file.write_text(study.to_toml())
    codes = [killed(file, folder, executor, dice.random() * 0.1) for _ in range(kills)]
    assert codes[0] == -signal.SIGKILL
    assert_same(study.run(folder), whole)


@pytest.mark.parametrize("extra", [100, 750])
def test_a_precision_does_not_depend_on_what_else_is_there(
    extra: int, alone_until: StudyResult, tmp_path: Path
) -> None:
    wanted = alone_until.cells["wanted"].to_list()
    assert len(set(wanted)) == 2, "one swarm is settled earlier than the other"
    assert max(wanted) < 800
    UNTIL.with_runs(extra).run(tmp_path / "s")
    assert_same(UNTIL.run(tmp_path / "s", workers=2), alone_until)
    for cell in (0, 7):
        found = alone_until.settled(cell)
        assert found is not None
        assert found.runs == wanted[cell]
        assert found.reached


def fails(what: Exception, first: int, times: int) -> Callable[..., BatchResult]:
    left = [times]

    def some_do(work: Batch, *more: Any) -> BatchResult:
        if (work.group, work.first) == (0, first) and left[0]:
            left[0] -= 1
            raise what
        return do_batch(work, *more)

    return some_do


def test_a_batch_that_fails_once_is_done_again(alone: StudyResult, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "do_batch", fails(MemoryError(), 0, 1))
    assert_same(STUDY.run(), alone)


def test_a_batch_that_fails_twice_is_told_and_can_be_run_alone(
    alone: StudyResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tells: list[StudyProgress] = []
    monkeypatch.setattr(executors, "do_batch", fails(MemoryError("too much"), 0, 2))
    with pytest.raises(
        RunError, match=r"runs failed, in 1 batch; .* batch 0:0-\d+ with seed 11 \(MemoryError: too much\)"
    ) as said:
        STUDY.run(tmp_path / "s", progress=tells.append)
    store = Store.open(tmp_path / "s")
    (failure,) = store.failures
    assert failure["batch"] in str(said.value)
    assert tells[-1].failed == 1
    assert tells[-1].done == 2 * RUNS - (failure["last"] - failure["first"]), "all else is kept"
    run_batch(STUDY, tmp_path / "s", failure["batch"])
    assert Store.open(tmp_path / "s").failures == []
    assert_same(STUDY.run(tmp_path / "s"), alone)


def test_a_worker_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def old(work: Batch, *more: Any) -> BatchResult:
        done = do_batch(work, *more)
        return BatchResult(work, done.files, done.rows, done.versions | {"code": "old"})

    monkeypatch.setattr(executors, "do_batch", old)
    with pytest.raises(
        InputError, match=r"a worker has other versions than this process \(code old there, \w+ here\)"
    ):
        STUDY.with_runs(20).run(tmp_path / "s")
    assert Store.open(tmp_path / "s").shards == []
    mixed = STUDY.with_runs(20).run(tmp_path / "s", mixed=True)
    assert mixed.runs().height == 160


def test_an_end_by_the_user_keeps_what_is_done_and_stops_the_threads(
    alone: StudyResult, tmp_path: Path
) -> None:
    def ctrl_c() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        STUDY.run(tmp_path / "s", workers=2, progress=once_done(0.3, ctrl_c))
    for thread in [t for t in threading.enumerate() if t.name.startswith("vibroswarm")]:
        thread.join(30.0)  # nobody waits for them, but they end with their batch
        assert not thread.is_alive()
    store = Store.open(tmp_path / "s")
    kept = sum(last - first for group in (0, 1) for first, last in store.ranges(group))
    assert 0.3 * 2 * RUNS <= kept < 2 * RUNS
    assert_same(STUDY.run(tmp_path / "s"), alone)


def test_nothing_to_do_needs_no_worker(alone: StudyResult) -> None:
    again = STUDY.run(alone.store.folder, executor="dask://127.0.0.1:1")
    assert_same(again, alone)
