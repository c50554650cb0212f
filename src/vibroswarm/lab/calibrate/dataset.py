"""Gather what a fit uses: samples and drives of several sessions, with distances from the nearest edge.

An edge is a border between a vibrating and a still tile. Each run of each recording (or simulation) is one session.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError, check_kind
from vibroswarm.floors.floor import Floor, refuse_changes
from vibroswarm.lab.calibrate.camera import RIGHT, Camera, corrected
from vibroswarm.lab.calibrate.drive import drive_table
from vibroswarm.lab.calibrate.samples import nearest_tile, sample_table
from vibroswarm.lab.recordings.recording import Recording
from vibroswarm.lab.recordings.threshold import edge_distance
from vibroswarm.result import Result
from vibroswarm.statistics.sampling import packet_loss


@dataclass(frozen=True)
class Dataset:
    """Sessions, numbered consecutively over all recordings (column ``run``)."""

    samples: pl.DataFrame
    """One row per sample, ordered by run, robot and time: the columns of ``samples.sample_table``; edge_m, the signed
    distance from the nearest tile of the other kind, negative on a vibrating tile; tile and other, the numbers of the
    tile below and of that nearest tile."""
    drives: pl.DataFrame
    """One row per undisturbed drive between two samples, with its speed and veer (columns ``drive.DRIVES``)."""
    exchange: pl.DataFrame
    """One row per session: messages addressed and received, share lost (``statistics.sampling.packet_loss``)."""
    floors: tuple[Floor, ...]
    """The floor of each session by its number, also of sessions that ``only`` removed."""
    arena_m: tuple[float, float]
    """Width and height of the arena."""
    results: tuple[Result, ...]
    """The recordings or simulations from which the dataset was made; also those of sessions that ``only`` removed."""

    @property
    def sessions(self) -> list[int]:
        """Numbers of the sessions, ascending."""
        return [int(run) for run in self.samples["run"].unique().sort()]

    @property
    def ground_numbers(self) -> Ints:
        """A number for the tiles below each session, (sessions,); it is the same where sessions have the same tiles.

        Recordings on equal floors have. Each run of a simulation has tiles of its own, whose factors it draws, unless
        its floor is that of the study.
        """
        own = [
            not isinstance(result, Recording) and result.scenario.floor.redraw == "run"
            for result in self.results
            for _ in range(result.runs.height)
        ]
        grounds = [
            (floor, k if is_own else None)
            for k, (floor, is_own) in enumerate(zip(self.floors, own, strict=True))
        ]
        number = {ground: k for k, ground in enumerate(dict.fromkeys(grounds))}
        return np.array([number[ground] for ground in grounds])

    @property
    def by_session(self) -> list[pl.DataFrame]:
        """The samples of each session, in the order of ``sessions``."""
        return self.samples.partition_by("run", maintain_order=True)

    def corrected(self, camera: Camera) -> Dataset:
        """Return the same sessions with the true positions of recordings that a camera made; simulations do not change.

        All tables are recomputed, because distances, drives and edges depend on the positions.
        """
        if camera == RIGHT:
            return self
        return dataset_of([corrected(result, camera) for result in self.results]).only(self.sessions)

    def held_out(self) -> Iterator[tuple[int, Dataset]]:
        """Yield the number of each session, and the other sessions."""
        for session in self.sessions:
            yield session, self.only([other for other in self.sessions if other != session])

    def only(self, sessions: Sequence[int]) -> Dataset:
        """Return a dataset whose tables have only the rows of these sessions, which keep their numbers."""
        chosen = pl.col("run").is_in(list(sessions))
        tables = ("samples", "drives", "exchange")
        return replace(self, **{name: getattr(self, name).filter(chosen) for name in tables})


def dataset_of(results: Sequence[Result]) -> Dataset:
    """Gather recordings, or simulations with energies, into one dataset; each run is a session.

    The drives of a simulation without poses have no veer, and their speeds are measured from sample to sample.
    Sessions are numbered from 0, in the order of the results and, within a result, of its runs.

    Raises:
        InputError: no results, no energies, floors that change, or arenas of different sizes.
    """
    if not results:
        raise InputError("nothing to fit; give at least one recording", field="REAL")
    for one in results:
        check_kind(one, Result, "results", "a Result or a Recording")
    sizes = {result.scenario.arena.size_m for result in results}
    if len(sizes) > 1:
        raise InputError("the recordings have arenas of different sizes; fit them separately", field="REAL")
    floors: list[Floor] = []
    tables: dict[str, list[pl.DataFrame]] = {"samples": [], "drives": [], "exchange": []}
    for result in results:
        runs = result.runs["run"].to_list()
        session_of = {int(run): len(floors) + k for k, run in enumerate(runs)}
        numbered = pl.col("run").replace_strict(session_of, return_dtype=pl.UInt32)
        table = sample_table(result)
        parts = [_with_edges(table.filter(run=run), result.floor(run)) for run in runs]
        frames = (pl.concat(parts), drive_table(result, table), packet_loss(result))
        for name, frame in zip(tables, frames, strict=True):
            tables[name].append(frame.with_columns(numbered))
        floors += [result.floor(run) for run in runs]
    for floor in floors:
        refuse_changes(floor)
    return Dataset(
        **{name: pl.concat(frames) for name, frames in tables.items()},
        floors=tuple(floors),
        arena_m=next(iter(sizes)),
        results=tuple(results),
    )


def _with_edges(samples: pl.DataFrame, floor: Floor) -> pl.DataFrame:
    columns = signed_edge_distance(floor, samples["x_m"].to_numpy(), samples["y_m"].to_numpy())
    return samples.with_columns(map(pl.Series, ("edge_m", "tile", "other"), columns))


def signed_edge_distance(floor: Floor, x_m: Floats, y_m: Floats) -> tuple[Floats, Ints, Ints]:
    """Find the nearest tile of the other kind for each place: its signed distance, the tile below, and that tile.

    The index of a tile is row x columns + column, from the top left tile.

    Args:
        x_m, y_m: the places, (places,) each.
    Returns:
        Distance from the nearest tile of the other kind, m, negative where the tile below vibrates, infinite if there
        is none; index of the tile below (beyond the floor's rim, of the nearest tile); index of the nearest tile of
        the other kind, -1 if there is none; (places,) each.
    """
    row, column = nearest_tile(floor, x_m, y_m)
    vibrating = floor.tiles[row, column] == 1
    distance, other = edge_distance(floor, x_m, y_m, vibrating)
    return np.where(vibrating, -distance, distance), row * floor.tiles.shape[1] + column, other
