"""Read the study's recordings of real robots.

The recordings are three sessions of five robots on one floor (``world.txt``); three logs of the authors' simulator
belong to them.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from vibroswarm.floors import read_tiles
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.scenario.scenario import preset

REAL_FLOOR: Final = "real-floor"
"""Name of the floor of the recordings in scenarios."""
ROWS: Final = ("01010", "10010", "10101", "01101", "10010")
"""Rows from the top; 12 of the 25 tiles vibrate."""


def real_floor() -> dict[str, Any]:
    """Return the fields, by dotted name, that put a scenario on the floor of the recordings."""
    return {"floor.source": REAL_FLOOR, "floor.tiles": ROWS}


REAL: Final = tuple(f"CAL_{session}.csv" for session in (1, 2, 3))
"""Files of the recordings."""
AUTHORS: Final = tuple(f"webots_log_{session}.txt" for session in (0, 1, 2))
"""Logs of the authors' simulator."""
FLOOR: Final = "world.txt"
"""File with the tiles of the floor."""
SIZE: Final = (5, 5)
"""Rows and columns of tiles in that file."""


def missing(folder: Path | None) -> str | None:
    """Return why the recordings in a folder cannot be read, as a sentence for the report; None if they can be read.

    Args:
        folder: folder of the recordings; None: the user named none.
    """
    if folder is None:
        return (
            "It needs the study's recordings, which are not part of this software: name their folder with "
            "`--recordings` "
            "or in `VIBROSWARM_RUGBOT`."
        )
    gone = [name for name in (*REAL, *AUTHORS, FLOOR) if not (folder / name).is_file()]
    return f"The folder of recordings lacks {', '.join(gone)}." if gone else None


def hash_of(folder: Path) -> str:
    """Return the SHA-256 of the contents of all files that are read in a folder: recordings, logs and floor.

    All these files must exist, see ``missing``.
    """
    digest = hashlib.sha256()
    for name in (*REAL, *AUTHORS, FLOOR):
        digest.update((folder / name).read_bytes())
    return digest.hexdigest()


def read_recordings(folder: Path, names: tuple[str, ...]) -> Recording:
    """Read the logs with these file names as one recording, in which each log is a session (run).

    The files must exist, see ``missing``. Fields of the recording's scenario that neither the logs nor the floor
    determine have the values of preset ``paper``.
    """
    return _recording(folder, names, hash_of(folder))


@lru_cache(maxsize=2)  # the real robots and the authors' simulator, which two items compare
def _recording(folder: Path, names: tuple[str, ...], contents: str) -> Recording:
    """Read a recording; ``contents`` is the hash of the files (``hash_of``), so that changed ones are read again."""
    floor = Floor.filling(read_tiles(folder / FLOOR, SIZE), name=FLOOR)
    return recording_of([read_log(folder / name) for name in names], floor, preset("paper"))
