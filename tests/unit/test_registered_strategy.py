"""Strategies that a program registers, or an installed package brings: they may what those of a file may."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from vibroswarm import Result, Scenario, simulate, strategies, tasks, verdict
from vibroswarm.documents.run import result_document
from vibroswarm.strategies import Strategy
from vibroswarm.tasks import Task


class One:
    alpha: int
    decision: int


class Corrected:
    alpha: int
    beta: int
    estimate: float
    estimate_spread: float


def begin(s: Any, a: Any, d: Any, p: Any, w: Any) -> None:
    s.alpha = 0


def begin_corrected(s: Any, a: Any, d: Any, p: Any, w: Any) -> None:
    s.estimate, s.estimate_spread = math.nan, math.nan


def on_counts(s: Any, ones: int, zeros: int, p: Any, w: Any) -> None:
    s.alpha += ones


def on_sample(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    s.alpha += x.reading
    out.bit = x.reading
    return True


def on_sample_corrected(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    s.alpha, s.beta = s.alpha + x.reading, s.beta + 1 - x.reading
    s.estimate, s.estimate_spread = 0.25, 0.0625
    out.bit = x.reading
    return True


def belief(s: Any, a: Any, p: Any, w: Any) -> float:
    return math.nan


def decision(s: Any, a: Any, p: Any, w: Any) -> int:
    return -1


HOOKS: dict[str, Any] = {"on_counts": on_counts, "decision": decision}
ONE = Strategy(name="one", state=One, begin=begin, on_sample=on_sample, belief=belief, **HOOKS)
CORRECTED = Strategy(
    name="corrected", state=Corrected, begin=begin_corrected, on_sample=on_sample_corrected, **HOOKS
)


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    for one in (ONE, CORRECTED):
        strategies.register(one)
    yield
    for one in (ONE, CORRECTED):
        strategies.base.forget(one.name)


def run_of(strategy: str, task: str = "fill_ratio", t_end_s: float = 20.0) -> Result:
    return simulate(
        Scenario().with_values({"strategy.name": strategy, "task.name": task, "run.t_end_s": t_end_s})
    )


def test_a_count_without_its_counterpart_and_a_belief_of_nan_are_no_posterior() -> None:
    robot = verdict(run_of("one", "changed")).robots[0]
    assert robot.belief is None
    assert robot.estimate is None


def test_an_estimate_of_its_own_comes_before_the_mean_of_a_posterior() -> None:
    result = run_of("corrected", "share")
    document = result_document(result)
    assert "ESTIMATES: 0.25; " in document.answer[0]
    assert document.tables["robots"].columns["posterior"].title == "estimate (95 %)"
    assert verdict(result).robots[0].interval == pytest.approx((0.1275, 0.3725), abs=1e-4)


def test_robots_without_any_count_have_no_estimate() -> None:
    assert verdict(run_of("corrected", t_end_s=0.1)).robots[0].estimate is None


def test_the_number_that_a_task_scores_is_not_called_the_share_of_kind_1() -> None:
    own = Task(
        name="third",
        truth=lambda floor, asked, p: 0,
        scored=lambda floor, asked, p: 0.24,
        answers=("a", "b", "c"),
    )
    tasks.register(own)
    try:
        of_kinds = {"sensor.model": "confusion", "floor.source": "random:0.4,0.36,0.24", "run.t_end_s": 20.0}
        asked = Scenario().with_values(of_kinds | {"strategy.name": "dirichlet", "task.name": "third"})
        document = result_document(simulate(asked))
    finally:
        tasks.base.forget("third")
    assert document.tables["robots"].columns["posterior"].title == "estimate (95 %)"
