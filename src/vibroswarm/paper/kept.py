"""The tables of an item on disk: a folder, whole or not at all, with the fingerprint of what made them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.files import whole_folder
from vibroswarm.paper.item import Tables

MARKER: Final = "item.json"


def read_kept(folder: Path, fingerprint: str) -> Tables | None:
    """The tables kept in a folder, or None: not there, damaged, or made of something else."""
    try:
        about = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        if about["fingerprint"] != fingerprint:
            return None
        return {name: pl.read_parquet(folder / f"{name}.parquet") for name in about["tables"]}
    except (OSError, ValueError, KeyError, TypeError, pl.exceptions.PolarsError):
        return None


def keep(folder: Path, fingerprint: str, tables: Tables) -> None:
    """Keep the tables, in place of what was there.

    Raises:
        InputError, RunError: they cannot be written.
    """
    with whole_folder(folder, replace=True, marker=MARKER) as part:
        for name, table in tables.items():
            table.write_parquet(part / f"{name}.parquet")
        about = {"fingerprint": fingerprint, "tables": list(tables)}
        (part / MARKER).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
