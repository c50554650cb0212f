"""Replay strategies on the observations of a recording.

Energies are those of the recording; a bit is E > theta_E with the requested threshold. Between two samples a robot
receives as many messages as its log counts (``inference.heard``). Which messages it received is not logged and is
drawn at random, so a replay consists of many draws. A sample whose row was lost is restored: between its neighbours in
time, at the robot's position, with an energy drawn from those that were read in the session on tiles of the same kind.
Motion is that of the recording, in which robots continued to sample after deciding.

Strategies that read places, such as ``places``, need to know who sent what, which no log says. For them each message is
lost with the share that the session's log counts, at random, and places are those of the recording (of the camera), as
if robots knew them. Lost rows are not restored: nobody heard of those samples. If logs count no messages, all
strategies are replayed like this, over the network of the recording's scenario, and so are the beliefs of pages
(``with_beliefs``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.arrays import Bools, Floats
from vibroswarm.core.jit import read_only, zero_rows
from vibroswarm.core.rng import SEED_LIMIT, Purpose, uniform
from vibroswarm.errors import InputError, check_kind, nearest, whole_number_of
from vibroswarm.inference.agents import FINALS, final_frame
from vibroswarm.inference.deliveries import timeline_of
from vibroswarm.inference.heard import RECORDED, Session, draw_heard
from vibroswarm.inference.outcomes import ROBOTS, RUNS, outcome_tables, with_shares
from vibroswarm.inference.replay import infer
from vibroswarm.inference.replay_arrays import NO_ESTIMATES, Log, Readings, Stops, empty_log
from vibroswarm.inference.replay_arrays import Rows as SampleRows
from vibroswarm.inference.replayer import NO_VALUES, Replayer
from vibroswarm.motion.motion_tables import Motion
from vibroswarm.motion.pose import pose
from vibroswarm.observation.energy_model import model_of, readings_of
from vibroswarm.observation.observe import kinds_at
from vibroswarm.recordings.assemble_recording import inside
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, field_types, parse_setting
from vibroswarm.simulation import MAX_RUNS
from vibroswarm.statistics.answers_over_time import ANSWERS, answers_table
from vibroswarm.statistics.sampling import packet_loss
from vibroswarm.strategies import Strategy, known
from vibroswarm.strategies import strategy as strategy_of

SLACK_S: Final = 1.0
"""Tolerance of the times at which messages are sent and received: sender and receiver may each be logged a quarter of a
second late, and real radios may receive during a stop."""
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
    unsent: float
    """Number of logged received messages that no robot can have sent at that time, mean over draws; left out."""
    put_back: int
    """Number of restored samples in all sessions."""
    answers: pl.DataFrame | None = None
    """``draw`` and the columns ``answers_over_time.ANSWERS``: one row per draw and session; None: the floor stays."""


@dataclass(frozen=True)
class _Rows:
    """Samples of a session in the order of time, (samples,) each; samples whose rows were lost are restored."""

    session: Session
    """Robots, times and counts of messages of the samples. Its bits are all 0, and a replay replaces them."""
    energy: Floats
    """nan for restored samples, whose energy is drawn at random."""
    vibrating: Bools
    """Whether the tile below vibrates."""
    ends: pl.DataFrame
    """The session's rows of ``Recording.ends``."""


def replay_recording(recording: Recording, scenario: Scenario, draws: int = 200, seed: int = 1) -> Replayed:
    """Replay a scenario on the observations of a recording, ``draws`` times.

    Args:
        scenario: that of the recording, in which the sections ``REPLAYABLE`` may be changed; of the sensor, the bits
            depend on the threshold alone. seed: of the first draw; each further draw has the next seed.
    Raises:
        InputError: ``draws`` is below 1, the seed of a draw is out of range, another section differs, the strategy is
            not one of ``counts_only`` and reads no places, or steers, or a row was lost on a kind of tile of which its
            session has no energy.
        CodeError: the strategy is a user's, and did something that strategies may not do.
    """
    check_kind(recording, Recording, "recording", "a Recording, as Recording.read() returns")
    check_kind(scenario, Scenario, "scenario", "a Scenario")
    draws = whole_number_of(draws, "draws", 1, MAX_RUNS)
    seed = whole_number_of(seed, "seed", 0, SEED_LIMIT - draws)
    for section in type(scenario).model_fields:
        if section not in REPLAYABLE and getattr(scenario, section) != getattr(recording.scenario, section):
            raise InputError("cannot be changed in the replay of a recording", field=section)
    strategy = strategy_of(scenario.strategy.name)
    if not counts_only(strategy) and not (scenario.strategy.reads_places and strategy.steer is None):
        if strategy.steer is not None:
            reason = "steers its robots, but recorded ones moved as they did"
        elif strategy.on_counts is None:
            reason = "needs to know who sent what and when, but logs only count messages"
        elif strategy.on_timer is not None:
            reason = "has a timer, but a replay calls strategies at samples only"
        else:
            reason = "revises decisions, but a replay is for robots that decide once"
        counting = ", ".join(name for name, one in known().items() if counts_only(one))
        raise InputError(
            f"'{scenario.strategy.name}' {reason}; choose a strategy that counts bits, has no timer and decides once: "
            f"{counting}; or places, which reads places",
            field="strategy.name",
        )
    runs = recording.runs["run"].to_list()
    if scenario.strategy.reads_places or not recording.counts_messages:
        return _replay_over_network(recording, scenario, draws, seed)
    parts = [_rows_of(recording, run) for run in runs]
    finals, unsent, answers = [], 0, []
    for draw in range(draws):
        samples = []
        for run, rows in zip(runs, parts, strict=True):
            final, missing, _, log = _replay_once(scenario, rows, run, seed + draw)
            finals.append(final)
            unsent += missing
            if scenario.change.is_given:
                robot, time_s = rows.session.robot, rows.session.time_s
                samples.append(
                    pl.DataFrame({"run": run, "robot": robot, "time_s": time_s, "decision": log.decision})
                )
        if samples:
            answers.append(_answers(recording, scenario, pl.concat(samples), draw))
    lost = int(recording.rows["lost_before"].sum())
    return _replayed(recording, scenario, finals, answers, unsent=unsent / draws, put_back=lost)


def counts_only(strategy: Strategy) -> bool:
    """Return whether this strategy counts bits, has no timers and decides once."""
    return strategy.on_counts is not None and strategy.on_timer is None and strategy.decides == "once"


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


def _replayed(
    recording: Recording,
    scenario: Scenario,
    finals: Sequence[pl.DataFrame],
    answers: Sequence[pl.DataFrame],
    unsent: float = 0.0,
    put_back: int = 0,
) -> Replayed:
    """Put together what the draws gave.

    Args:
        finals: final states of the robots of each session, draw by draw. answers: answers over time of each draw.
    """
    draws = len(finals) // recording.runs.height
    states, ends = pl.concat(finals).select(list(FINALS)), pl.concat([recording.ends] * draws)
    robots, runs = outcome_tables(scenario, recording.floor_by_run, states, ends)
    # A session may end before t_end_s, but because people ended it, not by a decision: it did not stop early.
    runs = runs.with_columns(stopped_early=False)
    return Replayed(
        scenario,
        draws,
        _numbered(robots, ROBOTS, draws),
        _numbered(runs, RUNS, draws),
        unsent,
        put_back,
        pl.concat(answers) if answers else None,
    )


def _numbered(table: pl.DataFrame, columns: Iterable[str], draws: int) -> pl.DataFrame:
    """Put the number of the draw before the columns of a table with as many rows of each draw, draw by draw."""
    number = np.repeat(np.arange(draws, dtype=np.uint32), table.height // draws)
    return table.select(pl.Series("draw", number), *columns)


def _replay_over_network(recording: Recording, scenario: Scenario, draws: int, seed: int) -> Replayed:
    """Replay a strategy with messages that are lost as often as in each session's log (``_with_losses``)."""
    sensor = scenario.sensor
    numbers = model_of(sensor).names_of_numbers(sensor.params)
    if sensor.readings > 2 and len(numbers) > 1:
        raise InputError(
            f"'{sensor.model}' reads {', '.join(numbers)}, and recordings have energies only",
            field="sensor.model",
        )
    scenario = scenario.with_values({"localisation.method": "true"})
    replays = []
    for run, of_session in _with_losses(recording, scenario):
        of_run = pl.col("run") == run
        samples = recording.motion.filter(of_run)
        motion = Motion(samples=samples, ends=recording.ends.filter(of_run))
        key = ["run", "robot", "sample"]
        energy = samples.join(recording.rows.select(*key, "energy"), on=key, maintain_order="left")["energy"]
        read = pl.Series(readings_of(sensor, energy.to_numpy())).set(energy.is_null(), None)
        seen = recording.observations.filter(of_run).with_columns(observation=read)
        replays.append((of_session, timeline_of(of_session, motion), seen))
    finals, answers = [], []
    for draw in range(draws):
        replayed = [infer(one, seed + draw, timeline, seen) for one, timeline, seen in replays]
        finals += [final for _, final in replayed]
        if scenario.change.is_given:
            samples = recording.motion.join(
                pl.concat([inference for inference, _ in replayed]), on=["run", "robot", "sample"]
            )
            in_order = samples.select("run", "robot", "time_s", "decision").sort("run", "time_s", "robot")
            answers.append(_answers(recording, scenario, in_order, draw))
    return _replayed(recording, scenario, finals, answers)


def _with_losses(recording: Recording, scenario: Scenario) -> Iterator[tuple[int, Scenario]]:
    """Yield each session with a scenario whose network loses messages at random, with the share that its log counts.

    The network stays that of ``scenario`` where the log does not count them.
    """
    for run, share in shares_lost(recording).items():
        of_session = scenario
        if share is not None:
            values = {"network.name": "loss", "network.loss.share": min(max(share, 0.0), 1.0)}
            of_session = scenario.with_values(values)
        yield run, of_session


def shares_lost(recording: Recording) -> dict[int, float | None]:
    """Return the share of messages that was lost in each session, None where its log does not count them."""
    lost = dict(packet_loss(recording).select("run", "packet_loss").iter_rows())
    return {run: lost.get(run) for run in recording.runs["run"].to_list()}


def _answers(recording: Recording, scenario: Scenario, samples: pl.DataFrame, draw: int) -> pl.DataFrame:
    """Return the table of answers over time of one draw on a floor that changes, with the draw's number.

    Args:
        samples: run, robot, time_s and decision of all samples, run by run in the order of time.
    """
    columns = {name: samples[name].to_numpy() for name in samples.columns}
    table = answers_table(scenario, None, recording.floor_by_run, columns, recording.runs["end_s"].to_numpy())
    return table.select(pl.lit(draw, dtype=pl.UInt32).alias("draw"), *ANSWERS)


def _replay_once(
    scenario: Scenario, rows: _Rows, run: int, seed: int
) -> tuple[pl.DataFrame, int, NDArray[np.void], Log]:
    """Replay a run once, with one random choice of the messages received.

    Args:
        scenario: with the strategy, decision and threshold to replay. rows: samples of the run. run: number of the run.
        seed: of the draw.
    Returns: the final state of each robot, a table; the number of received messages in the log that no robot can have
        sent at that time; and the messages and the states of the robots after each sample, in the order of ``rows``.
    """
    energy, session = rows.energy, rows.session
    if np.isnan(energy).any():
        energy = _drawn(rows, run, seed)
    count, robots, strategy = energy.size, scenario.swarm.robots, strategy_of(scenario.strategy.name)
    read_at = np.full((count, robots), -1, dtype=np.int64)
    unsent = draw_heard(session, read_at, np.zeros((robots, 2), dtype=np.int64), SLACK_S, seed, run)
    messages, log = zero_rows(count, strategy.message_type), empty_log(count, strategy.state_type)
    ticks = read_only(3 * np.arange(count) + 3)
    replayer = Replayer(
        scenario, seed, runs=1, longest=count, rows=count, messages=messages, log=log,
        network=RECORDED, network_params=SimpleNamespace(read_at=read_at.ravel()),
    )  # fmt: skip
    replayer.advance(
        SampleRows(
            bounds=read_only(np.array([0, count])),
            runs=read_only(np.array([run])),
            robot=read_only(session.robot.astype(np.uint16)),
            sample=read_only(session.sample.astype(np.uint32)),
            time_s=read_only(session.time_s),
        ),
        Readings(
            observation=read_only((energy > scenario.sensor.rms_threshold).astype(np.uint8)),
            x_m=NO_VALUES, y_m=NO_VALUES, heading_rad=NO_VALUES, uniforms=NO_VALUES, estimates=NO_ESTIMATES,
            weighed=NO_VALUES.reshape(0, 2),
        ),
        Stops(
            tick=ticks,
            stop_tick=ticks,
            following=read_only(np.empty(0, dtype=np.int32)),
            first=read_only(np.empty(0, dtype=np.int32)),
            walked_tick=read_only(np.zeros(robots, dtype=np.int64)),
            known_tick=read_only(np.zeros(1, dtype=np.int64)),
        ),
        from_start=True,
    )  # fmt: skip
    return final_frame(scenario, rows.ends, replayer.swarm), unsent, messages, log


def _drawn(rows: _Rows, run: int, seed: int) -> Floats:
    """Return the energies of a session, (samples,), with those of restored samples drawn at random.

    A restored sample gets one of the energies that were read in the session on tiles of the same kind; a place off all
    tiles counts as still.

    Raises:
        InputError: no energy was read on tiles of that kind.
    """
    energy = rows.energy.copy()  # ``rows`` is used again by the other draws
    for k in np.flatnonzero(np.isnan(rows.energy)):
        # Sorted, so that the draw does not depend on the order of the samples.
        same_kind = np.sort(rows.energy[(rows.vibrating == rows.vibrating[k]) & ~np.isnan(rows.energy)])
        if same_kind.size == 0:
            kind = "vibrating" if rows.vibrating[k] else "still"
            raise InputError(
                f"a row was lost on a {kind} tile, and there is no energy of such tiles to replace it; leave "
                "this session out of the recording",
                field=f"session {run + 1}",
            )
        # The last argument, the number of a second robot, is 0: a reading has none.
        u = uniform(
            seed, run, int(rows.session.robot[k]), int(Purpose.SENSING), int(rows.session.sample[k]), 0
        )
        energy[k] = same_kind[int(u * same_kind.size)]
    return energy


def _rows_of(recording: Recording, run: int) -> _Rows:
    """Return the samples of a run in the order of time, with a restored sample for each one whose row was lost."""
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
        # The start of the session stands in for the row before a robot's first sample.
        before: Mapping[str, Any] = {"sample": -1, "time_s": 0.0, "stop_start_s": 0.0, "messages_received": 0}
        for row in own.iter_rows(named=True):
            rows += _restored(recording, run, before, row)
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
    newly_received = table.select(
        pl.col("messages_received").cast(pl.Int64)
        - pl.col("messages_received").cast(pl.Int64).shift(1).over("robot").fill_null(0)
    ).to_series()
    session = Session(
        robot=table["robot"].cast(pl.Int64).to_numpy(),
        sample=table["sample"].cast(pl.Int64).to_numpy(),
        time_s=table["time_s"].to_numpy(),
        # A robot reads only while it walks, so for the last time one tick before its stop, and it reads a message one
        # tick after it was sent at the earliest. So the latest message that it reads was sent two ticks before the
        # stop. 1.5 in place of 2 leaves half a tick for rounding.
        hears_until_s=table["stop_start_s"].to_numpy() - 1.5 * recording.scenario.tick_s,
        received=newly_received.to_numpy(),
        observation=np.zeros(table.height, dtype=np.uint8),
    )
    energy = table["energy"].fill_null(float("nan")).to_numpy()
    kinds = kinds_at(floor, table["tile"].to_numpy(), table["time_s"].to_numpy())
    return _Rows(session, energy, kinds == 1, recording.ends.filter(of_run))


def _restored(
    recording: Recording, run: int, before: Mapping[str, Any], after: Mapping[str, Any]
) -> Iterator[dict[str, Any]]:
    """Make rows for the samples of a robot that were lost between two of its rows.

    The new samples are evenly spaced in time and in the number of messages received. Their stops last as long as the
    stop of the row ``after``. Their energy is None.

    Args:
        run: number of the run. before, after: the two rows, values by column. ``before`` may stand for the start of the
            session; its sample is then -1.
    Returns: one row for each lost sample, in the order of time.
    """
    lost = after["sample"] - before["sample"] - 1
    for nth in range(1, lost + 1):
        share = nth / (lost + 1)
        time_s = before["time_s"] + share * (after["time_s"] - before["time_s"])
        stop_s = after["time_s"] - after["stop_start_s"]
        x, y = after["x_m"], after["y_m"]  # without a path, the place of the next row
        if recording.poses is not None:
            x, y, _ = pose(recording.poses, run, after["robot"], time_s)
        tile = recording.floor(run).tile_at(
            *inside(np.array([x]), np.array([y]), recording.scenario.arena.size_m)
        )[0]
        yield {
            "run": run,
            "robot": after["robot"],
            "sample": before["sample"] + nth,
            "time_s": time_s,
            # A stop does not begin before the sample of the row ``before``.
            "stop_start_s": max(time_s - stop_s, before["time_s"]),
            # Cut to a whole number of messages.
            "messages_received": before["messages_received"]
            + int(share * (after["messages_received"] - before["messages_received"])),
            "energy": None,
            "tile": int(tile),
        }


def with_beliefs(recording: Recording, seed: int = 0) -> Result:
    """Return a copy of a recording, also a ``Recording``, with beliefs and decisions computed from its bits.

    The strategy of the recording's scenario computes them. They replace logged ones, so this is for recordings that
    lack beliefs. Logs do not say which messages the real radio delivered: each is lost at random, with the share that
    the session's log counts; where it counts none, the scenario's network delivers them.

    Args:
        seed: of the random numbers of strategy and network.
    """
    check_kind(recording, Recording, "recording", "a Recording, as Recording.read() returns")
    replayed = []
    for run, of_session in _with_losses(recording, recording.scenario):
        of_run = pl.col("run") == run
        motion = Motion(
            samples=recording.motion.filter(of_run),
            ends=recording.ends.filter(of_run),
        )
        replayed.append(infer(of_session, seed, motion, recording.observations.filter(of_run)))
    inference, finals = (pl.concat(tables) for tables in zip(*replayed, strict=True))
    # Samples whose rows were lost count here too: their numbers are missing in the table of motion.
    finals = finals.with_columns(recording.robots["samples"])
    robots, runs = outcome_tables(recording.scenario, recording.floor_by_run, finals, recording.ends)
    # As in ``_replayed``: people ended the session.
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
        InputError: a replay cannot change the field, the name without a section fits fields of several sections, both
            options set the gate, or ``--set`` names a strategy, which ``--strategy`` does.
    """

    known = [name for name in field_types() if name.partition(".")[0] in REPLAYABLE]
    values: dict[str, Any] = {}
    if gate is not None:
        values["decision.gate"] = gate
    for text in settings:
        name, value = parse_setting(text)
        matches = [field for field in known if name in (field, field.partition(".")[2])]
        if len(matches) != 1:  # no field has this name, or fields of several sections have it
            suggestion = nearest(name, known + [field.partition(".")[2] for field in known])
            raise InputError(f"is not a field that a replay can change{suggestion}", field=name)
        if matches[0] == "strategy.name":
            raise InputError("is set by --strategy; use that option", field="--set strategy.name")
        if matches[0] == "decision.gate" and gate is not None:
            raise InputError("is also set by --gate; use one of them", field="--set decision.gate")
        values[matches[0]] = value
    return values
