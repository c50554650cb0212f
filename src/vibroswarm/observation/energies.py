"""Measured energies from a CSV file of tile kind and energy."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from vibroswarm.errors import InputError

KINDS = {"vibrating": True, "1": True, "still": False, "non-vibrating": False, "0": False}
LARGEST_BYTES = 256 * 2**20


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Energies of vibrating and of still tiles.

    Args:
        path: a CSV file with a head line that names the columns ``kind`` (vibrating or still, 1 or 0) and
            ``energy`` (RMS, >= 0); other columns are left alone.
    Raises:
        InputError: naming the line and what would be right.
    """
    name = str(path)
    try:
        if Path(path).stat().st_size > LARGEST_BYTES:
            raise InputError("is larger than 256 MiB", field=name)
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.reader(file))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", field=name) from None
    except (UnicodeDecodeError, csv.Error, ValueError) as error:
        raise InputError(f"is no CSV file: {error}", field=name) from None
    if not rows:
        raise InputError("is empty; a line 'kind,energy' and then one line a sample", field=name)
    head = [cell.strip().lower() for cell in rows[0]]
    if "kind" not in head or "energy" not in head:
        raise InputError(
            f"its first line is '{','.join(rows[0])[:60]}'; it has to name kind and energy", field=name
        )
    found: dict[bool, list[float]] = {True: [], False: []}
    for number, row in enumerate(rows[1:], start=2):
        if row:
            kind, energy = _sample(row, head, f"{name}, line {number}")
            found[kind].append(energy)
    for vibrating, word in ((True, "vibrating"), (False, "still")):
        if not found[vibrating]:
            raise InputError(f"holds no energy of a {word} tile", field=name)
    return tuple(found[True]), tuple(found[False])


def _sample(row: list[str], head: list[str], where: str) -> tuple[bool, float]:
    if len(row) != len(head):
        raise InputError(f"{len(row)} columns where the first line has {len(head)}", field=where)
    kind, text = row[head.index("kind")].strip().lower(), row[head.index("energy")].strip()
    if kind not in KINDS:
        raise InputError(f"'{kind}' is no kind of tile; vibrating or still", field=where)
    try:
        energy = float(text)
    except ValueError:
        energy = math.nan
    if not 0 <= energy < math.inf:
        raise InputError(f"'{text}' is no energy; a number of 0 or more", field=where)
    return KINDS[kind], energy
