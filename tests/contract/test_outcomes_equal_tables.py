"""Searches come to the same outcomes as tables, and move runs no further than most need."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from polars.testing import assert_frame_equal

from helpers.drawn_scenarios import Draw, draws
from helpers.result_outcomes import assert_same_outcomes, from_result
from vibroswarm.motion import source as motion_source
from vibroswarm.motion.event.event_run import EventRun
from vibroswarm.motion.source import Source, moved
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.search import outcomes as simulated
from vibroswarm.search.objective import Objective
from vibroswarm.search.outcomes import Outcomes, outcomes_of
from vibroswarm.simulation import simulate
from vibroswarm.strategies import register
from vibroswarm.strategies import strategy as strategy_named
from vibroswarm.strategies.base import forget as forget_strategy
from vibroswarm.strategies.bayes import decide_once, observe
from vibroswarm.study.spec import Study

ARRAYS = ("run", "decision", "decision_time_s", "estimate", "end_s", "fill_ratio", "truth")


def by_tables(scenario: Scenario, seed: int, runs: list[int], motion: str = "event") -> Outcomes:
    return from_result(simulate(scenario, seed, runs, motion=motion, energies=False))


@pytest.mark.slow
@settings(
    deadline=None,
    max_examples=50,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
    database=None,
)
@given(draws, st.integers(0, 2**63 - 1), st.integers(0, 2**32 - 2))
def test_outcomes_equal_tables(draw: Draw, seed: int, run: int) -> None:
    scenario = replace(draw, stop="t_end").scenario()
    by_tables_ = by_tables(scenario, seed, [run, run + 1])
    (found,) = outcomes_of([scenario], seed, [run, run + 1])
    assert_same_outcomes(found, by_tables_)


@pytest.mark.parametrize("name", ["paper", "paper-empirical", "text", "calibrated"])
@pytest.mark.parametrize("strategy", ["none", "positive", "soft"])
def test_whole_runs_of_the_presets(name: str, strategy: str) -> None:
    values: dict[str, Any] = {"strategy.name": strategy, "decision.min_observations": 100}
    scenarios = [
        preset(name).with_values(values | more)
        for more in (
            {},
            {"network.name": "loss", "network.loss.share": 0.2},
            {"floor.source": "random:0.32"},
            {"decision.min_observations": 400},
        )
    ]
    for scenario, found in zip(scenarios, outcomes_of(scenarios, 3, [0, 7]), strict=True):
        assert_same_outcomes(found, by_tables(scenario, 3, [0, 7]))


@pytest.mark.parametrize("motion", ["event", "fixed-step"])
def test_runs_in_any_order_and_alone(motion: str) -> None:
    scenario = Draw(strategy="positive", loss=0.1).scenario()
    (together,) = outcomes_of([scenario], 9, [4, 2, 3], motion)
    for k, run in enumerate([4, 2, 3]):
        alone = by_tables(scenario, 9, [run], motion)
        assert_same_outcomes(row(together, k), alone)


@pytest.mark.parametrize("stop", ["t_end", "all_decided"])
@pytest.mark.parametrize(("strategy", "revise"), [("none", False), ("soft", True)])
def test_searches_judge_as_tables_do(strategy: str, revise: bool, stop: str) -> None:
    """The floor counts as it is at the end of the run, by which time most robots have long decided, and may revise."""
    scenario = replace(Draw(), strategy=strategy, revise=revise, stop=stop).scenario()
    scenario = scenario.with_values({"change.at_s": [18.0, 120.0], "change.to": "invert"})
    expected = by_tables(scenario, 2, list(range(8)))
    (found,) = outcomes_of([scenario], 2, list(range(8)))
    assert (found.end_s < 120.0).any()
    for name in ("truth", "decision", "decision_time_s", "right", "wrong"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


@pytest.mark.parametrize("strategy", ["none", "mcp", "dmvd"])  # with each sample, in turn, and by a timer
def test_messages_are_counted_to_the_end_of_the_run(strategy: str) -> None:
    values = {"strategy.name": strategy, "decision.min_observations": 30, "run.t_end_s": 200.0}
    scenario = preset("paper").with_values(values)
    for found in outcomes_of([scenario, scenario], 5, [0]):
        ended = scenario.with_values({"run.t_end_s": float(found.end_s[0])})
        np.testing.assert_array_equal(found.sent[0], simulate(ended, 5, [0]).robots["sent"])


@pytest.mark.parametrize("strategy", ["mcp", "averaging"])
def test_estimates_other_than_a_posterior_s_are_those_of_tables(strategy: str) -> None:
    """The strategy's own, or from its shares of kinds; of a task without decisions, so that runs go on to T_end."""
    values = {"strategy.name": strategy, "task.name": "share", "run.t_end_s": 60.0, "network.name": "ideal"}
    scenario = Scenario().with_values(values)
    (found,) = outcomes_of([scenario], 2, [0, 1])
    expected = simulate(scenario, 2, [0, 1]).robots["estimate"].to_numpy().reshape(2, -1)
    assert np.isfinite(expected).all()
    np.testing.assert_array_equal(found.estimate, expected)
    error = Objective("estimate_error").figures(found)
    np.testing.assert_array_equal(error[:, 0], np.abs(expected - found.fill_ratio[:, None]).mean(axis=1))


@pytest.mark.parametrize("t_end_s", [0.01, 0.02, 0.04])
@pytest.mark.parametrize("together", [1, 2])
def test_a_run_that_ends_at_once_is_not_the_one_before(t_end_s: float, together: int) -> None:
    scenario = Draw(strategy="positive").scenario()
    outcomes_of([scenario], 1, [0])
    for found in outcomes_of([scenario.with_values({"run.t_end_s": t_end_s})] * together, 1, [0, 1]):
        assert found.undecided.all()
        assert (found.estimate == 0.5).all()


def test_a_sample_at_the_very_end_counts() -> None:
    """A run ends at a look, and what is sampled at that very period is in the estimate."""
    scenario = Draw(strategy="none", robots=12).scenario()
    runs = list(range(150))
    result = simulate(scenario, 1, runs, energies=False)
    (found,) = outcomes_of([scenario], 1, runs)
    assert_same_outcomes(found, from_result(result))
    ends = np.repeat(found.end_s, result.motion.group_by("run", maintain_order=True).len()["len"].to_numpy())
    at_the_end = (result.motion["time_s"].to_numpy() == ends) & (ends < 150.0)
    assert at_the_end.sum() > 3


def test_where_a_run_stops_does_not_matter() -> None:
    scenario = Draw(strategy="soft").scenario()
    early = scenario.with_values({"run.stop": "all_decided"})
    one, other = outcomes_of([scenario, early], 4, [0, 1, 2])
    assert_same_outcomes(one, other)
    assert (one.end_s < 150.0).any()


@pytest.mark.parametrize("engine", ["event", "fixed-step"])
def test_a_run_that_ends_with_the_last_decision_is_one_whole(engine: str) -> None:
    """Its tables are those of a run that is moved to that end."""
    scenario = preset("paper").with_values({"run.stop": "all_decided", "run.t_end_s": 700.0})
    result = simulate(scenario, 3, [0, 2], motion=engine, poses=True, moves=True)
    for run in (0, 2):
        end_s = float(result.ends.filter(run=run)["end_s"][0])
        whole = moved(engine, scenario, 3, [run], moves=True, until=[round(end_s / scenario.tick_s)])
        for name, table in (
            ("motion", "samples"),
            ("ends", "ends"),
            ("moves", "moves"),
        ):
            assert getattr(result, name).filter(run=run).equals(getattr(whole, table)), name
        assert end_s > 200.0


def test_how_far_runs_are_moved_first_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is what the last runs needed; the few that need more are moved once more, and more shortly than to the end."""
    scenario = preset("paper").with_values({"decision.min_observations": 100, "floor.source": "random:0.32"})
    ends_s = []

    def noted(*arguments: Any, until: list[int]) -> Any:
        ends_s.append([tick * scenario.tick_s for tick in until])
        return moved(*arguments, until=until)

    monkeypatch.setattr(simulated, "moved", noted)
    simulated._needed_s.cache_clear()
    (whole,) = outcomes_of([scenario], 3, range(20))
    assert ends_s == [[1200.0] * 20]
    (found,) = outcomes_of([scenario], 3, range(20))
    assert_same_outcomes(found, whole)
    assert ends_s[1][0] < 1200.0
    assert ends_s[2] == [1200.0] * int((whole.end_s + 0.02 > ends_s[1][0]).sum())


def test_robots_that_may_decide_otherwise_later_are_followed_to_the_end() -> None:
    """Negative control too: had they been left when all had decided, the outcomes would be others."""
    draw = Draw(strategy="soft", revise=True)
    scenario = draw.scenario(decision__min_observations=0, decision__credible_threshold=0.6)
    runs = list(range(20))
    (found,) = outcomes_of([scenario], 2, runs)
    assert_same_outcomes(found, by_tables(scenario, 2, runs))
    (kept,) = outcomes_of([scenario.with_values({"decision.revise": False})], 2, runs)
    assert (kept.decision != found.decision).any()


def row(outcomes: Outcomes, k: int) -> Outcomes:
    """One run alone."""
    return replace(outcomes, **{name: getattr(outcomes, name)[k : k + 1] for name in ARRAYS})


SLOWLY = '''"""Every message is there after a while that depends on how many were sent before; some never."""
from vibroswarm.networks import Network, u


class State:
    sent: int


def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w):
    n.sent += 1
    for j in range(arrival_tick.size):
        arrival_tick[j] = -1 if u(d, j) < 0.2 else tick + 1 + (7 * n.sent + 13 * j) % 90


slowly = Network(name="slowly", state=State, send=send)
'''
EXAMPLE = Path(__file__).parents[2] / "examples" / "strategies" / "voter.py"


@pytest.mark.slow
@settings(
    deadline=None,
    max_examples=20,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    database=None,
)
@given(
    draws,
    st.sampled_from(["slowly", "near"]),
    st.integers(0, 2**63 - 1),
)
def test_timers_opinions_and_networks_that_remember(
    own_files: None, draw: Draw, network: str, seed: int
) -> None:
    """What is no strategy or network of the package: message by message."""
    drawn = replace(draw, stop="t_end", strategy="voter")
    scenario = drawn.scenario(decision__hold_s=4.0, strategy__voter__phase_s=9.0, network__name=network)
    by_tables_ = by_tables(scenario, seed, [3, 4])
    (found,) = outcomes_of([scenario], seed, [3, 4])
    assert_same_outcomes(found, by_tables_)


@pytest.mark.parametrize("range_m", [0.0, 0.3, 1e9])
def test_a_range_in_a_users_file_is_that_of_the_package(own_files: None, range_m: float) -> None:
    """Which is held against distances, and against the ideal network, in ``test_our_networks``."""
    ranges = {"network.near.range_m": range_m, "network.range.range_m": range_m or 1e-9}
    near, ours = (
        simulate(Draw(strategy="none").scenario(network__name=name).with_values(ranges), 7, [0, 1])
        for name in ("near", "range")
    )
    for name in ("inference", "robots", "runs"):
        assert_frame_equal(getattr(near, name), getattr(ours, name), check_exact=True)


@pytest.mark.slow
def test_a_range_where_runs_end_early_or_are_steered_or_share_motion(own_files: None) -> None:
    avoider = f"{EXAMPLE.with_name('avoider.py')}:avoider"
    plugins.load_file("strategy", avoider)
    near = Draw(strategy="positive").scenario(network__name="near")
    followed, also = outcomes_of([near, near.with_values({"run.stop": "all_decided"})], 3, [0, 1, 2])
    assert_same_outcomes(followed, also)
    early = simulate(near.with_values({"run.stop": "all_decided"}), 3, [0, 1, 2], moves=True)
    assert early.moves is not None
    assert early.robots["decision"].to_list() == followed.decision.ravel().tolist()
    assert early.robots["decision_time_s"].to_list() == followed.decision_time_s.ravel().tolist()
    assert early.ends["end_s"].max() < 150.0  # type: ignore[operator]
    steered = near.with_values({"strategy.name": "avoider"})
    one, other = (simulate(steered, 3, [0, 1], motion=name) for name in ("event", "fixed-step"))
    assert one.robots["messages_received"].to_list() == other.robots["messages_received"].to_list()
    assert one.robots["messages_received"].sum() > 0
    (found,) = outcomes_of([steered], 3, [0, 1])
    assert_same_outcomes(found, from_result(one))
    ideal = near.with_values({"network.name": "ideal"})
    study = Study(
        near.model_dump(exclude_none=True), {"grid": {"network.name": ["ideal", "near"]}}, runs=3, seed=3
    )
    told = study.run()
    for cell, scenario in enumerate((ideal, near)):
        alone = simulate(scenario, 3, [0, 1, 2]).robots
        assert (
            told.tables(told.cells[cell])[0]["messages_received"].to_list()
            == alone["messages_received"].to_list()
        )


@pytest.fixture
def own_files(tmp_path: Path) -> None:
    (tmp_path / "slowly.py").write_text(SLOWLY, encoding="utf-8")
    plugins.load_file("strategy", f"{EXAMPLE}:voter")
    plugins.load_file("network", f"{tmp_path / 'slowly.py'}:slowly")
    plugins.load_file("network", f"{EXAMPLE.parents[1] / 'networks' / 'near.py'}:near")


def says_ones_only(s: Any, a: Any, x: Any, out: Any, d: Any, p: Any, w: Any) -> bool:
    observe(s, x.reading)
    decide_once(s, w)
    if x.reading == 1:
        out.bit = 1
    return True


def test_a_message_is_zero_before_the_strategy_fills_it() -> None:
    """In every run: runs share the memory of their messages."""
    register(replace(strategy_named("none"), name="ones_only", on_sample=says_ones_only))
    try:
        runs, none = [0, 1, 2, 3], Draw(strategy="none").scenario()
        scenario = none.with_values({"strategy.name": "ones_only"})
        (found,) = outcomes_of([scenario], 2, runs)
        assert_same_outcomes(found, by_tables(scenario, 2, runs))
        assert_same_outcomes(found, outcomes_of([none], 2, runs)[0])
    finally:
        forget_strategy("ones_only")


class OfTables:
    """A state that is none of ours: that of the engine in another class."""

    def __init__(self, *wanted: Any) -> None:
        self.state: Any = EventRun(*wanted)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.state, name)


@pytest.fixture
def of_tables() -> Iterator[str]:
    made: Any = Source("of-tables", OfTables)
    yield motion_source.register(made).name
    motion_source.forget("of-tables")


def test_robots_of_a_source_that_gives_tables_alone_do_as_those_of_the_engine(of_tables: str) -> None:
    """They move, and runs end with the decisions."""
    scenario = Draw(strategy="positive").scenario()
    (found,) = outcomes_of([scenario], 5, [1, 2], of_tables)
    assert_same_outcomes(found, by_tables(scenario, 5, [1, 2]))
    early = scenario.with_values({"run.stop": "all_decided"})
    one, other = (simulate(early, 5, [1, 2], motion=name, poses=True) for name in ("event", of_tables))
    assert (one.ends["end_s"] < 150.0).any()
    for name in ("motion", "ends", "poses", "inference", "robots", "runs"):
        assert_frame_equal(getattr(one, name), getattr(other, name), check_exact=True)
