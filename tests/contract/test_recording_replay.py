"""Replay over a recording: without loss what was, with loss as many heard as counted, and other rules."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest
from polars.testing import assert_frame_equal

from vibroswarm.floors.floor import Floor
from vibroswarm.lab.replay import (
    replay_recording,
    replay_strategies,
    with_beliefs,
)
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import replay, simulate

KEY = ["run", "robot", "sample"]
RULES = (
    "sensor.rms_threshold",
    "strategy.name",
    "decision.min_observations",
    "decision.gate",
    "decision.credible_threshold",
)


def rules(told: Scenario) -> dict[str, object]:
    return {name: getattr(getattr(told, name.split(".")[0]), name.split(".")[1]) for name in RULES}


def described(told: Scenario) -> Scenario:
    return preset("paper").with_values(rules(told))


@pytest.fixture(scope="module")
def recording(logs: list[Path], ground: Floor, told: Scenario) -> Recording:
    return recording_of([read_log(path) for path in logs], ground, described(told), RULES)


MAP = """
name = "exact"
[columns]
robot = "robot"
time_s = "time_s"
x_m = "x_m"
y_m = "y_m"
energy = "energy"
alpha = "alpha"
beta = "beta"
belief_below = "belief_below"
decision = "decision"
sent = "sample"
messages_received = "messages_received"
stop_total_s = "stopped"
"""


def test_a_map_is_replayed_as_it_was(told: Scenario, ground: Floor, tmp_path: Path) -> None:
    """Without loss, robots of ``places`` that know their places decide as they did; with another share, they do not."""
    values = {"strategy.name": "places", "localisation.method": "true", "network.name": "ideal"}
    result = simulate(told.with_values(values), 9, 1)
    found = exactly_logged(result, ground, tmp_path)
    scenario = scenario_of(found, told).with_values({"strategy.name": "places"})
    found = replace(found, scenario=found.scenario.with_values({"run.t_end_s": told.run.t_end_s}))
    scenario = scenario.with_values({"run.t_end_s": told.run.t_end_s})
    names = ["decision", "decision_time_s", "belief_below"]
    replayed = replay_recording(found, scenario, draws=1).robots.select(names)
    assert_frame_equal(replayed, result.robots.select(names), check_exact=True)
    heard = found.inference.with_columns(
        messages_received=(pl.col("messages_received") * 0.3).cast(pl.UInt32)
    )
    deaf = replay_recording(replace(found, inference=heard), scenario, draws=1).robots.select(names)
    assert deaf["belief_below"].to_list() != replayed["belief_below"].to_list()


@pytest.mark.parametrize("strategy", ["none", "positive", "soft"])
def test_without_loss_a_replay_is_what_was(
    told: Scenario, ground: Floor, tmp_path: Path, strategy: str
) -> None:
    """With exact times, row for row and bit for bit, soft feedback's numbers too (they are addressed alike)."""
    result = simulate(told.with_values({"strategy.name": strategy}), 9, 1)
    found = exactly_logged(result, ground, tmp_path)
    uncounted = found.inference.with_columns(
        messages_received=pl.lit(None, pl.UInt32)
    )  # so that all are heard
    replayed = with_beliefs(replace(found, scenario=result.scenario, inference=uncounted), seed=9)
    assert_frame_equal(replayed.inference, result.inference, check_exact=True)


@pytest.mark.parametrize(("lost", "counts"), [(0.0, False), (0.3, True)])
def test_replay_and_page_hear_as_many_messages(
    lost: float, counts: bool, told: Scenario, ground: Floor, tmp_path: Path
) -> None:
    """A replay refused logs without counts, of which pages showed one; with counts, pages showed all as heard."""
    network = {"strategy.name": "none", "network.name": "loss", "network.loss.share": lost}
    result = simulate(told.with_values(network), 9, 1)
    found = exactly_logged(result, ground, tmp_path)
    scenario = scenario_of(found, told).with_values({"strategy.name": "none"})
    null = pl.lit(None, dtype=pl.UInt32).alias("messages_received")
    found = found if counts else replace(found, inference=found.inference.with_columns(null))
    shown = with_beliefs(replace(found, scenario=scenario))
    replays = replay_strategies(replace(found, scenario=scenario), scenario, ["none"], draws=1)
    heard = result.robots["messages_received"].sum()  # some of them after a robot's last sample
    for one in (shown, replays.by_strategy["none"]):
        assert one.robots["messages_received"].sum() == pytest.approx(heard, rel=0.05)


def exactly_logged(result: Result, ground: Floor, tmp_path: Path) -> Recording:
    """A recording of one run, with exact times."""
    table = result.motion.join(result.observations, on=KEY).join(result.inference, on=KEY)
    table.with_columns(
        stopped=(pl.col("time_s") - pl.col("stop_start_s")).cum_sum().over("robot"),
        energy=pl.col("energy").cast(float),
    ).drop("heading_rad").write_csv(tmp_path / "exact.csv")
    (tmp_path / "map.toml").write_text(MAP)
    log = read_log(tmp_path / "exact.csv", columns=tmp_path / "map.toml")
    return recording_of([log], ground, described(result.scenario), RULES)


def scenario_of(found: Recording, told: Scenario) -> Scenario:
    return found.scenario.with_values(rules(told))


def test_the_robots_log_gives_the_same_decisions(recording: Recording, told: Scenario, made: Result) -> None:
    replayed = replay_recording(recording, scenario_of(recording, told), draws=3)
    for draw in range(3):
        robots = replayed.robots.filter(pl.col("draw") == draw)
        assert robots["decision"].to_list() == made.robots["decision"].to_list()
        differ = (robots["decision_time_s"] - made.robots["decision_time_s"]).abs()
        assert differ.max() < 12.0  # a message counted a sample later may move a decision by some samples
        assert differ.median() < 0.25


@pytest.mark.parametrize("strategy", ["none", "soft"])
def test_another_strategy_decides_as_its_simulation_does(
    recording: Recording, told: Scenario, made: Result, strategy: str
) -> None:
    """``simulation.replay`` puts the same motion and the same readings under another strategy."""
    wanted = replay(made, told.with_values({"strategy.name": strategy}))
    found = replay_recording(
        recording, scenario_of(recording, told).with_values({"strategy.name": strategy}), draws=8
    )
    robots = (
        found.robots.group_by("run", "robot").agg(pl.col("alpha").cast(float).mean()).sort("run", "robot")
    )
    off = (robots["alpha"] - wanted.robots["alpha"].cast(float)) / wanted.robots["alpha"].cast(float)
    assert off.abs().max() < (0.03 if strategy == "none" else 0.2)
    other = replay_recording(
        recording, scenario_of(recording, told).with_values({"sensor.rms_threshold": 0.5}), draws=1
    )
    assert other.robots["alpha"].mean() > 1.5 * robots["alpha"].mean()  # negative control
