"""The reproduction as one zip file: scenarios, seeds, versions and results, from which anybody can confirm it.

| entry | holds |
|---|---|
| archive.json | format, settings, versions, items, the SHA-256 of each other entry |
| scenarios/HASH.toml | all scenarios |
| cells.csv | one row a cell: scenario, seed, engine, runs, digest of its table of robots, its figures, its command |
| robots.csv | the table of robots of the first runs of each cell |
| measured.csv, claims.csv | what claims were decided by, and the verdicts |
| tables/NAME.csv | the tables of all items |
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.csv_text import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.files import whole_file
from vibroswarm.paper.cells import Came, Cell
from vibroswarm.paper.item import CLAIMS
from vibroswarm.paper.report import cells_table, claims_table, command_of
from vibroswarm.paper.reproduce import Reproduction
from vibroswarm.simulation import versions

FORMAT: Final = 3
HEAD: Final = "archive.json"
FIGURES: Final = ("decision_time_s", "belief_in_truth", "robots_right", "robots_wrong", "robots_undecided")
_MADE: Final = (1980, 1, 1, 0, 0, 0)
"""Entries bear no date, so that the same reproduction gives the same file."""


def write_archive(made: Reproduction, path: Path) -> None:
    """Write the archive, whole or not at all.

    Raises:
        InputError: what came of the cells is not at hand, or the file cannot be written.
    """
    if made.came is None:
        raise InputError("needs what came of the cells; reproduce with again=True", field="--archive")
    entries = _entries(made, made.came)
    head = {
        "format": FORMAT,
        "settings": {
            "runs": made.settings.runs,
            "seed": made.settings.seed,
            "columns": list(made.settings.columns),
            "control": made.settings.control,
        },
        "command": command_of(made.settings),
        "items": [one.item.name for one in made.made if not one.skipped],
        "skipped": [one.item.name for one in made.made if one.skipped],
        "versions": versions(),
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in entries.items()},
    }
    entries = {HEAD: (json.dumps(head, indent=2) + "\n").encode(), **entries}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in entries.items():
            file.writestr(zipfile.ZipInfo(name, _MADE), data, zipfile.ZIP_DEFLATED)
    with whole_file(path) as part:
        part.write_bytes(buffer.getvalue())


def _entries(made: Reproduction, came: Came) -> dict[str, bytes]:
    cells = {key: cell for key, cell in made.cells.items() if key in came.cells}
    rows = [cell_row(cell, came) for cell in cells.values()]
    robots = [came.cells[key].first.select(pl.lit(key).alias("key"), pl.all()) for key in cells]
    decided = made.decided
    measured = [one.tables[CLAIMS] for one in made.made if CLAIMS in one.tables]
    entries = {
        f"scenarios/{cell.scenario.hash}.toml": cell.scenario.to_toml().encode() for cell in cells.values()
    }
    frames = {"cells": pl.DataFrame(rows, infer_schema_length=None)} if rows else {}
    frames |= {"robots": pl.concat(robots)} if robots else {}
    frames |= {"measured": pl.concat(measured)} if measured else {}
    frames |= {"claims": claims_table(decided), "intervals": cells_table(decided)}
    for one in made.made:
        frames |= {f"tables/{one.item.name}-{n}": t for n, t in one.tables.items() if n != CLAIMS}
    return entries | {f"{name}.csv": csv_bytes(frame) for name, frame in frames.items()}


def cell_row(cell: Cell, came: Came) -> dict[str, Any]:
    """What is kept of a cell."""
    found = came[cell]
    return {
        "key": cell.key,
        "column": cell.column,
        "scenario": cell.scenario.hash,
        "block": cell.block,
        "seed": cell.seed(came.seed),
        "motion": cell.motion,
        "runs": found.row["runs"],
        "digest": found.digest,
        **{name: found.row[name] for name in FIGURES},
        "command": cell.command(came.runs, came.seed),
    }
