"""Find what is doubtful in a tracking: where, when, and what to do about it.

| kind | what is doubtful |
|---|---|
| gap | a robot was not seen for more than a second |
| jump | a position too far from those before and after it, which was dropped |
| unexpected | a marker was seen that is in no list: it moves, or it never does and is likely no marker |
| small | a robot's marker is too small to be read well |
| floor | a marker of the floor is not at the place that the file of markers gives, or was not seen |

A robot is called by its name, the number that it has in the log.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import number, stated
from vibroswarm.tracking.camera import outwards
from vibroswarm.tracking.marker_detection import edge_lengths
from vibroswarm.tracking.track import SMALL_PX, Tracking

FLOOR_PX: Final = 1.0
"""A floor marker with a larger error of its corners (root mean square, px) is not where the file has it."""
TITLES: Final = {
    "gap": "Robots that were lost",
    "jump": "Positions that were dropped",
    "unexpected": "Markers that are not in the file",
    "floor": "Markers of the floor that are not in their places",
    "small": "Markers that are too small",
}
"""Kinds in the order in which they matter, with their headings."""
ADVICE: Final = {
    "gap": "Nothing is filled in there. Look what hides the marker: a hand, a cable, glare, a dark corner, the edge of "
    "the picture. If it is read badly everywhere, print it larger or on matt paper.",
    "jump": "Dropped, nothing to do, if there are few. If there are many, the camera moves (a warning says so), "
    "another object carries this marker, or the pattern is misread: choose another marker.",
    "unexpected": "If it is a marker, add it to the file. If not, something in the picture is misread as one, and "
    "might be misread as a robot's: cover it, or print markers of a dictionary with more squares (6X6_250).",
    "floor": "Measure its place again (centre, mm, from the lower left corner of the arena, y upwards), and look "
    "whether it was moved, lies flat, and is of the size stated. If that cannot be found out, remove it from the file.",
    "small": "Bring the camera nearer, film at a higher resolution, or print larger markers.",
}
"""What to do about each kind."""


@dataclass(frozen=True)
class Doubt:
    """One doubtful moment."""

    kind: str
    words: str
    """A sentence: who, when, what."""
    robot: int | None = None
    """The robot's name; None: the doubt is not about one robot."""
    time_s: float | None = None
    """When it happens, on the video's clock. None: it is there all the time."""
    weight: float = 0.0
    """How much it matters; doubts of a kind are sorted by descending weight."""


def doubts_of(tracking: Tracking) -> list[Doubt]:
    """Return what is doubtful in a tracking, in the order of ``TITLES``; doubts of a kind by descending weight."""
    found = [
        *_gaps(tracking), *_dropped(tracking), *_unexpected(tracking), *_floor(tracking),
        *_floor_never_seen(tracking), *_small(tracking),
    ]  # fmt: skip
    order = list(TITLES)
    return sorted(found, key=lambda doubt: (order.index(doubt.kind), -doubt.weight))


def _gaps(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each gap in which a robot was not seen."""
    for robot, start_s, end_s in tracking.gaps().iter_rows():
        words = (
            f"Robot {robot} was not seen from {number(start_s, 1)} to {number(end_s, 1)} s "
            f"({number(end_s - start_s, 1)} s)."
        )
        yield Doubt("gap", words, robot=robot, time_s=start_s, weight=end_s - start_s)


def _dropped(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt (kind ``jump``) for each position that tracking dropped, since it was too far from the others."""
    for robot, time_s, x_m, y_m in tracking.dropped.select("robot", "time_s", "x_m", "y_m").iter_rows():
        words = (
            f"Robot {robot} was read at ({number(x_m, 3)}, {number(y_m, 3)}) m at {number(time_s, 1)} s, far from "
            f"its path."
        )
        yield Doubt("jump", words, robot=robot, time_s=time_s)


def _unexpected(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each marker that is in no list and was seen in two whole frames or more.

    It moves if the middles of its places are farther apart than its edge.
    """
    seen = tracking.detections
    for marker, places in seen.unexpected.items():
        if len(places) < 2:
            continue
        frame, first = places[0]
        middles = np.array([four.mean(axis=0) for _, four in places])
        moves = float(np.linalg.norm(np.ptp(middles, axis=0))) > float(np.linalg.norm(first[1] - first[0]))
        how = "at several places" if moves else "always at the same place"
        words = (
            f"Marker {marker}, which is neither a robot's nor the floor's, was seen in {len(places)} of "
            f"{seen.whole_frames} frames searched whole, {how}."
        )
        yield Doubt("unexpected", words, time_s=float(seen.time_s[frame]), weight=len(places))


def _floor(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each marker of the floor that is more than ``FLOOR_PX`` from its place in the file."""
    for marker, error in floor_errors_px(floor_residuals(tracking)).items():
        if error <= FLOOR_PX:
            continue
        words = (
            f"Marker {marker} of the floor is {number(error, 1)} px ({number(error * mm_per_px(tracking), 1)} mm) "
            f"from where the "
            "file and the other markers have it."
        )
        yield Doubt("floor", words, weight=error)


def _floor_never_seen(tracking: Tracking) -> Iterator[Doubt]:
    """Yield one doubt about all markers of the floor that were never seen; none if all were seen."""
    missing = [marker for marker in tracking.markers.floor if marker not in tracking.detections.floor_px]
    if missing:
        markers = "marker" if len(missing) == 1 else "markers"
        listed = ", ".join(map(str, missing))
        yield Doubt("floor", f"Never seen: {markers} {listed} of the floor, which the file lists.")


def _small(tracking: Tracking) -> Iterator[Doubt]:
    """Yield a doubt for each robot whose marker is too small in the picture."""
    for robot, edge_px in zip(tracking.markers.robots.values(), tracking.detections.edge_px(), strict=True):
        if edge_px < SMALL_PX:
            size = f"{number(edge_px, 1)} px wide (median)"
            words = f"Robot {robot}'s marker is {size}; from {stated(SMALL_PX)} px on it is read well."
            yield Doubt("small", words, robot=robot, weight=SMALL_PX - edge_px)


def floor_residuals(tracking: Tracking) -> dict[int, Floats]:
    """Return the errors of the corners, (4, 2), px, of each floor marker that was seen, by its number.

    An error is the pixel at which a corner was seen minus the pixel to which the fitted camera projects it.
    """
    return {
        # ``sharp_corners`` takes several markers: here it takes one, and gives one back.
        marker: sharp_corners(tracking, corners[None])[0]
        - tracking.camera.project(tracking.markers.floor_corners(marker))
        for marker, corners in tracking.detections.floor_px.items()
    }


def floor_errors_px(residuals_px: Mapping[int, Floats]) -> dict[int, float]:
    """Return the root mean square of the errors of each floor marker's corners (``floor_residuals``), px."""
    return {marker: float(np.sqrt((each**2).sum(axis=1).mean())) for marker, each in residuals_px.items()}


def sharp_corners(tracking: Tracking, corners_px: Floats) -> Floats:
    """Return corners, (markers, 4, 2), px, with the edges moved inwards, as blur and thresholds moved them outwards."""
    return np.asarray(corners_px - tracking.camera.edge_px * outwards(corners_px))


def marker_sizes_m(tracking: Tracking) -> dict[int, float]:
    """Return the median edge of each robot's marker, m, as measured in the video; NaN if the marker was never seen.

    The marker is assumed to be at its stated height.

    Returns: edges by the robot's name, in the order of ``markers.robots``.
    """
    seen, found = tracking.detections.corners_px, {}
    for i, name in enumerate(tracking.markers.robots.values()):
        own = seen[np.isfinite(seen[:, i]).all(axis=(1, 2)), i]
        found[name] = float("nan")
        if len(own):
            corners = tracking.camera.at_height(sharp_corners(tracking, own), tracking.markers.height_m)
            found[name] = float(np.median(edge_lengths(corners)))
    return found


def mm_per_px(tracking: Tracking) -> float:
    """Return the width of floor, mm, that a pixel in the middle of the picture covers."""
    width, height = tracking.detections.size_px
    # Two points, a pixel apart, and the places on the floor that are seen there.
    middle = np.array([[width / 2, height / 2], [width / 2 + 1.0, height / 2]])
    at = tracking.camera.at_height(middle, 0.0)
    return 1000 * float(np.linalg.norm(at[1] - at[0]))
