"""Make a recording from the logs of sessions: its tables, its settings, and what is inferred from the logs.

Between known positions a robot's path is a straight line, on which the heading is its direction. It is not known
whether a robot turned or avoided between two positions, so every kind is ``drive``, except for stops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, rows_of
from vibroswarm.inference.agents import FINALS
from vibroswarm.inference.outcomes import outcome_tables, with_shares
from vibroswarm.inference.replay import INFERENCE
from vibroswarm.localisation.locate import PLACES
from vibroswarm.motion.motion_tables import ENDS, MOTION, POSES
from vibroswarm.observation.observe import OBSERVATIONS
from vibroswarm.recordings.floor_fit import check_floor
from vibroswarm.recordings.infer import Inferred, infer_settings
from vibroswarm.recordings.read import SAMPLES, Log, in_schema
from vibroswarm.recordings.recording import PLACES as TRACKED
from vibroswarm.recordings.recording import ROWS, Recording
from vibroswarm.result import RECORDED, change_frame, floor_frame
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions

APART_S: Final = 60.0
"""If the rows of a robot are usually farther apart than this, times are probably not in seconds."""
STANDING_M: Final = 0.002
"""Positions are accurate to a quarter of a millimetre; a smaller step has no usable direction."""
GAP_S: Final = 0.5
"""The camera sees a robot every 0.22 s or 0.44 s; an interval longer than this is a gap."""
EDGE_M: Final = 1e-9
"""A position closer to a wall than this is on the wall."""
COUNTED: Final = {
    "rows": "rows read",
    "missing": "rows without a time or a place: left out",
    "rows_repeated": "repeated rows: removed",
    "samples": "samples",
    "samples_lost": "samples without a row, by the count of messages sent",
    "counters_wrapped": "wraps of counters: unwrapped",
    "tracking_gaps": "gaps in tracking of more than half a second: interpolated linearly",
    "tracking_gap_longest_s": "s, the longest such gap",
    "off_the_floor": "samples off all tiles; if these are many, state arena.width_m and arena.height_m",
    "rows_apart_s": "s usually between two rows of a robot: times must be in seconds",
}
"""Counts that are made while a log is read: what is counted, in words."""


def recording_of(
    logs: Sequence[Log],
    floor: Floor,
    scenario: Scenario,
    stated: Sequence[str] = (),
    *,
    any_floor: bool = False,
) -> Recording:
    """Make a recording from logs of sessions of the same robots on one floor; run 0 is the first log.

    Args:
        scenario: a preset, in which the fields ``stated`` of these sessions are set; they override inferred values.
        any_floor: whether to accept a floor that does not fit the energies.
    """
    if not logs:
        raise InputError("give at least one log", field="LOG")
    names = _robots_of(logs)
    described, inferred, all_stated = _described(scenario, stated, logs, floor, robots=len(names))
    sessions, about = zip(
        *(_session(run, log, names, described, floor) for run, log in enumerate(logs)), strict=True
    )
    # The tables of all sessions, one below the other.
    tables = {name: pl.concat([one[name] for one in sessions]) for name in sessions[0]}
    # All three tables have a row per sample, in the same order.
    samples = tables["motion"].with_columns(
        energy=tables["rows"]["energy"], observation=tables["observations"]["observation"]
    )
    floor_words = (
        check_floor(floor, samples) if not any_floor else "The fit of the floor was not tested (--any-floor)."
    )
    if tables["places"].is_empty():
        del tables["places"]
    floors = dict.fromkeys(range(len(logs)), floor)
    robot_frame, runs = _outcomes(described, floors, tables.pop("finals"), tables["ends"])
    return Recording(
        scenario=described,
        seed=None,
        **tables,
        robots=with_shares(robot_frame, tables["motion"]),
        runs=runs,
        floors=floor_frame(floors),
        changes=change_frame(floors),
        source=f"{RECORDED} ({', '.join(sorted({log.reader for log in logs}))})",
        versions=versions(),
        names=names,
        sessions=about,
        stated=all_stated,
        inferred=tuple(setting._asdict() for setting in inferred),
        floor_words=floor_words,
    )


def _robots_of(logs: Sequence[Log]) -> tuple[int, ...]:
    # The numbers of the robots, ascending, which are those of every log.
    by_log = [{*log.samples["robot"], *log.tracks["robot"]} for log in logs]
    for log, numbers in zip(logs, by_log, strict=True):
        if log.samples.is_empty():
            raise InputError("has no sample (a row with an energy, or with an observation)", field=log.name)
        if numbers != by_log[0] or log.robots != logs[0].robots:
            raise InputError(
                f"has robots {sorted(log.robots or numbers, key=str)}, and '{logs[0].name}' "
                f"{sorted(logs[0].robots or by_log[0], key=str)}; sessions of one recording must have the same robots",
                field=log.name,
            )
    return tuple(sorted(by_log[0]))


def _described(
    scenario: Scenario, stated: Sequence[str], logs: Sequence[Log], floor: Floor, robots: int
) -> tuple[Scenario, list[Inferred], tuple[str, ...]]:
    """User's values override those of logs (of several, the last); both override inferred ones."""
    of_logs = {name: value for log in logs for name, value in log.settings.items() if name not in stated}
    scenario = scenario.with_values(of_logs)
    prior = scenario.decision.prior_alpha, scenario.decision.prior_beta
    inferred = infer_settings(logs, prior, scenario.sample.stop_ms / 1000.0)
    stated = (*stated, *of_logs, "swarm.robots")
    values: dict[str, Any] = {
        setting.name: setting.value
        for setting in inferred
        if setting.value is not None and setting.name not in stated
    }
    end_s = float(np.ceil(max(_end_of(log) for log in logs)))
    values |= {
        "floor.source": floor.name or "floor",
        "floor.tiles": rows_of(floor.tiles),
        "floor.tile_width_m": floor.tile_width_m,
        "floor.tile_height_m": floor.tile_height_m,
        "swarm.robots": robots,
        "run.t_end_s": end_s,
        "run.stop": "t_end",
    }
    # The battery of a preset says nothing of these robots, and must last longer than a run.
    if "robot.battery_life_s" not in stated:
        values["robot.battery_life_s"] = max(scenario.robot.battery_life_s, end_s + 1.0)
    return scenario.with_values(values), inferred, tuple(dict.fromkeys(stated))


def _end_of(log: Log) -> float:
    """Return the time of the last row of a log, s."""
    return max(float(frame["time_s"].max() or 0.0) for frame in (log.samples, log.tracks))  # type: ignore[arg-type]  # to polars a maximum may be of dates


def _session(
    run: int, log: Log, names: tuple[int, ...], scenario: Scenario, floor: Floor
) -> tuple[dict[str, pl.DataFrame], dict[str, Any]]:
    """Return the tables of one session, with the robots' final states, and its entry of ``Recording.sessions``."""
    robot = pl.col("robot").replace_strict({name: k for k, name in enumerate(names)}, return_dtype=pl.UInt16)
    of_run = pl.lit(run, dtype=pl.UInt32).alias("run")
    frame = log.samples.with_columns(of_run, robot=robot).sort("time_s", "robot")
    frame = _with_intervals(frame, scenario.sample.stop_ms / 1000.0)
    tracks = log.tracks.with_columns(of_run, robot=robot)
    # A camera sees robots more often than they sample; fewer tracks are rows of samples whose energy is missing.
    camera = tracks if tracks.height > frame.height else tracks.clear()
    paths = []
    for k in range(len(names)):
        samples, track, seen = (table.filter(robot=k) for table in (frame, tracks, camera))
        paths.append(_poses_of(run, k, _knots_of(track, seen, samples), samples))
    poses = pl.concat(paths)
    ends = poses.unique("robot", keep="last", maintain_order=True).with_columns(end_s=_end_of(log))
    # The latest position of the robot that a camera saw at the time of each sample; null: there is none.
    latest = camera.select("robot", "time_s", tracked_s="time_s").sort("time_s")
    rows = frame.join_asof(latest, on="time_s", by="robot", check_sortedness=False)
    rows = rows.with_columns(position_age_s=pl.col("time_s") - pl.col("tracked_s"))
    observations = _observations(frame, scenario, floor)
    tables = {
        "motion": in_schema(frame, MOTION),
        "ends": in_schema(ends, ENDS),
        "poses": poses.cast(pl.Schema(POSES)),
        "observations": observations,
        "inference": in_schema(frame, INFERENCE),
        "rows": in_schema(rows, ROWS),
        "tracks": in_schema(tracks, TRACKED),
        "places": _own_places(frame),
        "finals": _finals(run, frame, len(names)),
    }
    seen_s = pl.concat([one.select("robot", "time_s") for one in (log.samples, log.tracks)]).sort("time_s")
    between_s = seen_s.select(pl.col("time_s").diff().over("robot")).drop_nulls().to_series()
    apart_s = float(np.median(between_s)) if between_s.len() else 0.0
    gaps_s = camera.select(pl.col("time_s").diff().over("robot")).to_series()
    gaps_s = gaps_s.filter(gaps_s > GAP_S)
    counts = {
        "samples_lost": int(frame["lost_before"].sum()),
        "tracking_gaps": gaps_s.len(),
        "tracking_gap_longest_s": round(float(gaps_s.max() or 0.0), 6),  # type: ignore[arg-type]  # to polars a maximum may be of dates
        "off_the_floor": int((observations["tile"] < 0).sum()),
        "rows_apart_s": round(apart_s, 6) if apart_s > APART_S else 0.0,
    }
    told = {**log.counts, **counts}
    return tables, {"log": log.name, "reader": log.reader, "robots": dict(log.robots), "told": told}


def _with_intervals(frame: pl.DataFrame, usual_stop_s: float) -> pl.DataFrame:
    """Add the number of each sample, its stop, the avoidance since the one before, and the samples lost."""
    # The number of a sample is that of the messages sent before it, or if that is not logged, of the rows before it.
    rows_before = pl.int_range(pl.len(), dtype=pl.Int64).over("robot")
    frame = frame.with_columns(sample=pl.coalesce("sent", rows_before).cast(pl.UInt32))

    def since_before(column: pl.Expr, at_first: Any = None) -> pl.Expr:
        """Return the growth since the robot's previous sample; before its first sample the value is ``at_first``."""
        return column - pl.coalesce(column.shift(1).over("robot", order_by="time_s"), pl.lit(at_first))

    number = pl.col("sample").cast(pl.Int64)
    is_first = pl.col("sample") == 0
    # Duration of a stop: growth of the counter of standing time since the previous row. If rows were lost between, it
    # is the mean duration of the stops since then. The counter begins at 0 with sample 0.
    stop_s = since_before(pl.col("stop_total_s")) / since_before(number)
    logged_stop_s = pl.coalesce(stop_s, pl.when(is_first).then("stop_total_s"))
    before_s = pl.col("time_s").shift(1).over("robot", order_by="time_s")
    began_s = pl.col("time_s") - logged_stop_s.fill_null(usual_stop_s)
    avoid_s = since_before(pl.col("avoid_total_s"))
    return frame.with_columns(
        stop_s=logged_stop_s.cast(pl.Float32),
        # A stop does not begin before the robot's previous sample, or before the session.
        stop_start_s=pl.max_horizontal(began_s, before_s.fill_null(0.0)),
        # Unlike stop_s this is not a mean: it is all avoidance since the previous row, also that before lost samples.
        avoid_s=pl.coalesce(avoid_s, pl.when(is_first).then("avoid_total_s")).cast(pl.Float32),
        # Before a robot's first row the number is -1, so that samples lost from number 0 on are counted.
        lost_before=(since_before(number, -1) - 1).cast(pl.UInt32),
    )


def _own_places(frame: pl.DataFrame) -> pl.DataFrame:
    """Return where the robots believed that they sampled; empty if their log does not say it."""
    own = {name.removeprefix("place_"): pl.col(name) for name in SAMPLES if name.startswith("place_")}
    known = frame.drop_nulls("place_spread_m").with_columns(
        **own, heading_rad=pl.col("heading_rad").fill_null(0.0)
    )
    return in_schema(known, PLACES)


def _knots_of(track: pl.DataFrame, seen: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """The positions of a camera; without one also those of samples, at the start and at the end of each stop."""
    names = ["time_s", "x_m", "y_m"]
    if seen.height:
        return seen.select(names)
    # A stop may start at the time of the previous sample. One of the two positions is dropped, so that times increase.
    stops = samples.select(pl.col("stop_start_s").alias("time_s"), "x_m", "y_m")
    return (
        pl.concat([track.select(names), stops, samples.select(names)])
        .sort("time_s")
        .unique("time_s", keep="last", maintain_order=True)
    )


def _poses_of(run: int, robot: int, knots: pl.DataFrame, samples: pl.DataFrame) -> pl.DataFrame:
    """Until the time of its first position the robot stands there. The kind is "stop" if the middle of the time to the
    next position lies between the start of a stop and the sample at its end.
    """
    time, x, y = (knots[name].to_numpy() for name in ("time_s", "x_m", "y_m"))
    if time[0] > 0.0:
        time, x, y = np.append(0.0, time), np.append(x[0], x), np.append(y[0], y)
    heading = _courses(x, y)
    stop, end = samples["stop_start_s"].to_numpy(), samples["time_s"].to_numpy()
    middle = time + np.append(np.diff(time), 0.0) / 2
    # k: the first stop that has not ended by that middle; after the last one, a stop that begins at inf.
    k = np.searchsorted(end, middle)
    stands = (k < end.size) & (middle > np.append(stop, np.inf)[k])
    columns: dict[str, Any] = {
        "run": np.full(time.size, run),
        "robot": np.full(time.size, robot),
        "time_s": time,
        "x_m": x,
        "y_m": y,
        "heading_rad": heading,
        "kind": np.where(stands, "stop", "drive").tolist(),
    }
    return pl.DataFrame(columns)


def _courses(x: Floats, y: Floats) -> Floats:
    """A standing robot has the heading of its latest move; before its first one that of this move, or 0."""
    dx, dy = np.diff(x), np.diff(y)
    moves = np.hypot(dx, dy) >= STANDING_M
    heading = pl.Series(np.append(np.where(moves, np.arctan2(dy, dx), np.nan), np.nan)).fill_nan(None)
    return heading.forward_fill().backward_fill().fill_null(0.0).to_numpy()


def _observations(frame: pl.DataFrame, scenario: Scenario, floor: Floor) -> pl.DataFrame:
    """A bit that is not logged is computed as E > theta_E."""
    # Positions on a wall, to which cameras clip markers, are moved a nanometre inside, so that they lie on a tile.
    x, y = (
        np.where(np.abs(at - whole) < EDGE_M, whole - EDGE_M, np.where(np.abs(at) < EDGE_M, EDGE_M, at))
        for at, whole in zip(frame.select("x_m", "y_m").to_numpy().T, scenario.arena.size_m, strict=True)
    )
    read = (frame["energy"] > scenario.sensor.rms_threshold).cast(pl.Int64)
    tile = pl.Series(floor.tile_at(x, y))
    return in_schema(
        frame.with_columns(tile=tile, observation=pl.coalesce("observation", read)), OBSERVATIONS
    )


def _finals(run: int, frame: pl.DataFrame, robots: int) -> pl.DataFrame:
    """The decision time of a robot that ends with a decision is that of the first sample after which its decision
    does not change any more; its ``belief_below`` is the belief there. The number of samples includes those whose
    rows were lost.
    """
    decision = pl.col("decision")
    logged = frame.with_columns(final=decision.last().over("robot")).filter(
        pl.col("final").is_in([0, 1]), decision.is_not_null()
    )
    others_follow = (decision != pl.col("final")).cum_sum(reverse=True).over("robot") > 0
    decided = logged.filter(~others_follow).unique("robot", keep="first", maintain_order=True)
    decided = decided.select("robot", decision_time_s="time_s", belief_at_decision="belief_below")
    last = frame.unique("robot", keep="last").with_columns(samples=pl.col("sample") + 1)
    every = pl.DataFrame({"robot": range(robots)}, schema={"robot": pl.UInt16})
    states = every.join(last, on="robot", how="left").join(decided, on="robot", how="left")
    has_decided = pl.col("decision_time_s").is_not_null()
    states = states.sort("robot").with_columns(
        run=pl.lit(run),
        samples=pl.col("samples").fill_null(0),
        decision=pl.when(pl.col("samples").is_null()).then(-1).otherwise(decision),
        belief_below=pl.when(has_decided).then("belief_at_decision").otherwise("belief_below"),
    )
    return in_schema(states, FINALS)


def _outcomes(
    scenario: Scenario, floors: Mapping[int, Floor], finals: pl.DataFrame, ends: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """If the decision of any robot of a run is not logged, the run's consensus and its numbers of right, wrong and
    undecided robots are null.
    """
    # The tables are computed with -1 for a decision that is not logged. Below, the table of robots gets the null back.
    known = finals.with_columns(pl.col("decision").fill_null(-1))
    robot_frame, run_frame = outcome_tables(scenario, floors, known, ends)
    unknown = finals.group_by("run", maintain_order=True).agg(pl.col("decision").is_null().any())["decision"]
    of_decisions = ("consensus", "consensus_time_s", "right", "wrong", "undecided")
    null_if_unknown = [pl.when(~unknown).then(pl.col(name)).alias(name) for name in of_decisions]
    # Sessions are ended by people, not by a decision.
    runs = run_frame.with_columns(null_if_unknown).with_columns(stopped_early=False)
    return robot_frame.with_columns(decision=finals["decision"]), runs
