"""The plan of a study: what is shared, how runs are cut into blocks, shares, and what is missing."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError, RunError
from vibroswarm.scenario.scenario import preset
from vibroswarm.study.cell_comparison import MOST_AGAIN, SECOND, on_other_seeds
from vibroswarm.study.executors import workers_for
from vibroswarm.study.plan import BLOCKS_OF_A_SIZE, Group, missing, plan_of
from vibroswarm.study.runner import TRIAL, Job, expected
from vibroswarm.study.spec import Study
from vibroswarm.study.store import Store
from vibroswarm.study.work import Work, WorkerDied, parts_of, results_of

RANGES = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)).map(sorted).map(tuple), max_size=8)


def group_of(number: int, t_end_s: float, robots: int) -> Group:
    scenario = preset("paper").with_values({"run.t_end_s": t_end_s, "swarm.robots": robots})
    return Group(number, plan_of(Study(scenario)).groups[0].observed, 1.5e-4)


GROUPS = [group_of(k, *size) for k, size in enumerate([(60.0, 2), (1200.0, 5), (8000.0, 100)])]


@given(st.sampled_from(GROUPS), st.integers(0, 20_000), st.integers(0, 20_000), st.integers(1, 20))
@settings(max_examples=100, deadline=None)
def test_blocks_and_shares_cover_each_run_once(group, low, high, of):
    low, high = sorted((low, high))
    shares = [Job(k + 1, of) for k in range(of)]
    covered = []
    for number, first, last in group.blocks(low, high):
        covered += range(first, last)
        assert sum(share.has(group, number) for share in shares) == 1
    assert covered == list(range(low, high))


@given(st.sampled_from(GROUPS), st.integers(1, 3000), st.integers(1, 20_000))
@settings(max_examples=60, deadline=None)
def test_bounds_do_not_depend_on_how_many_runs_are_asked_for(group, runs, more):
    some = list(group.blocks(0, runs))
    all_of_them = list(group.blocks(0, runs + more))
    assert all_of_them[: len(some) - 1] == some[:-1]
    assert all_of_them[len(some) - 1][:2] == some[-1][:2]


def test_blocks_grow_so_that_a_long_study_has_few_files():
    blocks = list(GROUPS[1].blocks(0, 1_000_000))
    sizes = [last - first for _, first, last in blocks]
    assert sizes[:BLOCKS_OF_A_SIZE] == [GROUPS[1].block] * BLOCKS_OF_A_SIZE
    assert sizes[:-1] == sorted(sizes[:-1])
    assert len(blocks) < 2000


@pytest.mark.parametrize(("runs", "tried"), [(TRIAL, 0), (TRIAL + 1, TRIAL)])
def test_runs_are_tried_where_they_are_fewer_than_those_of_the_study(tmp_path, runs, tried):
    study = Study(preset("paper").with_values({"run.t_end_s": 60.0}), runs=runs)
    left = expected(Store(tmp_path, study), plan_of(study))
    assert (left.runs, left.tried) == (runs, tried)
    assert 0.0 < left.core_s < 60.0


def test_runs_on_other_seeds_are_left_to_do_while_they_are_missing(tmp_path):
    study = Study(preset("paper").with_values({"run.t_end_s": 60.0}), runs=TRIAL)
    store, second = Store(tmp_path, study), Store(tmp_path / SECOND, on_other_seeds(study, 2 * MOST_AGAIN))
    left = expected(store, plan_of(study), again=second)
    assert (left.runs, left.again_runs) == (TRIAL, MOST_AGAIN)


def test_what_is_left_of_a_job_are_its_own_blocks(tmp_path):
    study = Study(preset("paper").with_values({"run.t_end_s": 60.0}), runs=TRIAL)  # one block
    left = [expected(Store(tmp_path, study), plan_of(study), job=Job(number, 3)).runs for number in (1, 2, 3)]
    assert left == [TRIAL, 0, 0]


def test_further_studies_are_estimated_from_the_same_trials(tmp_path):
    study = Study(preset("paper").with_values({"run.t_end_s": 60.0}), runs=TRIAL)
    store = Store(tmp_path, study)
    alone, twice = expected(store, plan_of(study)), expected(store, plan_of(study), [store, store])
    assert twice[:3] == alone[:3]
    assert (twice.further_runs, twice.further_s) == (2 * alone.runs, 2 * alone.core_s)


def test_blocks_of_many_cells_and_robots_are_small_enough_for_the_memory():
    many = {"decision.credible_threshold": [0.5 + k / 1000 for k in range(400)]}
    (group,) = plan_of(Study({"swarm": {"robots": 100}}, {"grid": many})).groups
    assert group.rows == 40_000
    assert {last - first for _, first, last in group.blocks(0, 500)} <= {1, 2}


@pytest.mark.parametrize(("strategy", "robots"), [("places", 200), ("field", 200), ("explore", 20)])
def test_blocks_of_strategies_that_read_places_or_steer_take_no_longer_than_others(strategy, robots):
    """A run of 200 robots with places takes about 10 s on each floor, one of 20 robots with explore 4 s."""
    floors = ["stripe:0.46", "stripe:0.48", "diagonal:0.46", "diagonal:0.48"]
    study = Study.of({"swarm": {"robots": robots}}, strategy__name=[strategy], floor__source=floors)
    group = plan_of(study).groups[0]
    assert group.block <= 3
    assert group.run_s > 2.0


@given(st.tuples(st.integers(0, 60), st.integers(0, 60)).map(sorted), RANGES)
@settings(max_examples=200, deadline=None)
def test_what_is_missing_is_what_is_wanted_and_not_there(wanted, there):
    gaps = missing(tuple(wanted), there)
    in_gaps = [run for first, last in gaps for run in range(first, last)]
    have = {run for first, last in there for run in range(first, last)}
    assert in_gaps == [run for run in range(*wanted) if run not in have]


def test_cells_share_motion_and_observations():
    grid = {
        "swarm.robots": [5, 6],
        "floor.source": ["random:0.44", "random:0.48"],
        "strategy.name": ["none", "soft"],
        "strategy.soft.eta": [1.0, 2.0],
    }
    plan = plan_of(Study(vary={"grid": grid}))
    assert len(plan.groups) == 2
    assert plan.observations == 4
    assert plan.inferences == 12, "eta is nothing to robots that do not use soft feedback"
    assert sorted(c.number for g in plan.groups for c in g.cells) == list(range(16))
    for group in plan.groups:
        assert len({cell.scenario.swarm.robots for cell in group.cells}) == 1


def test_runs_that_end_when_all_have_decided_share_nothing():
    base = {"run": {"stop": "all_decided"}}
    plan = plan_of(Study(base, {"grid": {"strategy.name": ["none", "positive"]}}))
    assert [len(group.cells) for group in plan.groups] == [1, 1]


@pytest.mark.parametrize("text", ["5/4", "0/4", "1/0", "3", "a/b", "-1/4", "1/4/2", "", "1.5/4"])
def test_what_is_no_share_is_said(text: str) -> None:
    with pytest.raises(InputError, match="is not a job; give one such as 3/16"):
        Job.from_words(text)


def test_a_share_from_words():
    assert Job.from_words("3/16") == (3, 16)


def test_runs_of_a_slow_source_are_kept_one_by_one():
    """A run of five robots on wheels takes some 8 s: what is done is kept after each."""
    five = preset("paper")
    assert plan_of(Study(five, motion="mujoco")).groups[0].block == 1
    assert plan_of(Study(five, motion="mujoco-planar")).groups[0].block == 10
    assert plan_of(Study(five)).groups[0].block > 10


def test_work_is_divided_into_parts_of_nearly_equal_size():
    work = Work(first=5, last=12, seed=1, motion="event")
    assert [(part.first, part.last) for part in parts_of(work, 3)] == [(5, 7), (7, 9), (9, 12)]
    assert [part.runs for part in parts_of(work, 20)] == [1] * 7


def test_results_come_in_the_order_of_the_work_and_failures_as_texts():
    works, told = [Work(first=k, last=k + 2, seed=0, motion="") for k in range(5)], []
    with workers_for("threads", 3) as crew:
        found = results_of(crew, _unless_odd, works, "of run", progress=told.append)
    assert found == ["of run 0", "ValueError: 1 is odd", "of run 2", "ValueError: 3 is odd", "of run 4"]
    assert told[-1] == 10


def test_work_of_lost_workers_is_no_result():
    """A search would save their runs as failed for ever, and find another winner."""
    works = [Work(first=k, last=k + 2, seed=7, motion="") for k in (0, 1)]
    words = "the workers are gone (WorkerDied: of run 1); finished work is saved"
    with workers_for("threads", 3) as crew, pytest.raises(RunError, match=re.escape(words)):
        results_of(crew, _lost_if_odd, works, "of run", progress=lambda done: None)


def _lost_if_odd(work: Work, words: str) -> None:
    if work.first % 2:
        raise WorkerDied(f"{words} {work.first}")


def _unless_odd(work: Work, words: str) -> str:
    if work.first % 2:
        raise ValueError(f"{work.first} is odd")
    return f"{words} {work.first}"
