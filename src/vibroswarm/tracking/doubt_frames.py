"""Pictures of doubtful moments, cut from a video in a second pass: a bounded number of small ones."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.tracking import opencv
from vibroswarm.tracking.doubts import Doubt, place_px
from vibroswarm.tracking.stitch import Stitched
from vibroswarm.tracking.track import Tracking
from vibroswarm.tracking.video_file import frames_at

Gray = NDArray[np.uint8]

FRAMES_UP_TO: Final = 40
"""Pictures of one page."""
OF_A_KIND: Final = 4
"""Doubts of one kind that are shown before the next kind has its turn."""
WIDE: Final = 8.0
"""Side of the picture in edges of a marker."""
LEAST_PX: Final = 96
SHOWN_PX: Final = 300
"""Side of the picture as it is saved."""
QUALITY: Final = 82


class Shot(NamedTuple):
    """A picture of a doubtful moment."""

    doubt: int
    """Which doubt, of those given."""
    words: str
    jpeg: bytes

    @property
    def address(self) -> str:
        """The picture as a data URI."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


def chosen(doubts: Sequence[Doubt], most: int = FRAMES_UP_TO) -> list[int]:
    """Return the indices of the doubts that get pictures: a few of each kind first, then more up to ``most``."""
    ranks: list[tuple[int, int]] = []
    counts: Counter[str] = Counter()
    for number, doubt in enumerate(doubts):
        if doubt.shots:
            ranks.append((counts[doubt.kind] // OF_A_KIND, number))
            counts[doubt.kind] += 1
    found, left = [], most
    for _, number in sorted(ranks):
        if len(doubts[number].shots) <= left:
            left -= len(doubts[number].shots)
            found.append(number)
    return sorted(found)


def shots_of(session: Stitched, doubts: Sequence[Doubt], most: int = FRAMES_UP_TO) -> list[Shot]:
    """Cut the pictures of doubts out of the videos, in the order of the doubts.

    Only the pictures are held in memory. A video that can no longer be read gives none.
    """
    numbers = chosen(doubts, most)
    cut: dict[tuple[int, int], Shot] = {}
    for place, camera in enumerate(session.cameras):
        own = [number for number in numbers if doubts[number].camera == place]
        cut |= _cuts_of(camera, doubts, own, f" of {camera.video.name}" if len(session.cameras) > 1 else "")
    return [cut[key] for key in sorted(cut)]


def _cuts_of(
    tracking: Tracking, doubts: Sequence[Doubt], numbers: Sequence[int], name: str
) -> dict[tuple[int, int], Shot]:
    """Return the pictures of one camera by the indices of doubt and shot; none if the video cannot be read."""
    time_s = tracking.detections.time_s
    wanted: dict[int, list[tuple[int, int]]] = {}
    for number in numbers:
        for k, (at_s, _) in enumerate(doubts[number].shots):
            wanted.setdefault(int(np.argmin(np.abs(time_s - at_s))), []).append((number, k))
    cut: dict[tuple[int, int], Shot] = {}
    try:
        for frame, picture in frames_at(tracking.video, wanted):
            for number, k in wanted[frame]:
                doubt = doubts[number]
                jpeg = _cut(tracking, doubt, doubt.shots[k][0], picture)
                if jpeg is not None:
                    words = f"{time_s[frame]:.1f} s{name}, {doubt.shots[k][1]}"
                    cut[number, k] = Shot(number, words, jpeg)
    except InputError:
        return {}
    return cut


def _cut(tracking: Tracking, doubt: Doubt, at_s: float, picture: Gray) -> bytes | None:
    """Return a square of the picture as JPEG, with a ring where the robot or marker is or was.

    None if the doubt has no place in the picture, or the JPEG cannot be written.
    """
    cv2: Any = opencv()
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
    left, top = (
        int(np.clip(round(at[axis] - side / 2), 0, room - side)) for axis, room in ((0, width), (1, height))
    )
    scale = SHOWN_PX / side
    piece = cv2.resize(
        picture[top : top + side, left : left + side],
        (SHOWN_PX, SHOWN_PX),
        interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC,
    )
    middle = (round((at[0] - left + 0.5) * scale), round((at[1] - top + 0.5) * scale))
    radius = max(round(1.1 * edge * scale), 8)
    for colour, thick in ((0, 4), (255, 2)):
        cv2.circle(piece, middle, radius, colour, thick, cv2.LINE_AA)
    written, coded = cv2.imencode(".jpg", piece, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(coded) if written else None
