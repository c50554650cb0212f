"""The tables of an item on disk: a folder, whole or not at all, with the fingerprint of what made them."""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.errors import InputError
from vibroswarm.files import whole_folder
from vibroswarm.paper.item import Tables
from vibroswarm.plain_files import entry, read_bytes, read_json, texts

MARKER: Final = "item.json"
MOST_BYTES: Final = 2**30


def read_kept(folder: Path, fingerprint: str) -> Tables | None:
    """The tables kept in a folder, or None: not there, damaged, or made of something else."""
    path = folder / MARKER
    if not path.exists():
        return None
    try:
        about = read_json(path, "the tables of an item")
        if entry(about, "fingerprint", str, path) != fingerprint:
            return None
        tables = {}
        for name, digest in texts(entry(about, "sha256", dict, path), "sha256", path).items():
            data = read_bytes(folder / Path(f"{name}.parquet").name, MOST_BYTES, "a table")
            if hashlib.sha256(data).hexdigest() != digest:
                return None
            tables[name] = pl.read_parquet(io.BytesIO(data))
        return tables
    except (InputError, pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None


def keep(folder: Path, fingerprint: str, tables: Tables) -> None:
    """Keep the tables, in place of what was there.

    Raises:
        InputError, RunError: they cannot be written.
    """
    with whole_folder(folder, replace=True, marker=MARKER) as part:
        for name, table in tables.items():
            table.write_parquet(part / f"{name}.parquet")
        digests = {
            name: hashlib.sha256((part / f"{name}.parquet").read_bytes()).hexdigest() for name in tables
        }
        about = {"fingerprint": fingerprint, "sha256": digests}
        (part / MARKER).write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
