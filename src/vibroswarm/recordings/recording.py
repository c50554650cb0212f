"""Sessions of real robots as a ``Recording``, a ``Result`` with additional tables.

It differs from a simulated result:

* ``seed`` is None. Values that a log does not contain are null, such as headings, driving and turning times.
* ``scenario`` describes the sessions: fields in ``stated`` by the user or a log, fields in ``inferred`` by the logs.
  All other fields are those of a preset and have no meaning here.
* ``sample`` is the number of messages sent before, so a lost row leaves a gap.
* Bits that a log does not have are computed from the energies with ``sensor.rms_threshold``.
* Paths between tracked positions are straight (``assemble_recording``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Final

import polars as pl

from vibroswarm.core.atomic_io import make_folder, whole_file
from vibroswarm.core.folders import kind_of, read_manifest
from vibroswarm.core.tables import csv_bytes, parquet_bytes, read_frame
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.result import TABLES, Result

ROWS: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "sample": pl.UInt32,
    "line": pl.UInt32,
    "energy": pl.Float64,
    "lost_before": pl.UInt32,
    "position_age_s": pl.Float64,
    "avoid_total_s": pl.Float64,
    "stop_total_s": pl.Float64,
}
"""One row per sample: the line of the log, the energy with all digits, the number of lost samples just before it, the
time from the last tracked position to the sample (null if a log has no tracks), and the counters. The energy is null
in a log of bits."""


PLACES: Final[dict[str, Any]] = {
    "run": pl.UInt32,
    "robot": pl.UInt16,
    "time_s": pl.Float64,
    "x_m": pl.Float64,
    "y_m": pl.Float64,
}
"""One row per tracked position."""


_EXTRA_TABLES: Final = ("rows", "tracks")
"""Additional tables of a recording."""


@dataclass(frozen=True, eq=False, repr=False)  # both are those of a result
class Recording(Result):
    """Sessions of real robots as a result; see the module."""

    KIND: ClassVar[str] = "recording"
    rows: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=ROWS))
    tracks: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=PLACES))
    names: tuple[int, ...] = ()
    """For robots 0, 1, ... their numbers in the logs."""
    sessions: tuple[Mapping[str, Any], ...] = ()
    """For each run: name of the log, its reader, numbers of robots by name, and (``told``) what was counted."""
    stated: tuple[str, ...] = ()
    """Fields of the scenario stated by the user or by a log."""
    inferred: tuple[Mapping[str, Any], ...] = ()
    """``infer.Inferred`` as plain values."""
    floor_words: str = ""

    @property
    def logs_beliefs(self) -> bool:
        """Whether the logs hold all beliefs, counts and decisions of all robots."""
        return bool(self.inference.drop("message").null_count().sum_horizontal()[0] == 0)

    def knows(self, *names: str) -> bool:
        """Return whether user or logs stated these fields of the scenario, or the logs show them."""
        shown = {one["name"] for one in self.inferred if one["value"] is not None}
        return shown.union(self.stated).issuperset(names)

    @property
    def floor_by_run(self) -> dict[int, Floor]:
        """The floor of each session, by its number."""
        return {run: self.floor(run) for run in self.runs["run"].to_list()}

    def is_tracked(self, run: int) -> bool:
        """Return whether a camera saw the robots of a session."""
        return not self.tracks.filter(pl.col("run") == run).is_empty()

    @property
    def places_corrected(self) -> bool:
        """Whether all sessions are from ``lab track``, which corrects positions for lens and marker height."""
        return bool(self.sessions) and all(session["reader"] == "camera" for session in self.sessions)

    def _contents(self) -> Iterator[tuple[str, bytes]]:
        """Yield the files of a result, ``rows.parquet`` and ``tracks.parquet``."""
        yield from super()._contents()
        for name in _EXTRA_TABLES:
            yield f"{name}.parquet", parquet_bytes(getattr(self, name))

    def _about(self) -> dict[str, Any]:
        """Return what the manifest of a recording says, besides that of a result."""
        return super()._about() | {
            "names": list(self.names),
            "sessions": [dict(item) for item in self.sessions],
            "stated": list(self.stated),
            "inferred": [dict(item) for item in self.inferred],
            "floor": self.floor_words,
        }

    @classmethod
    def read(cls, path: str | Path) -> Recording:
        """Read a recording from the folder that ``write`` has written."""
        folder = Path(path)
        if kind_of(folder) != cls.KIND:
            raise InputError("is not a recording; make one with 'vibroswarm lab import'", field=str(folder))
        result = Result._read(folder)
        about = read_manifest(folder)
        values: dict[str, Any] = {one.name: getattr(result, one.name) for one in fields(Result)}
        for name in _EXTRA_TABLES:
            values[name] = read_frame(folder / f"{name}.parquet", name)
        for key in ("names", "sessions", "stated", "inferred"):
            values[key] = tuple(about[key])
        return cls(**values, floor_words=about["floor"])


def read_result(folder: str | Path) -> Result:
    """Read a ``Result`` or a ``Recording`` from its folder."""
    folder = Path(folder)
    return Recording.read(folder) if kind_of(folder) == Recording.KIND else Result.read(folder)


def write_csv(result: Result, folder: str | Path, *, replace: bool = False) -> None:
    """Write every table of ``result.TABLES``, with all runs, as a CSV file in a folder."""
    folder = Path(folder)
    make_folder(folder)
    frames = {f"{name}.csv": getattr(result, name) for name in TABLES if getattr(result, name) is not None}
    for name, frame in frames.items():
        with whole_file(folder / name, replace=replace) as part:
            part.write_bytes(csv_bytes(frame))  # no table of a result has nested values
