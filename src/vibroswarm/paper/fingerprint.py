"""What an item's tables depend on, so that kept ones are taken only where nothing has changed."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path

from vibroswarm.paper.item import Cells, Item, Settings
from vibroswarm.simulation import versions


@cache
def room_hash() -> str:
    """Of the sources and numbers of this room and of those that it computes with."""
    found = hashlib.sha256()
    top = Path(__file__).parent.parent
    for room in ("analysis", "calibrate", "lab", "optimize", "paper", "study"):
        for path in sorted((top / room).rglob("*")):
            if path.suffix in (".py", ".json", ".toml"):
                found.update(path.relative_to(top).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


def fingerprint(item: Item, settings: Settings, cells: Cells) -> str:
    """16 hexadecimal digits that change with whatever changes the item's tables."""
    data = {
        "item": item.name,
        "cells": sorted({cell.key for cell in cells.values()}),
        "runs": settings.runs,
        "seed": settings.seed,
        "columns": settings.columns,
        "control": settings.control,
        "also": item.also(settings),
        "versions": versions(),
        "room": room_hash(),
    }
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]
