"""What a shard must be: the tables of one batch, of its cells, runs and robots, each once."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.result import UNTOLD
from vibroswarm.study.plan import Group
from vibroswarm.study.rows import ROWS, WALK
from vibroswarm.study.simulate_batch import SAMPLES
from vibroswarm.study.spec import Study
from vibroswarm.tables import Schema, check_table, read_frame

NEVER_UNTOLD: Final = frozenset({"decision", "received", "consensus", "right", "wrong", "undecided"})
"""A simulation always knows these; not every strategy keeps a posterior or a belief."""
_NULLABLE: Final = (UNTOLD["robots"] | UNTOLD["runs"] | frozenset(WALK)) - NEVER_UNTOLD
ROBOTS: Final = Schema(ROWS, _NULLABLE, ("cell", "run", "robot"))
_OF_SAMPLES: Final = frozenset({"energy", "message", "alpha", "beta", "belief"})
SAMPLE_ROWS: Final = Schema(SAMPLES, _OF_SAMPLES, ("cell", "run", "robot", "sample"))


def check_shard(files: Mapping[str, Path], study: Study, group: Group, runs: range, rows: int) -> None:
    """Refuse tables that are not those of a batch.

    Args:
        files: by table. group, runs: of the batch. rows: that its description tells.
    Raises:
        InputError: a table is missing or too many, or not what it should be; names file and column.
    """
    wanted = {"robots", *study.keep}
    if set(files) != wanted:
        raise InputError(
            f"has the tables {', '.join(sorted(files)) or 'none'}, not {', '.join(sorted(wanted))}"
        )
    cells, robots = [cell.number for cell in group.cells], group.first.swarm.robots
    expected = len(cells) * len(runs) * robots
    if rows != expected:
        raise InputError(
            f"tells of {rows} rows; {len(cells)} cells, {len(runs)} runs and {robots} robots make {expected}"
        )
    for table, path in files.items():
        schema = ROBOTS if table == "robots" else SAMPLE_ROWS
        frame = read_frame(path, table)
        frame = check_table(frame, schema, path.name, table)
        if table == "robots" and frame.height != expected:
            raise InputError(f"has {frame.height} rows, not {expected}", field=path.name)
        for column, allowed in (("cell", set(cells)), ("run", set(runs)), ("robot", set(range(robots)))):
            strange = set(frame[column].unique().to_list()) - allowed
            if strange:
                raise InputError(
                    f"column '{column}' names {min(strange)}, which is not of this batch", field=path.name
                )
        if table == "robots":
            _check_outcomes(frame, robots, path.name)


def _check_outcomes(frame: pl.DataFrame, robots: int, name: str) -> None:
    timed = frame["decision_time_s"].is_not_null()
    if (frame["decision"].is_in([0, 1]) != timed).any():
        raise InputError(
            "column 'decision_time_s' is there for those who decided, and for no one else", field=name
        )
    for column in ("right", "wrong", "undecided"):
        most: Any = frame[column].max()
        if most > robots:
            raise InputError(f"column '{column}' counts more than {robots} robots", field=name)
