"""Small pictures of doubtful moments in a tracking (see ``doubts``), cut out of the video in a second pass.

A doubt has up to three *shots*, which are moments that show it: "seen last", "in between", "seen again". Each shot of a
chosen doubt becomes a picture; their number is limited.
"""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from vibroswarm.core.numbers import number
from vibroswarm.errors import InputError
from vibroswarm.tracking import opencv
from vibroswarm.tracking.doubts import Doubt, place_px
from vibroswarm.tracking.track import Tracking
from vibroswarm.tracking.video_file import Gray, frames_at

FRAMES_UP_TO: Final = 40
"""Most pictures of one page."""
OF_A_KIND: Final = 4
"""Number of doubts of each kind that are chosen in one round."""
WIDE: Final = 8.0
"""Side of the square that is cut out, in edges of a marker."""
LEAST_PX: Final = 96
"""Smallest side of this square, px of the video."""
SHOWN_PX: Final = 300
"""Side of the picture as it is saved, px."""
QUALITY: Final = 82
"""Quality of the JPEG, 0 to 100."""


class Shot(NamedTuple):
    """A picture of a doubtful moment."""

    doubt: int
    """Index of the doubt in the given list."""
    words: str
    """Time and description."""
    jpeg: bytes

    @property
    def address(self) -> str:
        """The picture as a data URI."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


def chosen(doubts: Sequence[Doubt], most: int = FRAMES_UP_TO) -> list[int]:
    """Return the indices of the doubts that get pictures, ascending.

    Doubts are chosen in rounds, so that all kinds have pictures: the first ``OF_A_KIND`` doubts of each kind, then the
    next ``OF_A_KIND`` of each kind, and so on. A doubt is left out if it has no shots, or if its shots would make more
    than ``most`` pictures in all.
    """
    rounds: list[tuple[int, int]] = []  # for each doubt: the round in which it is chosen, and its index
    counts: Counter[str] = Counter()
    for place, doubt in enumerate(doubts):
        if doubt.shots:
            rounds.append((counts[doubt.kind] // OF_A_KIND, place))
            counts[doubt.kind] += 1
    found, left = [], most  # ``left``: how many more pictures are allowed
    for _, place in sorted(rounds):
        if len(doubts[place].shots) <= left:
            left -= len(doubts[place].shots)
            found.append(place)
    return sorted(found)


def shots_of(tracking: Tracking, doubts: Sequence[Doubt], most: int = FRAMES_UP_TO) -> list[Shot]:
    """Cut the pictures of the chosen doubts out of the video.

    Only the cut pictures are held in memory, not the frames. A video that can no longer be read gives no pictures.

    Returns: at most ``most`` pictures, in the order of the doubts and their shots.
    """
    time_s = tracking.detections.time_s
    # For each frame to cut from: indices of doubt and shot. A shot is cut from the frame nearest in time.
    wanted: dict[int, list[tuple[int, int]]] = {}
    for place in chosen(doubts, most):
        for k, (at_s, _) in enumerate(doubts[place].shots):
            wanted.setdefault(int(np.argmin(np.abs(time_s - at_s))), []).append((place, k))
    cut: dict[tuple[int, int], Shot] = {}
    try:
        for frame, picture in frames_at(tracking.video, wanted):
            for place, k in wanted[frame]:
                doubt = doubts[place]
                jpeg = _cut(tracking, doubt, doubt.shots[k][0], picture)
                if jpeg is not None:
                    words = f"{number(time_s[frame], 1)} s, {doubt.shots[k][1]}"
                    cut[place, k] = Shot(place, words, jpeg)
    except InputError:
        return []
    return [cut[key] for key in sorted(cut)]


def _cut(tracking: Tracking, doubt: Doubt, at_s: float, picture: Gray) -> bytes | None:
    """Cut a square out of a frame, with a ring around the place of the doubt.

    The place is given by the doubt, or else it is where the doubt's robot was seen nearest in time.

    Args:
        at_s: time of the shot, s. picture: the frame nearest to it in time.
    Returns: the square as JPEG; None if the doubt has no place in the frame, or the JPEG cannot be written.
    """
    cv2: Any = opencv()
    # Edge of a floor marker, px, estimated from the edges of robots' markers. If the place is a robot's, the edge of
    # the robot's marker replaces it below.
    edge = (
        tracking.markers.floor_size_m
        / tracking.markers.size_m
        * float(np.nanmedian(tracking.detections.edge_px()))
    )
    at = None if doubt.at_px is None else np.array(doubt.at_px)
    if at is None and doubt.robot is not None:
        found = place_px(tracking, doubt.robot, at_s)
        if found is not None:
            at, edge = found
    if at is None:
        return None
    height, width = picture.shape[:2]
    side = int(min(max(WIDE * edge, LEAST_PX), height, width))
    # The square has the place in its middle, unless it would then extend beyond the frame.
    left, top = (
        int(np.clip(round(at[axis] - side / 2), 0, room - side)) for axis, room in ((0, width), (1, height))
    )
    scale = SHOWN_PX / side  # saved px per px of the video; areas are averaged if it is below 1
    piece = cv2.resize(
        picture[top : top + side, left : left + side],
        (SHOWN_PX, SHOWN_PX),
        interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC,
    )
    # The place in the resized square; 0.5, since the centre of a pixel is half a pixel from its border.
    middle = (round((at[0] - left + 0.5) * scale), round((at[1] - top + 0.5) * scale))
    radius = max(round(1.1 * edge * scale), 8)  # around the whole marker, and large enough to be seen
    for colour, thick in ((0, 4), (255, 2)):  # a white ring with a black border, to be seen on any floor
        cv2.circle(piece, middle, radius, colour, thick, cv2.LINE_AA)
    written, coded = cv2.imencode(".jpg", piece, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(coded) if written else None
