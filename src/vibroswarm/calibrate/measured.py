"""What a fit looks at: samples and drives of several sessions in one place, and how far from an edge samples lay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.correlation import packet_loss
from vibroswarm.calibrate.approach import approach_tables
from vibroswarm.calibrate.camera import RIGHT, Camera, corrected
from vibroswarm.calibrate.drive import drive_table
from vibroswarm.calibrate.features import sample_table
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.result import Result

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Measured:
    """Sessions, numbered through over all recordings (column ``run``)."""

    samples: pl.DataFrame
    """``features.sample_table``, with edge_m (``edge_distance``), tile and other (``edge_distance``)."""
    drives: pl.DataFrame
    """``drive.DRIVES``."""
    approaches: pl.DataFrame
    """``approach.APPROACHES``."""
    turns: pl.DataFrame
    """``approach.TURNS``."""
    exchange: pl.DataFrame
    """``correlation.packet_loss``."""
    floors: tuple[Floor, ...]
    arena_m: tuple[float, float]
    results: tuple[Result, ...]
    """Whence."""

    @property
    def sessions(self) -> list[int]:
        """Their numbers."""
        return [int(run) for run in self.samples["run"].unique().sort()]

    def corrected(self, camera: Camera) -> Measured:
        """The same with the robots of recordings where they were."""
        if camera == RIGHT:
            return self
        return measured([corrected(one, camera) for one in self.results]).only(self.sessions)

    def seen_by(self, camera: Camera) -> pl.DataFrame:
        """``samples`` where a camera would have seen them, with all that follows from the place."""
        x, y = camera.seen(self.samples["x_m"].to_numpy(), self.samples["y_m"].to_numpy(), self.arena_m)
        moved = self.samples.with_columns(x_m=pl.Series(x), y_m=pl.Series(y))
        parts = []
        for (run,), own in moved.group_by("run", maintain_order=True):
            floor = self.floors[int(run)]
            distance, tile, other = edge_distance(floor, own["x_m"].to_numpy(), own["y_m"].to_numpy())
            parts.append(
                own.with_columns(
                    edge_m=pl.Series(distance),
                    tile=pl.Series(tile),
                    other=pl.Series(other),
                    vibrating=pl.Series(floor.tiles.ravel()[tile] == 1),
                )
            )
        steps = {f"d{name}": pl.col(name).diff().over("run", "robot") for name in ("x_m", "y_m")}
        return (
            pl.concat(parts)
            .with_columns(**steps)
            .with_columns(distance_m=(pl.col("dx_m") ** 2 + pl.col("dy_m") ** 2).sqrt())
        )

    def only(self, sessions: Sequence[int]) -> Measured:
        """These sessions alone; they keep their numbers."""
        chosen = pl.col("run").is_in(list(sessions))
        return replace(
            self,
            samples=self.samples.filter(chosen),
            drives=self.drives.filter(chosen),
            approaches=self.approaches.filter(chosen),
            turns=self.turns.filter(chosen),
            exchange=self.exchange.filter(chosen),
        )


def measured(results: Sequence[Result]) -> Measured:
    """Gather results (recordings, or simulations with energies and segments); each run is a session.

    Raises:
        InputError: none, no energies, or arenas that differ.
    """
    if not results:
        raise InputError("there is nothing to fit; give at least one recording", field="REAL")
    samples, drives, exchange, floors = [], [], [], []
    approaches: list[pl.DataFrame] = []
    turns: list[pl.DataFrame] = []
    sizes = {(one.scenario.arena.width_m, one.scenario.arena.height_m) for one in results}
    if len(sizes) > 1:
        raise InputError("the recordings are of arenas of different sizes; fit them apart", field="REAL")
    first = 0
    for one in results:
        runs = one.runs["run"].to_list()
        number = {int(run): first + k for k, run in enumerate(runs)}

        def numbered(frame: pl.DataFrame, number: dict[int, int] = number) -> pl.DataFrame:
            return frame.with_columns(pl.col("run").replace_strict(number, return_dtype=pl.UInt32))

        table = sample_table(one)
        parts = []
        for run in runs:
            own = table.filter(pl.col("run") == run)
            distance, tile, other = edge_distance(
                one.floor(run), own["x_m"].to_numpy(), own["y_m"].to_numpy()
            )
            parts.append(
                own.with_columns(edge_m=pl.Series(distance), tile=pl.Series(tile), other=pl.Series(other))
            )
            floors.append(one.floor(run))
        samples.append(numbered(pl.concat(parts)))
        drives.append(numbered(drive_table(one)))
        for kept, frame in zip((approaches, turns), approach_tables(one, table), strict=True):
            kept.append(numbered(frame))
        exchange.append(numbered(packet_loss(one)))
        first += len(runs)
    return Measured(
        samples=pl.concat(samples),
        drives=pl.concat(drives),
        approaches=pl.concat(approaches),
        turns=pl.concat(turns),
        exchange=pl.concat(exchange),
        floors=tuple(floors),
        arena_m=next(iter(sizes)),
        results=tuple(results),
    )


def edge_distance(
    floor: Floor, x_m: Floats, y_m: Floats
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Distance to the nearest vibrating tile, minus that to the nearest still one where the tile below vibrates, m.

    Returns: it (inf, or -inf, where no tile of the other kind is), the tile below (the nearest one at the rim, as the
        authors count), and the nearest of the other kind (-1: none).
    """
    rows, columns, width, height, left, bottom = floor.geometry
    column = np.clip(np.floor((x_m - left) / width), 0, columns - 1).astype(np.int64)
    row = rows - 1 - np.clip(np.floor((y_m - bottom) / height), 0, rows - 1).astype(np.int64)
    tile = row * columns + column
    kinds = floor.tiles.ravel()
    best, other = np.full(x_m.shape, np.inf), np.full(x_m.shape, -1)
    for index, kind in enumerate(kinds):
        x0, y0 = left + (index % columns) * width, bottom + (rows - 1 - index // columns) * height
        dx = np.maximum(np.maximum(x0 - x_m, x_m - x0 - width), 0.0)
        dy = np.maximum(np.maximum(y0 - y_m, y_m - y0 - height), 0.0)
        nearer = (kinds[tile] != kind) & (np.hypot(dx, dy) < best)
        best[nearer], other[nearer] = np.hypot(dx, dy)[nearer], index
    return np.where(kinds[tile] == 1, -best, best), tile, other
