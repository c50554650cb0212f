"""Write grey frames to a video."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Final

from vibroswarm.errors import RunError
from vibroswarm.lab.tracking import opencv
from vibroswarm.lab.tracking.video_file import Gray

CODECS: Final = {".avi": "MJPG", ".mp4": "mp4v"}
"""The codec of a video that is written, by its suffix; both are in OpenCV's own wheel."""
QUALITY: Final = 92
"""Quality that OpenCV is to use for the video, 0 to 100; OpenCV's FFmpeg backend ignores it."""


class VideoWriter:
    """Context manager that writes grey frames to a video.

    Args:
        size_px: width and height of the frames.
    Raises:
        RunError: the file cannot be written.
    """

    def __init__(self, path: Path, size_px: tuple[int, int], frames_per_s: float) -> None:
        cv2 = opencv()
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
        """Write a frame, uint8 of shape (height, width).

        The frame must have the writer's size: OpenCV leaves out other frames without an error.
        """
        cv2 = opencv()
        self._writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
