"""Replay strategies on the observations of a recording.

Bits are those that were read, or E > theta_E with the requested threshold. Each message is lost at random, with the
share that the session's log counts, in many draws; where a log counts no messages, the network of the recording's
scenario delivers them. Places are those of the recording, as if robots knew them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.inference.agents import FINALS
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.outcomes import ROBOTS, RUNS, outcome_tables, with_shares
from vibroswarm.inference.replay import infer
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.observation.energy_model import model_of, readings_of
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.sampling import packet_loss
from vibroswarm.strategies import strategy as strategy_of

REPLAYABLE: Final = ("sensor", "strategy", "decision")
"""Sections of the scenario that a replay may change."""


@dataclass(frozen=True, eq=False)
class Replayed:
    """Draws of the replay of one scenario."""

    scenario: Scenario
    robots: pl.DataFrame
    runs: pl.DataFrame


def replay_recording(recording: Recording, scenario: Scenario, draws: int = 200, seed: int = 1) -> Replayed:
    """Replay a scenario on the observations of a recording, ``draws`` times, with seeds from ``seed`` on.

    Args:
        scenario: that of the recording, in which the sections ``REPLAYABLE`` may be changed; of the sensor, the bits
            depend on the threshold alone.
    Raises:
        InputError: another section differs, the strategy steers, or the sensor reads more than energies.
    """
    for section in type(scenario).model_fields:
        if section not in REPLAYABLE and getattr(scenario, section) != getattr(recording.scenario, section):
            raise InputError("cannot be changed in the replay of a recording", field=section)
    if strategy_of(scenario.strategy.name).steer is not None:
        raise InputError(
            f"'{scenario.strategy.name}' steers its robots, but recorded ones moved as they did",
            field="strategy.name",
        )
    numbers = model_of(scenario.sensor).names_of_numbers(scenario.sensor.params)
    if scenario.sensor.readings > 2 and len(numbers) > 1:
        raise InputError(
            f"'{scenario.sensor.model}' reads {', '.join(numbers)}, and recordings have energies only",
            field="sensor.model",
        )
    scenario = scenario.with_values({"localisation.method": "true"})
    sessions = [
        (of_session, timeline_of(of_session, motion), _readings(recording, scenario, motion.samples, run))
        for run, of_session, motion in _sessions(recording, scenario)
    ]
    finals = [
        infer(one, seed + draw, timeline, seen)[1]
        for draw in range(draws)
        for one, timeline, seen in sessions
    ]
    states, ends = pl.concat(finals).select(list(FINALS)), pl.concat([recording.ends] * draws)
    robots, runs = outcome_tables(scenario, recording.floor_by_run, states, ends)
    # A session may end before t_end_s, but because people ended it, not by a decision: it did not stop early.
    number = np.arange(draws, dtype=np.uint32)
    robots, runs = (
        table.select(pl.Series("draw", number.repeat(table.height // draws)), *columns)
        for table, columns in ((robots, ROBOTS), (runs.with_columns(stopped_early=False), RUNS))
    )
    return Replayed(scenario, robots, runs)


def _sessions(recording: Recording, scenario: Scenario) -> Iterator[tuple[int, Scenario, Motion]]:
    """Yield each session with its motion, and a scenario whose network loses messages as often as its log counts."""
    for run, share in shares_lost(recording).items():
        of_run = pl.col("run") == run
        motion = Motion(recording.motion.filter(of_run), recording.ends.filter(of_run))
        loss = (
            {} if share is None else {"network.name": "loss", "network.loss.share": min(max(share, 0.0), 1.0)}
        )
        yield run, scenario.with_values(loss), motion


def shares_lost(recording: Recording) -> dict[int, float | None]:
    """Return the share of messages that was lost in each session, None where its log does not count them."""
    lost = dict(packet_loss(recording).select("run", "packet_loss").iter_rows())
    return {run: lost.get(run) for run in recording.runs["run"].to_list()}


def _readings(recording: Recording, scenario: Scenario, samples: pl.DataFrame, run: int) -> pl.DataFrame:
    """Return the observations of a session, with the readings of the scenario's sensor where energies are known."""
    key = ["run", "robot", "sample"]
    energy = samples.join(recording.rows.select(*key, "energy"), on=key, maintain_order="left")["energy"]
    read = pl.Series("read", readings_of(scenario.sensor, energy.fill_null(0.0).to_numpy()))
    seen = recording.observations.filter(run=run)
    return seen.with_columns(
        observation=pl.select(
            pl.when(energy.is_not_null()).then(read).otherwise(seen["observation"])
        ).to_series()
    )


@dataclass(frozen=True)
class Replays:
    """What several strategies would have decided on a recording's observations."""

    recording: Recording
    by_strategy: Mapping[str, Replayed]
    draws: int
    """Draws of the lost packets, the same for all."""
    seed: int
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the law that robots go by."""


def replay_strategies(
    recording: Recording, scenario: Scenario, names: Sequence[str], draws: int = 200, seed: int = 1
) -> Replays:
    """Replay each of some strategies as ``replay_recording`` does; the scenario's own strategy does not matter."""
    by_strategy = {
        name: replay_recording(recording, scenario.with_values({"strategy.name": name}), draws, seed)
        for name in names
    }
    return Replays(recording, by_strategy, draws, seed)


def with_beliefs(recording: Recording, seed: int = 0) -> Result:
    """Return a copy of a recording with beliefs and decisions computed from its bits by its strategy."""
    replayed = [
        infer(of_session, seed, motion, recording.observations.filter(run=run))
        for run, of_session, motion in _sessions(recording, recording.scenario)
    ]
    inference, finals = (pl.concat(tables) for tables in list(zip(*replayed, strict=True))[:2])
    # Samples whose rows were lost count here too: their numbers are missing in the table of motion.
    finals = finals.with_columns(recording.robots["samples"])
    robots, runs = outcome_tables(recording.scenario, recording.floor_by_run, finals, recording.ends)
    robots = with_shares(robots, recording.motion)
    return replace(recording, inference=inference, robots=robots, runs=runs.with_columns(stopped_early=False))


@dataclass(frozen=True)
class SessionOutcome:
    """Outcome of a session, summarised over the draws of a replay."""

    session: int
    consensus: dict[str, float]
    """Share of the draws with each consensus; empty if decisions are not logged."""
    decision_time_s: float | None
    """Mean over draws of the mean over robots; a robot that never decides counts with the time of its last sample. None
    if decisions are not logged or no robot has a sample; so are its quantiles."""
    decision_time_s_low: float | None
    """5 % quantile over the draws."""
    decision_time_s_high: float | None
    """95 % quantile over the draws."""
    undecided: float | None
    """Share of undecided robots; None if decisions are not logged."""
    belief_in_truth: float | None
    """Mean over draws and robots; None if no decision is right, or beliefs are not known."""


def logged_outcomes(recording: Recording) -> list[SessionOutcome]:
    """Summarise the robots' own decisions as if they were a replay of a single draw."""
    number = pl.lit(0, dtype=pl.UInt32).alias("draw")
    robots, runs = recording.robots.select(number, *ROBOTS), recording.runs.select(number, *RUNS)
    return session_outcomes(recording, Replayed(recording.scenario, robots, runs))


def session_outcomes(recording: Recording, replayed: Replayed) -> list[SessionOutcome]:
    """Summarise the outcome of each session over the draws of a replay, in the order of sessions."""
    # A robot that never decides counts with the time of its last sample.
    last = recording.motion.group_by("run", "robot").agg(pl.col("time_s").max().alias("last_s"))
    timed = replayed.robots.join(last, on=["run", "robot"], how="left").with_columns(
        time_s=pl.coalesce("decision_time_s", "last_s")
    )
    outcomes = []
    for run in recording.runs["run"].to_list():
        own = timed.filter(run=run)
        is_known = own["decision"].null_count() == 0
        # Mean decision time over robots, one value per draw, in the order of draws: a sum depends on the order.
        by_draw = own.filter(is_known).group_by("draw", maintain_order=True).agg(pl.col("time_s").mean())
        means_s = by_draw["time_s"].drop_nulls().to_numpy()
        consensus = replayed.runs.filter(run=run)["consensus"].drop_nulls().cast(pl.String)
        shares = consensus.value_counts(normalize=True).sort(
            "proportion", "consensus", descending=[True, False]
        )
        belief = own["belief_in_truth"].drop_nulls().to_numpy()
        outcomes.append(
            SessionOutcome(
                session=run + 1,
                consensus={str(name): float(share) for name, share in shares.iter_rows()},
                decision_time_s=float(means_s.mean()) if means_s.size else None,
                decision_time_s_low=float(np.quantile(means_s, 0.05)) if means_s.size else None,
                decision_time_s_high=float(np.quantile(means_s, 0.95)) if means_s.size else None,
                undecided=float((own["decision"] == -1).to_numpy().mean()) if is_known else None,
                belief_in_truth=float(belief.mean()) if belief.size else None,
            )
        )
    return outcomes
