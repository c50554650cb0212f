"""Replay strategies on the observations of a recording.

Bits are those that were read, or E > theta_E with the requested threshold. Logs do not say who heard what: each message
is lost at random, with the share that the session's log counts, so that a replay consists of many draws; where a log
counts no messages, the network of the recording's scenario delivers them. Places are those of the recording (of the
camera), as if robots knew them. Samples whose rows were lost are left out. Motion is that of the recording, in which
robots continued to sample after deciding.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.rng import SEED_LIMIT
from vibroswarm.errors import InputError, check_kind, nearest, whole_number_of
from vibroswarm.inference.agents import FINALS
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.outcomes import ROBOTS, RUNS, outcome_tables, with_shares
from vibroswarm.inference.replay import infer
from vibroswarm.lab.recordings.recording import Recording
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.observation.energy_model import model_of, readings_of
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, field_types, parse_setting
from vibroswarm.simulation import MAX_RUNS
from vibroswarm.statistics.sampling import packet_loss
from vibroswarm.strategies import strategy as strategy_of

REPLAYABLE: Final = ("sensor", "strategy", "decision")
"""Sections of the scenario that a replay may change."""


@dataclass(frozen=True, eq=False)
class Replayed:
    """Many draws of the replay of one scenario on a recording."""

    scenario: Scenario
    draws: int
    """Number of draws."""
    robots: pl.DataFrame
    """``draw`` and the columns ``outcomes.ROBOTS``: one row per draw, session and robot."""
    runs: pl.DataFrame
    """``draw`` and the columns ``outcomes.RUNS``: one row per draw and session."""


def replay_recording(recording: Recording, scenario: Scenario, draws: int = 200, seed: int = 1) -> Replayed:
    """Replay a scenario on the observations of a recording, ``draws`` times.

    Args:
        scenario: that of the recording, in which the sections ``REPLAYABLE`` may be changed; of the sensor, the bits
            depend on the threshold alone. seed: of the first draw; each further draw has the next seed.
    Raises:
        InputError: ``draws`` is below 1, the seed of a draw is out of range, another section differs, the strategy
            steers, or the sensor reads more than energies.
        CodeError: the strategy is a user's, and did something that strategies may not do.
    """
    check_kind(recording, Recording, "recording", "a Recording, as Recording.read() returns")
    check_kind(scenario, Scenario, "scenario", "a Scenario")
    draws = whole_number_of(draws, "draws", 1, MAX_RUNS)
    seed = whole_number_of(seed, "seed", 0, SEED_LIMIT - draws)
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
    return Replayed(scenario, draws, robots, runs)


def _sessions(recording: Recording, scenario: Scenario) -> Iterator[tuple[int, Scenario, Motion]]:
    """Yield each session with its motion, and a scenario whose network loses messages as often as its log counts.

    The network stays that of ``scenario`` where the log does not count them.
    """
    for run, share in shares_lost(recording).items():
        of_run = pl.col("run") == run
        motion = Motion(recording.motion.filter(of_run), recording.ends.filter(of_run))
        values: dict[str, Any] = {}
        if share is not None:
            values = {"network.name": "loss", "network.loss.share": min(max(share, 0.0), 1.0)}
        yield run, scenario.with_values(values), motion


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
    """At least one."""
    draws: int
    """Draws of the lost packets, the same for all."""
    seed: int
    warnings: tuple[str, ...] = ()
    """Reasons not to trust the law that robots go by."""


def replay_strategies(
    recording: Recording, scenario: Scenario, names: Sequence[str], draws: int = 200, seed: int = 1
) -> Replays:
    """Replay each of some strategies as ``replay_recording`` does; the scenario's own strategy does not matter."""
    found = {
        name: replay_recording(recording, scenario.with_values({"strategy.name": name}), draws, seed)
        for name in names
    }
    return Replays(recording, found, draws, seed)


def with_beliefs(recording: Recording, seed: int = 0) -> Result:
    """Return a copy of a recording, also a ``Recording``, with beliefs and decisions computed from its bits.

    The strategy of the recording's scenario computes them, with messages as in a replay. They replace logged ones, so
    this is for recordings that lack beliefs.

    Args:
        seed: of the random numbers of strategy and network.
    """
    check_kind(recording, Recording, "recording", "a Recording, as Recording.read() returns")
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
    """From 1."""
    strategy: str
    """Name of the strategy."""
    consensus: dict[str, float]
    """Share of the draws with each consensus; empty if decisions are not logged."""
    decision_time_s: float | None
    """Mean over draws of the mean over robots; a robot that never decides counts with the time of its last sample. None
    if decisions are not logged or no robot has a sample; so are its quantiles."""
    decision_time_low_s: float | None
    """5 % quantile over the draws."""
    decision_time_high_s: float | None
    """95 % quantile over the draws."""
    undecided: float | None
    """Share of undecided robots; None if decisions are not logged."""
    belief_in_truth: float | None
    """Mean over draws and robots; None if no decision is right, or beliefs are not known."""


def session_outcomes(recording: Recording, replayed: Replayed) -> list[SessionOutcome]:
    """Summarise a replay: the outcome of each session over the draws, in the order of sessions."""
    return _session_outcomes(recording, replayed.robots, replayed.runs, replayed.scenario.strategy.name)


def logged_outcomes(recording: Recording) -> list[SessionOutcome]:
    """Summarise the robots' own decisions as if they were a replay of a single draw."""
    number = pl.lit(0, dtype=pl.UInt32).alias("draw")
    robots, runs = recording.robots.select(number, *ROBOTS), recording.runs.select(number, *RUNS)
    return _session_outcomes(recording, robots, runs, recording.scenario.strategy.name)


def _session_outcomes(
    recording: Recording, robots: pl.DataFrame, runs: pl.DataFrame, strategy: str
) -> list[SessionOutcome]:
    """Summarise the decisions of each session over all draws, in the order of sessions.

    If the decision of any robot of a session is not logged, the outcome has neither decision times nor a share of
    undecided robots, and no consensus either, since that of the run is null then. In decision times, robots without
    samples and without a decision do not count.

    Args:
        robots, runs: tables of the robots and of the runs of all draws, with the column ``draw``.
        strategy: name of the strategy, copied to the outcomes.
    """
    # A robot that never decides counts with the time of its last sample.
    last = recording.motion.group_by("run", "robot").agg(pl.col("time_s").max().alias("last_s"))
    timed = robots.join(last, on=["run", "robot"], how="left").with_columns(
        time_s=pl.coalesce("decision_time_s", "last_s")
    )
    outcomes = []
    for run in recording.runs["run"].to_list():
        own, of_run = timed.filter(pl.col("run") == run), runs.filter(pl.col("run") == run)
        is_known = own["decision"].null_count() == 0
        # Mean decision time over robots, one value per draw, in the order of draws: a sum depends on the order.
        known = own if is_known else own.clear()
        by_draw = known.group_by("draw", maintain_order=True).agg(pl.col("time_s").mean())
        means_s = by_draw["time_s"].drop_nulls().to_numpy()
        counted = of_run["consensus"].drop_nulls().cast(pl.String).value_counts(normalize=True)
        shares = counted.sort("proportion", "consensus", descending=[True, False])
        belief = own["belief_in_truth"].drop_nulls().to_numpy()
        outcomes.append(
            SessionOutcome(
                session=run + 1,
                strategy=strategy,
                consensus={str(name): float(share) for name, share in shares.iter_rows()},
                decision_time_s=float(means_s.mean()) if means_s.size else None,
                decision_time_low_s=float(np.quantile(means_s, 0.05)) if means_s.size else None,
                decision_time_high_s=float(np.quantile(means_s, 0.95)) if means_s.size else None,
                undecided=float((own["decision"] == -1).to_numpy().mean()) if is_known else None,
                belief_in_truth=float(belief.mean()) if belief.size else None,
            )
        )
    return outcomes


def replayed_settings(settings: Sequence[str], gate: str | None = None) -> dict[str, Any]:
    """Return the fields that a replay changes, by dotted name.

    Args:
        settings: texts FIELD=VALUE; a field may be named with or without its section. gate: of the decision.

    Raises:
        InputError: a replay cannot change the field, the name without a section fits fields of several sections, or
            ``--set`` names a strategy, which ``--strategy`` does.
    """
    known = [
        name for name in field_types() if name.partition(".")[0] in REPLAYABLE and name != "strategy.name"
    ]
    values: dict[str, Any] = {} if gate is None else {"decision.gate": gate}
    for text in settings:
        name, value = parse_setting(text)
        matches = [field for field in known if name in (field, field.partition(".")[2])]
        if len(matches) != 1:  # no field has this name, or fields of several sections have it
            raise InputError(f"is not a field that a replay can change{nearest(name, known)}", field=name)
        values[matches[0]] = value
    return values
