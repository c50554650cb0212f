"""Replay of a strategy, including its messages, over the samples of runs.

A "timeline" (``deliveries.Timeline``) holds the samples of a motion in the form that replay reads; its rows are those
of the motion table. Code that replays many strategies over one motion builds the timeline once.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import read_only, zero_rows
from vibroswarm.inference.agents import Swarm, as_column, final_frame, refuse_values, strategy_used
from vibroswarm.inference.deliveries import Timeline, timeline_of
from vibroswarm.inference.generated_kernels import uses_uniforms
from vibroswarm.inference.replay_arrays import Log, Readings, empty_log
from vibroswarm.inference.replayer import NO_VALUES, MessagesReplayer, Replayer, counts_only, replayer_of
from vibroswarm.inference.reports import report_frame
from vibroswarm.inference.sender_positions import NO_TRACKS
from vibroswarm.motion.source import Motion
from vibroswarm.networks import network as network_of
from vibroswarm.observation.decision_boundary import grid_of
from vibroswarm.observation.energy_model import weighed
from vibroswarm.observation.observe import OBSERVATIONS, reads_energies
from vibroswarm.scenario.scenario import Scenario

INFERENCE: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "message": pl.UInt8,
    "alpha": pl.UInt32,
    "beta": pl.UInt32,
    "messages_received": pl.UInt32,
    "belief_below": pl.Float64,
    "decision": pl.Int8,
}
"""Columns of the inference table: message and state of the robot after each of its samples."""


def infer(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the inference table and the final state of each robot (``agents.FINALS``).

    Args:
        motion: the motion, or its timeline. observations: the observation table, with the rows of the motion table.
    Raises:
        ValueError: the rows of motion and observations are not the same, or the strategy reads energies and some are
            missing.
        CodeError: the strategy did something that strategies may not do.
    """
    timeline = timeline_of(scenario, motion)
    return _tables(scenario, timeline, *_logged(scenario, seed, timeline, observations))


def infer_and_report(
    scenario: Scenario, seed: int, motion: Motion | Timeline, observations: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame, pl.DataFrame | None]:
    """Return both tables of ``infer``, and that of what robots reported, None if the strategy reports nothing."""
    timeline = timeline_of(scenario, motion)
    swarm, messages, log = _logged(scenario, seed, timeline, observations)
    reports = report_frame(scenario, timeline, log, swarm)
    return *_tables(scenario, timeline, swarm, messages, log), reports


def _logged(
    scenario: Scenario, seed: int, timeline: Timeline, observations: pl.DataFrame
) -> tuple[Swarm, Any, Log]:
    strategy = strategy_used(scenario)
    log = empty_log(timeline.rows.robot.size, strategy.state_type)
    messages = zero_rows(timeline.rows.robot.size, strategy.message_type)
    return _replayed(scenario, seed, timeline, observations, messages, log), messages, log


def _tables(
    scenario: Scenario, timeline: Timeline, swarm: Swarm, messages: Any, log: Log
) -> tuple[pl.DataFrame, pl.DataFrame]:
    key = [timeline.samples[name] for name in ("run", "robot", "sample")]
    columns = inference_columns(scenario, messages, log)
    return pl.DataFrame([*key, *columns]), final_frame(scenario, timeline.ends, swarm)


def replay_to_end(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    energy: NDArray[np.float32] | None = None,
) -> Swarm:
    """Replay whole runs; return the state of all robots at the end.

    Args:
        observation, energy: (rows,): classes and values of the timeline's samples; values are needed only if the
            strategy reads them.
    Raises:
        ValueError: the strategy reads energies, and ``energy`` is None.
    """
    return _replay(scenario, seed, timeline, observation, energy, messages=None, log=None)


def replay_followed(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    energy: NDArray[np.float32] | None = None,
) -> tuple[Swarm, Log]:
    """Return the state of all robots at the end, and that after each sample.

    Arguments and errors are those of ``replay_to_end``.
    """
    strategy, rows = strategy_used(scenario), timeline.rows.robot.size
    messages, log = zero_rows(rows, strategy.message_type), empty_log(rows, strategy.state_type)
    return _replay(scenario, seed, timeline, observation, energy, messages, log), log


def sent_messages(
    scenario: Scenario, seed: int, timeline: Timeline, observations: pl.DataFrame
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return sender and tick of the messages of one run, in the order of tick and sender, (messages,) each.

    Args:
        timeline, observations: those of a single run.
    """
    # Such a strategy sends exactly one message at each sample, unless a robot's radio is dead.
    if counts_only(strategy_used(scenario)) and not scenario.faults.radio_dead:
        return timeline.rows.robot.astype(np.int64), timeline.stops.tick
    # All other strategies need this replayer. Its buffer holds the messages of one run.
    replayer = MessagesReplayer(
        scenario,
        seed,
        runs=1,
        longest=timeline.longest,
        rows=timeline.rows.robot.size,
        messages=None,
        log=None,
        network=network_of(scenario.network.name),
    )
    _advance(replayer, scenario, seed, timeline, *classes_and_values(observations))
    buffer = replayer.buffer
    sent = int(buffer.filled[0])
    # Copies, so that the buffer, which is larger, can be freed.
    return buffer.sender[:sent].copy(), buffer.tick[:sent].copy()


def _replayed(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observations: pl.DataFrame,
    messages: NDArray[np.void] | None,
    log: Log | None,
) -> Swarm:
    """Check that the observations have the rows of the timeline, replay all runs, and return the robots' final state.

    Args:
        observations: the observation table. messages, log: (rows,): the message sent at each sample, and the state
            after it; written unless None.
    Raises:
        ValueError: the observation table does not have the rows of the timeline, or the strategy reads energies and
            some are missing.
    """
    if not _same_rows(timeline.samples, observations):
        raise ValueError("the observation table does not have the rows of the motion table")
    return _replay(scenario, seed, timeline, *classes_and_values(observations), messages, log)


def classes_and_values(observations: pl.DataFrame) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """Return the classes and the values of an observation table, (rows,) each; no values (None) if any is missing.

    Where several numbers are measured, they take the place of energies, (rows, numbers).
    """
    energy = observations["energy"]
    measured = [energy, *(observations[name] for name in observations.columns if name not in OBSERVATIONS)]
    classes = observations["observation"].to_numpy()
    if energy.null_count():
        return classes, None
    return classes, energy.to_numpy() if len(measured) == 1 else np.column_stack(measured)


def _replay(
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    energy: NDArray[np.float32] | None,
    messages: NDArray[np.void] | None,
    log: Log | None,
) -> Swarm:
    """Replay all runs with the kernels of the scenario's strategy and network; return the final state of all robots.

    Args:
        observation, energy: (rows,): classes and values of the samples; values are needed only if the strategy reads
            them. messages, log: (rows,): the message sent at each sample, and the state after it; written unless None.
    """
    longest = timeline.longest
    replayer = replayer_of(
        scenario, seed, runs=timeline.rows.runs.size, longest=longest, rows=timeline.rows.robot.size, messages=messages,
        log=log, timeline=timeline,
    )  # fmt: skip
    _advance(replayer, scenario, seed, timeline, observation, energy)
    return replayer.swarm


def _advance(
    replayer: Replayer,
    scenario: Scenario,
    seed: int,
    timeline: Timeline,
    observation: NDArray[np.uint8],
    energy: NDArray[np.float32] | None,
) -> None:
    """Replay all runs of a timeline with ``replayer``, from their start to their end.

    Args:
        replayer: new, changed. observation, energy: (rows,): classes and values of the samples; values are needed only
            if the strategy reads them.
    """
    strategy = strategy_used(scenario)
    numbers = timeline.message_uniforms(seed) if uses_uniforms(strategy) else NO_VALUES
    readings = Readings(
        observation=read_only(observation),
        x_m=timeline.x_m,
        y_m=timeline.y_m,
        heading_rad=timeline.heading_rad,
        uniforms=read_only(numbers),
        estimates=timeline.estimates(scenario, seed),
        weighed=read_only(_weighed(scenario, observation, energy)),
    )
    replayer.advance(
        timeline.rows,
        readings,
        timeline.stops_if(replayer.needs_stops),
        from_start=True,
        to_end=True,
        tracks=timeline.tracks if replayer.reads_positions else NO_TRACKS,
    )


def _weighed(
    scenario: Scenario, observation: NDArray[np.uint8], energy: NDArray[np.float32] | None
) -> NDArray[np.float64]:
    """Return value and log likelihood ratio of each sample, (rows, 2); no rows if the strategy does not read them.

    Raises:
        ValueError: the strategy reads energies, and ``energy`` is None.
    """
    if not reads_energies(scenario):
        return NO_VALUES.reshape(0, 2)
    if energy is None:
        raise ValueError("the strategy reads energies, and the observation table has none")
    return weighed(scenario.sensor, observation, energy, grid_of(scenario))


def _same_rows(samples: pl.DataFrame, observations: pl.DataFrame) -> bool:
    if samples.height != observations.height:
        return False
    return all(_same(samples[name].to_numpy(), observations[name].to_numpy()) for name in samples.columns)


def _same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    # For speed: an observation table shares columns with its motion table. Columns at one address need not be compared.
    at_one_place = one.__array_interface__["data"][0] == other.__array_interface__["data"][0]
    return (at_one_place and one.dtype == other.dtype) or np.array_equal(one, other)


def inference_columns(scenario: Scenario, messages: NDArray[np.void], log: Log) -> list[pl.Series]:
    """Return the columns of the inference table (``INFERENCE``) except run, robot and sample.

    A column is null everywhere if the strategy has no such value. ``message`` is the bit of a one-bit message; it is
    null where the robot did not send.

    Args:
        messages: (rows,): message sent at each sample. log: state after each sample.
    Raises:
        CodeError: as of ``refuse_values``.
    """
    count = log.belief.size
    columns: dict[str, Any] = {
        "messages_received": log.received,
        "belief_below": log.belief,
        "decision": log.decision,
    }
    if "bit" in (messages.dtype.names or ()):
        sent = log.sends != 0
        # floats only if some are missing, which nan marks
        columns["message"] = messages["bit"] if sent.all() else np.where(sent, messages["bit"], np.nan)
    for name in ("alpha", "beta"):
        if name in (log.states.dtype.names or ()):
            columns[name] = log.states[name]
    refuse_values(scenario, {name: column for name, column in columns.items() if name != "decision"})
    return [
        as_column(name, columns[name], kind)
        if name in columns
        else pl.Series(name, [None], kind).new_from_index(0, count)
        for name, kind in INFERENCE.items()
        if name not in ("run", "robot", "sample")
    ]
