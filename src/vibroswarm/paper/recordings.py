"""The study's recordings, where they are: three sessions of five robots, and three logs of its authors' simulator."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

from vibroswarm.floors.files import read_tiles
from vibroswarm.floors.floor import Floor
from vibroswarm.lab.readers import read_log
from vibroswarm.lab.recording import Recording, recording_of
from vibroswarm.presets import preset

REAL: Final = tuple(f"CAL_{session}.csv" for session in (1, 2, 3))
AUTHORS: Final = tuple(f"webots_log_{session}.txt" for session in (0, 1, 2))
FLOOR: Final = "world.txt"
SIZE: Final = (5, 5)


def missing(folder: Path | None) -> str | None:
    """Why they cannot be read, or None."""
    if folder is None:
        return (
            "It needs the study's recordings, which are no part of this software: name their folder with "
            "`--recordings` "
            "or in `VIBROSWARM_RUGBOT`."
        )
    gone = [name for name in (*REAL, *AUTHORS, FLOOR) if not (folder / name).is_file()]
    return f"The folder of recordings lacks {', '.join(gone)}." if gone else None


def hash_of(folder: Path) -> str:
    """Of all that is read."""
    found = hashlib.sha256()
    for name in (*REAL, *AUTHORS, FLOOR):
        found.update((folder / name).read_bytes())
    return found.hexdigest()


def recorded(folder: Path, names: tuple[str, ...]) -> Recording:
    """The logs of these names as one recording, a session each."""
    floor = Floor.filling(read_tiles(folder / FLOOR, SIZE), name=FLOOR)
    return recording_of([read_log(folder / name) for name in names], floor, preset("paper"))
