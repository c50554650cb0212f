"""The plan of a study: what is shared, how runs are cut into blocks, shares, and what is missing."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from vibroswarm.scenario.scenario import preset
from vibroswarm.study.plan import Group, missing, plan_of
from vibroswarm.study.runner import Job
from vibroswarm.study.spec import Study

RANGES = st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)).map(sorted).map(tuple), max_size=8)


def group_of(number: int, t_end_s: float, robots: int) -> Group:
    scenario = preset("paper").with_values({"run.t_end_s": t_end_s, "swarm.robots": robots})
    return Group(number, plan_of(Study(scenario)).groups[0].observed, is_slow=False)


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
