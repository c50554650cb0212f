"""Distrust: its tails against fractions, what it leaves out against a plain search, and what it is for."""

from __future__ import annotations

from fractions import Fraction
from math import comb, factorial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.example_strategies import load_example, module_of
from helpers.plain_reference import differences, plain_run
from vibroswarm.inference.agents import world_of
from vibroswarm.scenario.fault_draws import working
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.strategies.bayes import GATE_OWN, GATE_RECEIVED, GATE_TOTAL

distrust = module_of("distrust")
begin, on_message, on_sample = distrust.begin, distrust.on_message, distrust.on_sample
two_sided_tail, weigh = distrust.two_sided_tail, distrust.weigh


@pytest.fixture(autouse=True, scope="module")
def it_is_known() -> None:
    load_example("distrust")


def beta(a: int, b: int) -> Fraction:
    return Fraction(factorial(a - 1) * factorial(b - 1), factorial(a + b - 1))


def tail(k: int, n: int, a: int, b: int) -> Fraction:
    """By its definition, in whole numbers."""
    side = range(k, n + 1) if k * (a + b) >= n * a else range(k + 1)
    chances = (comb(n, i) * beta(a + i, b + n - i) / beta(a, b) for i in side)
    return min(Fraction(1), 2 * sum(chances, Fraction(0)))


@given(n=st.integers(1, 40), share=st.floats(0, 1), a=st.integers(1, 90), b=st.integers(1, 90))
@settings(max_examples=150, deadline=None, derandomize=True, database=None)
def test_tails_are_those_of_the_beta_binomial(n: int, share: float, a: int, b: int) -> None:
    k = round(share * n)
    assert two_sided_tail(k, n, a, b) == pytest.approx(float(tail(k, n, a, b)), rel=1e-10)


def test_far_tails_are_tiny_and_not_wrong() -> None:
    assert two_sided_tail(40, 40, 1, 90) == pytest.approx(float(tail(40, 40, 1, 90)), rel=1e-9)
    assert two_sided_tail(40, 40, 1, 90) < 1e-30
    assert two_sided_tail(5000, 5000, 10, 100_000) == 0.0
    assert two_sided_tail(0, 1, 1, 1) == 1.0


def left_out(ones: list[int], bits: list[int], threshold: float) -> set[int]:
    """The search in words: leave out the least probable of those that remain, as long as there is one."""
    out: set[int] = set()
    while True:
        found = []
        for j in sorted(set(range(len(bits))) - out):
            others = [i for i in range(len(bits)) if i not in out and i != j]
            a = 1 + sum(ones[i] for i in others)
            b = 1 + sum(bits[i] - ones[i] for i in others)
            if bits[j]:
                found.append((tail(ones[j], bits[j], a, b), j))
        least = min(found, default=(Fraction(2), -1))
        if not least[0] < threshold:
            return out
        out.add(least[1])


@given(
    sources=st.lists(st.tuples(st.integers(0, 25), st.floats(0, 1)), min_size=1, max_size=6),
    # No tail of few bits is one of these: at a tie, such as 3/10, rounding decides.
    threshold=st.sampled_from([0.30000007, 0.01000003, 1.00000007e-4]),
)
@settings(max_examples=60, deadline=None, derandomize=True, database=None)
def test_what_is_left_out(sources: list[tuple[int, float]], threshold: float) -> None:
    bits = [n for n, _ in sources]
    ones = [round(n * share) for n, share in sources]
    s, is_out = SimpleNamespace(), np.ones(len(bits), dtype=np.uint8)
    w: Any = SimpleNamespace(prior_alpha=1, prior_beta=1)
    weigh(s, np.array(ones), np.array(bits), is_out, threshold, w)
    expected = left_out(ones, bits, threshold)
    assert set(np.flatnonzero(is_out).tolist()) == expected
    kept = [j for j in range(len(bits)) if j not in expected]
    assert s.left_out == len(expected)
    assert (s.alpha, s.beta) == (1 + sum(ones[j] for j in kept), 1 + sum(bits[j] - ones[j] for j in kept))


@pytest.mark.parametrize(
    ("gate", "needed", "decision"),
    [(GATE_OWN, 0, -1), (GATE_RECEIVED, 479, 0), (GATE_TOTAL, 479, 0), (GATE_TOTAL, 480, -1)],
)
def test_bits_of_a_source_left_out_count_neither_for_the_belief_nor_for_the_gate(
    gate: int, needed: int, decision: int
) -> None:
    """Robot 0, whose own sensor is stuck at 1, and robot 1, whose sensor is stuck at 1 too, among three that read 0.

    They count 480 bits.
    """
    w: Any = world_of(preset("paper").with_values({"decision.min_observations": needed}), 6000)
    w = w._replace(gate=gate, robot=0)
    s: Any = SimpleNamespace(own=0)
    a: Any = SimpleNamespace(ones=np.zeros(5, int), bits=np.zeros(5, int), is_out=np.zeros(5, np.uint8))
    p: Any = SimpleNamespace(threshold=0.01)
    begin(s, a, None, p, w)
    for _ in range(160):
        for sender in range(1, 5):
            on_message(s, a, SimpleNamespace(bit=int(sender == 1)), sender, 1.0, None, p, w)
        on_sample(s, a, SimpleNamespace(reading=1), SimpleNamespace(), None, p, w)
    assert a.is_out.tolist() == [1, 1, 0, 0, 0]
    assert s.decision == decision
    before = (s.alpha, s.beta)
    assert before == (1, 1 + 3 * 160)
    on_message(s, a, SimpleNamespace(bit=1), 1, 2.0, None, p, w)
    assert (s.alpha, s.beta) == before
    on_message(s, a, SimpleNamespace(bit=1), 2, 2.0, None, p, w)
    assert (s.alpha, s.beta) == (2, before[1])


QUICK = {"run.t_end_s": 150.0, "decision.min_observations": 20, "decision.credible_threshold": 0.8}


def test_it_equals_the_plain_account() -> None:
    values = QUICK | {"strategy.name": "distrust", "faults.stuck_at_1": [1], "faults.opposite": [2]}
    result = simulate(Scenario().with_values(values | {"run.t_end_s": 60.0}), 4, [0])
    plain = plain_run(result.scenario, 4, result.motion, result.ends, result.observations)
    assert list(differences(result, plain)) == []


def test_one_sensor_stuck_at_1_does_no_harm_and_none_costs_nothing() -> None:
    """Where no feedback is wrong in all 24 runs; and without faults all decide as without distrust."""
    base = preset("paper").with_values({"floor.source": "random:0.44"})

    def share(answer: int, name: str, stuck: float) -> float:
        """Of the robots that work; answer 0 is right."""
        scenario = base.with_values({"strategy.name": name, "faults.stuck_at_1": stuck})
        result = simulate(scenario, 5, 24, energies=False)
        fine = result.robots["decision"].to_numpy()[working(scenario, 5, range(24)).ravel()]
        return float((fine == answer).mean())

    assert share(1, "none", 0.2) == 1.0
    assert share(0, "distrust", 0.2) > 0.65
    assert share(1, "distrust", 0.2) < 0.1
    assert share(0, "distrust", 0.0) == share(0, "none", 0.0) > 0.75
    fine = [
        simulate(base.with_values({"strategy.name": name}), 5, 12, energies=False)
        for name in ("none", "distrust")
    ]
    assert fine[0].robots["decision"].equals(fine[1].robots["decision"])
    assert fine[0].robots["decision_time_s"].equals(fine[1].robots["decision_time_s"])
