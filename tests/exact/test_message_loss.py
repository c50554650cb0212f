"""The model of lost messages in recordings: its likelihood by enumeration, and a fit to windows drawn from it."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import polars as pl
import pytest

from vibroswarm.calibrate.message_loss import (
    Bursts,
    Windows,
    _Table,
    by_size,
    fit_bursts,
    fit_independent,
    gap_sizes,
    jackknife,
    lost_for_good,
    lost_in_long_windows,
    passing,
    simulated,
    windows_of,
)
from vibroswarm.errors import InputError
from vibroswarm.scenario.scenario import preset
from vibroswarm.simulation import simulate

MODEL = Bursts(0.2, 6.0, 0.9, 0.05, 0.4, 0.0, 5)


def test_chances_of_received_messages_by_enumeration() -> None:
    """All sequences of states and losses of four messages, one by one."""
    chances = passing(MODEL, 4, 4, spacing_s=2.0)
    anew = 1.0 - math.exp(-2.0 / (6.0 * 0.8))
    share = (0.8, 0.2)
    lost = (0.05, 0.9)
    for before, after, received in product((0, 1), (0, 1), range(5)):
        total = 0.0
        for states in product((0, 1), repeat=4):
            if states[-1] != after:
                continue
            path = 1.0
            for a, b in zip((before, *states), states, strict=False):
                path *= anew * share[b] + (1.0 - anew) * (a == b)
            for hears in product((0, 1), repeat=4):
                if sum(hears) == received:
                    total += path * math.prod(
                        1.0 - lost[z] if h else lost[z] for z, h in zip(states, hears, strict=True)
                    )
        assert chances[4, received, before, after] == pytest.approx(total, abs=1e-12)
    assert chances[3].sum(axis=(0, 2)) == pytest.approx([1.0, 1.0])


def windows(count: int, receivers: int) -> list[Windows]:
    rng = np.random.default_rng(7)
    return [
        Windows(0, k, sent := rng.poisson(4.0, count), sent, np.full(count, 4.0)) for k in range(receivers)
    ]


def test_a_fit_finds_the_model_that_windows_were_drawn_from() -> None:
    assert (MODEL.lost, MODEL.aic) == (pytest.approx(0.2 * 0.9 + 0.8 * 0.05), 10.0)
    truth = Bursts(0.05, 12.0, 0.9, 0.02, 0.4, 0.0, 5)
    drawn = simulated(windows(40, 40), truth, 1.0, draw=6)
    found, plain = fit_bursts(drawn, truth), fit_independent(drawn)
    assert found.bad_share == pytest.approx(0.05, abs=0.03)
    assert 6.0 < found.bad_s < 24.0
    assert found.lost_in_bad == pytest.approx(0.9, abs=0.08)
    assert found.lost_in_good == pytest.approx(0.02, abs=0.006)
    assert found.aic < plain.aic - 100.0
    # Negative control: where losses are independent, the same bursts are less likely.
    alone = simulated(windows(40, 40), Bursts(0.0, 1.0, 0.0, 0.06, 0.4, 0.0, 2), 1.0, draw=3)
    plain = fit_independent(alone)
    assert plain.lost_in_good == pytest.approx(0.06, abs=0.01)
    assert _Table(alone).log_likelihood(found, 1.0) < plain.log_likelihood - 100.0


def test_gaps_by_hand() -> None:
    sent, received = np.array([4, 4, 4, 4, 4, 4]), np.array([4, 3, 5, 1, 2, 3])
    one = Windows(0, 0, sent, received, np.full(6, 4.0))
    assert lost_for_good(one).tolist() == [0, 0, 0, 3, 2, 1]  # that of the second window was only late
    assert gap_sizes(one).tolist() == [6]
    assert by_size([one]).tolist() == [0, 0, 0, 1, 0, 0]
    # The last window is over twice as long as the usual one: it has 6 of 7 lost messages and 8 of 20 sent ones.
    sent, received, length_s = np.array([4, 4, 4, 8]), np.array([4, 4, 3, 2]), np.array([4.0, 4.0, 4.0, 12.0])
    assert lost_in_long_windows([Windows(0, 0, sent, received, length_s)]) == pytest.approx((6 / 7, 8 / 20))


def test_windows_of_a_simulation_hold_all_messages() -> None:
    scenario = preset("paper").with_values(
        {"run.t_end_s": 200.0, "network.name": "loss", "network.loss.share": 0.2}
    )
    result = simulate(scenario, 3, 2)
    found = windows_of(result)
    assert [(one.run, one.robot) for one in found] == [(run, robot) for run in (0, 1) for robot in range(5)]
    sent, received = (sum(int(getattr(one, name).sum()) for one in found) for name in ("sent", "received"))
    assert abs(received / sent - 0.8) < 4.0 * math.sqrt(0.16 / sent)
    one, first = found[0], pl.col("robot") == 0
    own, others = (result.motion.filter(pl.col("run") == 0, of) for of in (first, ~first))
    before = [int((others["time_s"] < stop_s).sum()) for stop_s in own["stop_start_s"]]
    assert np.cumsum(one.sent).tolist() == before
    table = result.inference
    assert (
        one.received.sum()
        == table.filter((table["run"] == 0) & (table["robot"] == 0))["messages_received"][-1]
    )


def test_standard_errors_need_two_receivers() -> None:
    with pytest.raises(InputError, match="at least two receivers") as refused:
        jackknife(windows(20, 1), MODEL)
    assert refused.value.field == "windows"
    errors = jackknife(simulated(windows(6, 2), MODEL, 1.0, 0), MODEL)
    assert errors["lost_in_bad"] >= 0.0
