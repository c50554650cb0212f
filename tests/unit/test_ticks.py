"""Times that are sums or products of doubles are the ticks that they stand for."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.drawn_scenarios import Draw
from vibroswarm.core.ticks import tick_at
from vibroswarm.search.outcomes import outcomes_of
from vibroswarm.simulation import simulate

TICKS, PERIODS_MS = st.integers(0, 2**31), st.sampled_from([1, 7, 20, 33, 100])


@given(TICKS, PERIODS_MS, st.integers(-2, 2))
def test_a_time_a_few_roundings_off_is_its_tick(tick: int, period_ms: int, steps: int) -> None:
    time_s = tick * period_ms / 1000.0
    for _ in range(abs(steps)):
        time_s = math.nextafter(time_s, math.copysign(math.inf, steps))
    assert tick_at(time_s, period_ms) == tick


@given(st.integers(0, 10**6), PERIODS_MS, st.integers(1, 999))
def test_a_time_within_a_period_is_the_next_tick(tick: int, period_ms: int, part: int) -> None:
    exact = (tick + Fraction(part, 1000)) * period_ms / 1000
    assert tick_at(float(exact), period_ms) == tick + 1


def test_sums_of_times_are_rounded() -> None:
    """What makes the rounding necessary: without it, one of these sums is a tick later than it stands for."""
    sums = np.cumsum(np.full(3000, 0.02))
    assert [tick_at(float(time_s), 20) for time_s in sums] == list(range(1, 3001))
    assert (np.ceil(sums * 50) != np.arange(1, 3001)).any()


@pytest.mark.parametrize("strategy", ["none", "soft"])
def test_a_run_whose_end_is_rounded_ends(strategy: str) -> None:
    draw = Draw(strategy=strategy)
    exact, rounded = (draw.scenario(run__t_end_s=t_end_s) for t_end_s in (5.0, math.nextafter(5.0, 6.0)))
    for early in ("t_end", "all_decided"):
        one, other = (simulate(s.with_values({"run.stop": early}), 3, 2) for s in (exact, rounded))
        assert one.motion.equals(other.motion)
        assert one.ends["end_s"].to_list() == other.ends["end_s"].to_list()
    watched = simulate(rounded, 3, 2, progress=lambda share: None)
    assert watched.motion.equals(one.motion)
    (found,) = outcomes_of([rounded], 3, [0, 1])
    (right,) = outcomes_of([exact], 3, [0, 1])
    assert np.array_equal(found.decision, right.decision)
