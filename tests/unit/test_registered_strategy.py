"""Strategies that a program registers, or an installed package brings: they may what those of a file may."""

from __future__ import annotations

import importlib.util
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from vibroswarm import Result, Scenario, simulate, strategies, verdict
from vibroswarm.strategies import Strategy
from vibroswarm.study.store import key_of


class One:
    alpha: int
    decision: int


class Counts:
    alpha: int
    beta: int


class Corrected(Counts):
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
    if w.robot < 4:  # the last has none
        s.estimate = s.alpha / (s.alpha + s.beta) if w.robot == 0 else 0.25
        s.estimate_spread = 0.0625
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
COUNTED = Strategy(name="counted", state=Counts, begin=begin, on_sample=on_sample, **HOOKS)


@pytest.fixture(autouse=True)
def registered() -> Iterator[None]:
    for one in (ONE, CORRECTED, COUNTED):
        strategies.register(one)
    yield
    for one in (ONE, CORRECTED, COUNTED):
        strategies.base.forget(one.name)


def run_of(strategy: str, task: str = "fill_ratio", t_end_s: float = 20.0) -> Result:
    return simulate(
        Scenario().with_values({"strategy.name": strategy, "task.name": task, "run.t_end_s": t_end_s})
    )


def test_a_count_without_its_counterpart_and_a_belief_of_nan_are_no_posterior() -> None:
    robot = verdict(run_of("one", "changed")).robots[0]
    assert robot.belief is None
    assert robot.estimate is None


def test_robots_without_any_count_have_no_estimate() -> None:
    assert verdict(run_of("counted", t_end_s=0.1)).robots[0].estimate is None


def test_runs_of_registered_code_are_keyed_by_the_source_text_of_its_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = []
    for k, step in enumerate("112"):
        text = f"def on_sample(s, a, x, out, d, p, w):\n    s.alpha += {step}\n    return False\n"
        file = tmp_path / f"program_{k}.py"
        file.write_text(text, encoding="utf-8")
        spec = importlib.util.spec_from_file_location(f"program_{k}", file)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, f"program_{k}", module)
        spec.loader.exec_module(module)
        hooks = HOOKS | {"on_sample": module.on_sample, "begin": begin, "belief": belief}
        strategies.register(Strategy(name="of_program", state=One, **hooks))
        keys.append(key_of(Scenario().with_values({"strategy.name": "of_program"})))
        strategies.base.forget("of_program")
    assert None not in keys
    assert keys[0] == keys[1] != keys[2]
