"""What a robot says and when it decides (Eq. 13 and 16 to 18, Algorithms 1 and 3), by hand-made cases."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.special import betainc

from vibroswarm.robot.belief import belief_below
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import simulate
from vibroswarm.strategies import none, positive, soft
from vibroswarm.strategies.bayes import (
    GATE_OWN,
    GATE_RECEIVED,
    GATE_TOTAL,
    begin,
    decided,
    is_enough,
    on_counts,
)
from vibroswarm.strategies.world import Draws, Reading, World, beliefs

WORLD = World(
    robot=0,
    robots=5,
    kinds=2,
    t_end_s=1200.0,
    tick_s=0.02,
    tick_ms=20,
    width_m=1.0,
    height_m=1.0,
    rows=5,
    columns=5,
    tile_width_m=0.2,
    tile_height_m=0.2,
    left_m=0.0,
    bottom_m=0.0,
    decision_boundary=0.5,
    boundary=0.5,
    credible_threshold=0.95,
    min_observations=10,
    gate=GATE_TOTAL,
    gate_counts_current=False,
    revise=False,
    prior_alpha=1,
    prior_beta=1,
    false_positive=0.0,
    false_negative=0.0,
    hold_s=30.0,
    beliefs=beliefs(0.5, 6000),
)
SOFT = SimpleNamespace(eta=1500.0, kappa=2.0)
bits = st.integers(0, 1)
counts = st.integers(1, 5000)


def state(
    alpha: int = 1, beta: int = 1, decision: int = -1, own: int = 0, received: int | None = None
) -> SimpleNamespace:
    """A robot's state; with ``received``, the counts are made to agree with it, all zeros."""
    if received is not None:
        alpha, beta = 1, 1 + own + received
    return SimpleNamespace(alpha=alpha, beta=beta, decision=decision, own=own)


def sampled(
    strategy: Any,
    before: SimpleNamespace,
    reading: int,
    world: World = WORLD,
    u: float = 0.5,
    p: SimpleNamespace = SOFT,
) -> SimpleNamespace:
    """The state after an own sample, and the bit that is sent: of a module of ``strategies``."""
    after, out = SimpleNamespace(**vars(before)), SimpleNamespace(bit=7)
    x = Reading(reading, 1.0, 0, 0.5, 0.5, 0.0, 0.0, 0, 0.5, 0.5, 0.0, 0.0)
    assert strategy.on_sample(after, 0, x, out, Draws(1, 0, 0, 6, 0, 0, 0, u), p, world)
    after.message = out.bit
    return after


def belief_in(one: SimpleNamespace) -> float:
    return belief_below(one.alpha, one.beta, 0.5)


@settings(deadline=None, max_examples=200)
@given(bits, counts, counts, st.floats(0, 5000), st.floats(0, 8))
def test_probability_of_a_one_is_equation_11(o: int, alpha: int, beta: int, eta: float, kappa: float) -> None:
    belief = float(betainc(alpha, beta, 0.5))
    delta = math.exp(-eta * float(stats.beta.var(alpha, beta))) * abs(0.5 - belief) ** kappa
    assert soft.weight(alpha, beta, belief, eta, kappa) == pytest.approx(delta, rel=1e-9, abs=1e-300)
    expected = delta * (1 - belief) + (1 - delta) * o
    assert soft.probability(o, alpha, beta, belief, eta, kappa) == pytest.approx(
        expected, rel=1e-9, abs=1e-300
    )


@pytest.mark.parametrize("o", [0, 1])
def test_without_weight_a_robot_says_what_it_reads(o: int) -> None:
    for u in (2.0**-53, 0.5, 1 - 2.0**-53):
        assert soft.message(o, 1, 1, 0.5, 1500.0, 2.0, u) == o  # p = 1/2
        assert soft.message(o, 3, 9, 0.97, 1e12, 2.0, u) == o  # eta without end
    assert sampled(none, state(), o).message == o


def test_the_message_is_one_where_the_number_lies_below_the_probability() -> None:
    p = soft.probability(1, 20, 200, 0.99, 100.0, 1.0)
    assert 0.5 < p < 1
    assert soft.message(1, 20, 200, 0.99, 100.0, 1.0, np.nextafter(p, 0)) == 1
    assert soft.message(1, 20, 200, 0.99, 100.0, 1.0, p) == 0


@settings(deadline=None, max_examples=100)
@given(bits, counts, counts, st.integers(0, 30), st.booleans())
def test_a_decision_comes_only_past_the_gate(o: int, alpha: int, beta: int, own: int, revise: bool) -> None:
    """Nothing else of the belief is heeded by those without soft feedback."""
    world = WORLD._replace(revise=revise)
    before = state(alpha, beta, -1, own)
    for strategy in (none, positive):
        after = sampled(strategy, before, o, world)
        if not is_enough(after, world):
            assert after.decision == -1
            assert after.message == o


def test_positive_feedback_says_the_decision_once_there_is_one() -> None:
    for o in (0, 1):
        assert sampled(positive, state(), o).message == o
        assert sampled(positive, state(decision=0), o).message == 0
        assert sampled(positive, state(decision=1), o).message == 1


@pytest.mark.parametrize("threshold", [0.5, 0.75, 0.95, 0.99])
def test_decide_is_strict(threshold: float) -> None:
    world = WORLD._replace(credible_threshold=threshold)
    above = float(np.nextafter(threshold, 1))
    assert decided(threshold, -1, world) == -1
    assert decided(above, -1, world) == 0
    assert decided(0.5, -1, world) == -1
    assert decided(1.0, -1, world) == 0
    assert decided(0.0, -1, world) == 1
    assert decided(0.5, 1, world) == 1


@pytest.mark.parametrize(
    ("gate", "current", "expected"),
    [
        (GATE_TOTAL, False, 7),
        (GATE_TOTAL, True, 8),
        (GATE_RECEIVED, False, 5),
        (GATE_RECEIVED, True, 5),
        (GATE_OWN, False, 2),
        (GATE_OWN, True, 3),
    ],
)
def test_the_gates_count(gate: int, current: bool, expected: int) -> None:
    """Three own samples, the current one among them, and five received bits."""
    one = state(own=3, received=5)
    world = WORLD._replace(gate=gate, gate_counts_current=current)
    assert is_enough(one, world._replace(min_observations=expected - 1))
    assert not is_enough(one, world._replace(min_observations=expected))


def test_a_sample_observes_tests_and_composes_in_this_order() -> None:
    """The own bit is in the posterior that is tested, and the decision in the message."""
    world = WORLD._replace(min_observations=0)
    before = state(1, 4)  # p = 15/16
    assert belief_in(before) < 0.95
    after = sampled(positive, before, 0, world)
    assert (after.alpha, after.beta) == (1, 5)
    assert belief_in(after) == pytest.approx(31 / 32)
    assert (after.decision, after.own, after.message) == (0, 1, 0)
    assert sampled(positive, after, 1, world).message == 0  # says its decision from now on
    assert sampled(none, after, 1, world).message == 1
    silent = sampled(positive, before, 1, world)
    assert (silent.decision, silent.message) == (-1, 1)


def test_the_soft_message_uses_the_posterior_with_the_own_sample() -> None:
    p = SimpleNamespace(eta=1.0, kappa=1.0)
    before = state(1, 4)
    after = sampled(soft, before, 0, p=p)
    share = soft.probability(0, 1, 5, belief_in(after), 1.0, 1.0)
    assert sampled(soft, before, 0, u=float(np.nextafter(share, 0)), p=p).message == 1
    assert sampled(soft, before, 0, u=share, p=p).message == 0


def test_a_received_bit_counts_as_an_own_one_and_decides_nothing() -> None:
    heard = state(1, 400, own=50)
    on_counts(heard, 0, 1, SOFT, WORLD)
    on_counts(heard, 1, 0, SOFT, WORLD)
    assert (heard.own, heard.decision) == (50, -1)
    assert (heard.alpha, heard.beta) == (2, 401)
    own = sampled(none, heard, 0)
    assert (own.alpha, own.beta) == (2, 402)


@pytest.mark.parametrize("strategy", [none, positive, soft])
@pytest.mark.parametrize("revise", [False, True])
def test_only_soft_feedback_may_revise(strategy: Any, revise: bool) -> None:
    world = WORLD._replace(revise=revise)
    sure_of_one = state(200, 20, decision=0, own=50)
    after = sampled(strategy, sure_of_one, 1, world)
    assert after.decision == (1 if strategy is soft and revise else 0)
    unsure = state(100, 100, decision=0, own=50)
    assert sampled(strategy, unsure, 1, world).decision == 0  # never undecided again


def test_begin_is_the_prior() -> None:
    first = SimpleNamespace(alpha=0, beta=0, decision=0, own=0)
    begin(first, 0, Draws(1, 0, 0, 14, 0, 0, 0, -1.0), SOFT, WORLD._replace(prior_alpha=3, prior_beta=2))
    assert (first.alpha, first.beta) == (3, 2)
    assert (first.decision, first.own) == (-1, 0)


SHORT: dict[str, Any] = {"run.t_end_s": 400.0, "decision.min_observations": 40, "strategy.soft.kappa": 1.0}


def replayed(**changes: Any) -> pl.DataFrame:
    values = SHORT | {name.replace("__", "."): value for name, value in changes.items()}
    return simulate(Scenario().with_values(values), seed=5, runs=4, energies=False).inference


def test_soft_feedback_without_weight_is_no_feedback_bit_for_bit() -> None:
    without = replayed(strategy__name="none")
    assert replayed(strategy__name="soft", strategy__soft__eta=1e12).equals(without)
    # Negative control: with a weight the tables differ.
    assert not replayed(strategy__name="soft", strategy__soft__eta=10.0).equals(without)
