"""What kernels make of a motion equals a plain tick-by-tick account of it, value for value.

The account (``helpers.plain_reference.plain_run``) calls the strategies' functions as plain Python and shares
nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from helpers.drawn_scenarios import QUICK, Draw, draws
from helpers.plain_reference import differences, plain_run
from vibroswarm.result import Result
from vibroswarm.scenario.plugins import load_file
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import simulate
from vibroswarm.strategies import Strategy, array, register, u
from vibroswarm.strategies.base import forget
from vibroswarm.testing import check_strategy

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
def test_a_strategy_of_all_that_there_is_holds_to_what_each_must() -> None:
    """The program's ``check`` does the same of others (``test_check``), and ``CHECKS`` of those that are published."""
    assert [one for one in check_strategy("uses_all") if not one.holds and not one.is_warning] == []


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


@pytest.mark.parametrize("strategy", ["none", "uses_all"])
def test_reading_one_period_longer_shows(strategy: str) -> None:
    values = {"strategy.name": strategy, "localisation.method": "true"}
    scenario = Draw(robots=20).scenario(run__t_end_s=25.0).with_values(values)
    result = simulate(scenario, 8, 1)
    assert list(differences(result, plain(scenario, 8, result))) == []
    later = result.motion.with_columns(pl.col("stop_start_s") + scenario.tick_s)
    assert list(differences(result, plain_run(scenario, 8, later, result.ends, result.observations))) != []
