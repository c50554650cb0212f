"""Find markers in the frames of a video: in windows where robots should be, in whole frames where one is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.tracking import opencv
from vibroswarm.tracking.markers import Markers, dictionary_of
from vibroswarm.tracking.video_file import Gray, Picture, grey, pictures_of, video_info

Floats = NDArray[np.float64]

WHOLE_EVERY: Final = 75
"""One in so many frames is searched whole."""
LOST_EVERY: Final = 5
"""While a robot is lost, one in so many frames is searched whole."""
MARGIN: Final = 0.9
"""Window around a marker, as a share of its edge, beside what it moved since the last frame."""
THRESHOLD_SHARE: Final = 0.4
"""Pixels that the adaptive threshold of a window averages, as a share of a marker's edge: one threshold finds 99.7 % of
the markers that OpenCV's three find, four times as fast; where it finds none, the three are tried."""
FLOOR_FRAMES: Final = 40
"""Whole frames whose floor corners are averaged, at most."""

Window = tuple[tuple[int, int], tuple[int, int]]
"""Left and top, right and bottom (exclusive), px."""


@dataclass(frozen=True)
class Detections:
    """What was seen of the markers in a video."""

    size_px: tuple[int, int]
    time_s: Floats
    """(frames,), from the first."""
    corners_px: Floats
    """(frames, robots, 4, 2): top left, top right, bottom right, bottom left of each marker; NaN: not seen."""
    floor_px: dict[int, Floats]
    """Of each floor marker that was seen, the median of its corners, (4, 2)."""
    whole_frames: int
    twice: tuple[tuple[int, int], ...] = ()
    """Frame and marker wherever a marker was seen twice, so that neither counted."""

    def edge_px(self) -> Floats:
        """Return the median edge of each robot's marker, (robots,); NaN: never seen."""
        edges = np.linalg.norm(np.roll(self.corners_px, -1, axis=2) - self.corners_px, axis=-1)
        seen = [of[~np.isnan(of)] for of in np.moveaxis(edges, 1, 0)]
        return np.array([np.median(of) if of.size else np.nan for of in seen])


def detect(
    path: Path,
    markers: Markers,
    *,
    partial: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Detections:
    """Find the markers of robots and floor in a video.

    Args:
        partial: whether a video that ends early is accepted. progress: called with frames done and frames in all.
    Raises:
        InputError: no video, or none of the robots is seen in it.
    """
    cv2 = opencv()
    info = video_info(path)
    finder = _Finder(cv2, markers)
    numbers = list(markers.robots)
    last: list[Floats | None] = [None] * len(numbers)
    moved = np.zeros((len(numbers), 2))
    times, found, whole_frames = [], [], 0
    floor: dict[int, list[Floats]] = {marker: [] for marker in markers.floor}
    twice: list[tuple[int, int]] = []
    for k, (time_s, picture) in enumerate(pictures_of(path, partial=partial)):
        here = np.full((len(numbers), 4, 2), np.nan)
        lost = any(corners is None for corners in last)
        if k % WHOLE_EVERY == 0 or (lost and k % LOST_EVERY == 0):
            whole_frames += 1
            seen = finder.everywhere(picture)
            for i, marker in enumerate(numbers):
                if marker in seen:
                    here[i] = seen[marker]
            for marker, corners in floor.items():
                if marker in seen and len(corners) < FLOOR_FRAMES:
                    corners.append(seen[marker])
        else:
            for i, marker in enumerate(numbers):
                box = _window(last[i], moved[i], info.size_px)
                if box is not None and (four := finder.in_window(picture, box, marker)) is not None:
                    here[i] = four
        for i in range(len(numbers)):
            now = None if np.isnan(here[i]).any() else here[i]
            before = last[i]
            moved[i] = (now - before).mean(axis=0) if now is not None and before is not None else 0.0
            last[i] = now
        twice += [(k, marker) for marker in dict.fromkeys(finder.twice)]
        finder.twice.clear()
        times.append(time_s)
        found.append(here)
        if progress is not None:
            progress(k + 1, max(info.frames, k + 1))
    corners_px = np.array(found)
    if np.isnan(corners_px).all():
        raise InputError(
            f"shows none of the robots' markers {numbers} (dictionary {markers.dictionary})", field=str(path)
        )
    return Detections(
        info.size_px,
        np.array(times),
        corners_px,
        {marker: np.median(corners, axis=0) for marker, corners in floor.items() if corners},
        whole_frames,
        tuple(twice),
    )


class _Finder:
    """OpenCV's detector, with one threshold where a marker should be and with three elsewhere.

    Corners are where lines through the pixels of a marker's edges meet: on 24 px they are five times as exact as
    corners that are refined one by one, which the squares inside a marker attract. OpenCV raises an error
    where it finds too few pixels of an edge, of very small markers: then corners are refined one by one after all.
    """

    def __init__(self, cv2: Any, markers: Markers) -> None:
        self._cv2, self._markers = cv2, markers
        self._all = self._detector()
        self._by_corner = self._detector(lines=False)
        self._one: dict[int, Any] = {}
        self.twice: list[int] = []
        """Markers that were seen twice in one picture since this was emptied."""

    def _detector(self, threshold_px: int | None = None, *, lines: bool = True) -> Any:
        aruco = self._cv2.aruco
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = (
            aruco.CORNER_REFINE_CONTOUR if lines else aruco.CORNER_REFINE_SUBPIX
        )
        parameters.cornerRefinementWinSize = 4
        parameters.relativeCornerRefinmentWinSize = 0.25
        if threshold_px is not None:
            parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = threshold_px
        return self._cv2.aruco.ArucoDetector(dictionary_of(self._markers), parameters)

    def everywhere(self, picture: Picture) -> dict[int, Floats]:
        """Return the corners, (4, 2), of each marker that is seen once."""
        return self._markers_in(self._all, grey(picture), (0, 0))

    def in_window(self, picture: Picture, window: Window, marker: int) -> Floats | None:
        """Return the corners, (4, 2), of a marker in a window, px of the picture; None if it is not seen once there."""
        (left, top), (right, bottom) = window
        cut = grey(np.ascontiguousarray(picture[top:bottom, left:right]))
        edge_px = min(right - left, bottom - top) / (1.0 + 2.0 * MARGIN)
        threshold_px = max(int(THRESHOLD_SHARE * edge_px) | 1, 5)
        if threshold_px not in self._one:
            self._one[threshold_px] = self._detector(threshold_px)
        for detector in (self._one[threshold_px], self._all):
            if (four := self._markers_in(detector, cut, (left, top)).get(marker)) is not None:
                return four
        return None

    def _markers_in(self, detector: Any, image: Gray, origin: tuple[int, int]) -> dict[int, Floats]:
        """Return the corners of each marker of an image whose first pixel is ``origin``; those seen twice are noted."""
        try:
            corners, ids, _ = detector.detectMarkers(image)
        except self._cv2.error:
            corners, ids, _ = self._by_corner.detectMarkers(image)
        if ids is None:
            return {}
        numbers = np.asarray(ids).ravel().tolist()
        self.twice += sorted({number for number in numbers if numbers.count(number) > 1})
        return {
            number: np.asarray(four, dtype=np.float64).reshape(4, 2) + origin
            for number, four in zip(numbers, corners, strict=True)
            if numbers.count(number) == 1
        }


def _window(corners: Floats | None, moved: Floats, size_px: tuple[int, int]) -> Window | None:
    """Return where a marker should be, from where it was in the last frame and how it moved.

    None if it was not seen there, or if less than 8 px of the window are in the picture.
    """
    if corners is None:
        return None
    edge = float(np.linalg.norm(corners[1] - corners[0]))
    margin = MARGIN * edge + float(np.abs(moved).max())
    low = np.floor(corners.min(axis=0) + moved - margin).astype(int)
    high = np.ceil(corners.max(axis=0) + moved + margin).astype(int) + 1
    low, high = np.maximum(low, 0), np.minimum(high, size_px)
    if (high - low < 8).any():
        return None
    return (int(low[0]), int(low[1])), (int(high[0]), int(high[1]))
