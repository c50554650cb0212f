"""Find ArUco markers in the frames of a video: in windows where robots should be, and at intervals in whole frames.

Searching small windows around the places of the last frame is fast. A whole frame is searched every ``WHOLE_EVERY``
frames, and every ``LOST_EVERY`` frames while a robot is lost. The floor's markers are searched in whole frames only.
"""

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
"""Interval, in frames, at which a whole frame is searched."""
LOST_EVERY: Final = 5
"""The same interval while a robot is lost, that is, was not seen in the last frame."""
MARGIN: Final = 0.9
"""Margin of a window around a marker, as a share of the marker's edge; the marker's movement between the last two
frames is added."""
THRESHOLD_SHARE: Final = 0.4
"""Width over which the adaptive threshold of a window averages, as a share of a marker's edge. By default OpenCV tries
three widths. This one width finds 99.7 % of the markers that the three find, in a quarter of the time. Where it finds
nothing, the three are tried."""
FLOOR_FRAMES: Final = 40
"""Most whole frames over which the corners of a floor marker are averaged (median)."""

Window = tuple[tuple[int, int], tuple[int, int]]
"""Left and top, right and bottom (exclusive), px."""


@dataclass(frozen=True)
class Detections:
    """What was seen of the markers in a video."""

    size_px: tuple[int, int]
    time_s: Floats
    """(frames,), from the first frame."""
    corners_px: Floats
    """(frames, robots, 4, 2): top left, top right, bottom right, bottom left of each marker; NaN: not seen."""
    floor_px: dict[int, Floats]
    """The median of the corners, (4, 2), of each floor marker that was seen, by its number."""
    whole_frames: int
    """Number of frames that were searched whole."""
    twice: tuple[tuple[int, int], ...] = ()
    """Frame and marker each time that a marker was seen at two places of a frame; neither place is used."""

    def edge_px(self) -> Floats:
        """Return the median length of the edges of each robot's marker, (robots,), px; NaN if it was never seen."""
        # (frames, robots, 4); NaN in frames in which a marker was not seen
        edges = np.linalg.norm(np.roll(self.corners_px, -1, axis=2) - self.corners_px, axis=-1)
        seen = [of_robot[~np.isnan(of_robot)] for of_robot in np.moveaxis(edges, 1, 0)]
        return np.array([np.median(of_robot) if of_robot.size else np.nan for of_robot in seen])


def detect(
    path: Path,
    markers: Markers,
    *,
    partial: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Detections:
    """Find the markers of robots and floor in a video.

    Args:
        partial: whether a video that ends early is accepted.
        progress: called after each frame with the number of frames done and the number of all frames.
    Returns: detections with robots in the order of ``markers.robots``.
    Raises:
        InputError: the file is no video or has no frames; it ends early, or does not state its number of frames, and
            ``partial`` is false; or no robot's marker is seen in it.
    """
    cv2 = opencv()
    info = video_info(path)
    finder = _Finder(cv2, markers)
    robot_markers = list(markers.robots)  # number of each robot's marker
    # The corners of each robot's marker in the last frame (None: lost), and its movement from the frame before, px.
    last: list[Floats | None] = [None] * len(robot_markers)
    moved = np.zeros((len(robot_markers), 2))
    times, found, whole_frames = [], [], 0
    # Corners of each floor marker in the whole frames in which it was seen.
    floor: dict[int, list[Floats]] = {marker: [] for marker in markers.floor}
    twice: list[tuple[int, int]] = []  # frame and marker
    for k, (time_s, picture) in enumerate(pictures_of(path, partial=partial)):
        here = np.full((len(robot_markers), 4, 2), np.nan)  # the corners in this frame
        lost = any(corners is None for corners in last)
        if k % WHOLE_EVERY == 0 or (lost and k % LOST_EVERY == 0):
            whole_frames += 1
            seen = finder.everywhere(picture)
            for i, marker in enumerate(robot_markers):
                if marker in seen:
                    here[i] = seen[marker]
            for marker, corners in floor.items():
                if marker in seen and len(corners) < FLOOR_FRAMES:
                    corners.append(seen[marker])
        else:
            for i, marker in enumerate(robot_markers):
                window = _window(last[i], moved[i], info.size_px)  # None for a robot that is lost
                if window is not None and (four := finder.in_window(picture, window, marker)) is not None:
                    here[i] = four
        for i in range(len(robot_markers)):
            now = None if np.isnan(here[i]).any() else here[i]
            before = last[i]
            # The movement is unknown unless the marker is seen in both frames: then 0 is taken.
            moved[i] = (now - before).mean(axis=0) if now is not None and before is not None else 0.0
            last[i] = now
        # Several windows of a frame may show the same marker twice; it is listed once per frame.
        twice += [(k, marker) for marker in dict.fromkeys(finder.twice)]
        finder.twice.clear()
        times.append(time_s)
        found.append(here)
        if progress is not None:
            progress(k + 1, max(info.frames, k + 1))  # the header of the video may state too few frames
    corners_px = np.array(found)
    if np.isnan(corners_px).all():
        raise InputError(
            f"shows none of the robots' markers {robot_markers} (dictionary {markers.dictionary})",
            field=str(path),
        )
    return Detections(
        size_px=info.size_px,
        time_s=np.array(times),
        corners_px=corners_px,
        floor_px={marker: np.median(corners, axis=0) for marker, corners in floor.items() if corners},
        whole_frames=whole_frames,
        twice=tuple(twice),
    )


class _Finder:
    """OpenCV's detector, with one threshold width in windows (three if that finds nothing), and three in whole frames.

    OpenCV can find corners in two ways: as the point where lines fitted to two edges of a marker meet, or by refining
    each corner by itself. Lines are used: with edges of 24 px, they give corners that are five times as exact, since
    the squares inside a marker attract corners that are refined by themselves. If an edge of a very small marker has
    too few pixels for a line, OpenCV raises an error; then each corner is refined by itself.
    """

    def __init__(self, cv2: Any, markers: Markers) -> None:
        self._cv2, self._markers = cv2, markers
        self._all = self._detector()  # with all three threshold widths
        self._by_corner = self._detector(lines=False)
        self._one: dict[int, Any] = {}  # detectors with a single threshold width, by this width
        self.twice: list[int] = []
        """Markers seen at two places of one image; the caller empties it after each frame."""

    def _detector(self, threshold_px: int | None = None, *, lines: bool = True) -> Any:
        """Return a detector of OpenCV.

        Args:
            threshold_px: width over which the adaptive threshold averages; None: OpenCV's three widths.
            lines: whether corners are the intersections of lines; if not, each is refined by itself.
        """
        aruco = self._cv2.aruco
        parameters = aruco.DetectorParameters()
        parameters.cornerRefinementMethod = (
            aruco.CORNER_REFINE_CONTOUR if lines else aruco.CORNER_REFINE_SUBPIX
        )
        # Only for corners that are refined by themselves: the window is 4 px, or a quarter of one of the small squares
        # of a marker (a module) if that is less.
        parameters.cornerRefinementWinSize = 4
        parameters.relativeCornerRefinmentWinSize = 0.25
        if threshold_px is not None:
            parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = threshold_px
        return self._cv2.aruco.ArucoDetector(dictionary_of(self._markers), parameters)

    def everywhere(self, picture: Picture) -> dict[int, Floats]:
        """Return the corners, (4, 2), px, of each marker that is seen in the picture, unless it is seen twice."""
        return self._markers_in(self._all, grey(picture), (0, 0))

    def in_window(self, picture: Picture, window: Window, marker: int) -> Floats | None:
        """Look for a marker in a window of a picture.

        Returns: its corners, (4, 2), px of the whole picture; None if it is not seen exactly once there, neither with
            one threshold width nor with three.
        """
        (left, top), (right, bottom) = window
        cut = grey(np.ascontiguousarray(picture[top:bottom, left:right]))
        # An estimate: a window is as wide as the marker's edge and two margins. It is wider if the marker is turned or
        # moves, and narrower if the picture's border cuts it.
        edge_px = min(right - left, bottom - top) / (1.0 + 2.0 * MARGIN)
        # ``| 1``: OpenCV needs an odd width. The minimum is for edges below 10 px, whose share is only 1 or 3 px.
        threshold_px = max(int(THRESHOLD_SHARE * edge_px) | 1, 5)
        if threshold_px not in self._one:
            self._one[threshold_px] = self._detector(threshold_px)
        # One width is tried first, since it is fast; all three are tried if it does not show the marker exactly once.
        for detector in (self._one[threshold_px], self._all):
            if (four := self._markers_in(detector, cut, (left, top)).get(marker)) is not None:
                return four
        return None

    def _markers_in(self, detector: Any, image: Gray, origin: tuple[int, int]) -> dict[int, Floats]:
        """Return the corners, (4, 2), px of the picture, of each marker that is seen exactly once in an image.

        Markers that are seen more than once are added to ``twice``.

        Args:
            image: the picture or a part of it. origin: pixel of the picture at the image's upper left corner.
        """
        try:
            corners, ids, _ = detector.detectMarkers(image)
        except self._cv2.error:  # an edge has too few pixels for a line
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
    """Return the window in which a marker should be if it moves as it did between the last two frames.

    Args:
        corners: corners of the marker in the last frame, (4, 2), px; None: it was not seen there.
        moved: its movement between the last two frames, (2,), px. size_px: width and height of the picture.
    Returns: None if the marker was not seen, or if less than 8 px of the window's width or height are in the picture.
    """
    if corners is None:
        return None
    edge = float(np.linalg.norm(corners[1] - corners[0]))
    # The window is moved by ``moved``. It is also enlarged by as much, since the robot may stop or turn.
    margin = MARGIN * edge + float(np.abs(moved).max())
    low = np.floor(corners.min(axis=0) + moved - margin).astype(int)
    high = np.ceil(corners.max(axis=0) + moved + margin).astype(int) + 1  # exclusive
    low, high = np.maximum(low, 0), np.minimum(high, size_px)
    if (high - low < 8).any():
        return None
    return (int(low[0]), int(low[1])), (int(high[0]), int(high[1]))
