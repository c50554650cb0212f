"""Read videos, and refuse files that are damaged, cut off or no videos.

A picture is a frame as it was decoded; a grey picture is its brightness. A file's head (its header) states size, rate
and number of frames. OpenCV does not compare the head with the frames that follow it. So the number of frames that were
read is compared here with what the head states, to find out whether a file was cut off.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.untrusted_files import check_plain
from vibroswarm.errors import InputError
from vibroswarm.lab.tracking import opencv

Gray = NDArray[np.uint8]
"""(height, width)."""
Picture = NDArray[np.uint8]
"""(height, width, 3) as it was decoded, or (height, width)."""

MISSING_FRAMES: Final = 2
"""The head of an intact file may state a frame or two too many; if more are missing, the video was cut off."""
LARGEST_BYTES: Final = 2**40
"""Size limit of a video."""


class VideoInfo(NamedTuple):
    """What a video's head states."""

    size_px: tuple[int, int]
    """Width and height."""
    frames_per_s: float
    frames: int
    """Number of frames; 0 if the head states none."""


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a video, yield OpenCV's ``VideoCapture``, and release it.

    Raises:
        InputError: it does not exist, is a folder or no plain file, is empty, or cannot be read as a video.
    """
    cv2 = opencv()
    name = str(path)
    check_plain(path, LARGEST_BYTES, "a video")
    if path.stat().st_size == 0:
        raise InputError("is empty: 0 bytes; copy it from the camera again", field=name)
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    # OpenCV's own messages are switched off, since a problem is reported below.
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        # One thread, since results must not depend on the number of processors; videos may be read in parallel.
        # ``resolve``: in a relative path such as "a:b.avi", FFmpeg takes "a:" for a protocol.
        capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    finally:
        logging.setLogLevel(level)
    if not capture.isOpened():
        raise InputError(
            "cannot be read as a video: it is damaged, cut off before its index was written, or not a video; "
            "copy it from the camera again, or convert it: ffmpeg -i IN -c:v mjpeg -q:v 3 OUT.avi",
            field=name,
        )
    try:
        yield capture
    finally:
        capture.release()


def video_info(path: Path) -> VideoInfo:
    """Return what the head of a video states; the size is that of its frames as they are shown.

    Raises:
        InputError: it is no video, states a size or rate that is not usable, or is a turned video without frames. Other
            videos without frames are not refused here.
    """
    cv2 = opencv()
    with _opened(path) as capture:
        width, height = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        # The head of a video that was taken upright may state the size before the frames are turned. Then the size is
        # that of the first frame, which is turned when it is read.
        is_turned = int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 180 != 0
        if capture.get(cv2.CAP_PROP_ORIENTATION_AUTO) and is_turned:
            read, frame = capture.read()
            if not read:
                raise InputError("has no frames", field=str(path))
            height, width = frame.shape[:2]
        frames, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
    if width < 16 or height < 16 or not 0.5 <= rate <= 2000:
        raise InputError(
            f"is not a usable video: {width} x {height} px at {rate:g} frames/s", field=str(path)
        )
    # A damaged head may give a negative number of frames; 0 means that the number is not known.
    return VideoInfo((width, height), rate, max(int(frames), 0))


def grey(picture: Picture) -> Gray:
    """Convert a picture, or a part of a picture, to brightness; a grey picture is returned as it is."""
    cv2 = opencv()
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) if picture.ndim == 3 else picture


def frames_of(path: Path, *, partial: bool = False) -> Iterator[tuple[float, Gray]]:
    """Yield the time (s, from the first frame) and the grey picture of each frame, see ``pictures_of``."""
    return ((time_s, grey(picture)) for time_s, picture in pictures_of(path, partial=partial))


def pictures_of(path: Path, *, partial: bool = False) -> Iterator[tuple[float, Picture]]:
    """Yield the time (s, from the first frame) and the picture of each frame.

    Args:
        partial: whether a video that ends early is accepted.
    Raises:
        InputError: the video has no frames, or see ``video_info``. Unless ``partial`` is true, also if its head states
            no number of frames, or if more than ``MISSING_FRAMES`` of the frames that it states are missing; missing
            frames are reported only after the last frame.
    """
    cv2 = opencv()
    info = video_info(path)
    if info.frames == 0 and not partial:
        raise InputError(
            "states neither its length nor its number of frames: its head is damaged, or it was cut off. Times are "
            f"then a guess ({info.frames_per_s:g} frames/s); copy it again, or add --partial to use it as it is",
            field=str(path),
        )
    # ``last_s`` is the time of the frame before; it is below 0 before the first frame, whose time is 0.
    count, first_s, last_s = 0, 0.0, -1.0
    with _opened(path) as capture:
        while (picture := capture.read())[0]:
            time_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
            if count == 0:
                first_s = time_s
            time_s -= first_s
            if time_s <= last_s:  # some files have no times of frames: they are computed from the rate
                time_s = last_s + 1.0 / info.frames_per_s
            last_s = time_s
            count += 1
            yield time_s, picture[1]
    if count == 0:
        raise InputError("has no frames that can be decoded: it is empty or damaged", field=str(path))
    if not partial and count < info.frames - MISSING_FRAMES:
        raise InputError(
            f"ends after {count} of {info.frames} frames ({last_s:.1f} s): it is truncated or damaged; copy it again, "
            "or add --partial to use what is there (also if the camera left out frames: MKV, WebM and TS state a "
            "length, from which their number of frames is computed)",
            field=str(path),
        )
