"""Make a recording from the logs of sessions: its tables, its settings, and what is inferred from the logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.inference.agents import FINALS
from vibroswarm.inference.outcomes import fills_and_truth, robot_table, run_table
from vibroswarm.inference.replay import INFERENCE
from vibroswarm.localisation.locate import PLACES
from vibroswarm.motion.source import ENDS, MOTION
from vibroswarm.observation.observe import OBSERVATIONS
from vibroswarm.recordings.floor_fit import check_floor
from vibroswarm.recordings.infer_settings import infer_settings
from vibroswarm.recordings.inferred import Inferred
from vibroswarm.recordings.log import COUNTED, OWN_PLACE, Log, gaps_of, in_order, knots_of, segments_of
from vibroswarm.recordings.recording import PLACES as TRACKED
from vibroswarm.recordings.recording import ROWS, Recording
from vibroswarm.result import RECORDED, change_frame, floor_frame
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions

USUAL_AGE_S: Final = 0.25
"""A sample's position that was seen longer before the sample than this is counted as old."""


EDGE_M: Final = 1e-9
"""A position closer to a wall than this is on the wall."""


def recording_of(
    logs: Sequence[Log],
    floor: Floor,
    scenario: Scenario,
    stated: Sequence[str] = (),
    *,
    robots: Sequence[int] | None = None,
    any_floor: bool = False,
) -> Recording:
    """Make a recording from logs of sessions of the same robots on one floor; run 0 is the first log.

    Args:
        logs: as their readers returned them. floor: the floor of all sessions.
        scenario: a preset, in which the fields that the user knows of these sessions are set.
        stated: names of the fields of ``scenario`` that the user set; their values override inferred values.
        robots: numbers of the robots in the logs; None: every robot that a log has, and all logs must have the same.
        any_floor: whether to accept a floor that does not fit the energies.
    Raises:
        InputError: no log, a log without samples, without rows of one of ``robots``, or with invalid rows
            (``log.in_order``), logs of different robots, a setting of a log that the scenario refuses, or a floor that
            does not fit.
    """
    if not logs:
        raise InputError("give at least one log", field="LOG")
    ordered = [in_order(log, robots) for log in logs]
    names = _robots_of(ordered, robots)
    for log in ordered:
        if log.samples.is_empty():
            raise InputError("has no sample (a row with an energy)", field=log.name)
    inferred = infer_settings(
        ordered,
        prior=(scenario.decision.prior_alpha, scenario.decision.prior_beta),
        eta=scenario.strategy.table("soft").eta,
        kappa=scenario.strategy.table("soft").kappa,
    )
    described, stated = _described(scenario, list(stated), ordered, inferred, floor, robots=len(names))
    tables = [_tables(run, log, names, described, floor) for run, log in enumerate(ordered)]
    # The tables of all sessions, one below the other. "told" is left out: it is not a table but the counts of problems.
    together = {name: pl.concat([parts[name] for parts in tables]) for name in tables[0] if name != "told"}
    # Both tables have a row per sample, in the same order.
    samples = together["motion"].with_columns(energy=together["rows"]["energy"])
    floor_words = (
        check_floor(floor, samples) if not any_floor else "The fit of the floor was not tested (--any-floor)."
    )
    if together["places"].is_empty():
        del together["places"]
    floors = dict.fromkeys(range(len(ordered)), floor)
    # The final states of robots are no table of a recording, so they are removed from ``together``.
    robot_frame, runs = _outcomes(described, floors, finals=together.pop("finals"), ends=together["ends"])
    return Recording(
        scenario=described,
        seed=None,
        **together,
        robots=robot_frame,
        runs=runs,
        floors=floor_frame(floors),
        changes=change_frame(floors),
        source=f"{RECORDED} ({', '.join(sorted({log.reader for log in ordered}))})",
        versions=versions(),
        names=names,
        sessions=tuple(
            {
                "log": log.name,
                "reader": log.reader,
                "wraps_at": dict(log.wraps_at),
                "told": dict(log.counts) | parts["told"],
            }
            for log, parts in zip(ordered, tables, strict=True)
        ),
        stated=tuple(stated),
        inferred=tuple(asdict(setting) for setting in inferred),
        floor_words=floor_words,
    )


def _robots_of(logs: Sequence[Log], robots: Sequence[int] | None) -> tuple[int, ...]:
    """Return the numbers of the robots, ascending: ``robots``, or if it is None, those of the logs.

    Raises:
        InputError: ``robots`` is None and the logs have different robots.
    """
    by_log = [sorted({*log.samples["robot"].to_list(), *log.tracks["robot"].to_list()}) for log in logs]
    if robots is not None:
        return tuple(sorted(robots))
    for log, numbers in zip(logs, by_log, strict=True):
        if numbers != by_log[0]:
            raise InputError(
                f"has robots {', '.join(map(str, numbers))}, and '{logs[0].name}' {', '.join(map(str, by_log[0]))}; "
                "sessions of one recording must have the same robots (name them with --known-robots)",
                field=log.name,
            )
    return tuple(by_log[0])


def _described(
    scenario: Scenario,
    stated: list[str],
    logs: Sequence[Log],
    inferred: Sequence[Inferred],
    floor: Floor,
    robots: int,
) -> tuple[Scenario, list[str]]:
    """Return the scenario that describes the sessions, and the names of its stated fields.

    A value that the user stated overrides one that a log states (of several logs, the last). Both override an inferred
    value.
    The floor, the number of robots and the end of the run are always those of the sessions.

    Args:
        scenario: with the values that the user stated. stated: names of these fields. logs: after ``in_order``.
        inferred: settings inferred from the logs. floor: the floor of all sessions. robots: number of robots.
    Raises:
        InputError: the scenario refuses a value.
    """
    values: dict[str, Any] = {
        setting.name: setting.value
        for setting in inferred
        if setting.value is not None and setting.name not in stated
    }
    values |= {name: value for log in logs for name, value in log.settings.items() if name not in stated}
    end_s = max(_end_of(log) for log in logs)
    values |= {
        "floor.source": floor.name or "floor",
        "floor.tiles": rows_of(floor.tiles),
        "floor.tile_width_m": floor.tile_width_m,
        "floor.tile_height_m": floor.tile_height_m,
        "swarm.robots": robots,
        "run.t_end_s": float(np.ceil(end_s)),
        "run.stop": "t_end",
    }
    from_log = [name for log in logs for name in log.settings]
    return scenario.with_values(values), list(dict.fromkeys([*stated, *from_log, "swarm.robots"]))


def _end_of(log: Log) -> float:
    """Return the time of the last row of a log, s."""
    return max(float(frame["time_s"].max() or 0.0) for frame in (log.samples, log.tracks))  # type: ignore[arg-type]


def _tables(run: int, log: Log, names: tuple[int, ...], scenario: Scenario, floor: Floor) -> dict[str, Any]:
    """Convert the log of one session to the tables of a recording.

    Args:
        run: number of the session. log: after ``in_order``. names: for robots 0, 1, ... their numbers in the log.
        scenario: describes the sessions. floor: the floor of the session.
    Returns: by name the tables motion, ends, segments, observations, inference, rows, tracks, places and finals (final
        states of robots); and as ``told`` the counts of problems.
    """
    number = {name: robot for robot, name in enumerate(names)}
    frame = log.samples.with_columns(
        run=pl.lit(run, dtype=pl.UInt32),
        robot=pl.col("robot").replace_strict(number, return_dtype=pl.UInt16),
    ).sort("time_s", "robot")
    # The number of a sample is that of the messages sent before it, or if that is not logged, of the rows before it.
    # ``in_order`` has checked that a robot's rows all have the number of messages or none, and that it grows.
    rows_before = pl.int_range(pl.len(), dtype=pl.Int64).over("robot")
    frame = frame.with_columns(sample=pl.coalesce("sent", rows_before).cast(pl.UInt32))

    def before(column: pl.Expr) -> pl.Expr:
        """Return the value at the robot's previous sample; null at its first."""
        return column.shift(1).over("robot", order_by="time_s")

    stop_total_s, avoid_total_s, number_sent = (
        pl.col("stop_total_s"), pl.col("avoid_total_s"), pl.col("sample").cast(pl.Int64),
    )  # fmt: skip
    # Duration of a stop: growth of the counter of standing time since the previous row. If rows were lost between, it
    # is the mean duration of the stops since then.
    stop_s = (stop_total_s - before(stop_total_s)) / (number_sent - before(number_sent))
    # The counter begins at 0 with sample 0. Without a counter a stop has the scenario's duration.
    is_first = pl.col("stop_total_s").is_not_null() & (pl.col("sample") == 0)
    usual_s = scenario.sample.stop_ms / 1000.0
    logged_stop_s = pl.coalesce(stop_s, pl.when(is_first).then(pl.col("stop_total_s")))
    length_s = pl.coalesce(logged_stop_s, pl.lit(usual_s))
    frame = frame.with_columns(
        stop_s=logged_stop_s.cast(pl.Float32),
        # A stop does not begin before the robot's previous sample, or before the session.
        stop_start_s=pl.max_horizontal(pl.col("time_s") - length_s, before(pl.col("time_s")).fill_null(0.0)),
        # Unlike stop_s this is not a mean: it is all avoidance since the previous row, also that before lost samples.
        avoid_s=pl.coalesce(
            avoid_total_s - before(avoid_total_s), pl.when(pl.col("sample") == 0).then("avoid_total_s")
        ).cast(pl.Float32),
        # Before a robot's first row the number is -1, so that samples lost from number 0 on are counted.
        lost_before=(number_sent - before(number_sent).fill_null(-1) - 1).cast(pl.UInt32),
        # A ``Log`` has no times of driving and turning.
        drive_s=pl.lit(None, dtype=pl.Float32),
        turn_s=pl.lit(None, dtype=pl.Float32),
    )
    tracks = log.tracks.with_columns(robot=pl.col("robot").replace_strict(number, return_dtype=pl.UInt16))
    paths = [
        _path(
            run,
            robot,
            name,
            frame.filter(pl.col("robot") == robot),
            tracks.filter(pl.col("robot") == robot),
            log,
        )
        for robot, name in enumerate(names)
    ]
    segments = pl.concat([path["segments"] for path in paths]).sort("start_s", "robot", maintain_order=True)
    age = pl.concat([path["age"] for path in paths])
    rows = frame.join(age, on=["robot", "sample"], how="left", maintain_order="left")
    observations = _observations(frame, scenario, floor)
    counts = _problem_counts(paths, rows, observations, frame, scenario)
    return {
        "motion": frame.select(pl.col(name).cast(kind) for name, kind in MOTION.items()),
        "ends": pl.concat([path["ends"] for path in paths]),
        "segments": segments,
        "observations": observations,
        "inference": frame.select(pl.col(name).cast(kind) for name, kind in INFERENCE.items()),
        "rows": rows.select(pl.col(name).cast(kind) for name, kind in ROWS.items()),
        "tracks": tracks.select(
            pl.lit(run, dtype=pl.UInt32).alias("run"), *(pl.col(name) for name in TRACKED if name != "run")
        ),
        "places": _own_places(frame),
        "finals": _finals(run, frame, len(names)),
        "told": counts,
    }


def _own_places(frame: pl.DataFrame) -> pl.DataFrame:
    """Return where the robots believed that they sampled; empty if their log does not say it."""
    own = {name.removeprefix("place_"): pl.col(name) for name in OWN_PLACE}
    # Places smoothed later are not logged.
    later = {name: pl.lit(None) for name in PLACES if name.startswith("lagged")}
    known = frame.drop_nulls("place_spread_m").with_columns(
        **own, **later, heading_rad=pl.col("heading_rad").fill_null(0.0)
    )
    return known.select(pl.col(name).cast(kind) for name, kind in PLACES.items())


def _path(
    run: int, robot: int, name: int, samples: pl.DataFrame, track: pl.DataFrame, log: Log
) -> dict[str, Any]:
    """Compute the path of one robot in a session.

    Args:
        run: number of the session. robot, name: index of the robot, and its number in the log.
        samples: samples of the robot, by time. track: its tracked positions, by time. log: log of the session.
    Returns: by name: ``segments``, the robot's table of segments; ``ends``, its final pose as a row of the table of
        ends; ``gaps``, number and longest of the gaps in its tracking, from ``gaps_of``; ``age``, a table with robot,
        sample and position_age_s, the time from the last tracked position to the sample (null if there is none).
    Raises:
        InputError: the robot has no rows.
    """
    knots = knots_of(track, samples)
    if knots.is_empty():
        raise InputError(f"robot {name} has no rows", field=log.name)
    time_s = track["time_s"].to_numpy()
    key = samples.select("robot", "sample")
    if time_s.size:
        sample_s = samples["time_s"].to_numpy()
        latest = np.searchsorted(time_s, sample_s, side="right") - 1  # -1: no position before the sample
        age = np.where(latest >= 0, sample_s - time_s[np.maximum(latest, 0)], np.nan)
        ages = key.with_columns(position_age_s=pl.Series(age, nan_to_null=True))
    else:
        ages = key.with_columns(position_age_s=pl.lit(None, dtype=pl.Float64))
    segments = segments_of(run, robot, knots, samples)
    end = {
        "run": [run],
        "robot": [robot],
        "end_s": [_end_of(log)],
        "x_m": [knots["x_m"][-1]],
        "y_m": [knots["y_m"][-1]],
        "heading_rad": [segments["heading_rad"][-1]],
        "stop_start_s": [None],  # whether the robot stands at the end is not known
    }
    return {
        "segments": segments,
        "age": ages,
        "ends": pl.DataFrame(end, schema=ENDS),
        "gaps": gaps_of(time_s),
    }


def _observations(frame: pl.DataFrame, scenario: Scenario, floor: Floor) -> pl.DataFrame:
    """Return the table of observations: for each sample the tile below (-1: none), its energy and its bit.

    A bit that is not logged is computed as E > theta_E.
    """
    x, y = inside(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), scenario)
    read = (frame["energy"] > scenario.sensor.rms_threshold).cast(pl.Int64)
    return frame.with_columns(
        tile=pl.Series(floor.tile_at(x, y)), observation=pl.coalesce("observation", read)
    ).select(pl.col(name).cast(kind) for name, kind in OBSERVATIONS.items())


def inside(x_m: Any, y_m: Any, scenario: Scenario) -> tuple[Any, Any]:
    """Move positions on a wall a nanometre inside, so that they lie on a tile; return x and y, m.

    Logs have such positions, since the camera clips a marker to the arena. x = 0 lies on a tile already, since an edge
    belongs to the tile on its right; y = 0 does not, since an edge belongs to the tile below it.

    Args:
        x_m, y_m: positions, m, arrays of the same shape. scenario: its arena has the walls.
    """
    width, height = scenario.arena.width_m, scenario.arena.height_m
    x = np.where(np.abs(x_m - width) < EDGE_M, width - EDGE_M, x_m)
    return x, np.where(
        np.abs(y_m) < EDGE_M, EDGE_M, np.where(np.abs(y_m - height) < EDGE_M, height - EDGE_M, y_m)
    )


def _problem_counts(
    paths: Sequence[Mapping[str, Any]],
    rows: pl.DataFrame,
    observations: pl.DataFrame,
    frame: pl.DataFrame,
    scenario: Scenario,
) -> dict[str, float]:
    """Count the problems of a session: gaps, old positions, inconsistent posteriors, and samples off all tiles.

    Args:
        paths: from ``_path``, of all robots. rows, observations: tables of the session.
        frame: samples of the session, with the columns of the log. scenario: it has the prior.
    Returns: counts by key of ``log.COUNTED``.
    """
    ages_s = rows["position_age_s"].drop_nulls()
    prior = scenario.decision.prior_alpha + scenario.decision.prior_beta
    # alpha + beta counts the prior, the own samples (one more than messages sent before) and the messages received.
    odd = frame.filter(
        pl.col("alpha") + pl.col("beta") - prior != pl.col("sent") + pl.col("messages_received") + 1
    )
    return {
        "tracking_gaps": sum(path["gaps"][0] for path in paths),
        "tracking_gap_longest_s": round(max(path["gaps"][1] for path in paths), 6),
        "positions_old": int((ages_s > USUAL_AGE_S).sum()),
        "position_oldest_s": round(float(ages_s.max() or 0.0), 6),  # type: ignore[arg-type]
        "posteriors_odd": odd.height,
        "off_the_floor": int((observations["tile"] < 0).sum()),
    }


def _finals(run: int, frame: pl.DataFrame, robots: int) -> pl.DataFrame:
    """Return the final state of each robot of a session, with the columns ``inference.agents.FINALS``.

    The decision time of a robot that ends with a decision is that of the first sample after which its decision does
    not change any more. Its ``belief_below`` is the belief at this sample, as in the result of a simulation; that of
    any other robot is the belief at its last sample. A robot without samples is undecided, and its posterior is null.
    The number of samples includes those whose rows were lost.

    Args:
        run: number of the session. frame: samples of the session, by time. robots: number of robots.
    """
    rows: list[dict[str, Any]] = []
    for robot in range(robots):
        own = frame.filter(pl.col("robot") == robot)
        row: dict[str, Any] = dict.fromkeys(FINALS) | {"run": run, "robot": robot, "samples": 0}
        if own.height:
            last = own.row(-1, named=True)
            row |= {name: last[name] for name in ("alpha", "beta", "messages_received", "belief_below")}
            row["samples"] = last["sample"] + 1
            row["decision"] = last["decision"]
            if last["decision"] in (0, 1):
                # The robot decided finally at the sample after the last one with another decision. A decision that is
                # not logged (null) does not count as another one.
                others = own.with_row_index().filter(pl.col("decision") != last["decision"])
                decided = own.row(0 if others.is_empty() else int(others["index"][-1]) + 1, named=True)
                row |= {
                    "decision_time_s": decided["time_s"],
                    "belief_at_decision": decided["belief_below"],
                    "belief_below": decided["belief_below"],
                }
        else:
            row["decision"] = -1
        rows.append(row)
    return pl.DataFrame(rows, schema=FINALS)


def _outcomes(
    scenario: Scenario, floors: Mapping[int, Floor], finals: pl.DataFrame, ends: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Compute the tables of robots and of runs of a recording from the final states of the robots.

    If the decision of any robot of a run is not logged, the run's consensus and its numbers of right, wrong and
    undecided robots are null.

    Args:
        finals: from ``_finals``, of all sessions. ends: the table of ends. Both have a row for each robot of each
            session, ordered by session and robot.
    """
    robots = scenario.swarm.robots
    runs = finals["run"].to_list()[::robots]  # there is a row for each run and robot
    end_s = ends["end_s"].to_numpy().reshape(-1, robots).max(axis=1)
    fills, truth = fills_and_truth(scenario, floors, runs, end_s)
    # The tables are computed with -1 for a decision that is not logged. Below, the table of robots gets the null back.
    known = finals.with_columns(pl.col("decision").fill_null(-1))
    # Sessions are ended by people, not by a decision.
    run_frame = run_table(known, fills, truth, end_s, scenario.run.t_end_s).with_columns(stopped_early=False)
    robot_frame = robot_table(known, truth).with_columns(decision=finals["decision"])
    unknown = finals.group_by("run", maintain_order=True).agg(pl.col("decision").is_null().any())["decision"]
    of_decisions = ("consensus", "consensus_time_s", "right", "wrong", "undecided")
    null_if_unknown = [pl.when(~unknown).then(pl.col(name)).alias(name) for name in of_decisions]
    return robot_frame, run_frame.with_columns(null_if_unknown)


def count_lines(recording: Recording) -> list[str]:
    """Write the counts that were made while the logs were read, as lines of text.

    Each session has one line with the name and the format of its log, followed by one line for each count above 0.
    """
    lines = []
    for run, session in enumerate(recording.sessions):
        counts = session["told"]
        lines.append(f"session {run + 1}: {session['log']} ({session['reader']})")
        lines += [f"  {counts[name]:g} {words}" for name, words in COUNTED.items() if counts.get(name)]
    return lines
