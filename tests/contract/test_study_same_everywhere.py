"""The same study gives the same frame, bit by bit, whoever does it, in whatever pieces, however it is broken off."""

from __future__ import annotations

import random
import shutil
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from helpers.dask_cluster import Cluster
from helpers.forked import begin, run_study
from vibroswarm.errors import RunError
from vibroswarm.inference.outcomes import SHARES
from vibroswarm.study.precision import Precision
from vibroswarm.study.run import StudyProgress
from vibroswarm.study.runs import Runs
from vibroswarm.study.spec import Study
from vibroswarm.study.store import FOLDER

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
def alone(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """One thread, never broken off."""
    return STUDY.run(tmp_path_factory.mktemp("alone") / "s", workers=1)


@pytest.fixture(scope="module")
def alone_until(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return UNTIL.run(tmp_path_factory.mktemp("until") / "s", workers=1)


def assert_same(mine: Runs, theirs: Runs) -> None:
    for table in ("robots", "frame", "cell_table"):
        assert_frame_equal(getattr(mine, table), getattr(theirs, table), check_exact=True)
    assert mine.store.damaged == []


def once_done(share: float, act: Callable[[], None]) -> Callable[[StudyProgress], None]:
    """Do something in the middle of a study, once."""
    did: list[bool] = []

    def progress(now: StudyProgress) -> None:
        if not did and now.done >= share * now.wanted > 0:
            did.append(True)
            act()

    return progress


def test_the_tables_are_what_single_runs_give(alone: Runs) -> None:
    assert alone.frame.height == RUNS * 8
    for cell, run in ((0, 0), (3, 17), (5, 399), (7, 200)):
        made = alone.again(alone.cells[cell], [run])
        robots, runs = alone.tables(alone.cells[cell])
        assert_frame_equal(made.robots.drop(SHARES), robots.filter(pl.col("run") == run), check_exact=True)
        assert_frame_equal(
            made.runs, runs.filter(pl.col("run") == run).select(made.runs.columns), check_exact=True
        )


def test_two_threads(alone: Runs, tmp_path: Path) -> None:
    assert_same(STUDY.run(tmp_path / "s", workers=2), alone)


def test_another_seed_is_another_study(alone: Runs) -> None:
    """Negative control."""
    assert not Study(BASE, {"grid": GRID}, RUNS, seed=12).run().frame.equals(alone.frame)


@pytest.mark.slow
def test_a_dask_worker_is_killed_in_the_middle(alone: Runs, tmp_path: Path) -> None:
    with Cluster(tmp_path, 2) as cluster:
        progress = once_done(0.2, cluster.workers[1].kill)
        result = STUDY.run(tmp_path / "s", executor=cluster.address, progress=progress)
        assert cluster.workers[1].exitcode == -signal.SIGKILL
        assert_same(result, alone)
        cluster.workers[0].kill()
        with pytest.raises(RunError, match="has no workers"):
            STUDY.run(tmp_path / "t", executor=cluster.address)


def test_parts_are_joined_by_copying(alone: Runs, tmp_path: Path) -> None:
    for k in range(4):
        STUDY.run(tmp_path / f"part {k}", shard=(k + 1, 4))
        shutil.copytree(tmp_path / f"part {k}" / FOLDER, tmp_path / "whole" / FOLDER, dirs_exist_ok=True)
    progress: list[StudyProgress] = []
    assert_same(STUDY.run(tmp_path / "whole", progress=progress.append), alone)
    assert all(one.wanted == 0 for one in progress), "nothing is left to do"


class Backwards(ThreadPoolExecutor):
    """Does the latest first, as far as it can, and some things twice."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        if random.Random(str(args[0])).random() < 0.2:
            super().submit(fn, *args, **kwargs)
        time.sleep(random.Random(repr(args[0].first)).random() * 0.01)
        return super().submit(fn, *args, **kwargs)


def test_any_executor_may_be_passed_in(alone: Runs, tmp_path: Path) -> None:
    with Backwards(3) as pool:
        assert_same(STUDY.run(tmp_path / "s", executor=pool), alone)
        assert not pool._shutdown, "it is left open"


def test_several_writers_at_once_who_know_nothing_of_each_other(alone: Runs, tmp_path: Path) -> None:
    with ThreadPoolExecutor(3) as pool:
        writers = [pool.submit(STUDY.run, tmp_path / "s", workers=1) for _ in range(3)]
        for writer in writers:
            assert_same(writer.result(), alone)
    assert not list(tmp_path.rglob(".*"))


def test_other_numbers_of_runs_and_one_more_strategy_compute_what_is_missing(
    alone: Runs, tmp_path: Path
) -> None:
    progress: list[StudyProgress] = []
    fewer = {**GRID, "strategy.name": ["none"]}
    for runs in (10, 300, 299):
        Study(BASE, {"grid": fewer}, runs, seed=11).run(tmp_path / "s")
    Study(BASE, {"grid": fewer}, RUNS, seed=11).run(tmp_path / "s")
    assert_same(STUDY.run(tmp_path / "s", workers=2, progress=progress.append), alone)
    assert progress[-1].wanted == 2 * RUNS, "of the other strategy"


def test_damaged_files_are_computed_again(alone: Runs, tmp_path: Path) -> None:
    STUDY.run(tmp_path / "s")
    files = sorted((tmp_path / "s" / FOLDER).glob("*.parquet"))
    data = bytearray(files[0].read_bytes())
    data[50] ^= 1
    files[0].write_bytes(data)
    files[1].write_bytes(files[1].read_bytes()[:-100])
    files[2].unlink()
    assert_same(STUDY.run(tmp_path / "s"), alone)
    assert sorted((tmp_path / "s" / FOLDER).glob("*.parquet")) == files


def killed(study: Path, folder: Path, executor: str, after_s: float) -> Any:
    """Begin the study, or go on with it, and kill it some time after it has added something; gives its exit code."""
    process = begin(run_study, study, folder, executor)
    before = set((folder / FOLDER).glob("*.parquet"))
    while process.exitcode is None and not set((folder / FOLDER).glob("*.parquet")) - before:
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
    what: str, executor: str, kills: int, alone: Runs, alone_until: Runs, tmp_path: Path
) -> None:
    study, whole = (STUDY, alone) if what == "runs" else (UNTIL, alone_until)
    dice, file, folder = random.Random(5), tmp_path / "a study.toml", tmp_path / "a folder"
    file.write_text(study.to_toml())
    codes = [killed(file, folder, executor, dice.random() * 0.1) for _ in range(kills)]
    assert codes[0] == -signal.SIGKILL
    assert_same(study.run(folder), whole)


@pytest.mark.parametrize("extra", [100, 750])
def test_a_precision_does_not_depend_on_what_else_is_there(
    extra: int, alone_until: Runs, tmp_path: Path
) -> None:
    wanted = alone_until.cell_table["wanted"].to_list()
    assert len(set(wanted)) == 2, "one swarm is settled earlier than the other"
    assert max(wanted) < 800
    UNTIL.with_runs(extra).run(tmp_path / "s")
    assert_same(UNTIL.run(tmp_path / "s", workers=2), alone_until)
    for cell in (alone_until.cells[0], alone_until.cells[7]):
        found = alone_until.settled[cell.number]
        assert found.runs == wanted[cell.number]
        assert found.reached


def test_an_end_by_the_user_keeps_what_is_done(alone: Runs, tmp_path: Path) -> None:
    def ctrl_c() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        STUDY.run(tmp_path / "s", workers=2, progress=once_done(0.3, ctrl_c))
    progress: list[StudyProgress] = []
    assert_same(STUDY.run(tmp_path / "s", progress=progress.append), alone)
    assert 0 < progress[-1].wanted <= 0.7 * 2 * RUNS
