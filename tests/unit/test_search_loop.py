"""Searches run, stop, go on, and are refused where they are not the same."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.dask_cluster import Cluster
from helpers.forked import FORKED
from helpers.manifests import resealed
from helpers.search_functions import steps_of
from vibroswarm.errors import CodeError, InputError, RunError
from vibroswarm.optimize import evaluate
from vibroswarm.optimize.evaluate import derived_seed
from vibroswarm.optimize.loop import Found, run_search
from vibroswarm.optimize.methods import Method, Sampler, forget, register
from vibroswarm.optimize.objective import Objective
from vibroswarm.optimize.outcomes import Outcomes
from vibroswarm.optimize.search_files import candidate_table, history_table, write_search
from vibroswarm.optimize.space import Point
from vibroswarm.optimize.spec import Search, SearchSettings
from vibroswarm.optimize.validation import Truth, front_of, truth_of
from vibroswarm.study import executors

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


@pytest.fixture
def folder(whole: Found, done: Path, tmp_path: Path) -> Path:
    """A copy of the folder of the whole search."""
    return Path(shutil.copytree(done, tmp_path / "s"))


class Stopped(Exception):  # noqa: N818
    pass


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
    monkeypatch.setattr(executors.multiprocessing, "get_context", lambda method: FORKED)
    assert same(whole, run_search(small(), workers=1))
    assert same(whole, run_search(small(), executor="processes", workers=1))


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

        assert same(whole, run_search(small(), executor=str(cluster.scheduler_file), progress=progress))
        assert killed

        def kill_the_rest(told: Any) -> None:
            cluster.workers[1].kill()

        monkeypatch.setattr(executors, "WITHOUT_WORKERS_S", 1.0)
        with pytest.raises(RunError, match=r"no worker for|workers are gone"):
            run_search(small(), tmp_path / "s", executor=cluster.address, progress=kill_the_rest)
    assert same(whole, run_search(small(), tmp_path / "s"))


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


def test_steps_that_are_not_there_are_done_again(folder: Path, whole: Found) -> None:
    before = steps_of(folder)
    names = list(before)
    for lost in (names[:1], names[2:4], names[-1:], names):
        for name in lost:
            (folder / "steps" / name).unlink()
        assert same(whole, run_search(small(), folder))
        assert steps_of(folder) == before


def test_a_search_that_is_done_runs_nothing_again(
    folder: Path, whole: Found, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object) -> None:
        raise Stopped

    monkeypatch.setattr(evaluate, "outcomes_of", never)
    assert same(whole, run_search(small(), folder))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("particles = 4", "particles = 5", "pso.particles is 4 there and 5 here"),
        ("to = 60", "to = 70", "min_observations.to is 60.0 there and 70.0 here"),
        ("seed = 3", "seed = 4", "seed is 3 there and 4 here"),
        ("robots = 2", "robots = 3", "scenario.swarm.robots is 2 there and 3 here"),
        ("[search]", "[objective]\ncost = 'printed'\n[search]", "objective.cost is 'authors_code' there"),
    ],
)
def test_a_changed_search_is_refused_with_what_differs(folder: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        run_search(small(SMALL.replace(old, new)), folder)


def test_folders_that_are_no_search(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").touch()
    with pytest.raises(InputError, match="is not a search"):
        run_search(small(), tmp_path / "other")
    (folder / "vibroswarm.json").write_text("{}")
    with pytest.raises(InputError, match="damaged"):
        run_search(small(), folder)


def test_other_versions_are_refused_unless_mixed(folder: Path, whole: Found) -> None:
    head = folder / "vibroswarm.json"
    about = json.loads(head.read_text())
    about["versions"]["numba"] = "0.1"
    head.write_text(json.dumps(about))
    resealed(head)
    with pytest.raises(InputError, match=r"numba 0\.1 there"):
        run_search(small(), folder)
    assert same(whole, run_search(small(), folder, mixed=True))


@pytest.mark.parametrize("workers", [1, 8])
def test_failed_runs_are_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, workers: int) -> None:
    """A machine that fails now and then costs a second try; one that fails always costs the candidate its chance.

    What is counted is the same where workers share the runs of a candidate.
    """
    right = evaluate.outcomes_of
    first_time: set[Any] = set()

    def failing(scenarios: Any, seed: int, runs: range, motion: str) -> list[Outcomes]:
        if 4 in runs:
            raise ZeroDivisionError("a crash")
        if 8 in runs and runs not in first_time:
            first_time.add(runs)
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


def method_of(step: float) -> Method:
    class Near(Sampler):
        name = "near"
        width = step

        def propose(self, count: int) -> list[Point]:
            return [self.width * self.random().random(self.archive.space.size) for _ in range(count)]

    return Method("near", Near.begin)


def test_a_search_by_a_registered_method_that_has_changed_is_not_continued(tmp_path: Path) -> None:
    try:
        for step in (1.0, 1.0):  # the same is continued
            forget("near")
            register(method_of(step))
            search = small().with_settings(method="near", budget=60, final=0)
            run_search(search, tmp_path / "s")
        forget("near")
        register(method_of(0.5))
        with pytest.raises(InputError, match="another method near, whose code has changed since"):
            run_search(search, tmp_path / "s")
    finally:
        forget("near")


def test_a_method_that_ranks_what_is_no_candidate_is_refused() -> None:
    class Odd(Sampler):
        def propose(self, count: int) -> list[Point]:
            return [np.full(2, 0.5)] * count

        def finalists(self, count: int) -> list[int]:
            return [99]

    register(Method("odd", Odd.begin))
    try:
        with pytest.raises(
            CodeError, match=r"odd: finalists are \[99\], .*; return keys of candidates, from 0"
        ):
            run_search(small().with_settings(method="odd", budget=90, final=60))
    finally:
        forget("odd")


def test_a_cost_that_gives_nan_stops_the_search() -> None:
    search = replace(small(), objectives=(Objective("mine", function=lambda o: np.full(o.run.size, np.nan)),))
    with pytest.raises(InputError, match="cost 'mine': gives nan"):
        run_search(search)
    with pytest.raises(InputError, match="function"):
        search.to_toml()
    with pytest.raises(InputError, match="function"):
        run_search(search, "nowhere")


def changes_outcomes(outcomes: Outcomes) -> Any:
    outcomes.decision_time_s[:] = 0.0
    return outcomes.end_s


@pytest.mark.parametrize(
    ("cost", "said"),
    [
        (lambda outcomes: 1 / 0, r"test_search_loop.py, line \d+, in <lambda>: ZeroDivisionError"),
        (changes_outcomes, r"in changes_outcomes: ValueError: .*read-only"),
    ],
)
def test_a_cost_that_fails_stops_the_search_and_is_no_failed_run(cost: Any, said: str) -> None:
    with pytest.raises(CodeError, match=said):
        run_search(replace(small(), objectives=(Objective("mine", function=cost),)))


def test_a_search_with_one_objective_has_no_front(whole: Found) -> None:
    with pytest.raises(InputError, match=r"found: has no Pareto front.*truth_of"):
        front_of(whole)


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


def test_the_difference_is_named_for_what_it_is(whole: Found, truth: Truth, tmp_path: Path) -> None:
    low = replace(truth, believed=truth.winner.score.estimate * 0.5)
    assert "50 % too low" in low.words
    assert "lucky" in low.words
    high = replace(truth, believed=truth.winner.score.estimate * 2.0)
    assert "unlucky" in high.words
    winner = truth.winner.score
    known = winner._replace(low=0.999 * winner.estimate, high=1.001 * winner.estimate)
    sure = replace(truth, winner=replace(truth.winner, score=known), believed=0.996 * winner.estimate)
    assert "is 0.4 % too low" in sure.words
    equal = replace(truth, believed=truth.winner.score.estimate)
    assert "no sign of selection bias" in equal.words
    few = truth_of(whole, runs=8, folder=str(tmp_path))
    assert list(tmp_path.iterdir())
    assert few.winner.score.low < 0.7 * few.winner.score.estimate
    assert "too few validation runs" in replace(few, believed=0.8 * few.winner.score.estimate).words


def test_what_is_kept(tmp_path: Path, whole: Found) -> None:
    write_search(whole, tmp_path / "out")
    from vibroswarm import Scenario

    best = Scenario.read(tmp_path / "out" / "best.toml")
    assert whole.search.space.values_of(best) == whole.values


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("particles = 4", "particles = 0", "pso.particles: 0 is wrong"),
        ("from = 1000, to = 6000", "from = 6000, to = 1000", "6000 is not below 1000"),
        ("2000.0", "500.0", "start: sample.sample_interval_ms: 500 lies outside"),
        ("final = 60", "final = 90", "search.budget"),
        ("[search]", "[[objective]]\ncost='printed'\n[[objective]]\ncost='intended'\n[search]", "there is no race"),
        ("final = 60", "budget = 20", "are too few for one iteration"),
        ("final = 60", "method = 'psi'", "did you mean 'pso'"),
        ("final = 60", "finale = 60", "did you mean 'final'"),
        ("[pso]", "[psu]", "psu"),
        ("[search]", "[[objective]]\ncost='printed'\n[[objective]]\ncost='intended'\n[search]\nmethod='pso'", "nsga2"),
        ("[space]", "[grid]\n'sample.sample_interval_ms' = [1.0, 2.0]\n[space]", "varied by the cases too"),
        ('preset = "paper"', 'preset = "paper"\n[scenario.floor]\nsource = "random:0.5"\nrows = 10\ncolumns = 10',
         "boundary"),
        ("start = [{", "start = ['papper', {", "did you mean 'paper'"),
        ("start = [{", "start = [3, {", "neither a preset"),
        ("seed = 3", "seed = -3", "seed"),
    ],
)  # fmt: skip
def test_searches_that_are_wrong(old: str, new: str, told: str) -> None:
    assert old in SMALL
    with pytest.raises(InputError, match=told):
        small(SMALL.replace(old, new))


def test_starts_that_do_not_fit_into_the_budget_are_refused() -> None:
    two = SMALL.replace(
        "}]", '}, { "sample.sample_interval_ms" = 3000.0, "decision.min_observations" = 20 }]'
    )
    for final, needed in (("", 67), ("final = 0", 40), ("final = 30", 70)):
        lines = f"method = 'random'\nevaluations = 20\nbudget = %d\n{final}"
        text = two.replace("final = 60", lines)
        told = f"2 starts take 40 runs.*raise the budget to {needed}, or give fewer starts"
        with pytest.raises(InputError, match=rf"search.budget: {needed - 3} runs are too few: {told}"):
            small(text % (needed - 3))
        assert small(text % needed).search_budget >= 40
    small(
        SMALL.replace("final = 60", "method = 'random'\nevaluations = 20\nbudget = 5")
    )  # one point is always made


@pytest.mark.parametrize("name", ["evaluations", "finalists", "fresh", "surface"])
def test_settings_without_a_default_rule_cannot_be_none(name: str) -> None:
    with pytest.raises(InputError, match=rf"search\.{name}: None is wrong"):
        SearchSettings(**{name: None})
    assert SearchSettings(budget=None, final=None) == SearchSettings()


@pytest.fixture(autouse=True)
def _small_caches() -> Iterator[None]:
    yield
    evaluate._scenario.cache_clear()
