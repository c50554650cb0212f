"""The study's real robots: their floor (``world.txt``) and where their recordings are.

There are three sessions of five robots, and three logs of the authors' simulator.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Final

from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import read_tiles
from vibroswarm.recordings.readers import read_log
from vibroswarm.recordings.recording import Recording, recording_of
from vibroswarm.scenario.scenario import preset

REAL_FLOOR: Final = "real-floor"
ROWS: Final = ("01010", "10010", "10101", "01101", "10010")
"""Rows from the top; 12 of the 25 tiles vibrate."""


def real_floor() -> dict[str, Any]:
    """Fields that put a scenario on that floor."""
    return {"floor.source": REAL_FLOOR, "floor.tiles": ROWS}


REAL: Final = tuple(f"CAL_{session}.csv" for session in (1, 2, 3))
AUTHORS: Final = tuple(f"webots_log_{session}.txt" for session in (0, 1, 2))
FLOOR: Final = "world.txt"
SIZE: Final = (5, 5)


def missing(folder: Path | None) -> str | None:
    """Why the recordings cannot be read, or None."""
    if folder is None:
        return (
            "It needs the study's recordings, which are not part of this software: name their folder with "
            "`--recordings` "
            "or in `VIBROSWARM_RUGBOT`."
        )
    gone = [name for name in (*REAL, *AUTHORS, FLOOR) if not (folder / name).is_file()]
    return f"The folder of recordings lacks {', '.join(gone)}." if gone else None


def hash_of(folder: Path) -> str:
    """SHA-256 of all files that are read."""
    found = hashlib.sha256()
    for name in (*REAL, *AUTHORS, FLOOR):
        found.update((folder / name).read_bytes())
    return found.hexdigest()


def read_recordings(folder: Path, names: tuple[str, ...]) -> Recording:
    """Read these logs as one recording, a session each."""
    floor = Floor.filling(read_tiles(folder / FLOOR, SIZE), name=FLOOR)
    return recording_of([read_log(folder / name) for name in names], floor, preset("paper"))
