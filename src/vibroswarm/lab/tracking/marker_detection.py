"""Find ArUco and AprilTag markers in the frames of a video: in windows where robots should be, else in whole frames.

Searching small windows around the places of the last frame is fast. A frame is searched whole if a robot is in none of
its windows, and every ``WHOLE_EVERY`` frames. So no marker is missed that OpenCV's detector, with its default settings,
sees in a whole frame. The floor's markers are searched in every ``WHOLE_EVERY``-th frame and in the last one only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibroswarm.core.arrays import Floats
from vibroswarm.lab.tracking import opencv
from vibroswarm.lab.tracking.markers import Markers, dictionary_of, first_corner
from vibroswarm.lab.tracking.video_file import Gray, frames_of, video_info

WHOLE_EVERY: Final = 75
"""Interval, in frames, at which a whole frame is searched."""
FLOOR_EVERY: Final = 5
"""The same interval until each marker of the floor was seen ``FLOOR_LEAST`` times."""
FLOOR_LEAST: Final = 8
"""See ``FLOOR_EVERY``."""
MARGIN: Final = 0.9
"""Margin of a window around a marker, as a share of the marker's edge; the marker's movement between the last two
frames is added."""
THRESHOLD_SHARE: Final = 0.4
"""Width over which the adaptive threshold of a window averages, as a share of a marker's edge. By default OpenCV tries
three widths. This one width finds 99.7 % of the markers that the three find, in a quarter of the time. Where it finds
nothing, the three are tried."""
ENLARGED_PX: Final = 30.0
"""A window that does not show a marker with a smaller edge is searched once more, enlarged twice."""
LEAST_ROUND: Final = 0.5
"""Least circumference of a marker in its window, as a share of the window's longer side; that of a robot that stands is
1.2 to 1.5. Looking into smaller figures, such as noise, would take most of the time."""
RIM: Final = 0.85
"""A rim is at least so white, from 0, a marker's black, to 1, its white."""

Window = tuple[tuple[int, int], tuple[int, int]]
"""Left and top, right and bottom (exclusive), px."""
Seen = dict[int, list[Floats]]
"""The corners, (4, 2), px, of each place at which each marker is seen, by its number."""


@dataclass(frozen=True)
class Detections:
    """What was seen of the markers in a video."""

    size_px: tuple[int, int]
    time_s: Floats
    corners_px: Floats
    """(frames, robots, 4, 2): top left, top right, bottom right, bottom left of each marker; NaN: not seen."""
    floor_seen: Mapping[int, Sequence[tuple[int, Floats]]]
    """Floor markers that were seen: frame and corners, (4, 2), px, of each time, by their numbers."""
    first_frame: Gray

    @property
    def have_rims(self) -> bool:
        """Whether the floor's markers have white rims, in the first frame."""
        return all(has_rim(self.first_frame, four) for four in self.floor_px.values())

    @cached_property
    def floor_px(self) -> dict[int, Floats]:
        """The median of the corners, (4, 2), of each floor marker that was seen, by its number."""
        return {
            marker: np.median([four for _, four in seen], axis=0) for marker, seen in self.floor_seen.items()
        }

    @cached_property
    def floor_spread(self) -> tuple[float, int]:
        """How far floor markers are from their medians, px, and the frame at which that is most.

        The shift of a frame is the median over markers, so that it is the camera that moves, not one of many markers.
        """
        by_frame: dict[int, list[float]] = {}
        for marker, seen in self.floor_seen.items():
            for frame, four in seen:
                shift = float(np.hypot(*(four - self.floor_px[marker]).mean(axis=0)))
                by_frame.setdefault(frame, []).append(shift)
        shifts = [(float(np.median(each)), frame) for frame, each in by_frame.items()]
        return max(shifts, default=(0.0, 0))

    def edge_px(self) -> Floats:
        """Return the median length of the edges of each robot's marker, (robots,), px; NaN if it was never seen."""
        # (robots, frames, 4); NaN in frames in which a marker was not seen
        edges = np.moveaxis(edge_lengths(self.corners_px), 1, 0)
        seen = [of_robot[~np.isnan(of_robot)] for of_robot in edges]
        return np.array([np.median(of_robot) if of_robot.size else np.nan for of_robot in seen])


def has_rim(picture: Gray, corners_px: Floats) -> bool:
    """Return whether a marker with these corners, (4, 2), is white around its black border."""
    cv2 = opencv()
    square = np.array([[12, 12], [60, 12], [60, 60], [12, 60]], dtype=np.float32)  # with a quarter around it
    turned = cv2.getPerspectiveTransform(corners_px.astype(np.float32), square)
    flat = cv2.warpPerspective(picture, turned, (72, 72), borderMode=cv2.BORDER_REPLICATE)
    around = np.concatenate([flat[6:9, 12:60], flat[63:66, 12:60], flat[12:60, 6:9].T, flat[12:60, 63:66].T])
    black, white = np.percentile(flat[12:60, 12:60], (5, 95))
    return bool(np.median(around) > black + RIM * (white - black))


def edge_lengths(corners: Floats) -> Floats:
    """Return the lengths of markers' edges, (..., 4), in the unit of their corners, (..., 4, 2)."""
    return np.asarray(np.linalg.norm(np.roll(corners, -1, axis=-2) - corners, axis=-1))


def detect(
    path: Path,
    markers: Markers,
    *,
    partial: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Detections:
    """Find the markers of robots, in the order of ``markers.robots``, and of the floor in a video.

    If a robot's marker is seen at two places of a frame, the one that moves is used while the other, such as a spare
    print, lies still; of two that move, or of two that lie still, the one nearer to the robot's path before and after.

    Args:
        partial: whether a video that ends early is accepted.
        progress: called after each frame with the number of frames done and the number of all frames.
    """
    size_px, _, frames = video_info(path)
    search, times = _Search(markers, size_px), []
    for k, (time_s, picture) in enumerate(frames_of(path, partial=partial)):
        search.look_at(k, picture)
        times.append(time_s)
        if progress is not None:
            progress(k + 1, max(frames, k + 1))  # the header of the video may state too few frames
    search.finish(k, picture)
    return Detections(
        size_px=size_px,
        time_s=np.array(times),
        corners_px=np.stack([_followed(_without_spare(places)) for places in search.places], axis=1),
        floor_seen={marker: seen for marker, seen in search.floor.items() if seen},
        first_frame=next(frames_of(path, partial=True))[1],
    )


class _Search:
    """Searches frame after frame for the markers, and remembers where they were."""

    def __init__(self, markers: Markers, size_px: tuple[int, int]) -> None:
        self._finder, self._size_px = _Finder(opencv(), markers), size_px
        self._robots = list(markers.robots)  # number of each robot's marker
        self.places: list[list[list[Floats]]] = [[] for _ in self._robots]
        """Corners of each robot's marker at each place of each frame."""
        # The corners of each robot's marker where it was seen last (None: never), and its movement to there, px.
        self._last: list[tuple[Floats, Floats] | None] = [None] * len(self._robots)
        self._doubled: set[int] = (
            set()
        )  # markers that were seen at several places: from then on looked for everywhere
        self.floor: dict[int, list[tuple[int, Floats]]] = {marker: [] for marker in markers.floor}
        """See ``Detections.floor_seen``; here also those that were not seen."""
        self._searched_for_all = -1

    def look_at(self, k: int, picture: Gray) -> None:
        """Find the robots' markers in frame ``k``, and at times all markers."""
        here: list[list[Floats]] = [[] for _ in self._robots]
        for i, marker in enumerate(self._robots):
            last = self._last[i]
            window = None if last is None else _window(*last, self._size_px)
            if window is not None:
                here[i] = self._finder.in_window(picture, window, marker)
        is_known = all(len(corners) >= FLOOR_LEAST for corners in self.floor.values())
        seen: Seen = {}
        if k % WHOLE_EVERY == 0 or (k % FLOOR_EVERY == 0 and not is_known):
            seen = self._search_for_all(k, picture)
        elif self._doubled or not all(here):
            seen = self._finder.listed_in(picture)
        for i, marker in enumerate(self._robots):
            everywhere = seen.get(marker, [])
            if len(everywhere) > 1:
                self._doubled.add(marker)
            if len(everywhere) > len(here[i]):
                here[i] = everywhere
            self.places[i].append(here[i])
            self._remember(i, k, here[i])

    def finish(self, k: int, picture: Gray) -> None:
        """Search the last frame for all markers, unless that was done: the camera may have been pushed since."""
        if k != self._searched_for_all:
            self._search_for_all(k, picture)

    def _search_for_all(self, k: int, picture: Gray) -> Seen:
        """Search the whole of frame ``k`` for all markers of the dictionary, and note those of the floor."""
        self._searched_for_all = k
        seen = self._finder.everywhere(picture)
        for marker, noted in self.floor.items():
            if len(places := seen.get(marker, [])) == 1:
                noted.append((k, places[0]))
        return seen

    def _remember(self, i: int, k: int, places: Sequence[Floats]) -> None:
        """Remember where a robot's marker is, and how it moved since the last frame (0 if it was not seen there)."""
        last = self._last[i]
        if places:
            now = places[0] if last is None else _nearest_to(last[0], places)
            was_seen = last is not None and k > 0 and self.places[i][k - 1]
            self._last[i] = now, (now - last[0]).mean(axis=0) if was_seen else np.zeros(2)  # type: ignore[index]  # None only if it was not seen
        elif last is not None:
            self._last[i] = last[0], np.zeros(2)


def _without_spare(places: Sequence[Sequence[Floats]]) -> Sequence[Sequence[Floats]]:
    """Leave out a print that lies still while another one of the same number moves.

    It lies where a marker is in nine of ten frames with several, and those elsewhere move by more than a marker's edge.
    """
    several = [own for own in places if len(own) > 1]
    if not several:
        return places
    middles = [np.array([four.mean(axis=0) for four in own]) for own in several]
    first = several[len(several) // 2]
    reach = 0.25 * float(edge_lengths(first[0]).mean())
    near = [[np.linalg.norm(own - four.mean(axis=0), axis=1) < reach for own in middles] for four in first]
    often = [int(sum(own.any() for own in each)) for each in near]
    still = int(np.argmax(often))
    moving = np.concatenate([own[~close] for own, close in zip(middles, near[still], strict=True)])
    is_still = often[still] > 0.9 * len(several) and often.count(often[still]) == 1
    if not is_still or float(np.ptp(moving, axis=0).max()) < 4.0 * reach:
        return places
    spare = first[still].mean(axis=0)
    return [[four for four in own if np.linalg.norm(four.mean(axis=0) - spare) >= reach] for own in places]


def _followed(places: Sequence[Sequence[Floats]]) -> Floats:
    """Return a marker's corners in each frame, (frames, 4, 2), px: of several those nearest to its path; NaN: none.

    The path begins where the marker is seen at a single place.
    """
    found = np.full((len(places), 4, 2), np.nan)
    first = next((k for k, own in enumerate(places) if len(own) == 1), None)
    if first is None:
        return found
    for frames in (range(first, len(places)), range(first - 1, -1, -1)):
        last = places[first][0]
        for k in frames:
            if places[k]:
                last = found[k] = _nearest_to(last, places[k])
    return found


class _Finder:
    """Looks for markers in whole frames and in windows; the fewer markers are listed, the faster."""

    def __init__(self, cv2: Any, markers: Markers) -> None:
        self._cv2 = cv2
        of_listed = partial(_Detector, cv2, markers.dictionary, [*markers.robots, *markers.floor])
        self.everywhere = _Detector(cv2, markers.dictionary).markers_in
        self.listed_in = of_listed().markers_in
        self._careful = of_listed(least_round=LEAST_ROUND)
        # The detector with a single threshold width, by this width.
        self._quick = cache(lambda width_px: of_listed(threshold_px=width_px, least_round=LEAST_ROUND))

    def in_window(self, picture: Gray, window: Window, marker: int) -> list[Floats]:
        """Return a marker's corners, (4, 2), px of the whole picture, at each place where it is seen in a window.

        It is looked for with one threshold width; else with three, in the window as it is or, if small, enlarged.
        """
        (left, top), (right, bottom) = window
        cut = np.ascontiguousarray(picture[top:bottom, left:right])
        # An estimate: a window is as wide as the marker's edge and two margins. It is wider if the marker is turned or
        # moves, and narrower if the picture's border cuts it.
        edge_px = min(right - left, bottom - top) / (1.0 + 2.0 * MARGIN)
        # ``| 1``: OpenCV needs an odd width. The minimum is for edges below 10 px, whose share is only 1 or 3 px.
        threshold_px = max(int(THRESHOLD_SHARE * edge_px) | 1, 5)
        places = self._quick(threshold_px).markers_in(cut).get(marker, [])
        if len(places) != 1 and edge_px >= ENLARGED_PX:
            places = self._careful.markers_in(cut).get(marker, [])
        elif not places:
            large = self._cv2.resize(cut, None, fx=2, fy=2, interpolation=self._cv2.INTER_CUBIC)
            # The centre of a pixel has whole coordinates, so pixel 0 becomes the pixels 0 and 1, with centre 0.5.
            places = [(four - 0.5) / 2.0 for four in self._careful.markers_in(large).get(marker, [])]
        return [four + np.array([left, top]) for four in places]


class _Detector:
    """OpenCV's detector of the markers of a dictionary, or of some of them.

    Corners are where lines fitted to two edges of a marker meet: with edges of 24 px this is five times as exact as
    refining each corner by itself, since the squares inside a marker attract corners. If an edge of a very small
    marker has too few pixels for a line, OpenCV raises an error; then each corner is refined by itself.
    """

    def __init__(
        self,
        cv2: Any,
        dictionary: str,
        listed: Sequence[int] | None = None,
        *,
        threshold_px: int | None = None,
        least_round: float | None = None,
    ) -> None:
        """Prepare a detector.

        Args:
            listed: numbers of the markers that are looked for; None: all of the dictionary.
            threshold_px: width over which the adaptive threshold averages; None: OpenCV's three widths.
            least_round: least circumference of a marker, as a share of the image's longer side.
        """
        self._cv2, self._first_corner = cv2, first_corner(dictionary)
        whole = dictionary_of(dictionary)
        self._ids = range(len(whole.bytesList)) if listed is None else listed
        chosen = np.ascontiguousarray(whole.bytesList[list(self._ids)])
        of_these = cv2.aruco.Dictionary(chosen, whole.markerSize, whole.maxCorrectionBits)
        parameters = cv2.aruco.DetectorParameters()
        if threshold_px is not None:
            parameters.adaptiveThreshWinSizeMin = parameters.adaptiveThreshWinSizeMax = threshold_px
        if least_round is not None:
            parameters.minMarkerPerimeterRate = least_round
        # Only for corners that are refined by themselves: the window is 4 px, or a quarter of one of the small squares
        # of a marker (a module) if that is less.
        parameters.cornerRefinementWinSize = 4
        parameters.relativeCornerRefinmentWinSize = 0.25
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        self._by_lines = cv2.aruco.ArucoDetector(of_these, parameters)
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._by_corner = cv2.aruco.ArucoDetector(of_these, parameters)

    def markers_in(self, image: Gray) -> Seen:
        """Return the corners of each marker at each place at which it is seen in an image."""
        try:
            corners, places, _ = self._by_lines.detectMarkers(image)
        except self._cv2.error:  # an edge has too few pixels for a line
            corners, places, _ = self._by_corner.detectMarkers(image)
        found: Seen = {}
        for place, four in zip([] if places is None else np.asarray(places).ravel(), corners, strict=True):
            in_order = np.roll(np.asarray(four, dtype=np.float64).reshape(4, 2), -self._first_corner, axis=0)
            found.setdefault(self._ids[int(place)], []).append(in_order)
        return found


def _nearest_to(at: Floats, places: Sequence[Floats]) -> Floats:
    """Return the place whose middle is nearest to that of ``at``; all are corners, (4, 2), px."""
    return min(places, key=lambda four: float(np.hypot(*(four - at).mean(axis=0))))


def _window(corners: Floats, moved: Floats, size_px: tuple[int, int]) -> Window | None:
    """Return the window in which a marker should be if it moves again as it did; None: hardly in the picture."""
    edge = float(np.linalg.norm(corners[1] - corners[0]))
    # The window is moved by ``moved``. It is also enlarged by as much, since the robot may stop or turn.
    margin = MARGIN * edge + float(np.abs(moved).max())
    low = np.floor(corners.min(axis=0) + moved - margin).astype(int)
    high = np.ceil(corners.max(axis=0) + moved + margin).astype(int) + 1  # exclusive
    low, high = np.maximum(low, 0), np.minimum(high, size_px)
    if (high - low < 8).any():
        return None
    return (int(low[0]), int(low[1])), (int(high[0]), int(high[1]))
