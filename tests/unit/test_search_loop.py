"""Searches run, stop, go on, and give the same whoever does the work."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.dask_cluster import Cluster
from helpers.forked import FORKED
from vibroswarm.errors import InputError, RunError
from vibroswarm.search.evaluate import ARCHIVE
from vibroswarm.search.loop import Found, run_search
from vibroswarm.search.objective import Objective
from vibroswarm.search.outcomes import Outcomes
from vibroswarm.search.searched import best_scenario, candidate_table, history_table
from vibroswarm.search.spec import Search
from vibroswarm.search.validation import bias_of, truth_of
from vibroswarm.statistics.intervals import Interval
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
def whole() -> Found:
    return run_search(small(), workers=2)


def test_a_search_written_down_is_the_same() -> None:
    for search in (Search(), small()):
        again = Search.from_toml(search.to_toml())
        assert again.hash == search.hash
        for name in ("space", "objectives", "settings", "pso"):
            assert getattr(again, name) == getattr(search, name)


def test_the_account_of_runs_holds(whole: Found) -> None:
    search = small()
    assert (search.budget, search.final_runs, search.pso_iterations) == (90, 60, 2)
    assert whole.archive.runs == 2 * 15 + 60
    assert [one.runs for one in whole.race] == [50, 70, 90]
    assert whole.archive[whole.best].count >= 10 + 20 + 20
    assert whole.archive[0].values == {"sample.sample_interval_ms": 2000.0, "decision.min_observations": 20}


def test_no_result_depends_on_who_does_the_work(whole: Found, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_run.multiprocessing, "get_context", lambda method: FORKED)
    assert same(whole, run_search(small(), workers=9))
    assert same(whole, run_search(small(), executor="processes", workers=1))


@pytest.mark.slow
def test_on_a_cluster_that_loses_a_worker_it_is_the_same(whole: Found, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    killed: list[int] = []
    with Cluster(tmp_path, 2) as cluster:

        def progress(runs_done: int, best: float) -> None:
            if runs_done > 30 and not killed:
                cluster.workers[0].kill()
                killed.append(cluster.workers[0].pid)

        assert same(whole, run_search(small(), executor=cluster.address, progress=progress))
        assert killed


def test_every_evaluation_has_runs_of_its_own() -> None:
    seen: list[int] = []

    def cost(outcomes: Outcomes) -> Any:
        seen.extend(outcomes.run.tolist())
        return outcomes.time_s.mean(axis=1)

    search = replace(small(), objectives=(Objective("mine", "mean", function=cost),))
    run_search(search.with_settings(final=0), workers=1)
    assert len(set(seen)) == 90


@pytest.mark.parametrize("runs", [1, 20, 50])
def test_stopped_and_resumed_it_gives_the_same_bit_by_bit(tmp_path: Path, whole: Found, runs: int) -> None:
    def stop(runs_done: int, best: float) -> None:
        if runs_done >= runs:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_search(small(), tmp_path, progress=stop, workers=2)
    assert same(whole, run_search(small(), tmp_path))
    archive = (tmp_path / ARCHIVE).read_bytes()
    assert same(whole, run_search(small(), tmp_path))
    assert (tmp_path / ARCHIVE).read_bytes() == archive
    (tmp_path / ARCHIVE).write_bytes(archive[:-100])  # damaged: computed again
    assert same(whole, run_search(small(), tmp_path))


def test_a_larger_budget_continues_the_search(tmp_path: Path, whole: Found) -> None:
    seen: list[int] = []

    def cost(outcomes: Outcomes) -> Any:
        seen.append(outcomes.run.size)
        return outcomes.time_s.mean(axis=1)

    search = replace(small(), objectives=(Objective("mine", "mean", function=cost),)).with_settings(final=30)
    first = run_search(search.with_settings(budget=90), tmp_path, workers=1)
    seen.clear()
    more = run_search(search.with_settings(budget=150), tmp_path, workers=1)
    assert more.history[: len(first.history)] == first.history
    assert len(more.history) == 8
    assert 60 <= sum(seen) <= 90  # further iterations, and final runs of other finalists
    with pytest.raises(InputError, match="another search"):
        run_search(small(), tmp_path)


def test_a_cost_that_fails_fails_its_candidate(tmp_path: Path) -> None:
    def cost(outcomes: Outcomes) -> Any:
        if 4 in outcomes.run:
            raise ZeroDivisionError("a crash")
        return np.where(outcomes.run == 11, np.nan, outcomes.time_s.mean(axis=1))

    search = replace(small(), objectives=(Objective("mine", "mean", function=cost),)).with_settings(final=0)
    for workers in (1, 8):
        found = run_search(search, tmp_path, workers=workers)
        assert found.archive.failed == 2
        bad = [one for one in found.archive.candidates if one.failed]
        assert "ZeroDivisionError: a crash" in bad[0].why
        assert "nan" in bad[1].why
        assert found.archive.score(bad[0].key) == np.inf
        assert found.best not in {one.key for one in bad}


def test_values_that_make_no_scenario_are_failures_and_bounds_out_of_range_are_refused() -> None:
    free = "\n".join(line for line in SMALL.splitlines() if not line.startswith("start"))
    legs = free.replace(
        "[space]",
        '[space]\n"walk.leg_min_ms" = { from = 0, to = 20000 }\n"walk.leg_max_ms" = { from = 100, to = 30000 }',
    )
    found = run_search(small(legs))
    assert found.archive.failed > 0
    assert "leg_m" in next(c.why for c in found.archive.candidates if c.why)
    for wrong in ("{ from = -5, to = 60 }", '["x", 3]'):
        with pytest.raises(InputError, match="min_observations"):
            small(free.replace("{ from = 0, to = 60 }", wrong))

    def never(outcomes: Outcomes) -> Any:
        raise ValueError("never")

    with pytest.raises(RunError, match="all of the first 12 runs failed"):
        run_search(replace(small(), objectives=(Objective("never", function=never),)))


def test_a_saved_candidate_is_a_start(tmp_path: Path, whole: Found) -> None:
    (tmp_path / "best.toml").write_text(best_scenario(whole).to_toml())
    text = "\n".join(['start = ["best.toml"]', *SMALL.splitlines()[2:]])
    (tmp_path / "search.toml").write_text(text)
    search = Search.read(tmp_path / "search.toml")
    assert search.space.values(search.starts[0]) == pytest.approx(whole.values)


def test_the_winner_is_scored_on_runs_that_the_search_has_not_seen(whole: Found) -> None:
    slow = {"sample.sample_interval_ms": 6000.0, "decision.min_observations": 60}
    truth = truth_of(whole, runs=200, others=[("slow", slow)])
    assert [one.name for one in truth.others] == ["start", "slow"]
    score = whole.search.objectives[0].score
    assert truth.winner.score.estimate == score(truth.winner.figures.rows)
    expected = truth.winner.score.estimate - truth.others[1].score.estimate
    assert truth.against[1].estimate == pytest.approx(expected)
    assert truth.bias.estimate == pytest.approx(truth.winner.score.estimate - truth.believed)


def test_a_constant_added_to_the_cost_does_not_change_the_bias() -> None:
    true = Interval(10.0, 9.0, 12.0, 0.95, 100, "")
    moved = true._replace(estimate=1010.0, low=1009.0, high=1012.0)
    assert bias_of(true, 7.0, 0.5)[:3] == pytest.approx(bias_of(moved, 1007.0, 0.5)[:3])
    assert bias_of(true, 7.0, 0.5).low > 0.0
    assert bias_of(true, 7.0, 2.0).low < 0.0
