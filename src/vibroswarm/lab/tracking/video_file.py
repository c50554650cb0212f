"""Read videos, and refuse files that are damaged, cut off or no videos.

OpenCV does not compare the size, rate and number of frames that a file's head states with the frames that follow it. So
the number of frames that were read is compared here, to find out whether a file was cut off.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.untrusted_files import check_plain
from vibroswarm.errors import InputError
from vibroswarm.lab.tracking import opencv

Gray = NDArray[np.uint8]
"""(height, width): brightness."""
MISSING_FRAMES: Final = 2
"""The head of an intact file may state a frame or two too many; if more are missing, the video was cut off."""
LARGEST_BYTES: Final = 2**40
"""Size limit of a video."""


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    cv2 = opencv()
    check_plain(path, LARGEST_BYTES, "a video")
    # One thread, since results must not depend on the number of processors; videos may be read in parallel.
    # ``resolve``: in a relative path such as "a:b.avi", FFmpeg takes "a:" for a protocol.
    capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    if not capture.isOpened():
        raise InputError(
            "cannot be read as a video: it is empty, damaged, cut off before its index was written, or not a video; "
            "copy it from the camera again, or convert it: ffmpeg -i IN -c:v mjpeg -q:v 3 OUT.avi",
            field=str(path),
        )
    try:
        yield capture
    finally:
        capture.release()


def video_info(path: Path) -> tuple[tuple[int, int], float, int]:
    """Return width and height of a video, px, frames per second, and the number of frames (0: its head states none)."""
    cv2 = opencv()
    with _opened(path) as capture:
        frames, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
        # The head of a video that was taken upright may state the size before frames are turned, so one is read.
        is_there, picture = capture.read()
    if not is_there:
        raise InputError("has no frames that can be decoded: it is empty or damaged", field=str(path))
    height, width = picture.shape[:2]
    if width < 16 or height < 16 or not 0.5 <= rate <= 2000:
        raise InputError(
            f"is not a usable video: {width} x {height} px at {rate:g} frames/s", field=str(path)
        )
    return (width, height), rate, max(int(frames), 0)  # a damaged head may give a negative number


def frames_of(path: Path, *, partial: bool = False) -> Iterator[tuple[float, Gray]]:
    """Yield the time (s, from the first frame) and the grey picture of each frame.

    ``partial``: whether a video that ends early, or does not state its number of frames, is accepted.
    """
    cv2 = opencv()
    _, rate, frames = video_info(path)
    if frames == 0 and not partial:
        raise InputError(
            "states neither its length nor its number of frames: its head is damaged, or it was cut off. Times are "
            f"then a guess ({rate:g} frames/s); copy it again, or add --partial to use it as it is",
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
                time_s = last_s + 1.0 / rate
            last_s = time_s
            count += 1
            frame = picture[1]
            yield time_s, np.asarray(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)) if frame.ndim == 3 else frame
    if not partial and count < frames - MISSING_FRAMES:
        raise InputError(
            f"ends after {count} of {frames} frames ({last_s:.1f} s): it is truncated or damaged; copy it again, "
            "or add --partial to use what is there (also if the camera left out frames: MKV, WebM and TS state a "
            "length, from which their number of frames is computed)",
            field=str(path),
        )
