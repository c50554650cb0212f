"""What kernels make of a motion equals a plain tick-by-tick account of it, value for value.

The account (``vibroswarm.testing.plain_run``) calls the strategies' functions as plain Python and shares nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.special import betainc

from helpers.drawn_scenarios import QUICK, Draw, draws
from vibroswarm.core.rng import Purpose, uniform
from vibroswarm.inference import replayer
from vibroswarm.result import Result
from vibroswarm.scenario.plugins import load_file
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.strategies import Strategy, array, register, u
from vibroswarm.strategies.base import forget
from vibroswarm.testing import check_strategy, plain_run
from vibroswarm.testing.plain_reference import _Plain
from vibroswarm.testing.runs import differences

EXAMPLES = Path(__file__).parents[2] / "examples" / "strategies"


# A strategy that uses all that there is: arrays, senders, times, numbers, a timer that sends beside the samples.


class State:
    score: float
    last_s: float
    next_s: float
    decision: int


class Arrays:
    heard = array("float64", "robots")
    tiles = array("int32", "tiles*2")


class Message:
    bit: int
    weight: float


def begin(s: Any, a: Any, d: Any, p: Any, w: Any) -> None:
    s.next_s, s.decision, s.score = 2.0 + 5.0 * u(d, 0), -1, 0.0
    a.tiles[0] = w.robot


def on_message(s: Any, a: Any, m: Any, sender: int, t_s: float, d: Any, p: Any, w: Any) -> None:
    a.heard[sender] += m.weight * (2 * m.bit - 1) * (0.5 + u(d, 1))
    s.score += a.heard[sender] + 0.001 * t_s
    s.last_s = t_s


def on_sample(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    s.score += 2 * x.reading - 1 + x.x_m - x.y_m
    out.bit, out.weight = x.reading, u(d, 2)
    if s.decision == -1 and abs(s.score) > 20.0:
        s.decision = 1 if s.score > 0.0 else 0
    return bool(u(d, 0) < 0.7)


def on_timer(s: Any, a: Any, t_s: float, out: Any, d: Any, p: Any, w: Any) -> bool:
    a.tiles[1] += 1
    s.next_s = t_s + 0.5 + 4.0 * u(d, 0)
    out.bit, out.weight = 1, t_s - s.last_s
    return bool(a.tiles[1] % 3 != 0)


def decision(s: Any, a: Any, p: Any, w: Any) -> int:
    found: int = s.decision
    return found


def belief(s: Any, a: Any, p: Any, w: Any) -> float:
    return float(1.0 / (1.0 + s.score * s.score))


STRATEGIES = ("none", "positive", "soft", "voter", "avoider", "uses_all")


@pytest.fixture(scope="module", autouse=True)
def strategies_of_others() -> Iterator[None]:
    """Strategies that are not of the package, while this file is tested."""
    for example in ("voter", "avoider"):
        load_file("strategy", str(EXAMPLES / f"{example}.py:{example}"))
    space = globals()
    parts = {
        one: space[one] for one in ("begin", "on_message", "on_sample", "on_timer", "decision", "belief")
    }
    register(Strategy("uses_all", state=State, arrays=Arrays, message=Message, **parts))
    yield
    for name in ("voter", "avoider", "uses_all"):
        forget(name)


def differs(scenario: Scenario, seed: int, run: int) -> list[str]:
    """Where tables and account differ; robots know their true places, as the account does not replay localisation."""
    scenario = scenario.with_values({"localisation.method": "true"})
    result = simulate(scenario, seed, [run])
    return list(differences(result, plain(scenario, seed, result)))


def plain(scenario: Scenario, seed: int, result: Result) -> Any:
    return plain_run(scenario, seed, result.motion, result.ends, result.observations)


@pytest.mark.slow
@settings(
    deadline=None,
    max_examples=30,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
    database=None,
)
@given(draws, st.sampled_from(STRATEGIES), st.integers(0, 2**63 - 1), st.integers(0, 2**32 - 1))
def test_kernels_equal_the_plain_account(draw: Draw, strategy: str, seed: int, run: int) -> None:
    scenario = draw.scenario()
    periods_s = 1000 * scenario.tick_s  # the account is slow
    scenario = scenario.with_values({"run.t_end_s": min(scenario.run.t_end_s, periods_s)})
    if strategy not in ("none", "positive", "soft"):
        scenario = scenario.with_values({"strategy.name": strategy, "decision.hold_s": 4.0})
    assert differs(scenario, seed, run) == []


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("stop", ["t_end", "all_decided"])
@pytest.mark.parametrize("loss", [0.0, 0.2])
@pytest.mark.parametrize("robots", [1, 2, 9])
def test_each_strategy_equals_the_plain_account(strategy: str, stop: str, loss: float, robots: int) -> None:
    draw = Draw(stop=stop, loss=loss, robots=robots, floor="border")
    scenario = draw.scenario(run__t_end_s=25.0)
    values = {"strategy.name": strategy, "decision.hold_s": 2.0}
    assert differs(scenario.with_values(values), 5, 3) == []


@pytest.mark.parametrize(
    "t_end_s", [0.01, 0.02, 0.04, 1.5, 2.0, 2.99, 3.0, 3.02, 3.04, 3.06, 3.08, 3.1, 10.001]
)
@pytest.mark.parametrize("strategy", ["positive", "voter", "uses_all"])
def test_wherever_the_run_ends(t_end_s: float, strategy: str) -> None:
    """Before, in, at and after the first stops: who still hears what is sent last."""
    draw = Draw(robots=20)
    scenario = draw.scenario(run__t_end_s=t_end_s, decision__min_observations=0)
    for run in range(3):
        assert differs(scenario.with_values({"strategy.name": strategy}), 8, run) == []


@pytest.mark.parametrize("strategy", ["none", "positive", "soft"])
def test_a_full_run_of_the_paper(strategy: str) -> None:
    assert differs(Scenario().with_values({"strategy.name": strategy}), 1, 0) == []


@pytest.mark.parametrize("strategy", ["none", "positive", "soft"])
def test_calibrated_robots_too(strategy: str) -> None:
    """Robots named one by one, blind after turns, with sensing across edges."""
    scenario = preset("calibrated").with_values(QUICK | {"strategy.name": strategy, "swarm.robots": 7})
    assert differs(scenario, 8, 2) == []


@pytest.mark.slow
@settings(deadline=None, max_examples=40, derandomize=True, database=None)
@given(draws, st.integers(0, 2**63 - 1))
def test_counts_equal_messages_one_by_one(draw: Draw, seed: int) -> None:
    scenario = draw.scenario()
    one = simulate(scenario, seed, [0, 1])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(replayer, "counts_only", lambda strategy: False)
        other = simulate(scenario, seed, [0, 1])
    assert one.same_tables(other)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["positive", "uses_all"])
def test_every_strategy_holds_to_what_each_must(strategy: str) -> None:
    """``vibroswarm check`` does the same of the others, in ``test_own_strategies`` and ``test_check``."""
    assert [one for one in check_strategy(strategy) if not one.holds and not one.is_warning] == []


# A third account, with inboxes, without any of the package's functions, and with scipy's incomplete beta function


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
                if j != i and uniform(seed, run, j, Purpose.LOSS, index, i) >= scenario.network.params.share:
                    inbox[j].append(message)
            table.append([run, i, index, message, alpha[i], beta[i], received[i], decision[i]])
    return table


COLUMNS = ["run", "robot", "sample", "message", "alpha", "beta", "messages_received", "decision"]


@pytest.mark.slow
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
    scenario = draw.scenario(run__t_end_s=50.0)
    expected = [list(row) for row in simulate(scenario, 6, [2]).inference.select(COLUMNS).iter_rows()]
    assert with_inboxes(scenario, 6, 2) == expected
    assert len({row[7] for row in expected}) > 1
    # Negative control: a radio that listens during stops tells another one.
    assert with_inboxes(scenario, 6, 2, read_while_standing=True) != expected


# Negative controls: the comparison sees a difference in any one rule.

BASE = Draw(strategy="soft", loss=0.1, robots=5)
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    ("no loss", {"network.loss.share": 0.0}),
    ("a little more loss", {"network.loss.share": 0.13}),
    ("another eta", {"strategy.soft.eta": 30.0}),
    ("another gate", {"decision.gate": "own"}),
    ("one observation more", {"decision.min_observations": 14}),
    ("another prior", {"decision.prior_alpha": 2}),
]


@pytest.mark.parametrize(("name", "values"), VARIANTS, ids=[name for name, _ in VARIANTS])
def test_the_comparison_is_sensitive(name: str, values: dict[str, Any]) -> None:
    scenario = BASE.scenario()
    result = simulate(scenario, 5, 1)
    assert list(differences(result, plain(scenario, 5, result))) == []
    assert list(differences(result, plain(scenario.with_values(values), 5, result))) != []


@pytest.mark.parametrize("strategy", ["none", "voter", "uses_all"])
def test_reading_one_period_too_early_shows(monkeypatch: pytest.MonkeyPatch, strategy: str) -> None:
    scenario = (
        Draw(robots=6)
        .scenario(run__t_end_s=15.0, decision__min_observations=4)
        .with_values({"strategy.name": strategy, "localisation.method": "true"})
    )
    result = simulate(scenario, 8, 1)
    right = _Plain.tick
    monkeypatch.setattr(_Plain, "read", early(_Plain.read))
    assert list(differences(result, plain(scenario, 8, result))) != []
    monkeypatch.undo()
    assert _Plain.tick is right
    assert list(differences(result, plain(scenario, 8, result))) == []


def early(read: Any) -> Any:
    """Reading that also takes in, at once, what another robot has sent at this very period."""

    def and_at_once(account: Any, robot: Any, tick: int) -> None:
        read(account, robot, tick)
        for other in account.robots:
            robot.unread += [m for m in other.unread if m.sender != robot.number and m not in robot.unread][
                :1
            ]

    return and_at_once
