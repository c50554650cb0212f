"""Measured energies, read from a CSV file of tile kind and energy."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError, shown

KINDS = {"vibrating": True, "1": True, "still": False, "non-vibrating": False, "0": False}
"""Words for a kind of tile, and whether it vibrates."""
LARGEST_BYTES = 64 * 2**20
"""Size limit of the file."""
MAX_ENERGIES = 1_000_000
"""Limit on the number of energies of each kind of tile."""
MAX_ENERGY = 1e9
"""Largest energy, as in a scenario (``scenario.fields.Energies``)."""


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read measured energies; return those of vibrating tiles, then those of still tiles, in the order of the file.

    Args:
        path: a CSV file whose first line names the columns ``kind`` (vibrating or still, 1 or 0) and ``energy`` (RMS,
            0 to ``MAX_ENERGY``); other columns and, below the first line, lines of empty cells are ignored.
    Raises:
        InputError: the file cannot be read, is larger than ``LARGEST_BYTES`` or is not a CSV file; its first line lacks
            a column; a line is wrong (the message names it); a kind has no energy, or more than ``MAX_ENERGIES``.
    """
    name = str(path)
    # Spreadsheet programs write a byte order mark, which would become part of the first column's name.
    text = read_text(Path(path), "a CSV file of energies", LARGEST_BYTES)
    energies: dict[bool, list[float]] = {True: [], False: []}
    head: list[str] | None = None
    try:
        # Read row by row: a list of all rows would need a hundred times the memory of the file.
        for number, row in enumerate(csv.reader(io.StringIO(text, newline="")), start=1):
            if head is None:
                head = _head(row, name)
            elif any(row):  # spreadsheets write empty lines as ","
                kind, energy = _sample(row, head, f"{name}, line {number}")
                energies[kind].append(energy)
                if len(energies[kind]) > MAX_ENERGIES:
                    raise InputError(f"holds more than {MAX_ENERGIES:,} energies of a kind", field=name)
    except csv.Error as error:
        raise InputError(f"is not a CSV file: {error}", field=name) from None
    if head is None:
        raise InputError("is empty; give a line 'kind,energy', then one line per sample", field=name)
    for vibrating, word in ((True, "vibrating"), (False, "still")):
        if not energies[vibrating]:
            raise InputError(f"holds no energy of a {word} tile", field=name)
    return tuple(energies[True]), tuple(energies[False])


def _head(row: list[str], name: str) -> list[str]:
    """Return the column names in the first line of the file, in lower case.

    Args:
        row: cells of the line. name: name of the file, for the message.
    Raises:
        InputError: kind or energy is not among the columns.
    """
    head = [cell.strip().lower() for cell in row]
    if "kind" not in head or "energy" not in head:
        raise InputError(
            f"its first line is {shown(','.join(row))}; it has to name kind and energy, with ',' between them",
            field=name,
        )
    return head


def _sample(row: list[str], head: list[str], where: str) -> tuple[bool, float]:
    """Return whether a row's tile vibrates, and the row's energy.

    Args:
        row: cells of the line. head: names of the columns. where: file and line, for messages.
    Raises:
        InputError: the row has another number of columns, an unknown kind, or an energy outside 0 to ``MAX_ENERGY``.
    """
    if len(row) != len(head):
        raise InputError(f"{len(row)} columns where the first line has {len(head)}", field=where)
    kind, text = row[head.index("kind")].strip().lower(), row[head.index("energy")].strip()
    if kind not in KINDS:
        raise InputError(f"{shown(kind)} is not a kind of tile; use vibrating or still", field=where)
    try:
        energy = float(text)
    except ValueError:
        energy = math.nan  # refused below
    if not 0 <= energy <= MAX_ENERGY:
        raise InputError(f"{shown(text)} is not an energy; use a number from 0 to 1e9", field=where)
    return KINDS[kind], energy
