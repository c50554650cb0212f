"""Write the reproduction as one zip file: scenarios, seeds, versions and results, for deposit beside a publication.

| entry | content |
|---|---|
| archive.json | format, settings, versions, items, the SHA-256 of each other entry |
| scenarios/HASH.toml | all scenarios |
| cells.csv | one row per cell: scenario, seed, runs, digest of its table of robots, its figures, its command |
| robots.csv | the table of robots of the first runs of each cell |
| measured.csv | the values that decided the claims |
| claims.csv, intervals.csv | the verdicts, and the intervals behind them |
| tables/NAME.csv | the tables of all items |

An archive of items without cells has no scenarios, and neither ``cells.csv`` nor ``robots.csv``.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.folders import FORMAT
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.paper.cells import Cell, CellResults
from vibroswarm.paper.item import CLAIMS
from vibroswarm.paper.reproduce import Reproduction
from vibroswarm.paper.reproduction_tables import cells_table, claims_table, command_of_all
from vibroswarm.simulation import versions

HEAD: Final = "archive.json"
"""Entry that describes the archive and has the hashes of the other entries."""
FIGURES: Final = ("decision_time_s", "belief_in_truth", "robots_right", "robots_wrong", "robots_undecided")
"""Figures of a cell in ``cells.csv``."""
_MADE: Final = (1980, 1, 1, 0, 0, 0)
"""Date of all entries, the earliest that a zip file can hold, so that the same reproduction gives the same file."""


def write_archive(made: Reproduction, path: Path) -> None:
    """Write the archive of a reproduction into the file ``path``, whole or not at all.

    Raises:
        InputError: the results of the cells are missing, or the file cannot be written. RunError: the disk is full.
    """
    if made.results is None:
        raise InputError("needs the results of the cells; reproduce with with_cells=True", field="--archive")
    entries = _entries(made, made.results)
    head = {
        "format": FORMAT,
        # Left out: ``workers``, which changes no result, and ``recordings``, a folder of this machine.
        "settings": {
            "runs": made.settings.runs,
            "seed": made.settings.seed,
            "columns": list(made.settings.columns),
            "control": made.settings.control,
        },
        "command": command_of_all(made),
        "items": [entry.item.name for entry in made.made if not entry.skipped],
        "skipped": [entry.item.name for entry in made.made if entry.skipped],
        "versions": versions(),
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in entries.items()},
    }
    entries = {HEAD: (json.dumps(head, indent=2) + "\n").encode(), **entries}
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in entries.items():
            file.writestr(zipfile.ZipInfo(name, _MADE), data, zipfile.ZIP_DEFLATED)


def _entries(made: Reproduction, results: CellResults) -> dict[str, bytes]:
    """Return the contents of all files of the archive but ``archive.json``, by name.

    The tables ``cells``, ``robots`` and ``measured`` are left out if they would have no rows.
    """
    # Without ``with_cells``, a reproduction has no results of cells whose items all have saved tables.
    cells = {key: cell for key, cell in made.cells.items() if key in results.cells}
    rows = [cell_row(cell, results) for cell in cells.values()]
    robots = [results.cells[key].first.select(pl.lit(key).alias("key"), pl.all()) for key in cells]
    decided = made.decided
    measured = [entry.tables[CLAIMS] for entry in made.made if CLAIMS in entry.tables]
    entries = {
        f"scenarios/{cell.scenario.hash}.toml": cell.scenario.to_toml().encode() for cell in cells.values()
    }
    frames = {"cells": pl.DataFrame(rows, infer_schema_length=None)} if rows else {}
    frames |= {"robots": pl.concat(robots)} if robots else {}
    frames |= {"measured": pl.concat(measured)} if measured else {}
    frames |= {"claims": claims_table(decided), "intervals": cells_table(decided)}
    for entry in made.made:
        for name, table in entry.tables.items():
            if name != CLAIMS:  # the measured values of all items are in the table ``measured``
                frames[f"tables/{entry.item.name}-{name}"] = table
    return entries | {f"{name}.csv": csv_bytes(frame) for name, frame in frames.items()}


def cell_row(cell: Cell, results: CellResults) -> dict[str, Any]:
    """Return the row of a cell in ``cells.csv``, by column; ``digest`` is the SHA-256 of the cell's table of robots."""
    result = results[cell]
    return {
        "key": cell.key,
        "column": cell.column,
        "scenario": cell.scenario.hash,
        "seed": results.seed,
        "runs": result.row["runs"],
        "digest": result.digest,
        **{name: result.row[name] for name in FIGURES},
        "command": cell.command(results.runs, results.seed),
    }
