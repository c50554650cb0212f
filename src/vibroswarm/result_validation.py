"""Checks of a result's tables against each other, and against scenario and seed.

A result may come from anywhere. Code that reads its tables relies on each run having all its robots, samples
being in order, observations and inference matching these samples, and tiles lying on the floor: that is checked
here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import TILE_LIMIT
from vibroswarm.scenario.scenario import Scenario

Frames = Mapping[str, pl.DataFrame | None]
TOLERANCE_S = 1e-6


REQUIRED: Final[dict[str, tuple[str, ...]]] = {
    "motion": ("heading_rad", "drive_s", "turn_s", "avoid_s", "stop_s"),
    "inference": ("message", "alpha", "beta", "messages_received", "belief_below", "decision"),
    "robots": ("decision", "alpha", "beta", "messages_received", "belief_below"),
    "runs": ("consensus", "right", "wrong", "undecided"),
}
"""Columns that a simulation always fills, and a recording may not."""


def check_result(frames: Frames, scenario: Scenario, folder: Path, *, simulated: bool) -> None:
    """Refuse tables that do not fit each other or the scenario.

    Args:
        frames: by name, each of its schema; ``segments`` may be None. folder: for errors.
        simulated: no recording, so that nothing is unknown.
    Raises:
        InputError: names the file and the column.
    """
    tables = {name: frame for name, frame in frames.items() if frame is not None}
    runs = tables["runs"]
    if runs.is_empty():
        raise InputError("holds no run", field=_file(folder, "runs"))
    is_foreign = scenario.strategy.code is not None  # which may keep no posterior and send nothing
    for name, columns in REQUIRED.items() if simulated else ():
        for column in columns:
            table = tables[name]
            if is_foreign and column in ("message", "alpha", "beta", "belief_below"):
                continue
            if (name, column) == ("robots", "belief_below"):
                table = table.filter(pl.col("samples") > 0)  # robots without samples have no belief yet
            if table[column].null_count():
                raise InputError(f"column '{column}' lacks a value", field=_file(folder, name))
    _check_robots(tables, scenario, folder)
    _check_samples(tables, scenario, folder)
    _check_floors(tables, folder)
    _check_outcomes(tables, scenario, folder)


def _file(folder: Path, name: str) -> str:
    return str(folder / f"{name}.parquet")


def _check_robots(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path) -> None:
    """Check that each run has each robot once, in order, and that all tables have the same runs and robots."""
    runs, robots = tables["runs"]["run"], scenario.swarm.robots
    if not runs.is_sorted():
        raise InputError("column 'run' is not in order", field=_file(folder, "runs"))
    expected_run = np.repeat(runs.to_numpy(), robots)
    expected_robot = np.tile(np.arange(robots), runs.len())
    for name in ("ends", "robots"):
        table = tables[name]
        if table.height != expected_run.size:
            raise InputError(
                f"has {table.height} rows for {runs.len()} runs of {robots} robots", field=_file(folder, name)
            )
        for column, expected in (("run", expected_run), ("robot", expected_robot)):
            if not np.array_equal(table[column].to_numpy(), expected):
                raise InputError(
                    f"column '{column}' is not that of {runs.len()} runs of {robots} robots, in order",
                    field=_file(folder, name),
                )
    failed = tables.get("failures")
    strange_runs = (
        [] if failed is None else failed.filter(~pl.col("run").is_in(runs.implode()))["run"].to_list()
    )
    if strange_runs:
        raise InputError(
            f"column 'run' names run {strange_runs[0]}, which is not in runs", field=_file(folder, "failures")
        )
    for name in ("motion", "segments", "faults"):
        table = tables.get(name, tables["ends"])
        most: Any = table["robot"].max()
        if most is not None and most >= robots:
            raise InputError(
                f"column 'robot' names robot {most}; the scenario has {robots}, from 0",
                field=_file(folder, name),
            )
        strange = table.filter(~pl.col("run").is_in(runs.implode()))["run"]
        if strange.len():
            raise InputError(
                f"column 'run' names run {strange[0]}, which is not in runs", field=_file(folder, name)
            )
    if not tables["floors"]["run"].equals(runs):
        raise InputError("column 'run' is not that of runs", field=_file(folder, "floors"))


def _check_samples(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path) -> None:
    """Check that samples are in order of run, time and robot, and that observations and inference match them."""
    motion, last_s = tables["motion"], _ends_s(scenario)
    _check_sorted(motion, "time_s", folder, "motion")
    for column in ("time_s", "stop_start_s"):
        _check_most(motion, column, last_s, folder, "motion")
    _check_most(tables["ends"], "end_s", last_s, folder, "ends")
    late = motion.filter(pl.col("stop_start_s") > pl.col("time_s") + TOLERANCE_S)
    if late.height:
        raise InputError("column 'stop_start_s' lies after time_s", field=_file(folder, "motion"))
    step = motion.select(
        pl.col("sample").cast(pl.Int64).diff().over("run", "robot").alias("step"),
        pl.col("time_s").diff().over("run", "robot").alias("later"),
    )
    if (step["step"] <= 0).any() or (step["later"] <= 0).any():
        raise InputError("column 'sample' does not grow with a robot's time", field=_file(folder, "motion"))
    key = ["run", "robot", "sample"]
    for name in (n for n in ("observations", "inference", "places") if n in tables):
        if not tables[name].select(key).equals(motion.select(key)):
            raise InputError(
                "columns 'run', 'robot', 'sample' are not those of motion, in order",
                field=_file(folder, name),
            )
    counted = motion.group_by("run", "robot").agg((pl.col("sample").max().cast(pl.Int64) + 1).alias("least"))
    few = tables["robots"].join(counted, on=["run", "robot"]).filter(pl.col("samples") < pl.col("least"))
    if few.height:
        raise InputError("column 'samples' is less than the samples in motion", field=_file(folder, "robots"))
    segments = tables.get("segments")
    if segments is not None:
        _check_segments(segments, tables["ends"], last_s, folder)


def _check_segments(segments: pl.DataFrame, ends: pl.DataFrame, last_s: float, folder: Path) -> None:
    """Check that segments are sorted, within the run, and start at 0."""
    _check_sorted(segments, "start_s", folder, "segments")
    _check_most(segments, "start_s", last_s, folder, "segments")
    first = segments.group_by("run", "robot").agg(pl.col("start_s").min())
    if first.height < ends.height or (first["start_s"] > TOLERANCE_S).any():
        raise InputError(
            "column 'start_s': each robot of each run has a first segment at 0",
            field=_file(folder, "segments"),
        )


def _check_sorted(table: pl.DataFrame, time: str, folder: Path, name: str) -> None:
    """Check that a table is sorted by run, time and robot."""
    if table.height < 2:
        return
    order = [table[column].to_numpy() for column in ("run", time, "robot")]
    rising, equal = np.zeros(table.height - 1, dtype=np.bool_), np.ones(table.height - 1, dtype=np.bool_)
    for values in order:
        rising |= equal & (values[1:] > values[:-1])
        equal &= values[1:] == values[:-1]
    if not (rising | equal).all():
        raise InputError(
            f"column '{time}': rows are not in the order of run, time and robot", field=_file(folder, name)
        )


def _check_most(table: pl.DataFrame, column: str, most: float, folder: Path, name: str) -> None:
    """Check that times do not exceed the end of the run."""
    largest: Any = table[column].max()
    if largest is not None and largest > most:
        raise InputError(
            f"column '{column}' holds {largest:g} s, after the end of the scenario's run",
            field=_file(folder, name),
        )


def _ends_s(scenario: Scenario) -> float:
    """Return the latest allowed time; the last stop that began may end after the run."""
    return scenario.run.t_end_s + scenario.tick_s + TOLERANCE_S


def _check_floors(tables: Mapping[str, pl.DataFrame], folder: Path) -> None:
    """Check the floors, and that samples are on their tiles."""
    floors = tables["floors"]
    name = _file(folder, "floors")
    size = floors["rows"].cast(pl.Int64) * floors["columns"].cast(pl.Int64)
    if (size > TILE_LIMIT).any():
        raise InputError(f"columns 'rows' and 'columns' give more than {TILE_LIMIT} tiles", field=name)
    if (floors["tiles"].str.len_bytes() != size).any():
        raise InputError("column 'tiles' does not have rows x columns tiles", field=name)
    if not floors["tiles"].str.contains("^[01]+$").all():
        raise InputError("column 'tiles' holds values other than 0 and 1", field=name)
    most = floors.select("run", most=size - 1)
    sampled = tables["observations"].select("run", "tile").join(most, on="run", how="left")
    if (sampled["tile"] > sampled["most"]).any():
        raise InputError(
            "column 'tile' names a tile that its floor does not have", field=_file(folder, "observations")
        )


def _check_outcomes(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path) -> None:
    """Check that decisions, times and consensus agree."""
    robots, runs = tables["robots"], tables["runs"]
    decided, timed = robots["decision"].is_in([0, 1]), robots["decision_time_s"].is_not_null()
    if (decided & ~timed).any() or (~decided & timed).any():
        raise InputError(
            "column 'decision_time_s' must be given for robots that decided, and for no others",
            field=_file(folder, "robots"),
        )
    for name, column in (("robots", "decision_time_s"), ("runs", "consensus_time_s"), ("runs", "end_s")):
        _check_most(tables[name], column, _ends_s(scenario), folder, name)
    unknown = runs["consensus"].is_null()
    for column in ("right", "wrong", "undecided"):
        if (runs[column].is_null() != unknown).any():
            raise InputError(f"column '{column}' is there where 'consensus' is", field=_file(folder, "runs"))
        if (runs[column] > scenario.swarm.robots).any():
            raise InputError(
                f"column '{column}' counts more than {scenario.swarm.robots} robots",
                field=_file(folder, "runs"),
            )
    counts = robots.select(known=pl.all_horizontal(pl.col("alpha", "beta", "messages_received").is_null()))[
        "known"
    ]
    some = robots.select(known=pl.any_horizontal(pl.col("alpha", "beta", "messages_received").is_null()))[
        "known"
    ]
    if not counts.equals(some) and scenario.strategy.code is None:
        raise InputError(
            "columns 'alpha', 'beta', 'messages_received' must be given together or not at all",
            field=_file(folder, "robots"),
        )
