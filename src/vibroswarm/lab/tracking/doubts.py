"""Find what is doubtful in a tracking, and how well the camera meets the markers of the floor.

| kind | what is doubtful | size |
|---|---|---|
| gap | a robot was not seen for more than a second | length, s |
| jump | a position too far from those before and after it, which was dropped | - |
| unexpected | a marker was seen that is in no list | frames |
| floor | a marker of the floor is not at the place that the file of markers gives, or was not seen | error, px |
| small | a robot's marker is too small to be read well | width, px |
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.lab.tracking.camera import outwards
from vibroswarm.lab.tracking.track import SMALL_PX, Tracking

FLOOR_PX: Final = 1.0
"""A floor marker with a larger error of its corners (root mean square, px) is not where the file has it."""
_DOUBTS: Final = {"kind": pl.String, "of": pl.Int64, "time_s": pl.Float64, "size": pl.Float64}


def doubts_of(tracking: Tracking) -> pl.DataFrame:
    """Return what is doubtful in a tracking: its kind, the robot or marker, when, and its size."""
    seen = tracking.detections
    rows: list[tuple[Any, ...]] = [
        ("gap", robot, start_s, end_s - start_s) for robot, start_s, end_s in tracking.gaps().iter_rows()
    ]
    rows += [
        ("jump", robot, time_s, None) for robot, time_s in tracking.dropped.select("robot", "time_s").rows()
    ]
    rows += [
        ("unexpected", marker, float(seen.time_s[places[0][0]]), len(places))
        for marker, places in seen.unexpected.items()
        if len(places) > 1
    ]
    errors = floor_errors(tracking)
    rows += [
        ("floor", marker, None, error)
        for marker, error in errors.select("marker", "error_px").iter_rows()
        if error is None or error > FLOOR_PX
    ]
    rows += [
        ("small", robot, None, float(edge_px))
        for robot, edge_px in zip(tracking.markers.robots.values(), seen.edge_px(), strict=True)
        if edge_px < SMALL_PX
    ]
    return pl.DataFrame(rows, schema=_DOUBTS, orient="row")


def floor_errors(tracking: Tracking) -> pl.DataFrame:
    """Return how well the fitted camera meets each marker of the floor: its place, and the error of its corners.

    The error is the root mean square distance from where corners are seen to where the camera projects them, px and mm;
    null for a marker that was never seen.
    """
    rows = []
    for marker, (x_m, y_m, _) in tracking.markers.floor.items():
        corners = tracking.detections.floor_px.get(marker)
        error = None
        if corners is not None:
            seen = sharp_corners(tracking, corners[None])[0]
            away = seen - tracking.camera.project(tracking.markers.floor_corners(marker))
            error = float(np.sqrt((away**2).sum(axis=1).mean()))
        rows.append((marker, x_m, y_m, error))
    schema = {"marker": pl.Int64, **dict.fromkeys(("x_m", "y_m", "error_px"), pl.Float64)}
    frame = pl.DataFrame(rows, schema=schema, orient="row")
    return frame.with_columns(error_mm=pl.col("error_px") * mm_per_px(tracking))


def sharp_corners(tracking: Tracking, corners_px: Floats) -> Floats:
    """Return corners, (markers, 4, 2), px, with the edges moved inwards, as blur and thresholds moved them outwards."""
    return np.asarray(corners_px - tracking.camera.edge_px * outwards(corners_px))


def mm_per_px(tracking: Tracking) -> float:
    """Return the width of floor, mm, that a pixel in the middle of the picture covers."""
    width, height = tracking.detections.size_px
    middle = np.array([[width / 2, height / 2], [width / 2 + 1.0, height / 2]])
    at = tracking.camera.at_height(middle, 0.0)
    return 1000 * float(np.linalg.norm(at[1] - at[0]))
