"""Gather what a fit uses: samples and drives of several sessions, with distances from the nearest edge.

An edge is a border between a vibrating and a still tile. Each run of each recording (or simulation) is one session.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import polars as pl

from vibroswarm.calibrate.camera import RIGHT, Camera, corrected, moved
from vibroswarm.calibrate.drive import drive_table
from vibroswarm.calibrate.features import nearest_tile, sample_table
from vibroswarm.calibrate.wall_approach import approach_tables
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError, check_kind
from vibroswarm.floors.floor import Floor, refuse_changes
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import edge_distance
from vibroswarm.result import Result
from vibroswarm.statistics.sampling import packet_loss


@dataclass(frozen=True)
class Dataset:
    """Sessions, numbered consecutively over all recordings (column ``run``)."""

    samples: pl.DataFrame
    """One row per sample, ordered by run, robot and time: the columns of ``features.sample_table``; edge_m, the signed
    distance from the nearest tile of the other kind, negative on a vibrating tile; tile and other, the numbers of the
    tile below and of that nearest tile."""
    drives: pl.DataFrame
    """One row per undisturbed drive between two samples, with its speed and veer (columns ``drive.DRIVES``)."""
    exchange: pl.DataFrame
    """One row per session: messages addressed and received, share lost (``statistics.sampling.packet_loss``)."""
    floors: tuple[Floor, ...]
    """The floor of each session, at the index that is the session's number; also floors of sessions that ``only``
    removed."""
    arena_m: tuple[float, float]
    """Width and height of the arena."""
    results: tuple[Result, ...]
    """The recordings or simulations from which the dataset was made; also those of sessions that ``only`` removed."""
    at_walls: Callable[[], tuple[pl.DataFrame, pl.DataFrame]]
    """Returns ``approaches`` and ``turns`` of all sessions, also of those that ``only`` removed. The first call
    computes them: only the fit of rays needs them, and they take longer than all the rest."""

    @property
    def approaches(self) -> pl.DataFrame:
        """One row per turn away from a wall (columns ``wall_approach.APPROACHES``)."""
        return self.at_walls()[0].filter(pl.col("run").is_in(self.sessions))

    @property
    def turns(self) -> pl.DataFrame:
        """One row per turn at the end of a leg (columns ``wall_approach.TURNS``)."""
        return self.at_walls()[1].filter(pl.col("run").is_in(self.sessions))

    @property
    def sessions(self) -> list[int]:
        """Numbers of the sessions, ascending."""
        return [int(run) for run in self.samples["run"].unique().sort()]

    @property
    def grounds(self) -> list[tuple[Floor, int | None]]:
        """The tiles below each session, in the order of ``floors``; equal where sessions have the same tiles.

        Recordings on equal floors have. Each run of a simulation has tiles of its own, whose factors it draws, unless
        its floor is that of the study.
        """
        grounds: list[tuple[Floor, int | None]] = []
        for result in self.results:
            own = not isinstance(result, Recording) and result.scenario.floor.redraw == "run"
            for _ in range(result.runs.height):
                session = len(grounds)
                grounds.append((self.floors[session], session if own else None))
        return grounds

    @property
    def ground_numbers(self) -> Ints:
        """The number of the ground of each session, from 0: the same where ``grounds`` are equal, (sessions,)."""
        grounds = self.grounds
        number = {ground: k for k, ground in enumerate(dict.fromkeys(grounds))}
        return np.array([number[ground] for ground in grounds])

    @property
    def by_session(self) -> list[pl.DataFrame]:
        """The samples of each session, in the order of ``sessions``."""
        return [self.samples.filter(pl.col("run") == run) for run in self.sessions]

    def corrected(self, camera: Camera) -> Dataset:
        """Return the same sessions with the true positions of recordings that a camera made; simulations do not change.

        All tables are recomputed, because distances, drives and edges depend on the positions.
        """
        if camera == RIGHT:
            return self
        # ``results`` still has the sessions that ``only`` removed, so they are removed again.
        return dataset_of([corrected(result, camera) for result in self.results]).only(self.sessions)

    def held_out(self) -> Iterator[tuple[int, Dataset]]:
        """Yield the number of each session, and the other sessions."""
        for session in self.sessions:
            yield session, self.only([other for other in self.sessions if other != session])

    def seen_by(self, camera: Camera) -> pl.DataFrame:
        """Return ``samples`` as a camera would see them: all columns that depend on the position are recomputed.

        The camera sees a sample at another place, so the tile below it may be another tile, and ``vibrating`` may
        change. Rows are grouped by session; within a session they keep the order of ``samples``.
        """
        parts = []
        for own in moved(self.samples, camera.seen, self.arena_m).partition_by("run", maintain_order=True):
            floor = self.floors[own["run"][0]]
            relocated = _with_edges(own, floor)
            vibrating = floor.tiles.ravel()[relocated["tile"].to_numpy()] == 1
            parts.append(relocated.with_columns(vibrating=pl.Series(vibrating)))
        # Columns dx_m and dy_m: the step from the robot's previous sample, between the places that the camera sees.
        steps = {f"d{name}": pl.col(name).diff().over("run", "robot") for name in ("x_m", "y_m")}
        return (
            pl.concat(parts)
            .with_columns(**steps)
            .with_columns(distance_m=(pl.col("dx_m") ** 2 + pl.col("dy_m") ** 2).sqrt())
        )

    def only(self, sessions: Sequence[int]) -> Dataset:
        """Return a dataset whose tables have only the rows of these sessions.

        Sessions keep their numbers. ``floors`` keeps all its entries because it is indexed by session number.
        ``results`` keeps all its entries because ``corrected`` makes the dataset again from them, and this numbers the
        sessions in the order of the results: without some of the results, the other sessions would get other numbers.
        """
        chosen = pl.col("run").is_in(list(sessions))
        tables = ("samples", "drives", "exchange")
        return replace(self, **{name: getattr(self, name).filter(chosen) for name in tables})


def dataset_of(results: Sequence[Result]) -> Dataset:
    """Gather recordings, or simulations with energies, into one dataset; each run is a session.

    A simulation without poses has no paths, so it has no rows in ``approaches`` and ``turns``; the speeds of its
    drives are measured from sample to sample, and their veers are null.

    Sessions are numbered from 0, in the order of the results and, within a result, of its runs. ``REAL`` in the
    messages of errors is the command-line argument that names the recordings.

    Raises:
        InputError: no results, no energies, or arenas of different sizes.
    """
    check_kind(results, (list, tuple), "results", "a list of results or recordings")
    for one in results:
        check_kind(one, Result, "results", "a Result or a Recording")
    if not results:
        raise InputError("nothing to fit; give at least one recording", field="REAL")
    floors: list[Floor] = []
    tables: list[dict[str, pl.DataFrame]] = []
    # Each result with its samples and the expression that numbers its sessions, for ``at_walls``.
    parts_of: list[tuple[Result, pl.DataFrame, pl.Expr]] = []
    sizes = {result.scenario.arena.size_m for result in results}
    if len(sizes) > 1:
        raise InputError("the recordings have arenas of different sizes; fit them separately", field="REAL")
    for result in results:
        runs = result.runs["run"].to_list()
        # ``floors`` has one entry for each session of the earlier results, so its length is the next free number.
        session_of = {int(run): len(floors) + k for k, run in enumerate(runs)}
        table = sample_table(result)
        parts = [_with_edges(table.filter(pl.col("run") == run), result.floor(run)) for run in runs]
        frames = {
            "samples": pl.concat(parts),
            "drives": drive_table(result),
            "exchange": packet_loss(result),
        }
        numbered = pl.col("run").replace_strict(session_of, return_dtype=pl.UInt32)
        parts_of.append((result, table, numbered))
        tables.append({name: frame.with_columns(numbered) for name, frame in frames.items()})
        floors += [result.floor(run) for run in runs]
    for floor in floors:
        refuse_changes(floor)

    @cache
    def at_walls() -> tuple[pl.DataFrame, pl.DataFrame]:
        """Return the tables of ``Dataset.at_walls``."""
        approaches, turns = zip(
            *(
                [frame.with_columns(numbered) for frame in approach_tables(result, table)]
                for result, table, numbered in parts_of
            ),
            strict=True,
        )
        return pl.concat(approaches), pl.concat(turns)

    return Dataset(
        **{name: pl.concat([of_result[name] for of_result in tables]) for name in tables[0]},
        floors=tuple(floors),
        arena_m=next(iter(sizes)),
        results=tuple(results),
        at_walls=at_walls,
    )


def _with_edges(samples: pl.DataFrame, floor: Floor) -> pl.DataFrame:
    """Add ``edge_m``, ``tile`` and ``other`` to the samples of one session, see ``signed_edge_distance``."""
    columns = signed_edge_distance(floor, samples["x_m"].to_numpy(), samples["y_m"].to_numpy())
    return samples.with_columns(map(pl.Series, ("edge_m", "tile", "other"), columns))


def signed_edge_distance(floor: Floor, x_m: Floats, y_m: Floats) -> tuple[Floats, Ints, Ints]:
    """Find the nearest tile of the other kind for each place: its signed distance, the tile below, and that tile.

    The other kind is still tiles for a place on a vibrating tile, and vibrating tiles for a place on a still one. The
    index of a tile is row x columns + column, from the top left tile.

    Args:
        x_m, y_m: the places, (places,) each.
    Returns:
        A tuple of three arrays, (places,) each:

        1. Distance from the nearest tile of the other kind, m; negative where the tile below vibrates. It is infinite,
           with the same sign, if there is no tile of the other kind.
        2. Index of the tile below. A place beyond the floor's rim counts as on the nearest tile, as for the authors of
           the recordings.
        3. Index of the nearest tile of the other kind; -1 if there is none.
    """
    row, column = nearest_tile(floor, x_m, y_m)
    vibrating = floor.tiles[row, column] == 1
    distance, other = edge_distance(floor, x_m, y_m, vibrating)
    return np.where(vibrating, -distance, distance), row * floor.tiles.shape[1] + column, other
