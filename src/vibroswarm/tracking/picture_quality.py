"""Judge frames of a video: dark, blurred, with reflections, are their markers too small, or of another dictionary?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroswarm.core.arrays import Bools
from vibroswarm.core.numbers import number, percent, stated
from vibroswarm.tracking import opencv
from vibroswarm.tracking.markers import DICTIONARIES, Markers, dictionary_of
from vibroswarm.tracking.video_file import Gray

DARK: Final = 60.0
"""A picture is dark if nine tenths of its pixels are below this grey level of 255."""
BLURRED_PX: Final = 3.0
"""A picture is blurred if its edges are wider than this: so wide are the small squares of a marker of 20 px."""
WHITE: Final = 250
"""Least grey level of a pixel that is white, as in a reflection."""
LEAST_BITS: Final = 0.005
"""A file with fewer bits for each pixel of each frame is compressed strongly: phones write 0.1 to 0.5."""
AROUND_PX: Final = 25
"""Width of the windows in which contrast and steepest slope are compared."""
SMALL_PX: Final = 20.0
"""A marker with a smaller edge is read badly."""
SQUARE_PX: Final = 6.0
"""Least edge of the squares that are looked for."""
JUDGED: Final = 3
"""Number of frames in which markers of all dictionaries are looked for."""
LISTED: Final = 12
"""Most numbers of markers that a message lists."""


def light_of(frames: Sequence[Gray]) -> float:
    """Return the grey level, 0 to 255, that nine tenths of the pixels do not exceed; the median over frames."""
    return float(np.median([np.percentile(frame, 90) for frame in frames]))


def edges_px(frames: Sequence[Gray]) -> float:
    """Return how wide the most contrasting edges are, px: contrast divided by steepest slope; the median over frames.

    It is 2 for a sharp edge, and 2.5 standard deviations of a Gaussian blur. Of four directions the one with the widest
    edges counts, since a movement blurs along one only.
    """
    return float(np.median([_edges_of(frame) for frame in frames]))


def _edges_of(frame: Gray) -> float:
    cv2 = opencv()
    around = np.ones((AROUND_PX, AROUND_PX), dtype=np.uint8)
    smooth = cv2.medianBlur(frame, 3)  # takes off noise, and leaves edges as steep as they are
    contrast = cv2.dilate(smooth, around).astype(np.float32) - cv2.erode(smooth, around)
    # Sobel's sums over 3 by 3 pixels are 8 times the slope.
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *axis) / 8 for axis in ((1, 0), (0, 1)))
    highest = contrast >= np.percentile(contrast, 95)
    widths = []
    for slope in (across, down, (across + down) * 0.5**0.5, (across - down) * 0.5**0.5):
        steepest = cv2.dilate(np.abs(slope), around)
        # The sharpest tenth: in the other windows, edges may run along this direction.
        widths.append(float(np.quantile(contrast[highest] / np.maximum(steepest[highest], 1.0), 0.1)))
    return max((width for width in widths if width < AROUND_PX), default=0.0)  # wider ones: no edge across


def white_places(frames: Sequence[Gray], edge_px: float) -> list[Bools]:
    """Return where a picture is white in all frames, (height, width) of each place.

    A place has at least the area of a marker, and a square of half its edge fits in: the white rim of a marker on the
    floor is narrower.

    Args:
        frames: of one camera that does not move. edge_px: edge of a marker.
    """
    cv2 = opencv()
    white = (np.min(frames, axis=0) >= WHITE).astype(np.uint8)
    square = np.ones((math.floor(edge_px / 2) + 1,) * 2, dtype=np.uint8)
    wide = cv2.erode(white, square, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
    _, labels, figures, _ = cv2.connectedComponentsWithStats(white)
    areas = figures[:, cv2.CC_STAT_AREA]
    return [labels == k for k in np.unique(labels[wide]) if k > 0 and areas[k] >= edge_px**2]


def faults_of(frames: Sequence[Gray], edge_px: float = math.nan, bits_per_px: float = math.nan) -> list[str]:
    """Return what is wrong with a picture as a whole, with what to do: dark, blurred, reflections, compressed.

    Args:
        edge_px: edge of a marker, px; nan: reflections are not judged.
        bits_per_px: size of the file, bits for each pixel of each frame; nan: not judged.
    """
    light, width_px = light_of(frames), edges_px(frames)
    found = []
    if light < DARK:
        found.append(
            f"the picture is dark (nine tenths of it are at most {number(light, 0)} of 255): use more light or a "
            f"longer exposure"
        )
    if width_px > BLURRED_PX:
        found.append(
            f"the picture is blurred (its edges are {number(width_px, 1)} px wide, sharp ones 2): focus, clean "
            f"the lens, and keep the camera still"
        )
    if not math.isnan(edge_px) and (white := white_places(frames, edge_px)):
        places = "a place is" if len(white) == 1 else f"{len(white)} places are"
        share = percent(float(np.mean(white, axis=(1, 2)).sum()))
        found.append(
            f"{places} white throughout, as reflections are, {share} of the picture: "
            "markers are not seen there; move the lamps, expose for less, or print markers on matt paper"
        )
    if bits_per_px < LEAST_BITS:
        found.append(
            f"the video is compressed strongly ({number(bits_per_px, 4)} bits for each pixel): track the camera's "
            f"own file, "
            "not one that a messenger or an editor has made smaller"
        )
    return found


def why_none(frames: Sequence[Gray], markers: Markers) -> str:
    """Return why frames show none of some markers, as far as they tell, and what to do."""
    faults = faults_of(frames)
    if faults:
        return "; ".join(faults)
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
