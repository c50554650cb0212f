"""Write and read videos, and refuse those that cannot be trusted."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError, RunError
from vibroswarm.tracking import opencv

Gray = NDArray[np.uint8]
"""(height, width)."""
Picture = NDArray[np.uint8]
"""(height, width, 3) as it was decoded, or (height, width)."""

CODECS: Final = {".avi": "MJPG", ".mp4": "mp4v"}
"""By suffix; both are in OpenCV's own wheel."""
QUALITY: Final = 92
MISSING_FRAMES: Final = 2
"""Containers miscount by a frame or two; more are missing."""
UNEVEN: Final = 0.2
"""A step between frames that differs by this share from the usual one is uneven."""


def check_suffix(path: Path, field: str = "--out") -> None:
    """Refuse a name of a video whose suffix names no codec.

    Raises:
        InputError: it does not end in .avi or .mp4.
    """
    if path.suffix.lower() not in CODECS:
        raise InputError(f"'{path.name}' must end in {' or '.join(CODECS)}", field=field)


class VideoWriter:
    """Writes grey frames; a context manager."""

    def __init__(self, path: Path, size_px: tuple[int, int], frames_per_s: float) -> None:
        cv2 = opencv()
        check_suffix(path)
        code = cv2.VideoWriter_fourcc(*CODECS[path.suffix.lower()])
        self._writer = cv2.VideoWriter(str(path), code, frames_per_s, size_px)
        if not self._writer.isOpened():
            raise RunError(f"the video '{path}' cannot be written")
        self._writer.set(cv2.VIDEOWRITER_PROP_QUALITY, QUALITY)

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.release()

    def write(self, frame: Gray) -> None:
        """Write a frame, uint8 of shape (height, width)."""
        cv2 = opencv()
        self._writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))


@dataclass(frozen=True)
class VideoInfo:
    """What a video's head states."""

    path: Path
    width_px: int
    height_px: int
    frames_per_s: float
    frames: int
    """As stated; 0: not stated."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        return self.width_px, self.height_px


def _opened(path: Path) -> Any:
    cv2 = opencv()
    name = str(path)
    if not path.exists():
        raise InputError("does not exist", field=name)
    if path.is_dir():
        raise InputError("is a folder; give a video", field=name)
    if not path.is_file():
        raise InputError("is not a file", field=name)
    if path.stat().st_size == 0:
        raise InputError("is empty: 0 bytes; copy it from the camera again", field=name)
    logging = cv2.utils.logging
    level = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)  # what is wrong is said below
    try:
        # One thread: the work is divided by video, and results must not depend on processors.
        capture = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    finally:
        logging.setLogLevel(level)
    if not capture.isOpened():
        raise InputError(
            "cannot be read as a video: it is damaged, cut off before its index was written, or no video; "
            "copy it from the camera again, or convert it: ffmpeg -i IN -c:v mjpeg -q:v 3 OUT.avi",
            field=name,
        )
    return capture


def video_info(path: Path) -> VideoInfo:
    """Return what the head of a video states.

    Raises:
        InputError: no video, or one without frames.
    """
    cv2 = opencv()
    capture = _opened(path)
    width, height = (int(capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if capture.get(cv2.CAP_PROP_ORIENTATION_AUTO) and int(capture.get(cv2.CAP_PROP_ORIENTATION_META)) % 180:
        width, height = _size_of_first(capture, path)
    frames, rate = capture.get(cv2.CAP_PROP_FRAME_COUNT), capture.get(cv2.CAP_PROP_FPS)
    capture.release()
    if width < 16 or height < 16 or not 0.5 <= rate <= 2000:
        raise InputError(
            f"is not a usable video: {width} x {height} px at {rate:g} frames/s", field=str(path)
        )
    return VideoInfo(path, width, height, rate, max(int(frames), 0))


def _size_of_first(capture: Any, path: Path) -> tuple[int, int]:
    """Return the size of the first frame as it is shown, which is turned by the file's orientation."""
    read, frame = capture.read()
    if not read:
        raise InputError("has no frames", field=str(path))
    return frame.shape[1], frame.shape[0]


def grey(picture: Picture) -> Gray:
    """Return a picture, or a part of one, as brightness."""
    cv2 = opencv()
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)) if picture.ndim == 3 else picture


def frames_of(path: Path, *, partial: bool = False) -> Iterator[tuple[float, Gray]]:
    """Yield the time (s, from the first frame) and the picture of each frame, grey; as ``pictures_of``."""
    return ((time_s, grey(picture)) for time_s, picture in pictures_of(path, partial=partial))


def pictures_of(path: Path, *, partial: bool = False) -> Iterator[tuple[float, Picture]]:
    """Yield the time (s, from the first frame) and the picture of each frame.

    Args:
        partial: whether a video that ends early is accepted.
    Raises:
        InputError: no frames, fewer than the file's head states, or a head that states none.
    """
    cv2 = opencv()
    info = video_info(path)
    if info.frames == 0 and not partial:
        raise InputError(
            "states neither its length nor its number of frames: its head is damaged, or it was cut off. Times are "
            f"then a guess ({info.frames_per_s:g} frames/s); copy it again, or add --partial to use it as it is",
            field=str(path),
        )
    capture = _opened(path)
    count, first_s, last_s = 0, 0.0, -1.0
    try:
        while True:
            read, frame = capture.read()
            if not read:
                break
            time_s = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000.0
            if count == 0:
                first_s = time_s
            time_s -= first_s
            if time_s <= last_s:  # some containers have no times of their own
                time_s = last_s + 1.0 / info.frames_per_s
            last_s = time_s
            count += 1
            yield time_s, frame
    finally:
        capture.release()
    if count == 0:
        raise InputError("has no frames that can be decoded: it is empty or damaged", field=str(path))
    if not partial and count < info.frames - MISSING_FRAMES:
        raise InputError(
            f"ends after {count} of {info.frames} frames ({last_s:.1f} s): it is truncated or damaged; copy it again, "
            "or add --partial to use what is there",
            field=str(path),
        )


def frames_at(path: Path, numbers: Iterable[int]) -> Iterator[tuple[int, Gray]]:
    """Yield some frames: their number, from 0 as ``frames_of`` counts them, and picture; missing ones are left out.

    The others are skipped without converting them, and only one picture is held at a time.
    """
    cv2 = opencv()
    wanted = sorted(set(numbers))
    capture = _opened(path)
    at = 0
    try:
        for number in wanted:
            while at < number and capture.grab():
                at += 1
            if at < number:
                return
            read, frame = capture.read()
            if not read:
                return
            at += 1
            yield number, cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) if frame.ndim == 3 else frame
    finally:
        capture.release()


def uneven_frames(time_s: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """Return the share of uneven steps between frames, the shortest and the longest step, s.

    None if all are even, or with fewer than three frames.
    """
    steps = np.diff(time_s)
    if steps.size < 2:
        return None
    usual = float(np.median(steps))
    odd = np.abs(steps - usual) > UNEVEN * usual
    return (float(odd.mean()), float(steps.min()), float(steps.max())) if odd.any() else None


Progress = Callable[[int, int], None]
"""Called with frames done and frames in all."""
