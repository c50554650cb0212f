"""Simulate batches, and check the tables that come back. A batch is a range of runs of a group of cells.

The cells of a group share their motion (see ``plan``). A batch simulates the motion once, takes the readings once for
each floor and sensor, and replays each strategy on these readings.

A worker may be a thread, a process, or on another machine: it gets text and numbers (``Batch``) and returns Parquet
files as bytes (``BatchResult``). The study stores the files of a batch as a shard. The main table has one row for each
cell, run and robot; columns of the run are repeated for each robot.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.answers_over_time import (
    NO_AGREEMENTS,
    agreements_of,
    answers_table,
    is_followed,
    may_change,
)
from vibroswarm.analysis.map_figures import keeps_map, map_figures
from vibroswarm.analysis.sampling import Walk
from vibroswarm.core.tables import Schema, check_table, parquet_bytes, read_frame
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import arrays_fit, final_columns, strategy_used
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.inference.outcomes import fills_and_truth, robot_columns, run_columns
from vibroswarm.inference.replay import INFERENCE, infer, replay_followed, replay_to_end
from vibroswarm.inference.replay_arrays import Log
from vibroswarm.inference.reports import reported_at_end
from vibroswarm.motion.motion_tables import ENDS, MOTION, Motion
from vibroswarm.motion.source import moved
from vibroswarm.observation.observe import (
    OBSERVATIONS,
    Readings,
    energies_read,
    observation_frame,
    read_samples,
    reads_energies,
)
from vibroswarm.result import TABLES
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_scenario, floors_of, motion_by_decisions, versions
from vibroswarm.study.batch_table import (
    AGREED_TABLE,
    FAILED_TABLE,
    MAPS_TABLE,
    OF_SOME,
    REPORTED_TABLE,
    ROWS,
    WALK,
    BatchRows,
    Columns,
    agreed_rows,
    failed_rows,
    of_cells,
    walked,
)
from vibroswarm.study.plan import Group, Texts, samples_of_run, scenario_of
from vibroswarm.study.registered_code import registered_code
from vibroswarm.study.spec import Study
from vibroswarm.study.work import Work

SAMPLES: Final[dict[str, Any]] = {
    "cell": pl.UInt32,
    **MOTION,
    **{k: v for k, v in OBSERVATIONS.items() if k not in MOTION},
    **{k: v for k, v in INFERENCE.items() if k not in MOTION},
}
"""Columns of the table of samples, saved on request: one row per cell and sample."""


SAMPLES_TABLE: Final = "samples"
"""Name of that table in a shard."""


class Cancelled(Exception):  # noqa: N818  (nothing went wrong)
    """The study was stopped while a batch was running."""


BatchOutcomes = tuple[Sequence[Sequence[int]], Columns, Columns, Mapping[str, list[pl.DataFrame]]]
"""Outcomes of some runs of some cells. Rows stand for scenarios.

- for each row, the numbers of the cells with its scenario: one cell, or several with equal scenarios
- columns of the robots, (rows, runs, robots) each
- columns of the runs, (rows, runs) each, or (runs,) if all rows share the values
- the tables of ``FURTHER`` that cells have, by name, a frame for each cell that has some
"""


def simulate_batch(work: Batch, cancelled: Callable[[], bool] = lambda: False) -> Iterator[BatchOutcomes]:
    """Simulate the runs of a batch, and yield outcomes for each floor, sensor and end of the runs.

    Args:
        cancelled: returns whether the study was stopped.
    Raises:
        Cancelled: the study was stopped; checked between two steps.
    """
    entries = [[(scenario_of(text), cells) for text, cells in entry] for entry in work.observed]
    for scenario, _ in chain(*entries):
        check_scenario(scenario)
    _check(cancelled)
    first = entries[0][0][0]
    moves = any(needs_moves(scenario) for scenario, _ in chain(*entries))
    if by_decisions := motion_by_decisions(
        first
    ):  # such a group has a single scenario (see ``plan.plan_of``)
        floors = floors_of(first, work.seed, work.numbers)
        full = by_decisions(first, work.seed, work.numbers, floors, work.motion, moves)
    else:
        full = moved(work.motion, first, work.seed, work.numbers, moves)
    motion, end_s = _SharedMotion(first, full, work, cancelled), first.run.t_end_s
    for entry in entries:
        scenarios = [scenario for scenario, _ in entry]
        scenario = scenarios[0]  # all scenarios of an entry have the same floor, sensor and end
        if scenario.run.t_end_s != end_s:  # shorter runs: they use the beginning of the longest motion
            motion = _SharedMotion(scenario, beginning(full, scenario), work, cancelled)
            end_s = scenario.run.t_end_s
        _check(cancelled)
        yield motion.outcomes(scenarios, [cells for _, cells in entry])


def _check(cancelled: Callable[[], bool]) -> None:
    if cancelled():
        raise Cancelled


class _SharedMotion:
    """The motion of some runs, and what is computed once for all floors, sensors and strategies.

    Args:
        scenario: one of the scenarios that have this motion. motion: of the runs of ``work``.
    """

    def __init__(
        self, scenario: Scenario, motion: Motion, work: Batch, cancelled: Callable[[], bool]
    ) -> None:
        self.motion, self.work, self.cancelled = motion, work, cancelled
        self.timeline = timeline_of(scenario, motion)
        self.walk = Walk(motion.samples)
        # Time at which each run ends, (runs,): a run ends with its last robot. ``ends`` has one row per run and robot,
        # sorted by both.
        self.end_s = motion.ends["end_s"].to_numpy().reshape(-1, self.timeline.robots).max(axis=1)
        self._floors: dict[Any, dict[int, Floor]] = {}

    def outcomes(self, scenarios: Sequence[Scenario], cells: Sequence[Sequence[int]]) -> BatchOutcomes:
        """Compute the outcomes of scenarios that have this motion and share floor, sensor and end of the runs.

        Args:
            cells: for each scenario, the numbers of its cells.
        """
        common, runs, seed = scenarios[0], self.work.numbers, self.work.seed
        floors = self._floors_of(common)
        # Values (besides classes) are computed only if the table of samples shows them or a strategy reads them.
        with_samples = SAMPLES_TABLE in self.work.keep
        with_energies = with_samples or any(map(reads_energies, scenarios))
        readings = read_samples(common, seed, self.motion.samples, floors, with_energies)
        energy = energies_read(common, readings) if with_energies else None
        finals_by_scenario = []  # for each scenario, the columns of its robots at the end, (runs * robots,) each
        further = defaultdict[str, list[pl.DataFrame]](list)
        fills, truth = _asked_of(scenarios, floors, list(runs), self.end_s)
        for scenario, equal_cells, asked in zip(scenarios, cells, fills, strict=True):
            _check(self.cancelled)
            replayed = (scenario, seed, self.timeline, readings.observation, energy)
            answers = None
            if scenario.change.is_given or keeps_map(scenario):
                swarm, log = replay_followed(*replayed)
                if scenario.change.is_given:
                    answers = self._answers(scenario, floors, log)
                if keeps_map(scenario):
                    beliefs = self.motion.samples.select("run", "robot", "time_s", belief_below=log.belief)
                    found = map_figures(scenario, swarm, floors, self.end_s, beliefs)
                    further[MAPS_TABLE] += of_cells(found, equal_cells)
            else:
                swarm = replay_to_end(*replayed)
            finals_by_scenario.append(final_columns(scenario, swarm))
            if strategy_used(scenario).reports:
                reported = reported_at_end(scenario, swarm, runs, asked)
                further[REPORTED_TABLE] += of_cells(reported, equal_cells)
            if is_followed(scenario):
                agreed = agreements_of(swarm, runs) if may_change(scenario) else NO_AGREEMENTS
                further[AGREED_TABLE] += agreed_rows(agreed, answers, equal_cells)
        # The same columns, (scenarios, runs, robots) each.
        shape = (len(runs), self.timeline.robots)
        finals = {
            name: np.stack([columns[name].reshape(shape) for columns in finals_by_scenario])
            for name in finals_by_scenario[0]
        }
        tiles = floors[runs[0]].tiles.size  # the same in all runs
        walk = self.walk.figures(readings.tile, readings.observation, tiles)
        decisions, times_s = finals["decision"], finals["decision_time_s"]
        of_runs = {
            **run_columns(decisions, times_s, fills, truth, self.end_s, common.run.t_end_s),
            **walked(walk, runs),
        }
        if with_samples:
            further[SAMPLES_TABLE] = self._samples(scenarios, cells, readings)
        further[FAILED_TABLE] = failed_rows(self.motion.failures, cells, common.run.t_end_s)
        return cells, robot_columns(finals, truth), of_runs, further

    def _answers(self, scenario: Scenario, floors: dict[int, Floor], log: Log) -> pl.DataFrame:
        """Return how right the answers were over time, from the state after each sample."""
        samples = {name: self.motion.samples[name].to_numpy() for name in ("run", "robot", "time_s")}
        samples["decision"] = log.decision
        if "changed_s" in strategy_used(scenario).reported:
            samples["changed_s"] = log.states["changed_s"]
        return answers_table(scenario, self.work.seed, floors, samples, self.end_s)

    def _floors_of(self, scenario: Scenario) -> dict[int, Floor]:
        """Return the floors by number of the run; cached by floor and changes, which several sensors may share."""
        key = scenario.floor, scenario.change, scenario.run.t_end_s
        if key not in self._floors:
            self._floors[key] = floors_of(scenario, self.work.seed, self.work.numbers)
        return self._floors[key]

    def _samples(
        self, scenarios: Sequence[Scenario], cells: Sequence[Sequence[int]], readings: Readings
    ) -> list[pl.DataFrame]:
        """Return the table ``SAMPLES`` of each cell, scenario by scenario.

        Each scenario is replayed once more for it, since ``replay_to_end`` records nothing of the single samples.

        Args:
            cells: for each scenario, the numbers of its cells. readings: shared by all the scenarios.
        """
        motion = self.motion.samples
        observations = observation_frame(scenarios[0], motion, readings, energies=True)
        tables = []
        for scenario, equal_cells in zip(scenarios, cells, strict=True):
            inference, _ = infer(scenario, self.work.seed, self.timeline, observations)
            tables += samples_of(motion, observations, inference, equal_cells)
        return tables


def _asked_of(
    scenarios: Sequence[Scenario], floors: dict[int, Floor], runs: list[int], end_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the number that is asked for and the right decision for each scenario and run, (scenarios, runs) each.

    The number is the fill ratio unless a task asks for another; the decision is nan where none is right. Scenarios with
    the same task, boundary and number of kinds have the same, which are computed once.

    Args:
        floors: by number of the run. end_s: end of each run, (runs,).
    """
    # By what determines both.
    found: dict[Any, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    keys = [
        (one.task.model_dump_json(), one.decision.decision_boundary, one.sensor.kinds) for one in scenarios
    ]
    for scenario, key in zip(scenarios, keys, strict=True):
        if key not in found:
            found[key] = fills_and_truth(scenario, floors, runs, end_s)
    return np.stack([found[key][0] for key in keys]), np.stack([found[key][1] for key in keys])


def samples_of(
    motion: pl.DataFrame, observations: pl.DataFrame, inference: pl.DataFrame, cells: Sequence[int]
) -> list[pl.DataFrame]:
    """Build the table ``SAMPLES`` for each of several cells with equal scenarios: they differ in column ``cell`` only.

    Args:
        motion, observations, inference: tables of the same samples in the same order. cells: numbers of the cells.
    """
    others = (
        table.select(name for name in own if name not in MOTION)
        for table, own in ((observations, OBSERVATIONS), (inference, INFERENCE))
    )
    rows = pl.concat([motion, *others], how="horizontal")
    return of_cells(rows.select(name for name in SAMPLES if name != "cell"), cells)


def beginning(motion: Motion, scenario: Scenario) -> Motion:
    """Cut a motion to the shorter runs of a scenario that moves in the same way.

    A sample taken, or a stop begun, exactly at the end of the shorter runs is not part of them. The table of ends gets
    new values. Its ``stop_start_s`` is the start of the stop in which a robot is at the end, or null if it is in none.
    It is in a stop if it sampled in the last control period, since it walks on only in the next one, or if the stop for
    its next sample has begun. Positions at the end are null, since they cannot be known from the samples. Moves and
    failures are not cut off, since nothing uses those after the end.

    Args:
        motion: of the longer runs. scenario: with the shorter runs.
    """
    # A tick is the moment at which a control period begins. Runs end at the first tick at or after ``run.t_end_s``.
    tick_s, end_s = scenario.tick_s, scenario.ticks * scenario.run.control_period_ms / 1000.0
    # Times are whole ticks up to rounding errors. So that these errors do not matter, the limits are not ticks: one is
    # a quarter of a tick before the end, the other a quarter of a tick before the last tick that precedes the end.
    before_end_s, before_last_tick_s = end_s - tick_s / 4, end_s - 1.25 * tick_s
    samples, ends = motion.samples, motion.ends
    time_s, stop_s = samples["time_s"].to_numpy(), samples["stop_start_s"].to_numpy()
    end_row = _end_rows_of(ends, samples, scenario.swarm.robots)
    is_before = time_s < before_end_s
    # Per robot (row of ``ends``): start of the stop for its sample in the last control period; nan if there is none.
    last_stop = np.full(ends.height, np.nan)
    in_last_tick = is_before & (time_s > before_last_tick_s)
    last_stop[end_row[in_last_tick]] = stop_s[in_last_tick]
    # Per robot: start of the stop for its first sample after the end; nan if there is none. Samples are assigned from
    # the last one to the first, so that the first one of each robot is what remains.
    next_stop = np.full(ends.height, np.nan)
    after_end = np.flatnonzero(~is_before)[::-1]
    next_stop[end_row[after_end]] = stop_s[after_end]
    # A robot without a later sample may have begun a stop that lasts to the end of the longer motion.
    next_stop = np.where(np.isnan(next_stop), ends["stop_start_s"].to_numpy(), next_stop)
    begun = np.where(next_stop < before_end_s, next_stop, np.nan)  # only stops that begin before the end
    standing = pl.Series("stop_start_s", np.where(np.isnan(last_stop), begun, last_stop), nan_to_null=True)
    unknown = {name: pl.lit(None, dtype=pl.Float64) for name in ("x_m", "y_m", "heading_rad")}
    ends = ends.with_columns(standing, end_s=pl.lit(end_s), **unknown)
    return Motion(
        samples=samples.filter(pl.Series(is_before)),
        ends=ends.select(list(ENDS)),
        moves=motion.moves,
        failures=motion.failures,
    )


def _end_rows_of(ends: pl.DataFrame, samples: pl.DataFrame, robots: int) -> NDArray[np.int64]:
    """Return for each sample the row of its run and robot in the table of ends, (samples,)."""
    runs = ends["run"].to_numpy()[::robots]  # the table has a row for each run and robot, in this order
    run = np.searchsorted(runs, samples["run"].to_numpy())  # position of each sample's run in ``runs``
    return np.asarray(run * robots + samples["robot"].to_numpy(), dtype=np.int64)


ROWS_AT_A_TIME: Final = 250_000
"""Approximate number of samples that a worker has in memory at a time. Most first blocks have fewer: a part of a block
costs about 0.3 ms per cell besides its runs."""


@dataclass(frozen=True, kw_only=True)
class Batch(Work):
    """A batch in plain values, to be sent to a worker."""

    study: str
    """Hash of the study."""
    group: int
    """Number of the group."""
    observed: Texts
    """Scenarios as TOML and the cells that they stand for."""
    keep: tuple[str, ...]
    """The further tables that the study saves (``samples``)."""

    @property
    def name(self) -> str:
        """The name of the batch, as ``--batch`` takes it: ``GROUP:FIRST-LAST``, the last run not included."""
        return f"{self.group}:{self.first}-{self.last}"


@dataclass(frozen=True)
class BatchResult:
    """A finished batch: Parquet files by the name of their table, and the versions that made them."""

    work: Batch
    files: dict[str, bytes]
    """Each table as a Parquet file, by the table's name."""
    rows: int
    """Number of rows of the table ``robots``."""
    versions: dict[str, str]
    """``simulation.versions`` of the worker, and its ``registered_code``."""


def batch_of(study: Study, group: Group, first: int, last: int) -> Batch:
    """Make the batch of the runs ``first`` to ``last`` - 1 of a group."""
    return Batch(
        study=study.hash,
        group=group.number,
        observed=group.texts,
        first=first,
        last=last,
        seed=study.seed,
        motion=study.motion,
        keep=study.keep,
        code=plugins.texts_of(study.codes),
    )


def do_batch(work: Batch, cancelled: Callable[[], bool] = lambda: False) -> BatchResult:
    """Run a batch, a few of its runs at a time so that memory use stays bounded.

    Args:
        cancelled: called between two steps; if it returns true, the batch is given up.
    Returns: the tables as Parquet files: ``robots``, ``samples`` if the study saves them, ``failures`` if runs failed,
        ``agreements`` if opinions of a cell may change after its swarms have decided, ``maps`` if robots keep maps,
        ``reported`` if they report values.
    Raises:
        Cancelled: ``cancelled`` returned true.
    """
    plugins.install_all(work.code)
    # Pairs of a scenario's TOML and the numbers of the cells with this scenario.
    pairs = [*chain(*work.observed)]
    first = scenario_of(pairs[0][0])  # has the longest runs
    runs_at_a_time = min(
        max(int(ROWS_AT_A_TIME / samples_of_run(first)), 1),
        *(arrays_fit(scenario_of(text)) for text, _ in pairs),
    )
    cells = [cell for _, equal_cells in pairs for cell in equal_cells]
    rows = BatchRows(cells, work.numbers, first.swarm.robots)
    further = defaultdict[str, list[pl.DataFrame]](list)
    for low in range(work.first, work.last, runs_at_a_time):
        part = replace(work, first=low, last=min(low + runs_at_a_time, work.last))
        for cells_of_rows, robots, runs, more in simulate_batch(part, cancelled):
            rows.put(cells_of_rows, low, robots, runs)
            for name, frames in more.items():
                further[name] += frames
    tables = {"robots": rows.table()}
    for name, schema in FURTHER.items():
        if name in work.keep or any(frame.height for frame in further[name]):
            order = ("cell", "run", "time_s", "robot") if name == SAMPLES_TABLE else schema.key
            tables[name] = pl.concat(further[name]).sort(order, maintain_order=True)
    metadata = {"vibroswarm_study": work.study}
    files = {name: parquet_bytes(table, metadata) for name, table in tables.items()}
    made_by = versions() | registered_code((scenario_of(text) for text, _ in pairs), work.motion)
    return BatchResult(work=work, files=files, rows=tables["robots"].height, versions=made_by)


NEVER_NULL: Final = frozenset({"decision", "messages_received", "consensus", "right", "wrong", "undecided"})
"""Nullable columns of a result that a simulation always fills; the others may be null in a shard as well."""
_NULLABLE: Final = (TABLES["robots"].nullable | TABLES["runs"].nullable | frozenset(WALK)) - NEVER_NULL
"""Columns of the table ``robots`` that may be null."""
ROBOTS: Final = Schema(ROWS, _NULLABLE, ("cell", "run", "robot"))
"""Schema of the table ``robots`` of a shard."""
FURTHER: Final = {
    SAMPLES_TABLE: Schema(
        SAMPLES,
        frozenset({"energy", "message", "alpha", "beta", "belief_below"}),
        ("cell", "run", "robot", "sample"),
    ),
    **OF_SOME,
}
"""Schemas of the tables of a shard besides ``robots``: samples on request, the others if cells have rows of them."""


def check_shard(files: Mapping[str, Path], study: Study, group: Group, runs: range, rows: int) -> None:
    """Check that the files of a shard are the tables of a batch: names, number of rows, columns, cells, runs, robots.

    Args:
        files: path of each table by its name. group, runs: those of the batch.
        rows: number of rows of the table ``robots`` that the shard's description gives.
    Raises:
        InputError: a table is missing or unexpected, ``rows`` is wrong, or a table is wrong; only in the last case the
            error names the file.
    """
    required = {"robots", *study.keep}  # ``keep`` names the further tables that the study saves
    # The others exist only if a run failed, if opinions may change, or if robots have maps or reports.
    if set(files) - set(OF_SOME) != required:
        raise InputError(
            f"has the tables {', '.join(sorted(files)) or 'none'}, not {', '.join(sorted(required))}"
        )
    cells, robots = [cell.number for cell in group.cells], group.first.swarm.robots
    expected = len(cells) * len(runs) * robots
    if rows != expected:
        raise InputError(
            f"describes {rows} rows; {len(cells)} cells, {len(runs)} runs and {robots} robots make {expected}"
        )
    for table, path in files.items():
        schema = ROBOTS if table == "robots" else FURTHER[table]
        frame = check_table(read_frame(path, table), schema, path.name, table)
        if table == "robots" and frame.height != expected:
            raise InputError(f"has {frame.height} rows, not {expected}", field=path.name)
        for column, allowed in (("cell", set(cells)), ("run", set(runs)), ("robot", set(range(robots)))):
            # The tables of failures and of agreements have no column ``robot``.
            named = frame[column].unique().to_list() if column in frame.columns else []
            foreign = set(named) - allowed
            if foreign:
                raise InputError(
                    f"column '{column}' names {min(foreign)}, which is not of this batch", field=path.name
                )
        if table == "robots":
            _check_outcomes(frame, robots, path.name)


def _check_outcomes(frame: pl.DataFrame, robots: int, name: str) -> None:
    """Check that just the robots that decided have a decision time, and that no count exceeds ``robots``."""
    if ((frame["decision"] >= 0) != frame["decision_time_s"].is_not_null()).any():
        raise InputError(
            "column 'decision_time_s' must be given for robots that decided, and for no others", field=name
        )
    for column in ("right", "wrong", "undecided"):
        most: Any = frame[column].max()
        if most > robots:
            raise InputError(f"column '{column}' counts more than {robots} robots", field=name)
