"""Replay of a strategy over the samples of runs, messages and all."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import read_only, zero_rows
from vibroswarm.inference.agents import Swarm, as_column, final_frame
from vibroswarm.inference.generate import draws
from vibroswarm.inference.replayers import NOWHERE, replayer_of
from vibroswarm.inference.rows import Log, Readings, Rows, empty_log
from vibroswarm.inference.timeline import Timeline, timeline_of
from vibroswarm.inference.tracks import NO_TRACKS
from vibroswarm.motion.contract import Motion
from vibroswarm.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of

INFERENCE: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "message": pl.UInt8,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "received": pl.UInt32,
    "belief": pl.Float64,
    "decision": pl.Int8,
}


def infer(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """The inference table, and what became of each robot (``agents.FINALS``).

    Args:
        motion: or its timeline, made once for many strategies.
        observations: the observation table of the motion, row by row.
    Raises:
        ValueError: the rows of motion and observations are not the same.
        CodeError: the strategy did what none may.
    """
    timeline = timeline_of(scenario, motion)
    strategy = strategy_of(scenario.strategy.name)
    log = empty_log(timeline.robot.size, strategy.state_type)
    messages = zero_rows(timeline.robot.size, strategy.message_type)
    swarm = _replayed(scenario, seed, timeline, observations, messages, log)
    columns = inference_columns(messages, log)
    key = [timeline.samples[name] for name in ("run", "robot", "sample")]
    return pl.DataFrame([*key, *columns]), final_frame(timeline.ends, swarm)


def outcomes(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> pl.DataFrame:
    """What became of each robot, as ``infer`` has it, without the inference table."""
    timeline = timeline_of(scenario, motion)
    return final_frame(timeline.ends, _replayed(scenario, seed, timeline, observations, None, None))


def replay_to_end(scenario: Scenario, seed: int, timeline: Timeline, observation: NDArray[np.uint8]) -> Swarm:
    """``outcomes`` as rows: the robots at the end of each run.

    Args:
        observation: (rows,), of the timeline's samples.
    """
    return _replay(scenario, seed, timeline, observation, None, None)


def _replayed(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observations: pl.DataFrame,
    messages: NDArray[np.void] | None,
    log: Log | None,
) -> Swarm:
    if not _same_rows(timeline.samples, observations):
        raise ValueError("the observation table has not the rows of the motion table")
    return _replay(scenario, seed, timeline, observations["observation"].to_numpy(), messages, log)


def _replay(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    messages: NDArray[np.void] | None,
    log: Log | None,
) -> Swarm:
    longest = timeline.longest
    replayer = replayer_of(
        scenario, seed, runs=timeline.runs.size, longest=longest, rows=timeline.robot.size, messages=messages, log=log,
        timeline=timeline,
    )  # fmt: skip
    strategy = strategy_of(scenario.strategy.name)
    numbers = timeline.message_numbers(seed) if draws(strategy) else NOWHERE
    readings = Readings(
        read_only(observation),
        timeline.x_m,
        timeline.y_m,
        timeline.heading_rad,
        read_only(numbers),
    )
    replayer.go_on(
        rows_of(timeline),
        readings,
        timeline.stops_if(replayer.needs_stops),
        begins=True,
        ends=True,
        tracks=timeline.tracks if replayer.asks_places else NO_TRACKS,
    )
    return replayer.swarm


def rows_of(timeline: Timeline) -> Rows:
    """A timeline as kernels read it."""
    columns = (timeline.bounds, timeline.runs, timeline.robot, timeline.sample, timeline.time_s)
    return Rows(*(read_only(one) for one in (*columns, timeline.heard, timeline.heard_at_end)))


def _same_rows(samples: pl.DataFrame, observations: pl.DataFrame) -> bool:
    if samples.height != observations.height:
        return False
    return all(_same(samples[name].to_numpy(), observations[name].to_numpy()) for name in samples.columns)


def _same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    # An observation table is made with the columns of its motion table: one memory, nothing to compare.
    at_one_place = one.__array_interface__["data"][0] == other.__array_interface__["data"][0]
    return (at_one_place and one.dtype == other.dtype) or np.array_equal(one, other)


def inference_columns(messages: NDArray[np.void], log: Log) -> list[pl.Series]:
    """The columns of the inference table but run, robot and sample; null where the strategy has no such number."""
    count = log.belief.size
    columns: dict[str, Any] = {
        "received": log.received,
        "belief": log.belief,
        "decision": log.decision,
    }
    if "bit" in (messages.dtype.names or ()):
        bits = messages["bit"].astype(np.float64)
        bits[log.sends == 0] = np.nan
        columns["message"] = bits
    for name in ("alpha", "beta"):
        if name in (log.states.dtype.names or ()):
            columns[name] = log.states[name].astype(np.uint32)
    return [
        as_column(name, columns.get(name, np.full(count, np.nan)), kind)
        for name, kind in INFERENCE.items()
        if name not in ("run", "robot", "sample")
    ]
