"""Measured energies, read from a CSV file of tile kind and energy."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.read_tables import Column, ColumnMap, Use, read_rows
from vibroswarm.errors import InputError

KINDS: Final = {"vibrating": 1, "1": 1, "still": 0, "non-vibrating": 0, "0": 0}
"""Words for a kind of tile."""
_SCHEMA: Final = {
    "kind": Use(pl.Int64, 0, 1, f"one of {', '.join(KINDS)}", required=True),
    "energy": Use(pl.Float64, -1e300, 1e300, "a number", required=True),
}


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read measured energies; return those of vibrating tiles, then those of still tiles, in the order of the file.

    Args:
        path: a table with the columns ``kind`` (vibrating or still, 1 or 0) and ``energy`` (RMS); other columns are
            ignored, and rows without one of the two are left out.
    Raises:
        InputError: the file cannot be read, a kind or an energy is wrong, or a kind is missing.
    """
    columns = {"kind": Column(name="kind", values=KINDS), "energy": Column(name="energy")}
    rows = read_rows([Path(path)], _SCHEMA, ColumnMap(columns=columns)).rows
    vibrating, still = (tuple(rows.filter(kind=kind)["energy"].to_list()) for kind in (1, 0))
    if not vibrating or not still:
        raise InputError("needs energies of both kinds of tile", field=str(path))
    return vibrating, still
