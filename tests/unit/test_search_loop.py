"""Searches run, stop, go on, and are refused where they are not the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.dask_cluster import Cluster
from helpers.forked import FORKED
from helpers.search_functions import steps_of
from vibroswarm.errors import RunError
from vibroswarm.search import evaluate
from vibroswarm.search.evaluate import derived_seed
from vibroswarm.search.loop import Found, run_search
from vibroswarm.search.objective import Objective
from vibroswarm.search.outcomes import Outcomes
from vibroswarm.search.search_files import candidate_table, history_table
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import Truth, truth_of
from vibroswarm.study import run as study_run

SMALL = f"""
start = [{{ "sample.sample_interval_ms" = 2000.0, "decision.min_observations" = 20 }}]
{(Path(__file__).parents[1] / "helpers" / "small_search.toml").read_text()}
iterations = 6
[search]
final = 60
finalists = 2
"""


def small(text: str = SMALL) -> Search:
    return Search.from_toml(text)


def same(one: Found, other: Found) -> bool:
    tables = (history_table, candidate_table)
    return all(t(one).equals(t(other)) for t in tables) and one.believed == other.believed


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("done") / "s"


@pytest.fixture(scope="module")
def whole(done: Path) -> Found:
    return run_search(small(), done, workers=2)


def test_a_search_written_down_is_the_same() -> None:
    for search in (Search(), small()):
        again = Search.from_toml(search.to_toml())
        assert again.hash == search.hash
        assert again.to_toml() == search.to_toml()
        for name in ("space", "objectives", "settings", "pso", "cases"):
            assert getattr(again, name) == getattr(search, name)


def test_the_account_of_runs_holds(whole: Found) -> None:
    search = small()
    assert search.budget == 90
    assert search.final_runs == 60
    assert search.pso_settings.iterations == 2
    assert whole.runs == 2 * 15 + 60 == search.search_runs + 60
    assert sum(c.count for c in whole.archive.candidates) == whole.runs
    assert whole.race[-1].runs == whole.runs
    assert whole.archive[0].values == {"sample.sample_interval_ms": 2000.0, "decision.min_observations": 20}


def test_no_result_depends_on_who_does_the_work(whole: Found, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_run.multiprocessing, "get_context", lambda method: FORKED)
    assert same(whole, run_search(small(), workers=1))
    assert same(whole, run_search(small(), executor="processes", workers=1))


@pytest.mark.slow
def test_on_a_cluster_that_loses_a_worker_it_is_the_same(
    whole: Found, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    killed: list[int] = []
    with Cluster(tmp_path, 2) as cluster:

        def progress(told: Any) -> None:
            if told.runs > 30 and not killed:
                cluster.workers[0].kill()
                killed.append(cluster.workers[0].pid)

        assert same(whole, run_search(small(), executor=cluster.address, progress=progress))
        assert killed


def test_every_evaluation_has_runs_of_its_own_or_common_ones() -> None:
    seen: list[tuple[int, ...]] = []

    def cost(outcomes: Outcomes) -> Any:
        seen.append(tuple(outcomes.run.tolist()))
        return outcomes.time_s.mean(axis=1)

    for numbers in ("independent", "common"):
        seen.clear()
        search = replace(small(), objectives=(Objective("mine", "mean", function=cost),))
        run_search(search.with_settings(numbers=numbers), workers=1)
        runs = [run for piece in seen for run in piece]
        if numbers == "independent":
            assert sorted(runs) == list(range(90))
        else:
            assert seen.count((0, 1, 2)) == 8


@pytest.mark.parametrize("steps", [0, 3, 6])
def test_stopped_and_resumed_it_gives_the_same_bit_by_bit(tmp_path: Path, whole: Found, steps: int) -> None:
    told = 0

    def stop(_: object) -> None:
        nonlocal told
        if len(steps_of(tmp_path / "s")) >= steps:
            told += 1
            if told == 2:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_search(small(), tmp_path / "s", progress=stop, workers=2)
    assert len(steps_of(tmp_path / "s")) >= steps
    assert same(whole, run_search(small(), tmp_path / "s"))
    assert same(whole, run_search(small(), tmp_path / "s"))


@pytest.mark.parametrize("workers", [1, 8])
def test_failed_runs_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, workers: int) -> None:
    """What is counted is the same where workers share the runs of a candidate."""
    right = evaluate.outcomes_of

    def failing(scenarios: Any, seed: int, runs: range, motion: str) -> list[Outcomes]:
        if 4 in runs:
            raise ZeroDivisionError("a crash")
        return right(scenarios, seed, runs, motion)

    monkeypatch.setattr(evaluate, "outcomes_of", failing)
    found = run_search(small(), tmp_path / "s", workers=workers)
    assert found.archive.failed == 3
    (bad,) = [c for c in found.archive.candidates if c.failed]
    assert "ZeroDivisionError: a crash" in bad.why
    assert found.archive.score(bad.key) == np.inf
    assert found.best != bad.key
    assert found.runs == 90
    assert same(found, run_search(small(), tmp_path / "s"))


def test_values_that_make_no_scenario_are_failures(tmp_path: Path) -> None:
    free = "\n".join(line for line in SMALL.splitlines() if not line.startswith("start"))
    text = free.replace("[space]", '[space]\n"walk.leg_min_ms" = { from = 0, to = 60000 }')
    found = run_search(small(text))
    assert found.archive.failed > 0
    assert "leg_m" in next(c.why for c in found.archive.candidates if c.why)
    assert found.values["walk.leg_min_ms"] <= 30000
    bad = free.replace("[space]", "[scenario.walk]\nleg_max_ms = 10.0\nleg_min_ms = 0.0\n[space]")
    bad = bad.replace("[space]", '[space]\n"walk.leg_min_ms" = { from = 50, to = 60 }')
    with pytest.raises(RunError, match="all of the first 12 runs failed"):
        run_search(small(bad), tmp_path / "s")
    assert not (tmp_path / "s").exists()


@pytest.fixture(scope="module")
def truth(whole: Found) -> Truth:
    slow = {"sample.sample_interval_ms": 6000.0, "decision.min_observations": 60}
    return truth_of(whole, runs=200, others=[("slow", slow)])


def test_the_winner_is_scored_on_runs_that_the_search_has_not_seen(whole: Found, truth: Truth) -> None:
    assert truth.believed == whole.believed
    assert truth.winner.rows.shape[0] == 200
    assert [one.name for one in truth.others] == ["start", "slow"]
    assert truth.against[1].low < truth.against[1].estimate < truth.against[1].high
    score = whole.search.objectives[0].score
    assert truth.winner.score.estimate == score(truth.winner.rows)
    expected = truth.winner.score.estimate - truth.others[1].score.estimate
    assert truth.against[1].estimate == pytest.approx(expected)
    seeds = {derived_seed(3, purpose) for purpose in ("evaluations", "fresh runs", "check", "second check")}
    assert len(seeds) == 4


@pytest.fixture(autouse=True)
def _small_caches() -> Iterator[None]:
    yield
    evaluate._scenario.cache_clear()
