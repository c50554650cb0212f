"""Gather what a fit uses: samples and drives of several sessions, with distances from the nearest edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.sampling import packet_loss
from vibroswarm.calibrate.camera import RIGHT, Camera, corrected
from vibroswarm.calibrate.drive import drive_table
from vibroswarm.calibrate.features import nearest_tile, sample_table
from vibroswarm.calibrate.wall_approach import approach_tables
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.threshold import edge_distance
from vibroswarm.result import Result

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Dataset(NotebookView):
    """Sessions, numbered consecutively over all recordings (column ``run``)."""

    samples: pl.DataFrame
    """``features.sample_table``, with edge_m, tile and other (``signed_edge_distance``)."""
    drives: pl.DataFrame
    """``drive.DRIVES``."""
    approaches: pl.DataFrame
    """``wall_approach.APPROACHES``."""
    turns: pl.DataFrame
    """``wall_approach.TURNS``."""
    exchange: pl.DataFrame
    """``sampling.packet_loss``."""
    floors: tuple[Floor, ...]
    arena_m: tuple[float, float]
    results: tuple[Result, ...]
    """The results it was made from."""

    @property
    def sessions(self) -> list[int]:
        """Numbers of the sessions."""
        return [int(run) for run in self.samples["run"].unique().sort()]

    @property
    def by_session(self) -> list[pl.DataFrame]:
        """The samples of each session."""
        return [self.samples.filter(pl.col("run") == run) for run in self.sessions]

    def corrected(self, camera: Camera) -> Dataset:
        """Return the same with positions of recordings corrected for a camera."""
        if camera == RIGHT:
            return self
        return dataset_of([corrected(result, camera) for result in self.results]).only(self.sessions)

    def seen_by(self, camera: Camera) -> pl.DataFrame:
        """Return ``samples`` as a camera would see them: all columns that depend on the position are recomputed."""
        x, y = camera.seen(self.samples["x_m"].to_numpy(), self.samples["y_m"].to_numpy(), self.arena_m)
        moved = self.samples.with_columns(x_m=pl.Series(x), y_m=pl.Series(y))
        parts = []
        for own in moved.partition_by("run", maintain_order=True):
            floor = self.floors[own["run"][0]]
            relocated = _with_edges(own, floor)
            parts.append(
                relocated.with_columns(
                    vibrating=pl.Series(floor.tiles.ravel()[relocated["tile"].to_numpy()] == 1)
                )
            )
        steps = {f"d{name}": pl.col(name).diff().over("run", "robot") for name in ("x_m", "y_m")}
        return (
            pl.concat(parts)
            .with_columns(**steps)
            .with_columns(distance_m=(pl.col("dx_m") ** 2 + pl.col("dy_m") ** 2).sqrt())
        )

    def only(self, sessions: Sequence[int]) -> Dataset:
        """Return the data of these sessions only; they keep their numbers."""
        chosen = pl.col("run").is_in(list(sessions))
        tables = ("samples", "drives", "approaches", "turns", "exchange")
        return replace(self, **{name: getattr(self, name).filter(chosen) for name in tables})


def dataset_of(results: Sequence[Result]) -> Dataset:
    """Gather results (recordings, or simulations with energies and segments); each run is a session.

    Raises:
        InputError: no results, no energies, or arenas of different sizes.
    """
    if not results:
        raise InputError("nothing to fit; give at least one recording", field="REAL")
    floors: list[Floor] = []
    tables: list[dict[str, pl.DataFrame]] = []
    sizes = {(result.scenario.arena.width_m, result.scenario.arena.height_m) for result in results}
    if len(sizes) > 1:
        raise InputError("the recordings have arenas of different sizes; fit them separately", field="REAL")
    for result in results:
        runs = result.runs["run"].to_list()
        number = {int(run): len(floors) + k for k, run in enumerate(runs)}
        table = sample_table(result)
        parts = [_with_edges(table.filter(pl.col("run") == run), result.floor(run)) for run in runs]
        approaches, turns = approach_tables(result, table)
        frames = {
            "samples": pl.concat(parts), "drives": drive_table(result), "approaches": approaches, "turns": turns,
            "exchange": packet_loss(result),
        }  # fmt: skip
        numbered = pl.col("run").replace_strict(number, return_dtype=pl.UInt32)
        tables.append({name: frame.with_columns(numbered) for name, frame in frames.items()})
        floors += [result.floor(run) for run in runs]
    return Dataset(
        **{name: pl.concat([table_set[name] for table_set in tables]) for name in tables[0]},
        floors=tuple(floors),
        arena_m=next(iter(sizes)),
        results=tuple(results),
    )


def _with_edges(samples: pl.DataFrame, floor: Floor) -> pl.DataFrame:
    """Add ``edge_m``, ``tile`` and ``other`` to the samples of one session, see ``signed_edge_distance``."""
    columns = signed_edge_distance(floor, samples["x_m"].to_numpy(), samples["y_m"].to_numpy())
    return samples.with_columns(map(pl.Series, ("edge_m", "tile", "other"), columns))


def signed_edge_distance(
    floor: Floor, x_m: Floats, y_m: Floats
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """Return how far each place is from the nearest tile of the other kind, and both tiles; (places,) each.

    Returns: the distance, m, negative where the tile below vibrates (inf or -inf without a tile of the other kind); the
        index of the tile below (beyond the rim of the nearest one, as the authors count); and that of the nearest tile
        of the other kind (-1: none).
    """
    row, column = nearest_tile(floor, x_m, y_m)
    vibrating = floor.tiles[row, column] == 1
    distance, other = edge_distance(floor, x_m, y_m, vibrating)
    return np.where(vibrating, -distance, distance), row * floor.tiles.shape[1] + column, other
