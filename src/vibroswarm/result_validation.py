"""Checks of a result's tables against each other, and against scenario and seed.

A result may come from anywhere. Code that reads its tables relies on four properties, which are checked here: each run
has all its robots, samples are in order, observations and inference have the same rows as the samples, and each sampled
tile exists on the floor. Each check raises an InputError that names the file and the column. In all checks ``tables``
are the tables of the result by name, without optional ones that it lacks, and ``folder`` is its folder, for messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm import sensors, tasks
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import DIGITS, KIND_LIMIT, TILE_LIMIT
from vibroswarm.observation.observe import OBSERVATIONS
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.strategies import known

Frames = Mapping[str, pl.DataFrame | None]
"""Tables by name; None for an optional table that is absent."""
TOLERANCE_S = 1e-6
"""Tolerance for rounding of times."""


REQUIRED: Final[dict[str, tuple[str, ...]]] = {
    "motion": ("heading_rad", "drive_s", "turn_s", "avoid_s", "stop_s"),
    "inference": ("message", "alpha", "beta", "messages_received", "belief_below", "decision"),
    "robots": ("decision", "alpha", "beta", "messages_received", "belief_below"),
    "runs": ("consensus", "right", "wrong", "undecided"),
}
"""Columns that have no nulls in a simulated result; a recording may lack their values."""


def check_result(frames: Frames, scenario: Scenario, folder: Path | None, *, simulated: bool) -> None:
    """Refuse tables that do not fit each other or the scenario.

    Args:
        frames: tables by name, each of its schema (``result.SCHEMAS``); None for an optional table that is absent.
        folder: the result's folder, for messages; None: it is not read from one.
        simulated: whether the result is no recording; then the columns of ``REQUIRED`` must have no nulls, except for
            beliefs of robots without samples, and for columns that the strategy does not have (``_not_given``).
    Raises:
        InputError: a table is wrong; the message names the file and the column.
    """
    tables = {name: frame for name, frame in frames.items() if frame is not None}
    runs = tables["runs"]
    if runs.is_empty():
        raise InputError("holds no run", field=_file(folder, "runs"))
    required, not_given = REQUIRED if simulated else {}, _not_given(scenario)
    for name, columns in required.items():
        for column in columns:
            table = tables[name]
            if column in not_given:
                continue
            if (name, column) == ("robots", "belief_below"):
                table = table.filter(pl.col("samples") > 0)  # robots without samples have no belief yet
            if table[column].null_count():
                raise InputError(f"column '{column}' lacks a value", field=_file(folder, name))
    _check_robots(tables, scenario, folder)
    _check_samples(tables, scenario, folder)
    _check_floors(tables, folder)
    _check_changes(tables, scenario, folder)
    _check_kinds(tables, scenario, folder)
    _check_numbers(tables["observations"], scenario, folder)
    _check_outcomes(tables, scenario, folder)


def _not_given(scenario: Scenario) -> set[str]:
    """Return the columns of ``REQUIRED`` that may have nulls with a scenario's strategy and faults.

    A strategy may have no posterior or no belief, and send messages without a bit or not at every sample. Robots whose
    radio is dead send none.
    """
    strategy = known().get(scenario.strategy.name)
    if strategy is None:  # its code is not loaded
        return {"message", "alpha", "beta", "belief_below"}
    sensor = scenario.sensor
    found = {"alpha", "beta"} - set(strategy.state_type.names or ())
    # For more than two kinds of tile there is no belief in one of two answers; of a sensor whose code is not loaded
    # their number is not known.
    no_belief = strategy.answers_kinds and (sensor.kinds > 2 or sensor.model not in sensors.known())
    # ``reset`` has no belief in changes; that of a user's strategy may be nan.
    tells_change = getattr(scenario.strategy.params, "tells_change", False)
    if strategy.belief is None or no_belief or strategy.is_own or tells_change:
        found.add("belief_below")
    # Only the package's strategies that count bits are known to send one at every sample.
    if strategy.on_counts is None or strategy.is_own or scenario.faults.radio_dead:
        found.add("message")
    return found


def _file(folder: Path | None, name: str) -> str:
    """Return the path of a table's file, or its place in a result that is not read from a folder, for messages."""
    return f"result.{name}" if folder is None else str(folder / f"{name}.parquet")


def _check_robots(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path | None) -> None:
    """Check that the tables ``ends`` and ``robots`` have a row for each robot of each run, sorted by run and robot.

    The table runs, which defines the runs, must be sorted, and floors must have the same runs in the same order. The
    tables motion, segments, moves, faults and failures may lack some runs or robots, but must name no unknown ones.
    Observations, inference and places are compared with motion in ``_check_samples``.
    """
    runs, robots = tables["runs"]["run"], scenario.swarm.robots
    if not runs.is_sorted():
        raise InputError("column 'run' is not in order", field=_file(folder, "runs"))
    # Run and robot of each row of ``ends`` and ``robots``.
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
    unknown_runs = (
        [] if failed is None else failed.filter(~pl.col("run").is_in(runs.implode()))["run"].to_list()
    )
    if unknown_runs:
        raise InputError(
            f"column 'run' names run {unknown_runs[0]}, which is not in runs", field=_file(folder, "failures")
        )
    for name in ("motion", "segments", "moves", "faults"):
        if name not in tables:
            continue
        table = tables[name]
        largest: Any = table["robot"].max()
        if largest is not None and largest >= robots:
            raise InputError(
                f"column 'robot' names robot {largest}; the scenario has {robots}, numbered from 0",
                field=_file(folder, name),
            )
        unknown = table.filter(~pl.col("run").is_in(runs.implode()))["run"]
        if unknown.len():
            raise InputError(
                f"column 'run' names run {unknown[0]}, which is not in runs", field=_file(folder, name)
            )
    if not tables["floors"]["run"].equals(runs):
        raise InputError("column 'run' is not that of runs", field=_file(folder, "floors"))


def _check_samples(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path | None) -> None:
    """Check order and times of samples, ends, segments and moves; compare tables with a row per sample.

    Samples must be sorted by run, time and robot, and each robot's sample numbers must grow with time. No stop may
    start after its sample, and none of these times may lie after the end of the scenario's run. The tables
    observations, inference and places must have the same keys as motion, in the same order. The count ``samples`` of a
    robot must be at least its largest sample number + 1.
    """
    motion, last_s = tables["motion"], _ends_s(scenario)
    _check_sorted(motion, "time_s", folder, "motion")
    for column in ("time_s", "stop_start_s"):
        _check_most(motion, column, last_s, folder, "motion")
    _check_most(tables["ends"], "end_s", last_s, folder, "ends")
    late = motion.filter(pl.col("stop_start_s") > pl.col("time_s") + TOLERANCE_S)
    if late.height:
        raise InputError("column 'stop_start_s' lies after time_s", field=_file(folder, "motion"))
    # Differences between successive samples of each robot.
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
    # Samples are numbered from 0, so a robot has taken at least one more than its largest number.
    counted = motion.group_by("run", "robot").agg((pl.col("sample").max().cast(pl.Int64) + 1).alias("least"))
    few = tables["robots"].join(counted, on=["run", "robot"]).filter(pl.col("samples") < pl.col("least"))
    if few.height:
        raise InputError("column 'samples' is less than the samples in motion", field=_file(folder, "robots"))
    for name, word in (("segments", "segment"), ("moves", "move")):
        if name in tables:
            _check_starts(tables[name], tables["ends"], last_s, folder, name, word)


def _check_starts(
    table: pl.DataFrame, ends: pl.DataFrame, last_s: float, folder: Path | None, name: str, word: str
) -> None:
    """Check that segments or moves are sorted, begin no later than ``last_s``, and that each robot has one from 0 on.

    Args:
        name: name of the table. word: what a row of it is, for messages.
    """
    _check_sorted(table, "start_s", folder, name)
    _check_most(table, "start_s", last_s, folder, name)
    first = table.group_by("run", "robot").agg(pl.col("start_s").min())
    if first.height < ends.height or (first["start_s"] > TOLERANCE_S).any():
        raise InputError(
            f"column 'start_s': each robot of each run must have a {word} that starts at 0",
            field=_file(folder, name),
        )


def _check_sorted(table: pl.DataFrame, time: str, folder: Path | None, name: str) -> None:
    """Check that a table is sorted by run, time (its column ``time``) and robot; rows may be equal in all three."""
    if table.height < 2:
        return
    order = [table[column].to_numpy() for column in ("run", time, "robot")]
    # Compare each row with the one before it, column by column. rising: the row is larger by the columns so far.
    # equal: it is equal in all columns so far.
    rising, equal = np.zeros(table.height - 1, dtype=np.bool_), np.ones(table.height - 1, dtype=np.bool_)
    for values in order:
        rising |= equal & (values[1:] > values[:-1])
        equal &= values[1:] == values[:-1]
    if not (rising | equal).all():
        raise InputError(
            f"column '{time}': rows are not in the order of run, time and robot", field=_file(folder, name)
        )


def _check_most(table: pl.DataFrame, column: str, most: float, folder: Path | None, name: str) -> None:
    """Check that no time in a column exceeds ``most``, the latest time that the run allows, s."""
    largest: Any = table[column].max()
    if largest is not None and largest > most:
        raise InputError(
            f"column '{column}' holds {largest:g} s, after the end of the scenario's run",
            field=_file(folder, name),
        )


def _ends_s(scenario: Scenario) -> float:
    """Return the latest time that a table may hold, s.

    It is one tick after the end of the run, as the last control period may end then, plus the tolerance.
    """
    return scenario.run.t_end_s + scenario.tick_s + TOLERANCE_S


def _check_floors(tables: Mapping[str, pl.DataFrame], folder: Path | None) -> None:
    """Check that each floor's tiles fit its rows and columns, and that every sampled tile exists on its run's floor.

    A sample off all tiles has the tile -1, which passes.
    """
    floors = tables["floors"]
    name = _file(folder, "floors")
    size = floors["rows"].cast(pl.Int64) * floors["columns"].cast(pl.Int64)
    if (size > TILE_LIMIT).any():
        raise InputError(f"columns 'rows' and 'columns' give more than {TILE_LIMIT:,} tiles", field=name)
    if (floors["tiles"].str.len_bytes() != size).any():
        raise InputError("column 'tiles' does not have rows x columns tiles", field=name)
    last_tile = floors.select("run", last=size - 1)  # largest index of a tile
    sampled = tables["observations"].select("run", "tile").join(last_tile, on="run", how="left")
    if (sampled["tile"] > sampled["last"]).any():
        raise InputError(
            "column 'tile' names a tile that its floor does not have", field=_file(folder, "observations")
        )


def _check_changes(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path | None) -> None:
    """Check that changes are ordered, after time 0, and of tiles that the floor of their run has."""
    if "changes" not in tables:
        return
    changes, name = tables["changes"], _file(folder, "changes")
    order = changes.select("run", "time_s", "tile")
    if not order.equals(order.sort(order.columns)):
        raise InputError("rows are not in the order of run, time and tile", field=name)
    sizes = tables["floors"].select(
        "run", size=pl.col("rows").cast(pl.Int64) * pl.col("columns").cast(pl.Int64)
    )
    of_floor = changes.join(sizes, on="run", how="left")
    if (
        of_floor["size"].null_count()
        or (of_floor["tile"] < 0).any()
        or (of_floor["tile"] >= of_floor["size"]).any()
    ):
        raise InputError("columns 'run' and 'tile' name a tile that is on no floor", field=name)
    if not (changes["time_s"].is_finite() & (changes["time_s"] > 0)).all():
        raise InputError("column 'time_s' holds a time that is not above 0", field=name)
    kinds = scenario.sensor.kinds if scenario.sensor.model in sensors.known() else KIND_LIMIT
    if (changes["kind"] >= kinds).any():
        raise InputError(f"column 'kind' holds more than {kinds - 1}, the last of this scenario", field=name)


def _check_numbers(observations: pl.DataFrame, scenario: Scenario, folder: Path | None) -> None:
    """Check that what is measured beside energies is what the sensor measures, and is a number."""
    further = [name for name in observations.columns if name not in OBSERVATIONS]
    model = sensors.known().get(scenario.sensor.model)
    name = _file(folder, "observations")
    if model is not None and further:  # a recording may lack them
        numbers = list(model.names_of_numbers(scenario.sensor.params)[1:])
        if further != numbers:
            raise InputError(
                f"has the numbers {', '.join(further)}, and the sensor has {', '.join(numbers) or 'none'}",
                field=name,
            )
    for column in further:
        if not observations[column].fill_null(0.0).is_finite().all():
            raise InputError(f"column '{column}' holds a value that is not a number", field=name)


def _check_kinds(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path | None) -> None:
    """Check that tiles, readings, truths and decisions are kinds, classes and answers that the scenario has."""
    kinds, readings = scenario.sensor.kinds, scenario.sensor.readings
    task = tasks.known().get(scenario.task.name)
    answers = KIND_LIMIT if task is None else len(task.answers_of(kinds))
    if scenario.sensor.model not in sensors.known():  # its code is not loaded, so its kinds are not known
        kinds = readings = answers = KIND_LIMIT
    if not tables["floors"]["tiles"].str.contains(f"^[{DIGITS[:kinds]}]+$").all():
        raise InputError(
            f"column 'tiles' holds other kinds than {', '.join(DIGITS[:kinds])}",
            field=_file(folder, "floors"),
        )
    columns = (
        ("observations", "observation", readings),
        ("runs", "truth", answers),
        ("robots", "decision", answers),
    )
    for name, column, count in columns:
        if (tables[name][column] >= count).any():
            raise InputError(
                f"column '{column}' holds more than {count - 1}, the last that this scenario has",
                field=_file(folder, name),
            )


def _check_outcomes(tables: Mapping[str, pl.DataFrame], scenario: Scenario, folder: Path | None) -> None:
    """Check decisions, consensus, times (at most the end of the run), numbers of robots, and posterior counts.

    Robots that decided have a decision time, and all others have none, also those whose decision is not known (null).
    Exactly the runs with a known consensus have counts of right, wrong and undecided robots. A robot
    has both counts of its posterior, alpha and beta, or none. Only with a user's strategy (``Plugin.is_own``) may it
    have one of the two, since its state may have a field of only one of these names.
    """
    robots, runs, strategy = tables["robots"], tables["runs"], scenario.strategy.entry
    decided = (robots["decision"] >= 0).fill_null(False)
    if (decided != robots["decision_time_s"].is_not_null()).any():
        raise InputError(
            "column 'decision_time_s' must be given for robots that decided, and for no others",
            field=_file(folder, "robots"),
        )
    for name, column in (("robots", "decision_time_s"), ("runs", "consensus_time_s"), ("runs", "end_s")):
        _check_most(tables[name], column, _ends_s(scenario), folder, name)
    task = tasks.known().get(scenario.task.name)
    asks_share = task is not None and not (task.estimated or task.scored)
    if asks_share and not runs["fill_ratio"].is_between(0, 1).all():
        raise InputError(
            "column 'fill_ratio' holds a value that is not a share from 0 to 1", field=_file(folder, "runs")
        )
    unknown = runs["consensus"].is_null()
    for column in ("right", "wrong", "undecided"):
        if (runs[column].is_null() != unknown).any():
            raise InputError(
                f"column '{column}' must be given where 'consensus' is given, and nowhere else",
                field=_file(folder, "runs"),
            )
        if (runs[column] > scenario.swarm.robots).any():
            raise InputError(
                f"column '{column}' counts more than {scenario.swarm.robots} robots",
                field=_file(folder, "runs"),
            )
    if (
        (robots["alpha"].is_null() != robots["beta"].is_null()).any()
        and strategy is not None
        and not strategy.is_own
    ):
        raise InputError(
            "columns 'alpha' and 'beta' must be given together or not at all", field=_file(folder, "robots")
        )
