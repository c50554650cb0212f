"""Simulate batches, some runs of a group of cells, and check the tables that come back.

Motion is simulated once, each floor and sensor is observed once, and each strategy is replayed on these.

A worker may be a thread, a process, or on another machine: it gets text and numbers and returns bytes. Tables have one
row for each cell, run and robot; columns of the run are repeated for each robot.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.sampling import Walk
from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.tables import Schema, check_table, read_frame
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.agents import final_columns
from vibroswarm.inference.deliveries import needs_moves, timeline_of
from vibroswarm.inference.outcomes import fill_ratios, robot_columns, run_columns, truths
from vibroswarm.inference.replay import INFERENCE, infer, replay_to_end
from vibroswarm.motion.source import ENDS, MOTION, Motion, source
from vibroswarm.observation.observe import (
    OBSERVATIONS,
    Places,
    Readings,
    energies_read,
    observation_frame,
    reads_energies,
)
from vibroswarm.result import NULLABLE
from vibroswarm.scenario import plugins
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.simulation import check_scenario, floors_of, simulate, steers, versions
from vibroswarm.study.batch_table import (
    FAILED_ROWS,
    FAILED_TABLE,
    ROWS,
    WALK,
    BatchRows,
    Columns,
    columns_of,
    failed_rows,
    walked,
)
from vibroswarm.study.plan import Group, Texts, scenario_of
from vibroswarm.study.spec import Study

SAMPLES: Final[dict[str, Any]] = {
    "cell": pl.UInt32,
    **MOTION,
    **{k: v for k, v in OBSERVATIONS.items() if k not in MOTION},
    **{k: v for k, v in INFERENCE.items() if k not in MOTION},
}
"""One row per cell and sample; saved on request."""


class Cancelled(Exception):  # noqa: N818  (nothing went wrong)
    """The study was stopped while a batch was running."""


class BatchOutcomes(NamedTuple):
    """Outcomes of some runs of some cells, as ``BatchRows.put`` takes them.

    ``samples`` is empty unless samples are saved, ``failures`` unless runs failed.
    """

    cells: Sequence[Sequence[int]]
    robots: Columns
    runs: Columns
    samples: list[pl.DataFrame]
    failures: list[pl.DataFrame]


class BatchRequest(NamedTuple):
    """Which runs to simulate, from which seed, with which source of motion, and whether to return samples."""

    runs: range
    seed: int
    motion: str
    samples: bool
    cancelled: Callable[[], bool] = lambda: False

    def check(self) -> None:
        """Raise Cancelled if the study was stopped."""
        if self.cancelled():
            raise Cancelled


def simulate_batch(observed: Texts, request: BatchRequest) -> Iterator[BatchOutcomes]:
    """Simulate the runs, floor by floor and sensor by sensor.

    Args:
        observed: see ``Batch``.
    Raises:
        Cancelled: the study was stopped; checked between two steps.
    """
    for inferences in observed:
        for text, _ in inferences:
            check_scenario(scenario_of(text))
    first = scenario_of(observed[0][0][0])
    if first.run.stop == "all_decided" or steers(first):
        ((text, cells),) = observed[0]
        yield _until_all_decided(scenario_of(text), cells, request)
        return
    request.check()
    moves = any(needs_moves(scenario_of(text)) for inferences in observed for text, _ in inferences)
    full = source(request.motion).batch(first, request.seed, request.runs, False, moves)
    motion, end_s = _SharedMotion(first, full, request), first.run.t_end_s
    for inferences in observed:
        scenario = scenario_of(inferences[0][0])
        if scenario.run.t_end_s != end_s:
            motion, end_s = _SharedMotion(scenario, beginning(full, scenario), request), scenario.run.t_end_s
        request.check()
        yield motion.outcomes(
            [scenario_of(text) for text, _ in inferences], [cells for _, cells in inferences]
        )


def _until_all_decided(scenario: Scenario, cells: Sequence[int], request: BatchRequest) -> BatchOutcomes:
    """Simulate runs that end when all robots have decided, of one cell or several equal ones."""
    result = simulate(scenario, request.seed, request.runs, motion=request.motion, energies=request.samples)
    tile, observation = (result.observations[name].to_numpy() for name in ("tile", "observation"))
    walk = Walk(result.motion).figures(tile, observation, result.floor(request.runs[0]).tiles.size)
    robots, of_runs = columns_of(result)
    tables = (result.motion, result.observations, result.inference)
    samples = samples_of(*tables, cells) if request.samples else []
    failures = failed_rows(result.failures, [cells], scenario.run.t_end_s)
    return BatchOutcomes([cells], robots, {**of_runs, **walked(walk, request.runs)}, samples, failures)


class _SharedMotion:
    """The motion of some runs, and what is computed once for all floors, sensors and strategies."""

    def __init__(self, scenario: Scenario, motion: Motion, request: BatchRequest) -> None:
        self.motion, self.request = motion, request
        self.timeline = timeline_of(scenario, motion)
        self.places, self.walk = Places(request.seed, motion.samples), Walk(motion.samples)
        ends = motion.ends["end_s"].to_numpy().reshape(-1, self.timeline.robots)
        self.end_s = ends.max(axis=1)
        self._floors: dict[Any, dict[int, Floor]] = {}

    def outcomes(self, scenarios: Sequence[Scenario], cells: Sequence[Sequence[int]]) -> BatchOutcomes:
        """Compute outcomes of scenarios that differ only in strategy, network and decision."""
        seen, runs, seed = scenarios[0], self.request.runs, self.request.seed
        floors = self._floors_of(seen)
        energies = self.request.samples or any(map(reads_energies, scenarios))
        read = self.places.read(seen, floors, energies)
        energy = energies_read(seen, read) if energies else None
        each = []
        for scenario in scenarios:
            self.request.check()
            each.append(final_columns(replay_to_end(scenario, seed, self.timeline, read.observation, energy)))
        shape = (len(runs), self.timeline.robots)
        finals = {name: np.stack([columns[name].reshape(shape) for columns in each]) for name in each[0]}
        fills = np.array(fill_ratios(floors, list(runs), seen.arena.width_m, seen.arena.height_m))
        truth = _truths_of(scenarios, floors, list(runs), fills)
        decided = finals["decision"], finals["decision_time_s"]
        walk = self.walk.figures(read.tile, read.observation, floors[runs[0]].tiles.size)
        of_runs = {
            **run_columns(*decided, fills, truth, self.end_s, seen.run.t_end_s),
            **walked(walk, runs),
        }
        samples = self._samples(scenarios, cells, read) if self.request.samples else []
        failures = failed_rows(self.motion.failures, cells, seen.run.t_end_s)
        return BatchOutcomes(cells, robot_columns(finals, truth), of_runs, samples, failures)

    def _floors_of(self, scenario: Scenario) -> dict[int, Floor]:
        """Return the floor of each run by its number; cached, since several sensors share a floor."""
        if scenario.floor not in self._floors:
            self._floors[scenario.floor] = floors_of(scenario, self.request.seed, self.request.runs)
        return self._floors[scenario.floor]

    def _samples(
        self, scenarios: Sequence[Scenario], cells: Sequence[Sequence[int]], read: Readings
    ) -> list[pl.DataFrame]:
        """Return the samples tables of these scenarios."""
        motion = self.motion.samples
        observations = observation_frame(scenarios[0], motion, read, energies=True)
        tables = []
        for scenario, same in zip(scenarios, cells, strict=True):
            inference, _ = infer(scenario, self.request.seed, self.timeline, observations)
            tables += samples_of(motion, observations, inference, same)
        return tables


def _truths_of(
    scenarios: Sequence[Scenario], floors: dict[int, Floor], runs: list[int], fills: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the truth for each scenario and run, (scenarios, runs); equal questions are answered once."""
    known: dict[Any, NDArray[np.float64]] = {}
    for scenario in scenarios:
        question = (scenario.task.model_dump_json(), scenario.decision.decision_boundary)
        if question not in known:
            known[question] = truths(scenario, floors, runs, fills)
    return np.stack(
        [known[variant.task.model_dump_json(), variant.decision.decision_boundary] for variant in scenarios]
    )


def samples_of(
    motion: pl.DataFrame, observations: pl.DataFrame, inference: pl.DataFrame, cells: Sequence[int]
) -> list[pl.DataFrame]:
    """Build the table ``SAMPLES`` for each of several equal cells."""
    others = (table.drop("run", "robot", "sample") for table in (observations, inference))
    rows = pl.concat([motion, *others], how="horizontal")
    return [rows.select(pl.lit(cell, dtype=pl.UInt32).alias("cell"), *list(SAMPLES)[1:]) for cell in cells]


def beginning(motion: Motion, scenario: Scenario) -> Motion:
    """Cut a motion off at the end of a scenario that is shorter but otherwise moves in the same way.

    A sample belongs to the tick before its time; a robot that took one at the last tick is still standing. Positions
    at the end are null, since the table of samples does not contain them.
    """
    tick_s, end_s = scenario.tick_s, scenario.ticks * scenario.run.control_period_ms / 1000.0
    samples, ends = motion.samples, motion.ends
    time_s, stop_s = samples["time_s"].to_numpy(), samples["stop_start_s"].to_numpy()
    place = _place_in(ends, samples, scenario.swarm.robots)
    before = time_s < end_s - tick_s / 4
    last, following = np.full(ends.height, np.nan), np.full(ends.height, np.nan)
    latest, later = before & (time_s > end_s - 1.25 * tick_s), np.flatnonzero(~before)[::-1]
    last[place[latest]] = stop_s[latest]
    following[place[later]] = stop_s[later]  # from the end, so that the first one stays
    under_way = np.where(np.isnan(following), ends["stop_start_s"].to_numpy(), following)
    since = np.where(under_way < end_s - tick_s / 4, under_way, np.nan)
    standing = pl.Series("stop_start_s", np.where(np.isnan(last), since, last), nan_to_null=True)
    unknown = {name: pl.lit(None, dtype=pl.Float64) for name in ("x_m", "y_m", "heading_rad")}
    ends = ends.with_columns(standing, end_s=pl.lit(end_s), **unknown)
    return Motion(
        samples.filter(pl.Series(before)), ends.select(list(ENDS)), None, motion.moves, motion.failures
    )


def _place_in(ends: pl.DataFrame, samples: pl.DataFrame, robots: int) -> NDArray[np.int64]:
    """Return for each sample the row of its run and robot in the table of ends, (rows,)."""
    runs = ends["run"].to_numpy()[::robots]
    run = np.searchsorted(runs, samples["run"].to_numpy())
    place: NDArray[np.int64] = run * robots + samples["robot"].to_numpy()
    return place


ROWS_AT_A_TIME: Final = 200_000
"""Approximate number of samples in memory at a time."""


@dataclass(frozen=True)
class Batch:
    """A batch in plain values, to be sent to a worker.

    Args:
        study: hash of the study. group: its number.
        observed: for each floor and sensor, for each way to decide: the scenario as TOML, and the cells it stands for.
        first, last: runs, the last not included. seed, motion, keep: those of the study.
    """

    study: str
    group: int
    observed: Texts
    first: int
    last: int
    seed: int
    motion: str
    keep: tuple[str, ...]
    code: tuple[tuple[str, str], ...] = ()
    """User code that the cells need, and its text."""

    @property
    def name(self) -> str:
        """The name of the batch, as ``--batch`` takes it."""
        return f"{self.group}:{self.first}-{self.last}"


@dataclass(frozen=True)
class BatchResult:
    """A finished batch: Parquet files by the name of their table, and the versions that made them."""

    work: Batch
    files: dict[str, bytes]
    rows: int
    versions: dict[str, str]


def batch_of(study: Study, group: Group, first: int, last: int) -> Batch:
    """Make the batch of some runs of a group."""
    code = plugins.texts_of(study.codes)
    return Batch(
        study.hash, group.number, group.texts, first, last, study.seed, study.motion, study.keep, code
    )


def do_batch(work: Batch, cancelled: Callable[[], bool] = lambda: False) -> BatchResult:
    """Run a batch, some of its runs at a time so that memory use stays bounded.

    Raises:
        Cancelled: ``cancelled`` returned true; checked between two steps.
        RunError: this process was forked after polars had begun its threads.
    """
    check_threads()
    plugins.install_all(work.code)
    first = scenario_of(work.observed[0][0][0])
    a_run = max(
        first.swarm.robots * first.run.t_end_s * 1000.0 / (first.sample.sample_interval_ms + 1000.0), 1.0
    )
    step = max(int(ROWS_AT_A_TIME / a_run), 1)
    cells = [cell for inferences in work.observed for _, same in inferences for cell in same]
    rows = BatchRows(cells, range(work.first, work.last), first.swarm.robots)
    samples: list[pl.DataFrame] = []
    failures: list[pl.DataFrame] = []
    for low in range(work.first, work.last, step):
        some = range(low, min(low + step, work.last))
        request = BatchRequest(some, work.seed, work.motion, "samples" in work.keep, cancelled)
        for outcomes in simulate_batch(work.observed, request):
            rows.put(outcomes.cells, low, outcomes.robots, outcomes.runs)
            samples += outcomes.samples
            failures += outcomes.failures
    tables = {"robots": rows.table()}
    if "samples" in work.keep:
        order = ["cell", "run", "time_s", "robot"]
        tables["samples"] = pl.concat(samples).sort(order, maintain_order=True)
    if failures:
        tables[FAILED_TABLE] = pl.concat(failures).sort("cell", "run")
    files = {name: _parquet(table, work) for name, table in tables.items()}
    return BatchResult(work, files, tables["robots"].height, versions())


def _parquet(table: pl.DataFrame, work: Batch) -> bytes:
    buffer = io.BytesIO()
    table.write_parquet(buffer, compression="zstd", metadata={"vibroswarm_study": work.study})
    return buffer.getvalue()


NEVER_NULL: Final = frozenset({"decision", "messages_received", "consensus", "right", "wrong", "undecided"})
"""Columns that a simulation always fills; others may be null, such as the posterior that not every strategy has."""
_NULLABLE: Final = (NULLABLE["robots"] | NULLABLE["runs"] | frozenset(WALK)) - NEVER_NULL
ROBOTS: Final = Schema(ROWS, _NULLABLE, ("cell", "run", "robot"))
_OF_SAMPLES: Final = frozenset({"energy", "message", "alpha", "beta", "belief_below"})
SAMPLE_ROWS: Final = Schema(SAMPLES, _OF_SAMPLES, ("cell", "run", "robot", "sample"))


def check_shard(files: Mapping[str, Path], study: Study, group: Group, runs: range, rows: int) -> None:
    """Check that tables are those of a batch.

    Args:
        files: by table. group, runs: of the batch. rows: the number that its description gives.
    Raises:
        InputError: a table is missing, unexpected or wrong; it names file and column.
    """
    required = {"robots", *study.keep}
    if set(files) - {FAILED_TABLE} != required:
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
        schema = {"robots": ROBOTS, FAILED_TABLE: FAILED_ROWS}.get(table, SAMPLE_ROWS)
        frame = read_frame(path, table)
        frame = check_table(frame, schema, path.name, table)
        if table == "robots" and frame.height != expected:
            raise InputError(f"has {frame.height} rows, not {expected}", field=path.name)
        for column, allowed in (("cell", set(cells)), ("run", set(runs)), ("robot", set(range(robots)))):
            if column not in frame.columns:
                continue
            strange = set(frame[column].unique().to_list()) - allowed
            if strange:
                raise InputError(
                    f"column '{column}' names {min(strange)}, which is not of this batch", field=path.name
                )
        if table == "robots":
            _check_outcomes(frame, robots, path.name)


def _check_outcomes(frame: pl.DataFrame, robots: int, name: str) -> None:
    """Check that decisions, times and beliefs of a shard agree."""
    timed = frame["decision_time_s"].is_not_null()
    if (frame["decision"].is_in([0, 1]) != timed).any():
        raise InputError(
            "column 'decision_time_s' must be given for robots that decided, and for no others", field=name
        )
    for column in ("right", "wrong", "undecided"):
        most: Any = frame[column].max()
        if most > robots:
            raise InputError(f"column '{column}' counts more than {robots} robots", field=name)
