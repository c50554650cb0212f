"""Gather what a fit uses: samples and drives of several sessions, with distances from the nearest edge.

An edge is a border between a vibrating and a still tile. Each run of each recording (or simulation) is one session. An
interval lies between two successive samples of a robot. It is undisturbed if the robot only drove in it, without
avoidance and without a turn on the spot. The drive is its part before the robot stops to sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.samples import ROUNDING_S, nearest_tile, sample_table
from vibroswarm.core.arrays import Floats, Ints
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor, refuse_changes
from vibroswarm.motion.pose import pose
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import edge_distance
from vibroswarm.result import Result
from vibroswarm.statistics.sampling import packet_loss

CALM_S: Final = 0.3
"""An undisturbed interval lasts the median of the intervals without avoidance, within this tolerance: these intervals
usually have no turn either."""
LEAST_M: Final = 0.05
"""Shortest distance between the two samples of an undisturbed interval."""


@dataclass(frozen=True)
class Dataset:
    """Sessions, numbered consecutively over all recordings (column ``run``)."""

    samples: pl.DataFrame
    """One row per sample, ordered by run, robot and time: the columns of ``samples.sample_table``; edge_m, the signed
    distance from the nearest tile of the other kind, negative on a vibrating tile; tile and other, the numbers of the
    tile below and of that nearest tile; ground, the same number in sessions that have the same tiles: recordings on
    equal floors have; runs of a simulation draw their own, unless its floor is that of the study."""
    drives: pl.DataFrame
    """One row per undisturbed drive between two samples, with its speed; time_s is that of the sample at its end."""
    exchange: pl.DataFrame
    """One row per session: messages addressed and received, share lost (``statistics.sampling.packet_loss``)."""
    floors: tuple[Floor, ...]
    """The floor of each session by its number, also of sessions that ``only`` removed."""
    arena_m: tuple[float, float]
    results: tuple[Result, ...]
    """The recordings or simulations from which the dataset was made; also those of sessions that ``only`` removed."""

    @property
    def sessions(self) -> list[int]:
        """Numbers of the sessions, ascending."""
        return [int(run) for run in self.samples["run"].unique().sort()]

    def only(self, sessions: Sequence[int]) -> Dataset:
        """Return a dataset whose tables have only the rows of these sessions, which keep their numbers."""
        chosen = pl.col("run").is_in(list(sessions))
        tables = ("samples", "drives", "exchange")
        return replace(self, **{name: getattr(self, name).filter(chosen) for name in tables})


def dataset_of(results: Sequence[Result]) -> Dataset:
    """Gather recordings, or simulations with energies, into one dataset; each run is a session.

    The speeds of a simulation without poses are measured from sample to sample. Sessions are numbered from 0, in the
    order of the results and, within a result, of its runs.

    Raises:
        InputError: no results, no energies, floors that change, or arenas of different sizes.
    """
    if not results:
        raise InputError("nothing to fit; give at least one recording", field="REAL")
    if len({result.scenario.arena.size_m for result in results}) > 1:
        raise InputError("the recordings have arenas of different sizes; fit them separately", field="REAL")
    floors: list[Floor] = []
    grounds: dict[tuple[Floor, int | None], int] = {}
    tables: dict[str, list[pl.DataFrame]] = {"samples": [], "drives": [], "exchange": []}
    for result in results:
        session_of: dict[int, int] = {}
        draws_tiles = not isinstance(result, Recording) and result.scenario.floor.redraw == "run"
        table, parts = sample_table(result), []
        for run in result.runs["run"].to_list():
            floor, session_of[run] = result.floor(run), len(floors)
            refuse_changes(floor)
            ground = grounds.setdefault((floor, len(floors) if draws_tiles else None), len(grounds))
            own = table.filter(run=run)
            columns = signed_edge_distance(floor, own["x_m"].to_numpy(), own["y_m"].to_numpy())
            edges = map(pl.Series, ("edge_m", "tile", "other"), columns)
            parts.append(own.with_columns(*edges, ground=pl.lit(ground)))
            floors.append(floor)
        numbered = pl.col("run").replace_strict(session_of, return_dtype=pl.UInt32)
        frames = (pl.concat(parts), drive_table(result, table), packet_loss(result))
        for name, frame in zip(tables, frames, strict=True):
            tables[name].append(frame.with_columns(numbered))
    gathered = {name: pl.concat(frames) for name, frames in tables.items()}
    return Dataset(
        **gathered, floors=tuple(floors), arena_m=results[0].scenario.arena.size_m, results=tuple(results)
    )


def signed_edge_distance(floor: Floor, x_m: Floats, y_m: Floats) -> tuple[Floats, Ints, Ints]:
    """Find the nearest tile of the other kind for each place, (places,).

    Returns:
        Distance from the nearest tile of the other kind, m, negative where the tile below vibrates, infinite if there
        is none; index (row x columns + column) of the tile below; index of the nearest tile of the other kind, or -1.
    """
    row, column = nearest_tile(floor, x_m, y_m)
    vibrating = floor.tiles[row, column] == 1
    distance, other = edge_distance(floor, x_m, y_m, vibrating)
    return np.where(vibrating, -distance, distance), row * floor.tiles.shape[1] + column, other


def calm_intervals(samples: pl.DataFrame, least_m: float = -1.0) -> pl.DataFrame:
    """Return the samples before which the robot neither avoided nor turned: the interval is about as long as usual.

    Intervals over distances below ``least_m`` do not count for what is usual.
    """
    unavoided = samples.filter((pl.col("avoid_s") < ROUNDING_S) & (pl.col("distance_m") > least_m))
    return unavoided.filter((pl.col("spacing_s") - pl.col("spacing_s").median()).abs() <= CALM_S)


def drive_table(result: Result, samples: pl.DataFrame) -> pl.DataFrame:
    """Return one row per undisturbed drive, from ``sample_table`` and the paths.

    The speed is that of the tracked steps without the first and the last, in which the robot starts and stops. Without
    a path it is the distance between the samples by the time of the drive.
    """
    rows: list[tuple[int, int, float, float]] = []
    drives = calm_intervals(samples, LEAST_M)
    for (run, robot), own in drives.group_by("run", "robot", maintain_order=True):
        track = track_of(result, int(run), int(robot))
        columns = own.select("time_s", "spacing_s", "stop_start_s", "distance_m")
        for time_s, spacing_s, stop_s, distance_m in columns.iter_rows():
            since_s = time_s - spacing_s
            speed = distance_m / (stop_s - since_s) if track is None else _speed_on(track, since_s, stop_s)
            if speed is not None:
                rows.append((int(run), int(robot), time_s, speed))
    return pl.DataFrame(
        rows,
        orient="row",
        schema={"run": pl.UInt32, "robot": pl.UInt16, "time_s": pl.Float64, "speed_m_s": pl.Float64},
    )


def track_of(result: Result, run: int, robot: int) -> Floats | None:
    """Return a robot's path at the rate of a camera: rows of time (s), x (m) and y (m); None if it is not known.

    That of a simulation is true, at intervals of 0.22 s.
    """
    if isinstance(result, Recording):
        own = result.tracks.filter(run=run, robot=robot)
        return own.select("time_s", "x_m", "y_m").to_numpy() if own.height else None
    if result.poses is None:
        return None
    times = np.arange(0.0, float(result.ends.filter(run=run, robot=robot)["end_s"][0]), 0.22)
    return np.column_stack([times, pose(result.poses, run, robot, times)[:, :2]])


def _speed_on(track: Floats, since_s: float, until_s: float) -> float | None:
    """Return the speed (m/s) of one drive; None if it is too short, or has a stop or a turn."""
    first, last = np.searchsorted(track[:, 0], [since_s, until_s])
    time, x, y = track[first:last].T
    # Seven positions give six steps. Without the first and the last step, a slope has four points.
    if time.size < 7:
        return None
    dx, dy, dt = (np.diff(each)[1:-1] for each in (x, y, time))
    step = np.hypot(dx, dy)
    # A step much shorter than the others means that the robot stood, so this was no undisturbed drive.
    if step.min() < 0.2 * np.median(step) or step.min() <= 0.0:
        return None
    middle_s = ((time[1:] + time[:-1]) / 2)[1:-1]
    middle_s = middle_s - middle_s.mean()
    # The least-squares slope of the course against time, rad/s; a faster change is an undetected turn.
    veer = middle_s @ np.unwrap(np.arctan2(dy, dx)) / (middle_s @ middle_s)
    return float(step.sum() / dt.sum()) if abs(veer) < np.radians(40.0) else None
