"""Measured energies, read from a CSV file of tile kind and energy."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from vibroswarm.core.untrusted_files import read_text
from vibroswarm.errors import InputError, shown

KINDS = {"vibrating": True, "1": True, "still": False, "non-vibrating": False, "0": False}
LARGEST_BYTES = 64 * 2**20
MAX_ENERGIES = 1_000_000


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read the energies of vibrating and of still tiles.

    Args:
        path: a CSV file with a head line that names the columns ``kind`` (vibrating or still, 1 or 0) and
            ``energy`` (RMS, >= 0); other columns are left alone.
    Raises:
        InputError: naming the line and what would be right.
    """
    name = str(path)
    text = read_text(Path(path), "a CSV file of energies", LARGEST_BYTES).removeprefix("\ufeff")
    energies: dict[bool, list[float]] = {True: [], False: []}
    head: list[str] | None = None
    try:
        # Row by row, as a list of all rows takes a hundred times the file's size.
        for number, row in enumerate(csv.reader(io.StringIO(text, newline="")), start=1):
            if head is None:
                head = _head(row, name)
            elif row:
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
    """Return the column names, lower case; refuse a header without kind and energy."""
    head = [cell.strip().lower() for cell in row]
    if "kind" not in head or "energy" not in head:
        raise InputError(
            f"its first line is {shown(','.join(row))}; it has to name kind and energy", field=name
        )
    return head


def _sample(row: list[str], head: list[str], where: str) -> tuple[bool, float]:
    """Parse a row to (vibrating, energy)."""
    if len(row) != len(head):
        raise InputError(f"{len(row)} columns where the first line has {len(head)}", field=where)
    kind, text = row[head.index("kind")].strip().lower(), row[head.index("energy")].strip()
    if kind not in KINDS:
        raise InputError(f"{shown(kind)} is not a kind of tile; use vibrating or still", field=where)
    try:
        energy = float(text)
    except ValueError:
        energy = math.nan
    if not 0 <= energy < math.inf:
        raise InputError(f"{shown(text)} is not an energy; use a number of 0 or more", field=where)
    return KINDS[kind], energy
