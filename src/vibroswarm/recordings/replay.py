"""Replay strategies on a recording's own observations.

The energies are the recorded ones; the bit is E > theta_E with the requested threshold. Between two samples of a
robot as
many messages are received as its log counts (``replay_from_counts``); which ones is not logged and drawn at random. A
sample whose row is lost is restored half-way between its neighbours, at the robot's position, with an energy
drawn from
those of the session on tiles of the same kind. Motion is unchanged: a robot that decided continued sampling.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.jit import zero_rows
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.rng import Purpose, uniform
from vibroswarm.errors import InputError
from vibroswarm.inference.agents import FINALS, empty_swarm, final_frame, world_of
from vibroswarm.inference.generated_kernels import kernels
from vibroswarm.inference.outcomes import (
    ROBOTS,
    RUNS,
    fills_and_truth,
    outcome_tables,
    robot_table,
    run_table,
)
from vibroswarm.inference.replay import infer, inference_columns
from vibroswarm.inference.replay_arrays import HeardMessages, Session, empty_log
from vibroswarm.motion.pose import pose
from vibroswarm.motion.source import Motion
from vibroswarm.networks import network as network_of
from vibroswarm.observation.observe import vibrating_at
from vibroswarm.recordings.recording import Recording, inside
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import strategy as strategy_of

SLACK_S: Final = 1.0
"""Times of sender and receiver may each be late by a quarter of a second, and real radios may receive during a stop."""
REPLAYABLE: Final = ("sensor", "strategy", "decision")
"""Sections of the scenario that a replay may change."""


@dataclass(frozen=True, eq=False)
class Replayed(NotebookView):
    """Many draws of one scenario on a recording."""

    scenario: Scenario
    draws: int
    robots: pl.DataFrame
    """``outcomes.ROBOTS``, and ``draw``."""
    runs: pl.DataFrame
    """``outcomes.RUNS``, and ``draw``."""
    unsent: float
    """Messages received that no robot can have sent at that time, mean over draws; they are left out."""
    put_back: int
    """Restored samples in all sessions."""


@dataclass(frozen=True)
class _Rows:
    """Samples of a session, lost ones restored; (samples,) each."""

    session: Session
    energy: NDArray[np.float64]
    """nan where it is drawn at random."""
    vibrating: NDArray[np.bool_]


def replay_recording(recording: Recording, scenario: Scenario, draws: int = 200, seed: int = 1) -> Replayed:
    """Replay a scenario on the observations of a recording, ``draws`` times.

    Args:
        scenario: as the recording's except for sensor (its threshold), strategy and decision.
        seed: of the draws.
    Raises:
        InputError: another section differs, too few draws, or no count of received messages.
    """
    if draws < 1:
        raise InputError(f"{draws} is too few; at least 1", field="draws")
    for section in type(scenario).model_fields:
        if section not in REPLAYABLE and getattr(scenario, section) != getattr(recording.scenario, section):
            raise InputError("cannot be changed in the replay of a recording", field=section)
    if recording.inference["messages_received"].null_count():
        raise InputError("do not count the messages received, which a replay needs", field="the logs")
    runs = recording.runs["run"].to_list()
    parts = [_rows_of(recording, run) for run in runs]
    tables, unsent = [], 0
    for draw in range(draws):
        finals = []
        for run, rows in zip(runs, parts, strict=True):
            final, missing, _ = _replay_once(recording, scenario, rows, run, seed + draw)
            finals.append(final)
            unsent += missing
        tables.append(_outcome(recording, scenario, pl.concat(finals), draw))
    lost = int(recording.rows["lost_before"].sum())
    robots, of_runs = (pl.concat([pair[k] for pair in tables]) for k in (0, 1))
    return Replayed(scenario, draws, robots, of_runs, unsent / draws, lost)


def _replay_once(
    recording: Recording, scenario: Scenario, rows: _Rows, run: int, seed: int
) -> tuple[pl.DataFrame, int, list[pl.Series]]:
    """Replay a run once.

    Returns: the final state of each robot, the number of messages received that no robot can have sent at that time,
        and the columns of the inference table.
    """
    energy = rows.energy
    if np.isnan(energy).any():
        energy = _drawn(rows, run, seed)
    session = rows.session._replace(observation=(energy > scenario.sensor.rms_threshold).astype(np.uint8))
    count, strategy = energy.size, strategy_of(scenario.strategy.name)
    swarm, log = (
        empty_swarm(strategy, network_of("ideal"), scenario, 1),
        empty_log(count, strategy.state_type),
    )
    messages, robots = zero_rows(count, strategy.message_type), scenario.swarm.robots
    heard_messages = HeardMessages(
        np.zeros((robots, count), np.uint8), np.zeros(robots, np.int64), np.zeros(robots, np.int64)
    )
    missing = kernels(strategy, network_of("ideal"), "replay_from_counts").replay_from_counts(
        session, swarm, messages, heard_messages, log, world_of(scenario, count), SLACK_S, seed, run
    )
    ends = recording.ends.filter(pl.col("run") == run)
    return final_frame(ends, swarm), int(missing), inference_columns(messages, log)


def _drawn(rows: _Rows, run: int, seed: int) -> NDArray[np.float64]:
    """Return the energies of a session; that of a lost sample is drawn from those read on tiles of the same kind."""
    energy = rows.energy.copy()
    for k in np.flatnonzero(np.isnan(rows.energy)):
        alike = np.sort(rows.energy[(rows.vibrating == rows.vibrating[k]) & ~np.isnan(rows.energy)])
        u = uniform(
            seed, run, int(rows.session.robot[k]), int(Purpose.SENSING), int(rows.session.sample[k]), 0
        )
        energy[k] = alike[int(u * alike.size)]
    return energy


def _rows_of(recording: Recording, run: int) -> _Rows:
    """Return the samples of a run ordered by time, lost ones restored."""
    of_run = pl.col("run") == run
    key = ["run", "robot", "sample"]
    frame = (
        recording.motion.filter(of_run)
        .join(recording.rows.select(*key, "energy", "lost_before"), on=key, maintain_order="left")
        .join(recording.inference.select(*key, "messages_received"), on=key, maintain_order="left")
        .join(recording.observations.select(*key, "tile"), on=key, maintain_order="left")
    )
    floor = recording.floor(run)
    rows: list[dict[str, Any]] = []
    for _, own in frame.group_by("robot", maintain_order=True):
        before: Mapping[str, Any] = {"sample": -1, "time_s": 0.0, "stop_start_s": 0.0, "messages_received": 0}
        for row in own.iter_rows(named=True):
            rows += _put_back(recording, run, before, row)
            rows.append(row)
            before = row
    table = pl.DataFrame(
        [
            {
                name: row[name]
                for name in (*key, "time_s", "stop_start_s", "messages_received", "energy", "tile")
            }
            for row in rows
        ],
        schema_overrides={"energy": pl.Float64},
    ).sort("time_s", "robot")  # fmt: skip
    new = table.select(
        pl.col("messages_received").cast(pl.Int64)
        - pl.col("messages_received").cast(pl.Int64).shift(1).over("robot").fill_null(0)
    ).to_series()
    session = Session(
        robot=table["robot"].cast(pl.Int64).to_numpy(),
        sample=table["sample"].cast(pl.Int64).to_numpy(),
        time_s=table["time_s"].to_numpy(),
        # Messages are read at the last walking tick at the latest, so sent two ticks before the stop; half a tick is
        # for rounding.
        hears_until_s=table["stop_start_s"].to_numpy() - 1.5 * recording.scenario.tick_s,
        received=new.to_numpy(),
        observation=np.zeros(table.height, dtype=np.uint8),
    )
    energy = table["energy"].fill_null(float("nan")).to_numpy()
    return _Rows(session, energy, vibrating_at(floor, table["tile"].to_numpy()))


def _put_back(
    recording: Recording, run: int, before: Mapping[str, Any], after: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return the rows for the samples lost between two of a robot's rows, evenly spaced in time and in messages
    received."""
    lost = after["sample"] - before["sample"] - 1
    restored = []
    for nth in range(1, lost + 1):
        share = nth / (lost + 1)
        time_s = before["time_s"] + share * (after["time_s"] - before["time_s"])
        stop_s = after["time_s"] - after["stop_start_s"]
        x, y = after["x_m"], after["y_m"]
        if recording.segments is not None:
            x, y, _ = pose(recording.segments, run, after["robot"], time_s)
        tile = recording.floor(run).tile_at(*inside(np.array([x]), np.array([y]), recording.scenario))[0]
        restored.append(
            {
                "run": run,
                "robot": after["robot"],
                "sample": before["sample"] + nth,
                "time_s": time_s,
                "stop_start_s": max(time_s - stop_s, before["time_s"]),
                "messages_received": before["messages_received"]
                + int(share * (after["messages_received"] - before["messages_received"])),
                "energy": None,
                "tile": int(tile),
            }
        )
    return restored


def _outcome(
    recording: Recording, scenario: Scenario, finals: pl.DataFrame, draw: int
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the tables of robots and runs of one draw."""
    runs = recording.runs["run"].to_list()
    floors = {run: recording.floor(run) for run in runs}
    fills, truth = fills_and_truth(scenario, floors, runs)
    end_s = recording.runs["end_s"].to_numpy()
    robots = robot_table(finals.select(list(FINALS)), truth)
    of_runs = run_table(finals, fills, truth, end_s, scenario.run.t_end_s).with_columns(stopped_early=False)
    number = pl.lit(draw, dtype=pl.UInt32).alias("draw")
    return robots.select(number, *ROBOTS), of_runs.select(number, *RUNS)


def with_beliefs(recording: Recording, seed: int = 0) -> Result:
    """Return a recording without beliefs with those that its scenario implies if every message is received."""
    motion = Motion(recording.motion, recording.ends, recording.segments)
    inference, finals = infer(recording.scenario, seed, motion, recording.observations)
    floors = {run: recording.floor(run) for run in recording.runs["run"].to_list()}
    robots, runs = outcome_tables(recording.scenario, floors, finals, recording.ends)
    return replace(recording, inference=inference, robots=robots, runs=runs)


@dataclass(frozen=True)
class SessionOutcome(NotebookView):
    """Outcome of a session over the draws."""

    session: int
    strategy: str
    consensus: dict[str, float]
    """Share of the draws with each consensus."""
    decision_time_s: float | None
    """Mean over draws of the mean over robots; a robot that never decides counts with the time of its last sample."""
    decision_time_low_s: float | None
    decision_time_high_s: float | None
    """5 % and 95 % quantiles over the draws."""
    undecided: float
    belief_in_truth: float | None


def session_outcomes(recording: Recording, replayed: Replayed) -> list[SessionOutcome]:
    """Return the outcome of each session, in order."""
    return _session_outcomes(recording, replayed.robots, replayed.runs, replayed.scenario.strategy.name)


def logged_outcomes(recording: Recording) -> list[SessionOutcome]:
    """Return the outcomes of the robots' own logged decisions."""
    number = pl.lit(0, dtype=pl.UInt32).alias("draw")
    robots, runs = recording.robots.select(number, *ROBOTS), recording.runs.select(number, *RUNS)
    return _session_outcomes(recording, robots, runs, recording.scenario.strategy.name)


def _session_outcomes(
    recording: Recording, robots: pl.DataFrame, runs: pl.DataFrame, strategy: str
) -> list[SessionOutcome]:
    """Summarise the decisions of each session."""
    last = recording.motion.group_by("run", "robot").agg(pl.col("time_s").max().alias("last_s"))
    timed = robots.join(last, on=["run", "robot"], how="left").with_columns(
        time_s=pl.coalesce("decision_time_s", "last_s")
    )
    outcomes = []
    for run in recording.runs["run"].to_list():
        own, of_run = timed.filter(pl.col("run") == run), runs.filter(pl.col("run") == run)
        mean = own.group_by("draw").agg(pl.col("time_s").mean())["time_s"].drop_nulls().to_numpy()
        shares = of_run["consensus"].cast(pl.String).value_counts(normalize=True, sort=True)
        belief = own["belief_in_truth"].drop_nulls().to_numpy()
        outcomes.append(
            SessionOutcome(
                session=run + 1,
                strategy=strategy,
                consensus={str(name): float(share) for name, share in shares.iter_rows()},
                decision_time_s=float(mean.mean()) if mean.size else None,
                decision_time_low_s=float(np.quantile(mean, 0.05)) if mean.size else None,
                decision_time_high_s=float(np.quantile(mean, 0.95)) if mean.size else None,
                undecided=float((own["decision"] == -1).to_numpy().mean()),
                belief_in_truth=float(belief.mean()) if belief.size else None,
            )
        )
    return outcomes
