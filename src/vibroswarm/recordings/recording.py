"""Store sessions of robots in the tables of a simulation, with additional tables from the log.

A ``Recording`` is a ``Result`` and accepted everywhere a result is. Differences:

* ``seed`` is None: nothing was random.
* ``scenario`` is a description. Fields in ``stated`` were stated by the user or by the log, those in ``inferred``
  follow from the log; all others are the preset's and mean nothing here.
* Null is what the log does not contain: a heading; driving and turning times; the bits that were sent.
* ``sample`` counts messages sent, so a lost row leaves a gap; ``samples`` of the robots includes lost ones.
* If a log has no bits, they are made from the energies with ``sensor.rms_threshold``.
* Paths are straight between tracked positions (``log.segments_of``).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.tables import Schema, read_table
from vibroswarm.core.untrusted_files import entry, number, read_json, words
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import FINALS
from vibroswarm.inference.outcomes import fills_and_truth, robot_table, run_table
from vibroswarm.inference.replay import INFERENCE
from vibroswarm.motion.source import ENDS, MOTION
from vibroswarm.observation.observe import OBSERVATIONS
from vibroswarm.recordings.floor_fit import check_floor
from vibroswarm.recordings.infer_settings import Inferred, infer_settings
from vibroswarm.recordings.log import COUNTED, Log, gaps_of, in_order, knots_of, segments_of
from vibroswarm.result import RECORDED, Result, floor_frame
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import versions

USUAL_AGE_S: Final = 0.25
EDGE_M: Final = 1e-9

ROWS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "line": pl.UInt32,
    "energy": pl.Float64,
    "lost_before": pl.UInt32,
    "position_age_s": pl.Float64,
    "avoid_total_s": pl.Float64,
    "stop_total_s": pl.Float64,
}
"""For each sample: the line of the log, the energy with all digits, the number of lost samples before it, how much
earlier its position was seen (null if a log has no tracks), and the counters."""
PLACES: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
}

_MORE: Final = {
    "rows": Schema(
        ROWS, frozenset({"position_age_s", "avoid_total_s", "stop_total_s"}), ("run", "robot", "sample")
    ),
    "tracks": Schema(PLACES),
}


@dataclass(frozen=True, eq=False)
class Recording(Result):
    """Sessions as a result, see the head of this module."""

    rows: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=ROWS))
    tracks: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=PLACES))
    names: tuple[int, ...] = ()
    """Names of robots 0, 1, ... in the log."""
    sessions: tuple[Mapping[str, Any], ...] = ()
    """For each run: the log's name, its reader, and the counts of ``log.COUNTED``."""
    stated: tuple[str, ...] = ()
    inferred: tuple[Mapping[str, Any], ...] = ()
    """``infer_settings.Inferred`` as plain values."""
    floor_words: str = ""

    __repr__ = Result.__repr__  # a dataclass would write all tables

    @property
    def places_corrected(self) -> bool:
        """Whether all sessions are from ``lab track``, which corrects positions for lens and marker height."""
        return bool(self.sessions) and all(session["reader"] == "camera" for session in self.sessions)

    def write_into(self, folder: Path) -> None:
        """Write the files of a result, ``recording.json``, and a Parquet file each for rows and tracks."""
        super().write_into(folder)
        head = {
            "names": list(self.names),
            "sessions": [dict(item) for item in self.sessions],
            "stated": list(self.stated),
            "inferred": [dict(item) for item in self.inferred],
            "floor": self.floor_words,
        }
        text = json.dumps(head, indent=2, allow_nan=False) + "\n"
        (folder / "recording.json").write_text(text, encoding="utf-8")
        for name in _MORE:
            getattr(self, name).write_parquet(folder / f"{name}.parquet", compression="zstd")

    @classmethod
    def read(cls, path: str | Path) -> Recording:
        """Read what ``write`` has written.

        Raises:
            InputError: not a recording, or a damaged one.
        """
        folder = Path(path)
        if not (folder / "recording.json").is_file():
            raise InputError("is not a recording; make one with 'vibroswarm lab import'", field=str(folder))
        result = Result.read(folder)
        if result.seed is not None or result.segments is None:
            raise InputError("is not a recording: result.json has a seed, or no segments", field=str(folder))
        path = folder / "recording.json"
        head = _head(read_json(path, "the head of a recording"), result, path)
        more = {name: read_table(folder / f"{name}.parquet", _MORE[name], name) for name in _MORE}
        _check_more(result, more, folder)
        fields = {name: getattr(result, name) for name in Result.__dataclass_fields__}
        return cls(
            **fields,
            rows=more["rows"],
            tracks=more["tracks"],
            **head,
        )


def _head(about: Any, result: Result, path: Path) -> dict[str, Any]:
    """Return the entries of ``recording.json`` as fields of ``Recording``.

    Raises:
        InputError: an entry is missing, of another type, or of another length than the result's.
    """
    names, sessions, inferred = (entry(about, key, list, path) for key in ("names", "sessions", "inferred"))
    if len(names) != result.scenario.swarm.robots or not all(type(name) is int for name in names):
        raise InputError("is damaged: 'names' must list a number for each robot", field=str(path))
    if len(sessions) != result.runs.height:
        raise InputError(
            f"is damaged: 'sessions' must have {result.runs.height} entries, one a run", field=str(path)
        )
    for session in sessions:
        entry(session, "log", str, path), entry(session, "reader", str, path)
        for key in ("told", "wraps_at"):
            for name in (numbers := entry(session, key, dict, path)):
                number(numbers, name, path)
    for setting in inferred:
        entry(setting, "name", str, path), entry(setting, "evidence", str, path)
        for key in ("value", "low", "high"):
            if key not in setting or isinstance(setting[key], list | dict):
                raise InputError(f"is damaged: 'inferred' has no {key}", field=str(path))
            if key != "value" and setting[key] is not None:
                number(setting, key, path)
    return {
        "names": tuple(names),
        "sessions": tuple(sessions),
        "stated": tuple(words(entry(about, "stated", list, path), "stated", path)),
        "inferred": tuple(inferred),
        "floor_words": entry(about, "floor", str, path),
    }


def _check_more(result: Result, more: Mapping[str, pl.DataFrame], folder: Path) -> None:
    """Rows must match the samples; tracks must be of existing runs and robots, each ordered by time."""
    key = ["run", "robot", "sample"]
    if not more["rows"].select(key).equals(result.motion.select(key)):
        raise InputError(
            "columns 'run', 'robot', 'sample' differ from those of motion",
            field=str(folder / "rows.parquet"),
        )
    existing = result.ends.select("run", "robot")
    if more["tracks"].join(existing, on=["run", "robot"], how="anti").height:
        raise InputError(
            "columns 'run' and 'robot' name one that is not in ends", field=str(folder / "tracks.parquet")
        )
    if (more["tracks"].select(later=pl.col("time_s").diff().over("run", "robot"))["later"] <= 0).any():
        raise InputError(
            "column 'time_s' does not grow with a robot's rows", field=str(folder / "tracks.parquet")
        )


def recording_of(
    logs: Sequence[Log],
    floor: Floor,
    scenario: Scenario,
    stated: Sequence[str] = (),
    *,
    robots: Sequence[int] | None = None,
    any_floor: bool = False,
) -> Recording:
    """Make a recording from logs of sessions of the same robots on one floor; run 0 is the first.

    Args:
        logs: as read. scenario: what is known of the sessions, on a preset for the rest.
        stated: fields of ``scenario`` stated by the user; they override inferred ones.
        robots: as named in the logs; None: those of the first log.
        any_floor: accept a floor that does not fit.
    Raises:
        InputError: invalid rows (``log``), robots that are not in all logs, a floor that does not fit.
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
    described, stated = _described(scenario, list(stated), ordered, inferred, floor, len(names))
    tables = [_tables(run, log, names, described, floor) for run, log in enumerate(ordered)]
    together = {name: pl.concat([parts[name] for parts in tables]) for name in tables[0] if name != "told"}
    samples = together["motion"].with_columns(energy=together["rows"]["energy"])
    floor_words = (
        check_floor(floor, samples) if not any_floor else "The fit of the floor was not tested (--any-floor)."
    )
    floors = dict.fromkeys(range(len(ordered)), floor)
    robot_frame, runs = _outcomes(described, floors, together.pop("finals"), together["ends"])
    return Recording(
        scenario=described,
        seed=None,
        **together,
        robots=robot_frame,
        runs=runs,
        floors=floor_frame(floors),
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
    """Return the names of the robots, ascending: ``robots``, or if it is None those of the logs.

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
                "sessions of one recording must have the same robots (name them with --robots)",
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

    What the user stated overrides what a log states, and that overrides what is inferred.
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
        "floor.tiles": tuple("".join(map(str, row)) for row in floor.tiles.tolist()),
        "floor.tile_width_m": floor.tile_width_m,
        "floor.tile_height_m": floor.tile_height_m,
        "swarm.robots": robots,
        "run.t_end_s": float(np.ceil(end_s)),
        "run.stop": "t_end",
    }
    from_log = [name for log in logs for name in log.settings]
    return scenario.with_values(values), list(dict.fromkeys([*stated, *from_log, "swarm.robots"]))


def _end_of(log: Log) -> float:
    return max(float(frame["time_s"].max() or 0.0) for frame in (log.samples, log.tracks))  # type: ignore[arg-type]


def _tables(run: int, log: Log, names: tuple[int, ...], scenario: Scenario, floor: Floor) -> dict[str, Any]:
    """Return the tables of one session by name, and as ``told`` the counts of its problems."""
    number = {name: robot for robot, name in enumerate(names)}
    frame = log.samples.with_columns(
        run=pl.lit(run, dtype=pl.UInt32),
        robot=pl.col("robot").replace_strict(number, return_dtype=pl.UInt16),
    ).sort("time_s", "robot")
    count = pl.int_range(pl.len(), dtype=pl.Int64).over("robot")
    frame = frame.with_columns(sample=pl.coalesce("sent", count).cast(pl.UInt32))

    def before(column: pl.Expr) -> pl.Expr:
        return column.shift(1).over("robot", order_by="time_s")

    stop_total_s, avoid_total_s, number_sent = (
        pl.col("stop_total_s"), pl.col("avoid_total_s"), pl.col("sample").cast(pl.Int64),
    )  # fmt: skip
    stop_s = (stop_total_s - before(stop_total_s)) / (number_sent - before(number_sent))
    # A robot's first stop, or if a log has no counter: the scenario's duration.
    first = pl.col("stop_total_s").is_not_null() & (pl.col("sample") == 0)
    usual_s = scenario.sample.stop_ms / 1000.0
    known = pl.coalesce(stop_s, pl.when(first).then(pl.col("stop_total_s")))
    length = pl.coalesce(known, pl.lit(usual_s))
    frame = frame.with_columns(
        stop_s=known.cast(pl.Float32),
        stop_start_s=pl.max_horizontal(pl.col("time_s") - length, before(pl.col("time_s")).fill_null(0.0)),
        avoid_s=pl.coalesce(
            avoid_total_s - before(avoid_total_s), pl.when(pl.col("sample") == 0).then("avoid_total_s")
        ).cast(pl.Float32),
        lost_before=(number_sent - before(number_sent).fill_null(-1) - 1).cast(pl.UInt32),
        drive_s=pl.lit(None, dtype=pl.Float32),
        turn_s=pl.lit(None, dtype=pl.Float32),
    )
    tracks = log.tracks.with_columns(robot=pl.col("robot").replace_strict(number, return_dtype=pl.UInt16))
    paths = [
        _path(
            run, robot, frame.filter(pl.col("robot") == robot), tracks.filter(pl.col("robot") == robot), log
        )
        for robot in range(len(names))
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
            pl.lit(run, dtype=pl.UInt32).alias("run"), *(pl.col(name) for name in PLACES if name != "run")
        ),
        "finals": _finals(run, frame, len(names)),
        "told": counts,
    }


def _path(run: int, robot: int, samples: pl.DataFrame, track: pl.DataFrame, log: Log) -> dict[str, Any]:
    """Return the segments, final state, tracking gaps and ages of positions of one robot.

    An age is the time from the last tracked position to the sample; null if there is none.

    Raises:
        InputError: the robot has no rows.
    """
    knots = knots_of(track, samples)
    if knots.is_empty():
        raise InputError(f"robot {robot} has no rows", field=log.name)
    time_s = track["time_s"].to_numpy()
    key = samples.select("robot", "sample")
    if time_s.size:
        at = np.searchsorted(time_s, samples["time_s"].to_numpy(), side="right") - 1
        age = np.where(at >= 0, samples["time_s"].to_numpy() - time_s[np.maximum(at, 0)], np.nan)
        aged = key.with_columns(position_age_s=pl.Series(age, nan_to_null=True))
    else:
        aged = key.with_columns(position_age_s=pl.lit(None, dtype=pl.Float64))
    segments = segments_of(run, robot, knots, samples)
    end = {
        "run": [run],
        "robot": [robot],
        "end_s": [_end_of(log)],
        "x_m": [knots["x_m"][-1]],
        "y_m": [knots["y_m"][-1]],
        "heading_rad": [segments["heading_rad"][-1]],
        "stop_start_s": [None],
    }
    return {
        "segments": segments,
        "age": aged,
        "ends": pl.DataFrame(end, schema=ENDS),
        "gaps": gaps_of(time_s),
    }


def _observations(frame: pl.DataFrame, scenario: Scenario, floor: Floor) -> pl.DataFrame:
    """Return the observations: the tile under each sample (-1: none), and its bit, as logged or else E > theta_E."""
    x, y = inside(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), scenario)
    read = (frame["energy"] > scenario.sensor.rms_threshold).cast(pl.Int64)
    return frame.with_columns(
        tile=pl.Series(floor.tile_at(x, y)), observation=pl.coalesce("observation", read)
    ).select(pl.col(name).cast(kind) for name, kind in OBSERVATIONS.items())


def inside(x_m: Any, y_m: Any, scenario: Scenario) -> tuple[Any, Any]:
    """Move positions on the walls (a marker clipped to the arena) a nanometre inside."""
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
    """Count gaps, old positions, inconsistent posteriors and samples outside the floor."""
    old = rows["position_age_s"].drop_nulls()
    prior = scenario.decision.prior_alpha + scenario.decision.prior_beta
    odd = frame.filter(
        pl.col("alpha") + pl.col("beta") - prior != pl.col("sent") + pl.col("messages_received") + 1
    )
    return {
        "tracking_gaps": sum(path["gaps"][0] for path in paths),
        "tracking_gap_longest_s": round(max(path["gaps"][1] for path in paths), 6),
        "positions_old": int((old > USUAL_AGE_S).sum()),
        "position_oldest_s": round(float(old.max() or 0.0), 6),  # type: ignore[arg-type]
        "posteriors_odd": odd.height,
        "off_the_floor": int((observations["tile"] < 0).sum()),
    }


def _finals(run: int, frame: pl.DataFrame, robots: int) -> pl.DataFrame:
    """Return the final state of each robot, as in ``inference.agents.final_frame``.

    A robot that ends decided did so at the first sample from which on its decision is the same; its belief is that at
    this sample. A robot without samples is undecided, and its posterior is null.
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
                changed = own.with_row_index().filter(pl.col("decision") != last["decision"])
                stood = own.row(0 if changed.is_empty() else int(changed["index"][-1]) + 1, named=True)
                row |= {
                    "decision_time_s": stood["time_s"],
                    "belief_at_decision": stood["belief_below"],
                    "belief_below": stood["belief_below"],
                }
        else:
            row["decision"] = -1
        rows.append(row)
    return pl.DataFrame(rows, schema=FINALS)


def _outcomes(
    scenario: Scenario, floors: Mapping[int, Floor], finals: pl.DataFrame, ends: pl.DataFrame
) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the tables of robots and runs.

    Where a robot's decision is not logged, the consensus of its run and the numbers of right, wrong and undecided
    robots are null.
    """
    robots = scenario.swarm.robots
    runs = finals["run"].to_list()[::robots]
    fills, truth = fills_and_truth(scenario, floors, runs)
    end_s = ends["end_s"].to_numpy().reshape(-1, robots).max(axis=1)
    known = finals.with_columns(pl.col("decision").fill_null(-1))
    # Sessions were ended by hand, not by a decision.
    run_frame = run_table(known, fills, truth, end_s, scenario.run.t_end_s).with_columns(stopped_early=False)
    robot_frame = robot_table(known, truth).with_columns(decision=finals["decision"])
    unknown = finals.group_by("run", maintain_order=True).agg(pl.col("decision").is_null().any())["decision"]
    came_to = ("consensus", "consensus_time_s", "right", "wrong", "undecided")
    nulls = [pl.when(~unknown).then(pl.col(name)).alias(name) for name in came_to]
    return robot_frame, run_frame.with_columns(nulls)


def count_lines(recording: Recording) -> list[str]:
    """Return the counts made while reading, one line for each session and kind; zeros are left out."""
    lines = []
    for run, session in enumerate(recording.sessions):
        counts = session["told"]
        lines.append(f"session {run + 1}: {session['log']} ({session['reader']})")
        lines += [f"  {counts[name]:g} {words}" for name, words in COUNTED.items() if counts.get(name)]
    return lines
