"""Save the tables of an item in a folder with a fingerprint of everything they depend on."""

from __future__ import annotations

import hashlib
import io
import json
from functools import cache
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.untrusted_files import entry, read_bytes, read_json, texts
from vibroswarm.errors import InputError
from vibroswarm.paper.item import Cells, Item, Settings, Tables
from vibroswarm.simulation import versions


@cache
def code_hash() -> str:
    """Hash of the sources and data files that items compute with."""
    found = hashlib.sha256()
    top = Path(__file__).parent.parent
    for room in ("analysis", "calibrate", "recordings", "optimize", "paper", "study"):
        for path in sorted((top / room).rglob("*")):
            if path.suffix in (".py", ".json", ".toml"):
                found.update(path.relative_to(top).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


def fingerprint(item: Item, settings: Settings, cells: Cells) -> str:
    """16 hexadecimal digits that change with everything the item's tables depend on."""
    data = {
        "item": item.name,
        "cells": sorted({cell.key for cell in cells.values()}),
        "runs": settings.runs,
        "seed": settings.seed,
        "columns": settings.columns,
        "control": settings.control,
        "also": item.also(settings),
        "versions": versions(),
        "room": code_hash(),
    }
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


MARKER: Final = "item.json"
MOST_BYTES: Final = 2**30


def load_tables(folder: Path, fingerprint: str) -> Tables | None:
    """Tables saved in a folder; None if missing, damaged, or of another fingerprint."""
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


def save_tables(folder: Path, fingerprint: str, tables: Tables) -> None:
    """Save the tables, replacing earlier ones.

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
