"""From a video to where the robots were, and with their log to a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.recordings.column_map import check_columns, check_values, numbers_of, table_of, text_of
from vibroswarm.recordings.log import SAMPLES, TRACKS, Log, log_frame
from vibroswarm.tracking.camera import Camera, Lens, fit_camera, square_of
from vibroswarm.tracking.detection import Detections, detect
from vibroswarm.tracking.markers import Markers
from vibroswarm.tracking.stops import STOPS, ClockOffset, clock_offset, stops_of
from vibroswarm.tracking.video_file import uneven_frames

Floats = NDArray[np.float64]

POSITIONS: Final = {
    "robot": pl.Int64, "time_s": pl.Float64, "x_m": pl.Float64, "y_m": pl.Float64, "heading_rad": pl.Float64,
}  # fmt: skip
"""Columns of positions: the robot's name, seconds from the first frame, and its pose; a row where it was seen."""
GAP_S: Final = 1.0
"""Positions are not interpolated over longer gaps."""
SMALL_PX: Final = 20.0
"""A marker with a smaller edge is read badly."""
FASTEST_M_S: Final = 0.5
"""A position that would need a higher speed from both its neighbours is another marker misread."""
FITTED: Final = 120
"""Robots' markers that a self-calibration is fitted to, spread over the video."""


@dataclass(frozen=True)
class Tracking:
    """Where robots were in a video."""

    video: Path
    markers: Markers
    camera: Camera
    detections: Detections
    positions: pl.DataFrame
    """``POSITIONS``."""
    stops: pl.DataFrame
    """``stops.STOPS``."""
    jumps: int
    """Positions that were dropped as too fast."""
    dropped: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=POSITIONS))
    """Those positions, ``POSITIONS``."""

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last frame."""
        return float(self.detections.time_s[0]), float(self.detections.time_s[-1])

    def gaps(self) -> pl.DataFrame:
        """Return the gaps of more than ``GAP_S``: robot, start_s, end_s; from the first frame to the last."""
        return gaps_in(self.positions, list(self.markers.robots.values()), self.span_s)

    def warnings(self, alone: bool = True) -> list[str]:
        """Return what a user should know of this video, in sentences.

        Args:
            alone: whether this is the only camera; else a robot that it never sees may be in another's view.
        """
        found = []
        small = float(np.nanmin(self.detections.edge_px()))
        if small < SMALL_PX:
            needed_mm = int(np.ceil(1000 * self.markers.size_m * SMALL_PX / small))
            found.append(
                f"A robot's marker is {small:.0f} px wide; below {SMALL_PX:g} px markers are missed and headings are "
                f"rough: bring the camera nearer, film at a higher resolution, or print markers of {needed_mm} mm."
            )
        never = [
            name
            for name, edge in zip(self.markers.robots.values(), self.detections.edge_px(), strict=True)
            if np.isnan(edge)
        ]
        if never and alone:
            found.append(f"Never seen: robots {', '.join(map(str, never))}.")
        uneven = uneven_frames(self.detections.time_s)
        if uneven is not None:
            found.append(
                f"Frames are uneven: {100 * uneven[0]:.1f} % of the steps differ from the usual one "
                f"({1000 * uneven[1]:.0f} to {1000 * uneven[2]:.0f} ms); the file's own times are used."
            )
        if self.camera.floor_error_px > 1.0:
            found.append(
                f"Corners of the floor's markers are off by {self.camera.floor_error_px:.1f} px: check their places, "
                "and calibrate the lens with a chessboard (--lens)."
            )
        return found


def gaps_in(positions: pl.DataFrame, robots: Sequence[int], span_s: tuple[float, float]) -> pl.DataFrame:
    """Return the gaps of more than ``GAP_S`` in ``POSITIONS`` within ``span_s``: robot, start_s, end_s."""
    rows = []
    for robot in robots:
        own = positions.filter(pl.col("robot") == robot)["time_s"].to_numpy()
        edges = np.concatenate([[span_s[0]], own, [span_s[1]]])
        rows += [(robot, a, b) for a, b in pairwise(edges.tolist()) if b - a > GAP_S]
    return pl.DataFrame(
        rows, schema={"robot": pl.Int64, "start_s": pl.Float64, "end_s": pl.Float64}, orient="row"
    )


def track(
    video: Path,
    markers: Markers,
    *,
    lens: Lens | None = None,
    lens_size_px: tuple[int, int] | None = None,
    camera_height_m: float | None = None,
    partial: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Tracking:
    """Track the robots of a video.

    Args:
        lens: fitted to a chessboard; without, it is fitted to the markers of the floor and of the robots.
        lens_size_px: width and height of the lens's video. camera_height_m: if it was measured.
    Raises:
        InputError: no video, no markers, or markers where they should not be.
    """
    seen = detect(video, markers, partial=partial, progress=progress)
    if lens is not None and lens_size_px is not None and lens_size_px != seen.size_px:
        raise InputError(
            f"is of {lens_size_px[0]} x {lens_size_px[1]} px, the video of {seen.size_px[0]} x {seen.size_px[1]}; "
            "record both alike",
            field="--lens",
        )
    if not seen.floor_px:
        raise InputError(
            f"shows none of the floor's markers {list(markers.floor)} (dictionary {markers.dictionary})",
            field=str(video),
        )
    there = np.isfinite(seen.corners_px.reshape(*seen.corners_px.shape[:2], 8).sum(axis=2))
    robots_px = seen.corners_px[there]
    camera = fit_camera(
        seen.size_px,
        np.concatenate([markers.floor_corners(marker) for marker in seen.floor_px]),
        np.concatenate(list(seen.floor_px.values())),
        robots_px[:: max(len(robots_px) // FITTED, 1)],
        markers.size_m,
        markers.height_m,
        lens,
        camera_height_m,
    )
    tables, stops, dropped = _robot_tables(seen, there, camera, markers)
    return Tracking(
        video,
        markers,
        camera,
        seen,
        pl.concat(tables),
        pl.concat(stops) if stops else pl.DataFrame(schema=STOPS),
        sum(part.height for part in dropped),
        pl.concat(dropped),
    )


def _robot_tables(
    seen: Detections, there: NDArray[np.bool_], camera: Camera, markers: Markers
) -> tuple[list[pl.DataFrame], list[pl.DataFrame], list[pl.DataFrame]]:
    """Return the positions, the stops, and the positions that are too fast, of each robot that was seen.

    Args:
        there: (frames, robots): whether a robot's marker was seen.
    """
    tables, stops, dropped = [], [], [pl.DataFrame(schema=POSITIONS)]
    for i, name in enumerate(markers.robots.values()):
        own = seen.corners_px[there[:, i], i]
        if not len(own):
            continue
        centre, along = square_of(camera.at_height(own, markers.height_m))
        time_s = seen.time_s[there[:, i]]
        heading = wrapped(along + np.pi / 2 + markers.forward_rad)
        kept = ~too_fast(time_s, centre)
        columns = {
            "robot": np.full(time_s.size, name), "time_s": time_s, "x_m": centre[:, 0], "y_m": centre[:, 1],
            "heading_rad": heading,
        }  # fmt: skip
        table = pl.DataFrame(columns, schema=POSITIONS)
        tables.append(table.filter(pl.Series(kept)))
        dropped.append(table.filter(pl.Series(~kept)))
        time_s, centre, heading = time_s[kept], centre[kept], heading[kept]
        stops.append(stops_of(name, time_s, centre[:, 0], centre[:, 1], heading))
    return tables, stops, dropped


def wrapped(angle_rad: Floats) -> Floats:
    """Return angles from -pi to pi."""
    return np.asarray(np.angle(np.exp(1j * angle_rad)))


def too_fast(time_s: Floats, centre_m: Floats) -> NDArray[np.bool_]:
    """Return which positions lie so far from both neighbours that no robot could have been there."""
    if time_s.size < 3:
        return np.zeros(time_s.size, dtype=np.bool_)
    steps = np.linalg.norm(np.diff(centre_m, axis=0), axis=1) / np.maximum(np.diff(time_s), 1e-6)
    fast = steps > FASTEST_M_S
    found = np.zeros(time_s.size, dtype=np.bool_)
    found[1:-1] = fast[:-1] & fast[1:]
    found[0], found[-1] = fast[0] and not fast[1], fast[-1] and not fast[-2]
    return found


def read_robot_log(path: Path) -> pl.DataFrame:
    """Read a robots' log: CSV with robot, time_s (by the robots' clock) and energy, and what else a log may have.

    Raises:
        InputError: missing columns, or cells that are no numbers; names the row.
    """
    name = str(path)
    table = table_of(text_of(path), name)
    check_columns({use: use for use in ("robot", "time_s", "energy")}, table.columns[1:], name)
    columns: dict[str, Any] = {"line": table["line"]}
    for use in SAMPLES:
        if use in ("line", "x_m", "y_m", "heading_rad") or use not in table.columns:
            continue
        numbers = numbers_of(table[use], table["line"], name, use, ("", "nan", "NaN"))
        check_values(numbers, table["line"], name, use, use)
        columns[use] = numbers
    found = log_frame(columns, SAMPLES).filter(pl.col("energy").is_not_null())
    if found["robot"].null_count() or found["time_s"].null_count():
        raise InputError("a row without robot or time_s", field=name)
    return found


@dataclass(frozen=True)
class TrackedLog:
    """A robots' log with the camera's positions."""

    log: Log
    offset: ClockOffset
    outside: int
    """Samples before the video began or after it ended: left out."""
    unseen: int
    """Samples during a gap of the tracking: left out, their places are not known."""


class Seen(Protocol):
    """What one camera or several saw of a session."""

    @property
    def markers(self) -> Markers: ...  # noqa: D102
    @property
    def positions(self) -> pl.DataFrame: ...  # noqa: D102
    @property
    def stops(self) -> pl.DataFrame: ...  # noqa: D102
    @property
    def span_s(self) -> tuple[float, float]: ...  # noqa: D102


def with_positions(
    tracking: Seen, samples: pl.DataFrame, name: str, control_period_s: float = 0.0
) -> TrackedLog:
    """Give the samples of a robots' log the places where the camera saw the robots; times are the log's.

    Args:
        control_period_s: how long after a sample a robot drives on.
    Raises:
        InputError: the clocks cannot be matched, or a robot of the log has no marker.
    """
    strangers = set(samples["robot"].unique().to_list()) - set(tracking.markers.robots.values())
    if strangers:
        raise InputError(
            f"has robot {min(strangers)}, which has no marker in the file of markers", field=name
        )
    offset = clock_offset(tracking.stops, samples, control_period_s)
    first_s, last_s = tracking.span_s
    outside, unseen, parts = 0, 0, []
    for robot in tracking.markers.robots.values():
        own = samples.filter(pl.col("robot") == robot)
        seen = tracking.positions.filter(pl.col("robot") == robot)
        time_s = own["time_s"].to_numpy() - offset.offset_s
        during = (time_s >= first_s) & (time_s <= last_s)
        outside += int((~during).sum())
        at = seen["time_s"].to_numpy()
        if at.size < 2:
            unseen += int(during.sum())
            continue
        after = np.clip(np.searchsorted(at, time_s), 1, at.size - 1)
        near = (time_s >= at[0]) & (time_s <= at[-1]) & (at[after] - at[after - 1] <= GAP_S)
        unseen += int((during & ~near).sum())
        heading = np.unwrap(seen["heading_rad"].to_numpy())
        parts.append(
            own.with_columns(
                x_m=pl.Series(np.interp(time_s, at, seen["x_m"].to_numpy())),
                y_m=pl.Series(np.interp(time_s, at, seen["y_m"].to_numpy())),
                heading_rad=pl.Series(wrapped(np.interp(time_s, at, heading))),
            ).filter(pl.Series(during & near))
        )
    if not parts or sum(part.height for part in parts) == 0:
        raise InputError("none of its samples has a position in the video", field=name)
    tracks = tracking.positions.with_columns(
        pl.col("time_s") + offset.offset_s, line=pl.lit(0, dtype=pl.UInt32)
    ).filter(pl.col("time_s") >= 0.0)
    located = pl.concat(parts).sort("time_s", "robot")
    log = Log(
        name=Path(name).name,
        reader="camera",
        samples=log_frame(located.to_dict(), SAMPLES),
        tracks=log_frame(tracks.sort("time_s", "robot").to_dict(), TRACKS),
        counts={"rows": samples.height},
    )
    return TrackedLog(log, offset, outside, unseen)
