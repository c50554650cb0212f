"""Write the reproduction as one zip file: scenarios, seeds, versions and results, with which anyone can verify it.

| entry | content |
|---|---|
| archive.json | format, settings, versions, items, the SHA-256 of each other entry |
| scenarios/HASH.toml | all scenarios |
| cells.csv | one row per cell: scenario, seed, engine, runs, digest of its table of robots, its figures, its command |
| robots.csv | the table of robots of the first runs of each cell |
| measured.csv | the values that decided the claims |
| claims.csv, intervals.csv | the verdicts, and the intervals behind them |
| tables/NAME.csv | the tables of all items |

An archive of items without cells has no scenarios, and neither ``cells.csv`` nor ``robots.csv``.

A zip file of unknown origin is only read as data: nothing is unpacked to disk or run, and names and sizes are checked.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import polars as pl

from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.paper.cells import Cell, CellResults
from vibroswarm.paper.item import CLAIMS
from vibroswarm.paper.reproduce import Reproduction
from vibroswarm.paper.reproduction_report import cells_table, claims_table, command_of
from vibroswarm.simulation import versions

MOST_ENTRIES: Final = 20_000
"""Largest number of entries."""
MOST_BYTES: Final = 512 * 2**20
"""Total size of all entries, unpacked."""
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*(/[A-Za-z0-9][A-Za-z0-9_.-]*)?(\.[a-z]+)?")
"""A plain name of an entry: one folder at most, and nothing that leads out of a folder."""


class Zipped(NotebookView):
    """An open zip file whose entries have plain names and bounded sizes.

    Raises:
        InputError: not a zip file, a malformed name, too many or too large entries.
    """

    def __init__(self, path: Path) -> None:
        """Open the file, and check its entries; ``names`` are the names of the entries."""
        self.path = path
        if not path.is_file():
            raise InputError("is not a file", field=str(path))
        try:
            self._file = zipfile.ZipFile(path)
        except (OSError, zipfile.BadZipFile, NotImplementedError, ValueError) as error:
            raise InputError(f"is not a zip file ({error})", field=str(path)) from None
        try:
            self.names = self._checked()
        except InputError:
            self._file.close()  # the caller gets no object that it could close
            raise

    def _checked(self) -> list[str]:
        """Check the number, sizes, compression and names of all entries, and return the names.

        Raises:
            InputError: the entries are too many or too large, or an entry has a compression method other than deflate,
                a name that is not plain, or the name of another entry.
        """
        entries = self._file.infolist()
        names = [entry.filename for entry in entries]
        if len(entries) > MOST_ENTRIES or sum(entry.file_size for entry in entries) > MOST_BYTES:
            raise InputError(
                f"is too large: at most {MOST_ENTRIES} files, and 512 MiB in all, are allowed",
                field=str(self.path),
            )
        if any(entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for entry in entries):
            # Other methods may need gigabytes of memory.
            raise InputError("uses an unsupported compression method; use deflate", field=str(self.path))
        invalid = next((name for name in names if not _NAME.fullmatch(name)), None)
        if invalid is not None:
            raise InputError(f"has a file with an invalid name, {invalid!r}", field=str(self.path))
        if len(set(names)) != len(names):
            repeated = next(name for name in names if names.count(name) > 1)
            raise InputError(f"has two files named {repeated!r}", field=str(self.path))
        return names

    def read(self, name: str) -> bytes:
        """Return the unpacked bytes of an entry.

        Raises:
            InputError: the entry is missing, damaged, encrypted, or longer than stated.
        """
        try:
            entry = self._file.getinfo(name)
            with self._file.open(entry) as stream:
                # ``zipfile`` cuts an entry at its stated size, and refuses it if its checksum (CRC) does not fit. One
                # byte more is requested so that the check below does not rely on this.
                data = stream.read(entry.file_size + 1)
        except KeyError:
            raise InputError(f"has no '{name}'", field=str(self.path)) from None
        except Exception as error:  # zipfile and zlib raise many kinds
            words = str(error) or type(error).__name__
            raise InputError(f"'{name}' is damaged ({words})", field=str(self.path)) from None
        if len(data) > entry.file_size:
            raise InputError(f"'{name}' is longer than stated", field=str(self.path))
        return data

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


FORMAT: Final = 4
"""Number of the archive's format."""
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
        "command": command_of(made.settings),
        "items": [entry.item.name for entry in made.made if not entry.skipped],
        "skipped": [entry.item.name for entry in made.made if entry.skipped],
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
        "block": cell.block,
        "seed": cell.seed(results.seed),
        "motion": cell.motion,
        "runs": result.row["runs"],
        "digest": result.digest,
        **{name: result.row[name] for name in FIGURES},
        "command": cell.command(results.runs, results.seed),
    }
