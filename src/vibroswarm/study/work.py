"""The work of one batch: some runs of a group of cells, from the seed to a table.

What goes to a worker is text and numbers, what comes back is bytes: a worker may be a thread, a process, or on another
machine. The rows are one a cell, run and robot, with what is known of the run beside each robot.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import polars as pl

from vibroswarm import code_files
from vibroswarm.forked import check_threads
from vibroswarm.simulation import versions
from vibroswarm.study.plan import Group, Texts
from vibroswarm.study.rows import BatchRows
from vibroswarm.study.simulate_batch import Asked, Cancelled, simulate_batch
from vibroswarm.study.spec import Study
from vibroswarm.study.texts import scenario_of

ROWS_AT_A_TIME: Final = 200_000
"""Samples that are in memory at a time, roughly."""


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
    code: tuple[tuple[str, str], ...] = ()
    """Code of the user's that the cells need, and its text."""

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
    return Work(
        study.hash,
        group.number,
        group.texts,
        first,
        last,
        study.seed,
        study.motion,
        study.keep,
        code_files.texts_of(study.codes),
    )


def do(work: Work, cancelled: Callable[[], bool] = lambda: False) -> Done:
    """Do a batch; a part of its runs at a time, so that memory does not grow with it.

    Raises:
        Cancelled: ``cancelled`` said so between two steps.
        RunError: this process was forked after polars had begun its threads.
    """
    check_threads()
    code_files.install_all(work.code)
    first = scenario_of(work.observed[0][0][0])
    a_run = max(
        first.swarm.robots * first.run.t_end_s * 1000.0 / (first.sample.sample_interval_ms + 1000.0), 1.0
    )
    step = max(int(ROWS_AT_A_TIME / a_run), 1)
    cells = [cell for inferences in work.observed for _, same in inferences for cell in same]
    rows = BatchRows(cells, range(work.first, work.last), first.swarm.robots)
    samples: list[pl.DataFrame] = []
    for low in range(work.first, work.last, step):
        some = range(low, min(low + step, work.last))
        asked = Asked(some, work.seed, work.motion, "samples" in work.keep, cancelled)
        for came in simulate_batch(work.observed, asked):
            rows.put(came.cells, low, came.robots, came.runs)
            samples += came.samples
    tables = {"robots": rows.table()}
    if "samples" in work.keep:
        order = ["cell", "run", "time_s", "robot"]
        tables["samples"] = pl.concat(samples).sort(order, maintain_order=True)
    files = {name: _parquet(table, work) for name, table in tables.items()}
    return Done(work, files, tables["robots"].height, versions())


def _parquet(table: pl.DataFrame, work: Work) -> bytes:
    buffer = io.BytesIO()
    table.write_parquet(buffer, compression="zstd", metadata={"vibroswarm_study": work.study})
    return buffer.getvalue()


__all__ = ["Cancelled", "Done", "Work", "do", "work_of"]
