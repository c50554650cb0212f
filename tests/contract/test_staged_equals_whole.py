"""The whole run, messages in the loop, equals the three stages one after the other, table for table."""

from __future__ import annotations

from typing import Any

import polars as pl
import pytest
from drawn_scenarios import QUICK, Draw, draws
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal
from scipy.special import betainc
from vibroswarm.inference.minds import FINALS
from vibroswarm.whole import whole_run

from vibroswarm.draws import Purpose, uniform
from vibroswarm.presets import preset
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import simulate

TABLES = ("motion", "ends", "observations", "inference", "finals")
Tables = dict[str, pl.DataFrame]


def whole(scenario: Scenario, seed: int, run: int) -> Tables:
    floor = scenario.floor_for(seed, run if scenario.floor.drawn_by_run else 0)
    motion, observations, inference, finals = whole_run(scenario, seed, run, floor)
    return dict(zip(TABLES, (motion.samples, motion.ends, observations, inference, finals), strict=True))


def staged(scenario: Scenario, seed: int, run: int) -> Tables:
    result = simulate(scenario, seed, [run], motion="fixed-step")
    finals = result.robots.select(list(FINALS))
    tables = (result.motion, result.ends, result.observations, result.inference, finals)
    return dict(zip(TABLES, tables, strict=True))


def equal(one: Tables, other: Tables) -> None:
    """Every table, bit by bit, order and types included."""
    for name in TABLES:
        try:
            assert_frame_equal(one[name], other[name], check_exact=True)
        except AssertionError as error:
            raise AssertionError(f"{name}: {error}") from None


@settings(
    deadline=None,
    max_examples=120,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
    database=None,
)
@given(draws, st.integers(0, 2**63 - 1), st.integers(0, 2**32 - 1))
def test_whole_equals_staged(draw: Draw, seed: int, run: int) -> None:
    scenario = draw.scenario()
    equal(whole(scenario, seed, run), staged(scenario, seed, run))


@pytest.mark.parametrize("strategy", ["none", "positive", "soft"])
@pytest.mark.parametrize("stop", ["t_end", "all_decided"])
@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("robots", [1, 2, 5, 20])
def test_whole_equals_staged_for_each_strategy(strategy: str, stop: str, loss: float, robots: int) -> None:
    draw = Draw(strategy=strategy, stop=stop, loss=loss, robots=robots, floor="border")
    scenario = draw.scenario()
    one = whole(scenario, 5, 3)
    equal(one, staged(scenario, 5, 3))
    assert one["observations"]["tile"].min() == -1  # the border is stood upon


@pytest.mark.parametrize(
    "t_end_s", [0.01, 0.02, 0.04, 1.5, 2.0, 2.99, 3.0, 3.02, 3.04, 3.06, 3.08, 3.1, 10.001]
)
def test_whole_equals_staged_wherever_the_run_ends(t_end_s: float) -> None:
    """Before, in, at and after the first stops: who still hears what is sent last."""
    scenario = Draw(strategy="positive", robots=20).scenario(
        run__t_end_s=t_end_s, decision__min_observations=0
    )
    for run in range(3):
        equal(whole(scenario, 8, run), staged(scenario, 8, run))


def test_whole_equals_staged_over_a_full_run_of_the_paper() -> None:
    for name in ("none", "positive", "soft"):
        scenario = Scenario().with_values({"strategy.name": name})
        equal(whole(scenario, 1, 0), staged(scenario, 1, 0))


def test_pieces_of_a_longer_run_do_not_show() -> None:
    """With ``all_decided`` the staged run goes on in pieces of 100 s; here it ends in the third."""
    draw = Draw(strategy="none", stop="all_decided")
    scenario = draw.scenario(run__t_end_s=1200.0, decision__min_observations=400)
    one = whole(scenario, 2, 1)
    assert 200 < one["ends"]["end_s"][0] < 300
    equal(one, staged(scenario, 2, 1))


# A third account of the radio and the mind, with inboxes, and with scipy's incomplete beta function


def with_inboxes(
    scenario: Scenario, seed: int, run: int, read_while_standing: bool = False
) -> list[list[int]]:
    """run, robot, sample, message, alpha, beta, received, decision of each sample (no soft feedback).

    Tick by tick: whoever walks empties its inbox; whoever's stop is over observes, updates, tests, sends.
    """
    result = simulate(scenario, seed, [run], segments=True, motion="fixed-step")
    robots, tick_s, d = range(scenario.swarm.robots), scenario.tick_s, scenario.decision
    assert result.segments is not None
    mode, stands = {}, {}
    for row in result.segments.to_dicts():
        mode[row["robot"], round(row["start_s"] / tick_s)] = row["kind"]
    bits = {
        (round(row["time_s"] / tick_s), row["robot"]): (row["sample"], bit)
        for row, bit in zip(result.motion.to_dicts(), result.observations["observation"], strict=True)
    }
    inbox: dict[int, list[int]] = {i: [] for i in robots}
    alpha, beta = [d.prior_alpha for _ in robots], [d.prior_beta for _ in robots]
    own, received, decision = [0 for _ in robots], [0 for _ in robots], [-1 for _ in robots]
    table = []
    for tick in range(round(result.ends["end_s"][0] / tick_s)):
        for i in robots:
            stands[i] = (
                mode.get((i, tick), "stop" if tick == 0 else ("stop" if stands[i] else "drive")) == "stop"
            )
            if not stands[i] or read_while_standing:
                for bit in inbox[i]:
                    alpha[i], beta[i], received[i] = alpha[i] + bit, beta[i] + 1 - bit, received[i] + 1
                inbox[i] = []
        for i in robots:
            if (tick, i) not in bits:
                continue
            index, bit = bits[tick, i]
            alpha[i], beta[i], own[i] = alpha[i] + bit, beta[i] + 1 - bit, own[i] + 1
            counted = own[i] - 1 + d.gate_counts_current
            counted = {"total": counted + received[i], "own": counted, "received": received[i]}[d.gate]
            belief = betainc(alpha[i], beta[i], d.decision_boundary)
            if decision[i] == -1 and counted > d.min_observations:
                decision[i] = (
                    0 if belief > d.credible_threshold else 1 if 1 - belief > d.credible_threshold else -1
                )
            message = decision[i] if scenario.strategy.name == "positive" and decision[i] != -1 else bit
            for j in robots:
                if j != i and uniform(seed, run, j, Purpose.LOSS, index, i) >= scenario.network.loss:
                    inbox[j].append(message)
            table.append([run, i, index, message, alpha[i], beta[i], received[i], decision[i]])
    return table


COLUMNS = ["run", "robot", "sample", "message", "alpha", "beta", "received", "decision"]


@pytest.mark.parametrize(
    "draw",
    [
        Draw(),
        Draw(strategy="positive", loss=0.3, robots=6, floor="cut"),
        Draw(strategy="positive", gate="own", current=True, robots=12, stop_ms=20.0, interval_ms=300.0),
        Draw(strategy="none", gate="received", robots=7, prior=(4, 2), period_ms=50, timer="hold_in_turn"),
    ],
)
def test_inboxes_tell_the_same_story(draw: Draw) -> None:
    scenario = draw.scenario(run__t_end_s=100.0)
    expected = [list(row) for row in simulate(scenario, 6, [2]).inference.select(COLUMNS).iter_rows()]
    assert with_inboxes(scenario, 6, 2) == expected
    assert len({row[7] for row in expected}) > 1
    # Negative control: a radio that listens during stops tells another one.
    assert with_inboxes(scenario, 6, 2, read_while_standing=True) != expected


# Negative controls: the comparison sees a difference in any one rule.

BASE = Draw(strategy="soft", loss=0.1, robots=5)
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    ("another run", {}),
    ("no loss", {"network.name": "loss", "network.loss.share": 0.0}),
    ("a little more loss", {"network.name": "loss", "network.loss.share": 0.13}),
    ("another eta", {"strategy.soft.eta": 30.0}),
    ("another gate", {"decision.gate": "own"}),
    ("one observation more", {"decision.min_observations": 14}),
    ("another prior", {"decision.prior_alpha": 2}),
    ("another threshold", {"sensor.rms_threshold": 1.2}),
    ("a tile moved", {"floor.left_m": 0.02}),
]


@pytest.mark.parametrize(("name", "values"), VARIANTS, ids=[name for name, _ in VARIANTS])
def test_the_comparison_is_sensitive(name: str, values: dict[str, Any]) -> None:
    scenario = BASE.scenario()
    run = 1 if name == "another run" else 0
    other = staged(scenario.with_values(values), 5, run)
    with pytest.raises(AssertionError):
        equal(whole(scenario, 5, 0), other)


def test_hearing_one_period_too_early_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control for the radio: a staged run in which the last bits of a run are heard too early."""
    import vibroswarm.inference.timeline as timeline

    heard = timeline.heard_at_end
    different = 0
    for t_end_s in (20.02 + 0.02 * k for k in range(40)):
        scenario = Draw(robots=20).scenario(run__t_end_s=t_end_s)
        right = whole(scenario, 8, 0)
        equal(right, staged(scenario, 8, 0))
        monkeypatch.setattr(timeline, "heard_at_end", lambda ends, tick_ms: heard(ends, tick_ms) + 1)
        wrong = staged(scenario, 8, 0)
        monkeypatch.setattr(timeline, "heard_at_end", heard)
        different += not wrong["finals"].equals(right["finals"])
    assert different > 5


@pytest.mark.parametrize("strategy", ["none", "positive", "soft"])
def test_calibrated_robots_too(strategy: str) -> None:
    """Robots named one by one, blind after turns, with sensing across edges."""
    scenario = preset("calibrated").with_values(QUICK | {"strategy.name": strategy, "swarm.robots": 7})
    equal(whole(scenario, 8, 2), staged(scenario, 8, 2))
