"""Track robots in a video: find where they were. Join the robots' log with these positions, as a recording.

A robot is called by its name, which is the number that its log has. Times are seconds on the video's clock, from its
first frame, unless they are said to be on the robots' clock.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Bools, Floats
from vibroswarm.core.numbers import number, stated
from vibroswarm.core.read_tables import files_of, read_rows
from vibroswarm.errors import InputError
from vibroswarm.lab.tracking.camera import Camera, Lens, fit_camera, outwards, square_of
from vibroswarm.lab.tracking.marker_detection import Detections, detect
from vibroswarm.lab.tracking.markers import Markers
from vibroswarm.lab.tracking.stops import STOPS, ClockOffset, clock_offset, stops_of
from vibroswarm.recordings.read import SAMPLES, TRACKS, Log, log_frame

POSITIONS: Final = {
    "robot": pl.Int64, "time_s": pl.Float64, "x_m": pl.Float64, "y_m": pl.Float64, "heading_rad": pl.Float64,
}  # fmt: skip
"""Columns of positions: robot's name, seconds from the first frame, and its pose; a row for each time it was seen. Rows
of a robot are in the order of time."""
GAP_S: Final = 1.0
"""Positions are not interpolated over longer gaps."""
MOVED_PX: Final = 0.5
"""If the floor's markers move by more than this (``Detections.floor_spread``), the camera moves."""
FLOOR_PX: Final = 1.0
"""A floor marker with a larger error is not where the file has it."""
SMALL_PX: Final = 20.0
"""A marker with a smaller edge is read badly."""
PLACES_M: Final = 0.003
"""If places may be off by more, this is warned of."""
FASTEST_M_S: Final = 0.5
"""Fastest speed of a robot. A position that it could reach from the position before, and leave for the one after, only
at a higher speed is a misread marker."""
PLACES: Final = ("x_m", "y_m", "heading_rad")
"""Columns of a robots' log that are not read, since the camera gives them."""
FITTED: Final = 120
"""About how many detections of robots' markers a self-calibration is fitted to, spread over the video."""


@dataclass(frozen=True)
class Tracking:
    """What was found in one video: camera, markers, and where robots were."""

    video: Path
    markers: Markers
    camera: Camera
    detections: Detections
    positions: pl.DataFrame
    """``POSITIONS``."""
    stops: pl.DataFrame
    """``stops.STOPS``."""
    dropped: int
    """Number of positions that were dropped as too fast."""

    def gaps(self) -> pl.DataFrame:
        """Return robot, start_s, end_s of gaps of more than ``GAP_S``, also at both ends of the video."""
        first_s, last_s = self.detections.time_s[[0, -1]].tolist()
        rows = [
            (robot, start_s, end_s)
            for robot in self.markers.robots.values()
            for start_s, end_s in pairwise([first_s, *self.positions.filter(robot=robot)["time_s"], last_s])
            if end_s - start_s > GAP_S
        ]
        schema = {"robot": pl.Int64, "start_s": pl.Float64, "end_s": pl.Float64}
        return pl.DataFrame(rows, schema=schema, orient="row")

    def floor_errors(self) -> pl.DataFrame:
        """Return floor markers' places, and how well the camera meets their corners (RMS; null: not seen)."""
        errors = {}
        for marker, corners in self.detections.floor_px.items():
            seen = corners - self.camera.edge_px * outwards(corners[None])[0]
            away = seen - self.camera.project(self.markers.floor_corners(marker))
            errors[marker] = float(np.sqrt((away**2).sum(axis=1).mean()))
        rows = [
            (marker, x_m, y_m, errors.get(marker)) for marker, (x_m, y_m, _) in self.markers.floor.items()
        ]
        schema = {"marker": pl.Int64, **dict.fromkeys(("x_m", "y_m", "error_px"), pl.Float64)}
        return pl.DataFrame(rows, schema=schema, orient="row")

    def warnings(self) -> list[str]:
        """Return sentences on what a user should know of this video, such as markers that are too small."""
        found = []
        smallest_px = float(np.nanmin(self.detections.edge_px()))
        if smallest_px < SMALL_PX:
            needed_mm = int(np.ceil(1000 * self.markers.size_m * SMALL_PX / smallest_px))
            found.append(
                f"A robot's marker is {number(smallest_px, 0)} px wide; below {stated(SMALL_PX)} px markers are "
                f"missed and headings "
                f"are rough: bring the camera nearer, film at a higher resolution, or print markers of {needed_mm} mm."
            )
        never = [
            name
            for name, edge in zip(self.markers.robots.values(), self.detections.edge_px(), strict=True)
            if np.isnan(edge)
        ]
        if never:
            found.append(f"Never seen, or only at two places at once: robots {', '.join(map(str, never))}.")
        moved_px, frame = self.detections.floor_spread
        if moved_px > MOVED_PX:
            found.append(
                f"The floor's markers move in the picture (by {number(moved_px, 1)} px, most at "
                f"{number(self.detections.time_s[frame], 1)} s): the camera moves, vibrates or was pushed, and "
                "positions are off by as much; fix it to something that does not move."
            )
        is_off = pl.col("error_px").fill_null(np.inf) > FLOOR_PX
        off = self.floor_errors().filter(is_off)["marker"].to_list()
        if off:
            found.append(
                f"Markers of the floor not seen, or not where the file has them: {', '.join(map(str, off))}."
            )
        if self.camera.place_error_m > PLACES_M:
            found.append(
                f"Robots' places may be off by {number(1000 * self.camera.place_error_m, 0)} mm or more: lay a "
                "floor marker at each corner of the arena, measure the camera's height (--camera-height), or film a "
                "chessboard (--lens)."
            )
        return found


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
        lens: a lens that was fitted to a chessboard; None: the lens is fitted to the markers of floor and robots.
        lens_size_px: width and height of the video of the chessboard.
        camera_height_m: height of the camera, if it was measured. partial: whether a video that ends early is accepted.
        progress: called with the number of frames done and the number of all frames.
    """
    seen = detect(video, markers, partial=partial, progress=progress)
    if lens is not None and lens_size_px is not None and lens_size_px != seen.size_px:
        raise InputError(
            f"is of {lens_size_px[0]} x {lens_size_px[1]} px, the video of {seen.size_px[0]} x {seen.size_px[1]}; "
            "record both at the same size",
            field="--lens",
        )
    is_seen: Bools = np.all(np.isfinite(seen.corners_px), axis=(2, 3))  # (frames, robots)
    for whose, wanted, is_there in (
        ("robots'", list(markers.robots), is_seen.any()),
        ("floor's", list(markers.floor), bool(seen.floor_px)),
    ):
        if not is_there:
            raise InputError(
                f"shows none of the {whose} markers {wanted} (dictionary {markers.dictionary}), or only at two places "
                f"of a frame; are they of this dictionary, not mirrored, at least {stated(SMALL_PX)} px wide, with a "
                "white rim?",
                field=str(video),
            )
    robots_px = seen.corners_px[is_seen]
    camera = fit_camera(
        seen.size_px,
        floor_m=np.concatenate([markers.floor_corners(marker) for marker in seen.floor_px]),
        floor_px=np.concatenate(list(seen.floor_px.values())),
        robots_px=robots_px[:: max(len(robots_px) // FITTED, 1)],  # about ``FITTED``, spread over the video
        robot_size_m=markers.size_m,
        robot_height_m=markers.height_m,
        lens=lens,
        camera_height_m=camera_height_m,
        have_rims=seen.have_rims,
    )
    positions, stops, dropped = _robot_tables(seen, is_seen, camera, markers)
    return Tracking(
        video,
        markers,
        camera,
        detections=seen,
        positions=positions,
        stops=stops,
        dropped=dropped,
    )


def _robot_tables(
    seen: Detections, is_seen: Bools, camera: Camera, markers: Markers
) -> tuple[pl.DataFrame, pl.DataFrame, int]:
    """Return the robots' positions (``POSITIONS``), stops (``stops.STOPS``), and how many positions are too fast."""
    # Empty tables come first, so that no list is empty.
    tables, stops, dropped = [pl.DataFrame(schema=POSITIONS)], [pl.DataFrame(schema=STOPS)], 0
    for i, name in enumerate(markers.robots.values()):
        own = seen.corners_px[is_seen[:, i], i]
        if not len(own):  # the robot was never seen
            continue
        centre, along = square_of(camera.at_height(own, markers.height_m))
        time_s = seen.time_s[is_seen[:, i]]
        # ``along`` is the direction of the marker's top edge from left to right. A quarter turn from it is the
        # direction from the marker's centre to its top, and ``forward_rad`` from that is the robot's heading.
        heading = wrapped(along + np.pi / 2 + markers.forward_rad)
        kept = ~too_fast(time_s, centre)
        dropped += int((~kept).sum())
        time_s, centre, heading = time_s[kept], centre[kept], heading[kept]
        columns = {
            "robot": np.full(time_s.size, name), "time_s": time_s, "x_m": centre[:, 0], "y_m": centre[:, 1],
            "heading_rad": heading,
        }  # fmt: skip
        tables.append(pl.DataFrame(columns, schema=POSITIONS))
        stops.append(stops_of(name, time_s, centre[:, 0], centre[:, 1], heading))
    return pl.concat(tables), pl.concat(stops), dropped


def wrapped(angle_rad: Floats) -> Floats:
    """Return angles brought into the range from -pi to pi."""
    return np.asarray(np.angle(np.exp(1j * angle_rad)))


def too_fast(time_s: Floats, centre_m: Floats) -> Bools:
    """Return whether each position is too far from those before and after it for a robot's speed, (positions,).

    The first and the last position are too far if the step to the neighbour is too fast and the neighbour's other
    step is not. With fewer than three positions none is too far, since of two positions either may be wrong.
    """
    if time_s.size < 3:
        return np.zeros(time_s.size, dtype=np.bool_)
    # The maximum avoids a division by 0 if two frames have the same time.
    speeds_m_s = np.linalg.norm(np.diff(centre_m, axis=0), axis=1) / np.maximum(np.diff(time_s), 1e-6)
    fast = speeds_m_s > FASTEST_M_S
    found = np.zeros(time_s.size, dtype=np.bool_)
    found[1:-1] = fast[:-1] & fast[1:]
    found[0], found[-1] = fast[0] and not fast[1], fast[-1] and not fast[-2]
    return found


def read_robot_log(path: Path) -> pl.DataFrame:
    """Read a robots' log: columns of ``SAMPLES`` without poses; rows without an energy are left out."""
    schema = {use: one._replace(required=False) for use, one in SAMPLES.items() if use not in PLACES}
    schema |= {use: SAMPLES[use]._replace(required=True) for use in ("robot", "time_s", "energy")}
    return log_frame(read_rows(files_of(path), schema).rows)


@dataclass(frozen=True)
class TrackedLog:
    """A robots' log with the camera's positions."""

    log: Log
    offset: ClockOffset
    unseen: int
    """Number of samples that are left out since they were taken outside of the video or in a gap of the tracking."""


def with_positions(
    tracking: Tracking, samples: pl.DataFrame, name: str, control_period_s: float = 0.0
) -> TrackedLog:
    """Join the samples of a robots' log with the poses at which the camera saw the robots, by the robots' clock.

    Poses at the times of samples are interpolated. Samples outside the video or in gaps of the tracking are left out.
    The positions seen by the camera become the log's tracks, without those before time 0.

    Args:
        samples: result of ``read_robot_log``. name: path of the log. control_period_s: time from a sample to the end of
            its stop, s: a robot samples at one control tick and drives on at the next.
    """
    without_marker = set(samples["robot"].unique().to_list()) - set(tracking.markers.robots.values())
    if without_marker:
        raise InputError(
            f"has robot {min(without_marker)}, which has no marker in the file of markers", field=name
        )
    offset = clock_offset(tracking.stops, samples, control_period_s)
    parts = [samples.clear()]
    for robot in tracking.markers.robots.values():
        own, seen = samples.filter(robot=robot), tracking.positions.filter(robot=robot)
        time_s = own["time_s"].to_numpy() - offset.offset_s  # of samples, on the video's clock
        seen_s = seen["time_s"].to_numpy()
        if seen_s.size < 2:  # nothing can be interpolated
            continue
        # Index of the position after each sample. The limits keep the index valid for samples that are not located.
        after = np.clip(np.searchsorted(seen_s, time_s), 1, seen_s.size - 1)
        in_no_gap = seen_s[after] - seen_s[after - 1] <= GAP_S
        is_located = (time_s >= seen_s[0]) & (time_s <= seen_s[-1]) & in_no_gap
        heading = np.unwrap(seen["heading_rad"].to_numpy())
        parts.append(
            own.with_columns(
                x_m=pl.Series(np.interp(time_s, seen_s, seen["x_m"].to_numpy())),
                y_m=pl.Series(np.interp(time_s, seen_s, seen["y_m"].to_numpy())),
                heading_rad=pl.Series(wrapped(np.interp(time_s, seen_s, heading))),
            ).filter(pl.Series(is_located))
        )
    located = pl.concat(parts).sort("time_s", "robot")
    if located.is_empty():
        raise InputError("none of its samples has a position in the video", field=name)
    # ``line`` is the number of a row in the log's file. Positions by the camera are not in this file: their line is 0.
    tracks = tracking.positions.with_columns(
        pl.col("time_s") + offset.offset_s, line=pl.lit(0, dtype=pl.UInt32)
    ).filter(pl.col("time_s") >= 0.0)
    log = Log(
        name=Path(name).name,
        reader="camera",
        samples=log_frame(located),
        tracks=tracks.sort("time_s", "robot").select(TRACKS),
        counts={"rows": samples.height},
    )
    return TrackedLog(log, offset, unseen=samples.height - located.height)
