"""Replay of a strategy over the samples of runs, messages and all."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.compiled import read_only
from vibroswarm.errors import RunError
from vibroswarm.inference.agents import Swarm, empty_swarm, final_frame, world_of
from vibroswarm.inference.generate import draws, kernels
from vibroswarm.inference.rows import DONE, WHY, Counts, Log, Readings, Rows, empty_log
from vibroswarm.inference.timeline import NO_REACH, Reach, Timeline, timeline_of
from vibroswarm.motion.contract import Motion
from vibroswarm.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of
from vibroswarm.strategies.world import World

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
        RunError: the strategy did what none may.
    """
    timeline = timeline_of(scenario, motion)
    strategy = strategy_of(scenario.strategy.name)
    log = empty_log(timeline.robot.size, strategy.state_type)
    messages = np.zeros(timeline.robot.size, strategy.message_type)
    swarm = _replayed(scenario, seed, timeline, observations, messages, log)
    columns = inference_columns(messages, log)
    key = [timeline.samples[name] for name in ("run", "robot", "sample")]
    return pl.DataFrame([*key, *columns]), final_frame(timeline.ends, swarm)


def outcomes(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> pl.DataFrame:
    """What became of each robot, as ``infer`` has it, without the inference table."""
    timeline = timeline_of(scenario, motion)
    strategy = strategy_of(scenario.strategy.name)
    messages = np.empty(timeline.robot.size, strategy.message_type)
    log = empty_log(0, strategy.state_type)
    return final_frame(timeline.ends, _replayed(scenario, seed, timeline, observations, messages, log))


def replay_to_end(scenario: Scenario, seed: int, timeline: Timeline, observation: NDArray[np.uint8]) -> Swarm:
    """``outcomes`` as rows: the robots at the end of each run.

    Args:
        observation: (rows,), of the timeline's samples.
    """
    strategy = strategy_of(scenario.strategy.name)
    messages = np.empty(timeline.robot.size, strategy.message_type)
    return _replay(scenario, seed, timeline, observation, messages, empty_log(0, strategy.state_type))


def _replayed(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observations: pl.DataFrame,
    messages: NDArray[np.void],
    log: Log,
) -> Swarm:
    if not _same_rows(timeline.samples, observations):
        raise ValueError("the observation table has not the rows of the motion table")
    return _replay(scenario, seed, timeline, observations["observation"].to_numpy(), messages, log)


def _replay(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    messages: NDArray[np.void],
    log: Log,
) -> Swarm:
    strategy, longest = strategy_of(scenario.strategy.name), timeline.longest
    reach = timeline.reach(seed, scenario.network.loss)
    replayer = Replayer(
        scenario,
        seed,
        timeline.runs.size,
        longest,
        world_of(scenario, longest),
        reach,
        messages,
        log,
    )
    numbers = timeline.message_numbers(seed) if draws(strategy) else NOWHERE
    readings = Readings(
        read_only(observation),
        NO_ENERGY,
        timeline.x_m,
        timeline.y_m,
        timeline.heading_rad,
        read_only(numbers),
    )
    replayer.go_on(rows_of(timeline), readings, begins=True, ends=True)
    return replayer.swarm


NOWHERE: Final = read_only(np.empty(0))
NO_ENERGY: Final = read_only(np.empty(0, dtype=np.float32))


class Replayer:
    """The robots of some runs, and what runs their strategy from sample to sample.

    Args:
        runs: how many runs. longest: most samples of one. reach: of the timeline, where messages are lost.
        messages, log: (rows,), written; without: of one run, and nothing is put down.
    """

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        runs: int,
        longest: int,
        world: World,
        reach: Reach = NO_REACH,
        messages: NDArray[np.void] | None = None,
        log: Log | None = None,
    ) -> None:
        self.strategy = strategy_of(scenario.strategy.name)
        self.module = kernels(self.strategy, "replay_counts")
        self.seed, self.loss, self.world, self.reach = seed, scenario.network.loss, world, reach
        self.swarm = empty_swarm(self.strategy, scenario, runs)
        self.taken = np.zeros(runs, dtype=np.int64)
        self.messages = np.empty(longest, self.strategy.message_type) if messages is None else messages
        self.log = empty_log(0, self.strategy.state_type) if log is None else log
        self.course = np.empty((longest if self.strategy.steer is not None else 0, 2))
        self.counts = Counts(
            np.empty(longest + 1, dtype=np.int32),
            np.empty(longest, dtype=np.int32),
            np.empty((longest + 1, reach.words.shape[1]), dtype=np.uint64),
        )

    def go_on(
        self,
        rows: Rows,
        readings: Readings,
        *,
        begins: bool = False,
        ends: bool = False,
        limit_s: float = np.inf,
    ) -> None:
        """Replay the samples that are new.

        Args:
            begins: from time 0. ends: also hear what is heard after the last sample. limit_s: no further.
        Raises:
            RunError: the strategy did what none may.
        """
        came = self.module.replay(
            rows, readings, self.taken, self.swarm, self.messages, self.counts, self.log, self.course, self.world,
            self.seed, self.loss, self.reach, begins, ends, limit_s,
        )  # fmt: skip
        if came != DONE:
            raise RunError(f"strategy '{self.strategy.name}': {WHY[came]}")


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
    columns: dict[str, NDArray[Any]] = {
        "received": log.received,
        "belief": log.belief,
        "decision": log.decision,
    }
    if "bit" in (messages.dtype.names or ()):
        columns["message"] = messages["bit"].astype(np.uint8)
    for name in ("alpha", "beta"):
        if name in (log.states.dtype.names or ()):
            columns[name] = log.states[name].astype(np.uint32)
    return [
        pl.Series(name, columns.get(name, [None] * count), dtype=kind)
        for name, kind in INFERENCE.items()
        if name not in ("run", "robot", "sample")
    ]
