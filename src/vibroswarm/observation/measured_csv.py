"""Measured energies, read from a CSV file of tile kind and energy."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.read_tables import Column, ColumnMap, Use, read_rows
from vibroswarm.errors import InputError

SCHEMA: Final = {
    "kind": Use(pl.Int64, 0, 1, "a kind of tile, 'still' or 'vibrating'", required=True),
    "energy": Use(pl.Float64, -1e300, 1e300, "an energy", required=True),
}
BY: Final = ColumnMap(
    columns={
        "kind": Column(name="kind", values={"vibrating": 1, "1": 1, "still": 0, "non-vibrating": 0, "0": 0}),
        "energy": Column(name="energy"),
    }
)


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read measured energies; return those of vibrating tiles, then those of still tiles, in the order of the file.

    Args:
        path: a CSV file with the columns ``kind`` (vibrating or still, 1 or 0) and ``energy`` (RMS); other columns are
            ignored.
    Raises:
        InputError: the file cannot be read, or a kind or an energy is wrong, or missing.
    """
    read = read_rows([Path(path)], SCHEMA, BY)
    vibrating, still = (tuple(read.rows.filter(kind=one)["energy"].to_list()) for one in (1, 0))
    if read.missing or not (vibrating and still):
        raise InputError("needs a kind and an energy in each line, and both kinds of tile", field=str(path))
    return vibrating, still
