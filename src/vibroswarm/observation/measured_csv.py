"""Measured energies, read from a CSV file of tile kind and energy."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.errors import InputError

KINDS: Final = {"vibrating": 1, "1": 1, "still": 0, "non-vibrating": 0, "0": 0}
"""Words for a kind of tile."""


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read measured energies; return those of vibrating tiles, then those of still tiles, in the order of the file."""
    try:
        table = pl.read_csv(path, columns=["kind", "energy"], schema_overrides={"kind": pl.String})
        table = table.filter(~pl.all_horizontal(pl.all().is_null()))  # empty lines
        kind = table["kind"].str.to_lowercase().replace_strict(KINDS, return_dtype=pl.UInt8)
        energies = [tuple(table["energy"].cast(pl.Float64).filter(kind == one).to_list()) for one in (1, 0)]
    except (OSError, pl.exceptions.PolarsError) as error:
        raise InputError(
            f"is no CSV file with the columns kind and energy: {error}", field=str(path)
        ) from None
    if table.null_count().sum_horizontal().item() or not all(energies):
        raise InputError("needs a kind and an energy in each line, and both kinds of tile", field=str(path))
    return energies[0], energies[1]
