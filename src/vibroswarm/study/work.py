"""The work of one batch: some runs of a group of cells, from the seed to a table.

What goes to a worker is text and numbers, what comes back is bytes: a worker may be a thread, a process, or on another
machine. The rows are one a cell, run and robot, with what is known of the run beside each robot.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.analysis.sampling import WALK as OF_WALK
from vibroswarm.analysis.sampling import walk_figures
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.replay import INFERENCE, infer
from vibroswarm.inference.timeline import timeline_of
from vibroswarm.motion.contract import ENDS, MOTION, Motion, source
from vibroswarm.observation.model import OBSERVATIONS, observe
from vibroswarm.result import ROBOTS, RUNS
from vibroswarm.scenario import Scenario
from vibroswarm.simulation import floors_of, simulate, summarise, versions
from vibroswarm.study.plan import Group, Texts
from vibroswarm.study.spec import Study

WALK: Final = {name: kind for name, kind in OF_WALK.items() if name not in ("run", "samples")}
"""How the robots of the run sampled, see ``analysis.sampling``."""

ROWS: Final[dict[str, Any]] = {
    "cell": pl.UInt32,
    **ROBOTS,
    **{k: v for k, v in RUNS.items() if k != "run"},
    **WALK,
}
"""One row a cell, run and robot, in this order: the robot's columns, then those of its run."""

SAMPLES: Final[dict[str, Any]] = {
    "cell": pl.UInt32,
    **MOTION,
    **{k: v for k, v in OBSERVATIONS.items() if k not in MOTION},
    **{k: v for k, v in INFERENCE.items() if k not in MOTION},
}
"""One row a cell and sample, kept on request."""

ROWS_AT_A_TIME: Final = 200_000
"""Samples that are in memory at a time, roughly."""


class Cancelled(Exception):  # noqa: N818  (nothing went wrong)
    """The study was stopped while a batch was under way."""


@dataclass(frozen=True)
class Work:
    """One batch, in plain values.

    Args:
        study: hash of the study. group: its number.
        observed: for each floor and sensor, for each way to decide: the scenario as TOML, and the cells it stands for.
        first, last: runs, the last not included. seed, motion, keep: as the study has them.
    """

    study: str
    group: int
    observed: Texts
    first: int
    last: int
    seed: int
    motion: str
    keep: tuple[str, ...]

    @property
    def name(self) -> str:
        """The batch in words, as ``--batch`` takes it."""
        return f"{self.group}:{self.first}-{self.last}"


@dataclass(frozen=True)
class Done:
    """A batch that is done: Parquet files by the name of their table, and what made them."""

    work: Work
    files: dict[str, bytes]
    rows: int
    versions: dict[str, str]


def work_of(study: Study, group: Group, first: int, last: int) -> Work:
    """The batch of these runs of a group."""
    return Work(study.hash, group.number, group.texts, first, last, study.seed, study.motion, study.keep)


def do(work: Work, cancelled: Callable[[], bool] = lambda: False) -> Done:
    """Do a batch; a part of its runs at a time, so that memory does not grow with it.

    Raises:
        Cancelled: ``cancelled`` said so between two steps.
    """
    first = _scenario(work.observed[0][0][0])
    a_run = max(
        first.swarm.robots * first.run.t_end_s * 1000.0 / (first.sample.sample_interval_ms + 1000.0), 1.0
    )
    step = max(int(ROWS_AT_A_TIME / a_run), 1)
    parts: dict[str, list[pl.DataFrame]] = {"robots": [], **{name: [] for name in work.keep}}
    for low in range(work.first, work.last, step):
        for name, frames in _part(work, range(low, min(low + step, work.last)), cancelled).items():
            parts[name] += frames
    orders = {"robots": ["cell", "run", "robot"], "samples": ["cell", "run", "time_s", "robot"]}
    tables = {
        name: pl.concat(frames).sort(orders[name], maintain_order=True) for name, frames in parts.items()
    }
    files = {name: _parquet(table, work) for name, table in tables.items()}
    return Done(work, files, tables["robots"].height, versions())


def _part(work: Work, runs: range, cancelled: Callable[[], bool]) -> dict[str, list[pl.DataFrame]]:
    """The rows of some runs, table by table, cell by cell."""
    frames: dict[str, list[pl.DataFrame]] = {"robots": [], **{name: [] for name in work.keep}}
    if cancelled():
        raise Cancelled
    for cells, part in _came_of(work, runs):
        if cancelled():
            raise Cancelled
        of_run = part.runs.join(part.walk, on="run", how="left", maintain_order="left").drop("run", "samples")
        each = np.repeat(np.arange(part.runs.height), part.robots.height // part.runs.height)
        rows = pl.concat([part.robots, of_run[each]], how="horizontal")
        for cell in cells:
            frames["robots"].append(_of_cell(rows, cell, ROWS))
            if part.samples is not None:
                frames["samples"].append(_of_cell(part.samples, cell, SAMPLES))
    return frames


class _CameOf(NamedTuple):
    """The tables of some runs of one cell."""

    robots: pl.DataFrame
    runs: pl.DataFrame
    walk: pl.DataFrame
    samples: pl.DataFrame | None


def _came_of(work: Work, runs: range) -> Iterator[tuple[tuple[int, ...], _CameOf]]:
    """What came of these runs in each of the cells; equal cells together, motion and observations made once."""
    first, keep = _scenario(work.observed[0][0][0]), "samples" in work.keep
    if first.run.stop == "all_decided":
        ((text, cells),) = work.observed[0]
        result = simulate(_scenario(text), work.seed, runs, motion=work.motion, energies=keep)
        walk = _walk(result.motion, result.observations, result.floor(runs[0]))
        samples = _samples(result.motion, result.observations, result.inference) if keep else None
        yield cells, _CameOf(result.robots, result.runs, walk, samples)
        return
    whole = source(work.motion).batch(first, work.seed, runs, False)
    motion, timeline, end_s = whole, timeline_of(first, whole), first.run.t_end_s
    for inferences in work.observed:
        seen = _scenario(inferences[0][0])
        if seen.run.t_end_s != end_s:
            motion, end_s = beginning(whole, seen), seen.run.t_end_s
            timeline = timeline_of(seen, motion)
        floors = floors_of(seen, work.seed, runs)
        observations = observe(seen, work.seed, motion.samples, floors, energies=keep)
        walk = _walk(motion.samples, observations, floors[runs[0]])
        for text, cells in inferences:
            scenario = _scenario(text)
            robots, of_runs = summarise(scenario, work.seed, floors, timeline, observations)
            samples = None
            if keep:
                inference, _ = infer(scenario, work.seed, timeline, observations)
                samples = _samples(motion.samples, observations, inference)
            yield cells, _CameOf(robots, of_runs, walk, samples)


def beginning(motion: Motion, scenario: Scenario) -> Motion:
    """The beginning of a motion, up to the end of a scenario that moves alike but not as long: what its own would be.

    A sample belongs to the tick before its time; a robot that took one at the last tick still stands in it. Where
    robots are at the end is not told (null), since the table of samples does not know.
    """
    tick_s = scenario.tick_s
    end_s, key = scenario.ticks * scenario.run.control_period_ms / 1000.0, ["run", "robot"]
    before = pl.col("time_s") < end_s - tick_s / 4
    samples, later = motion.samples.filter(before), motion.samples.filter(~before)
    following = later.group_by(key).agg(following=pl.col("stop_start_s").first())
    last = samples.filter(pl.col("time_s") > end_s - 1.25 * tick_s).select(*key, last="stop_start_s")
    ends = motion.ends.join(following, on=key, how="left", maintain_order="left")
    ends = ends.join(last, on=key, how="left", maintain_order="left")
    under_way = pl.coalesce("following", "stop_start_s")
    since = pl.when(under_way < end_s - tick_s / 4).then(under_way)
    unknown = {name: pl.lit(None, dtype=pl.Float64) for name in ("x_m", "y_m", "heading_rad")}
    ends = ends.with_columns(end_s=pl.lit(end_s), stop_start_s=pl.coalesce("last", since), **unknown)
    return Motion(samples, ends.select(list(ENDS)), None)


def _samples(motion: pl.DataFrame, observations: pl.DataFrame, inference: pl.DataFrame) -> pl.DataFrame:
    others = (table.drop("run", "robot", "sample") for table in (observations, inference))
    return pl.concat([motion, *others], how="horizontal")


def _walk(samples: pl.DataFrame, observations: pl.DataFrame, floor: Floor) -> pl.DataFrame:
    return walk_figures(samples, observations, floor.tiles.size)


def _of_cell(rows: pl.DataFrame, cell: int, schema: dict[str, Any]) -> pl.DataFrame:
    return rows.with_columns(cell=pl.lit(cell, dtype=pl.UInt32)).select(list(schema)).cast(schema)  # type: ignore[arg-type]


@lru_cache(maxsize=4096)
def _scenario(text: str) -> Scenario:
    return Scenario.from_toml(text)


def _parquet(table: pl.DataFrame, work: Work) -> bytes:
    buffer = io.BytesIO()
    table.write_parquet(buffer, compression="zstd", metadata={"vibroswarm_study": work.study})
    return buffer.getvalue()
