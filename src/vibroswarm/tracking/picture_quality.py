"""Judge frames of a video: are they dark, are their markers too small, mirrored, or of another dictionary?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroswarm.core.numbers import number, stated
from vibroswarm.tracking import opencv
from vibroswarm.tracking.markers import DICTIONARIES, Markers, dictionary_of
from vibroswarm.tracking.video_file import Gray

DARK: Final = 60.0
"""A picture is dark if nine tenths of its pixels are below this grey level of 255."""
SMALL_PX: Final = 20.0
"""A marker with a smaller edge is read badly."""
SQUARE_PX: Final = 6.0
"""Least edge of the squares that are looked for."""
JUDGED: Final = 3
"""Number of frames in which markers of all dictionaries are looked for."""
LISTED: Final = 12
"""Most numbers of markers that a message lists."""


def why_dark(frames: Sequence[Gray]) -> str:
    """Return that the picture is dark, and what to do; empty if it is not."""
    light = float(np.median([np.percentile(frame, 90) for frame in frames]))
    if light >= DARK:
        return ""
    return (
        f"the picture is dark (nine tenths of it are at most {number(light, 0)} of 255): use more light or a longer "
        "exposure"
    )


def why_none(frames: Sequence[Gray], markers: Markers) -> str:
    """Return why frames show none of some markers, as far as they tell, and what to do."""
    dark = why_dark(frames)
    if dark:
        return dark
    judged = frames[:: max(len(frames) // JUDGED, 1)]
    wanted = {*markers.robots, *markers.floor}
    mirrored = wanted & set(_ids_in([opencv().flip(frame, 1) for frame in judged], markers.dictionary))
    if len(mirrored) > 1:
        return (
            f"the picture is mirrored (seen in a mirror it shows {_listed(sorted(mirrored))}): switch mirroring off, "
            "or track the camera's own file"
        )
    seen = {name: _ids_in(judged, name) for name in DICTIONARIES}
    best = max(
        seen, key=lambda name: len(seen[name])
    )  # of equally good ones the first, which is the smallest
    if len(seen[best]) > 1 and not set(seen[best]) <= set(seen[markers.dictionary]):
        return f"its markers are of the dictionary {best} ({_listed(seen[best])})"
    edges = [edge for frame in frames for edge in _square_edges(frame, markers.dictionary)]
    found = []
    if seen[markers.dictionary]:
        found.append(f"of this dictionary it shows {_listed(seen[markers.dictionary])} only")
    if edges and np.median(edges) < SMALL_PX:
        squares = "other squares" if found else "its squares"
        found.append(
            f"{squares} are {number(np.median(edges), 0)} px wide, and markers of {stated(SMALL_PX)} px are read "
            "well: bring the camera nearer, film at a higher resolution, or print larger markers"
        )
    if found:
        return "; ".join(found)
    return f"nothing in it is like a marker: are they in it, at least {stated(SMALL_PX)} px wide and with a white rim?"


def _ids_in(frames: Sequence[Gray], dictionary: str) -> list[int]:
    detector = opencv().aruco.ArucoDetector(dictionary_of(dictionary))
    found = [detector.detectMarkers(frame)[1] for frame in frames]
    return sorted({number for ids in found if ids is not None for number in np.asarray(ids).ravel().tolist()})


def _listed(ids: Sequence[int]) -> str:
    more = "" if len(ids) <= LISTED else f", and {len(ids) - LISTED} more"
    return ", ".join(map(str, ids[:LISTED])) + more


def _square_edges(frame: Gray, dictionary: str) -> list[float]:
    """Return the mean edge, px, of each nearly square figure that is no marker of the dictionary, nor inside of one."""
    cv2 = opencv()
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 4 * SQUARE_PX / max(frame.shape)
    read, _, others = cv2.aruco.ArucoDetector(dictionary_of(dictionary), parameters).detectMarkers(frame)
    found = []
    for corners in others:
        middle = corners[0].mean(axis=0).tolist()
        edges = np.linalg.norm(np.roll(corners[0], -1, axis=0) - corners[0], axis=1)
        is_inside = any(cv2.pointPolygonTest(marker[0], middle, False) >= 0 for marker in read)
        if edges.min() > 0.7 * edges.max() and not is_inside:
            found.append(float(edges.mean()))
    return found
