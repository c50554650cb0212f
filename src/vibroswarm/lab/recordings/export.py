"""Write results as plain CSV tables."""

from __future__ import annotations

from pathlib import Path

from vibroswarm.core.atomic_io import check_free, make_folder, whole_file
from vibroswarm.core.tables import csv_bytes
from vibroswarm.result import TABLES, Result


def write_csv(result: Result, folder: str | Path, *, replace: bool = False) -> None:
    """Write every table of a result, with all runs, as a CSV file in a folder.

    The tables are those of ``result.TABLES``, so the additional tables of a recording are not written.

    Args:
        replace: whether existing files may be replaced.
    Raises:
        InputError: ``folder`` is a file or cannot be created, or no file in it; or one of the files exists and
            ``replace`` is false (in this case no file is written).
        RunError: the disk is full or failed.
    """
    folder = Path(folder)
    make_folder(folder)
    frames = {f"{name}.csv": getattr(result, name) for name in TABLES if getattr(result, name) is not None}
    if not replace:
        for name in frames:
            check_free(folder / name)  # all of them before the first is written
    for name, frame in frames.items():
        with whole_file(folder / name, replace=replace) as part:
            part.write_bytes(csv_bytes(frame))  # no table of a result has nested values
