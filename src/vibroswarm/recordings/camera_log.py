"""The log of a tracked session as CSV: written by ``lab track``, read by ``lab import``, one session a file."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.tables import csv_bytes
from vibroswarm.errors import InputError
from vibroswarm.recordings.column_map import ColumnMap, column_map, read_mapped
from vibroswarm.recordings.log import SAMPLES, Log

NAME: Final = "log.csv"
COLUMNS: Final = tuple(name for name in SAMPLES if name != "line")


@cache
def camera_map() -> ColumnMap:
    """Return the column map of such a file."""
    text = files("vibroswarm.recordings").joinpath("formats/camera.toml").read_text(encoding="utf-8")
    return column_map(text, "camera")


def camera_log_bytes(log: Log) -> bytes:
    """Return a log as CSV in the order of time: rows with an energy are samples, the others positions.

    Times and places are rounded to a microsecond and a micrometre.
    """
    tracks = log.tracks.with_columns(
        pl.lit(None, dtype=kind).alias(name)
        for name, kind in SAMPLES.items()
        if name not in log.tracks.columns
    )
    rows = pl.concat([tracks.select(COLUMNS), log.samples.select(COLUMNS)])
    # A sample whose position was seen at the same moment comes after it.
    rows = rows.sort("time_s", "robot", maintain_order=True)
    return csv_bytes(rows.with_columns(pl.col("time_s", "x_m", "y_m", "heading_rad").round(6)))


def looks_like_camera(head: str) -> bool:
    """Return whether a text begins with the columns of such a file."""
    return head.split("\n", 1)[0].strip() == ",".join(COLUMNS)


def log_file(path: Path) -> Path:
    """Return the log that a path stands for: itself, or that of a folder of ``lab track``.

    Raises:
        InputError: a folder without one.
    """
    if not path.is_dir():
        return path
    if not (path / NAME).is_file():
        raise InputError(
            f"is a folder without {NAME}; give a log, or a folder that 'lab track' wrote with --log",
            field=str(path),
        )
    return path / NAME


def named_by_folder(log: Log, given: Path, file: Path) -> Log:
    """Return a log under its folder's name, if a folder was given: all such files have the same name."""
    return log if given == file else replace(log, name=given.resolve().name)


def read_camera_log(path: Path) -> Log:
    """Read such a file.

    Raises:
        InputError: as of ``read_mapped``.
    """
    return read_mapped(path, camera_map())
