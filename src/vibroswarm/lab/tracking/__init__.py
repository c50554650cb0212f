"""Videos of an overhead camera: rendered from a result, and tracked into a recording.

OpenCV, which only this package needs (extra ``video``), is reached through ``opencv``.
"""

from __future__ import annotations

import os
from functools import cache
from typing import Any

from vibroswarm.errors import InputError


@cache
def opencv() -> Any:
    """Import OpenCV and return its module ``cv2``, with its own messages switched off.

    Problems of videos are reported by this package instead. An environment variable that sets the level of these
    messages takes precedence.

    Raises:
        InputError: OpenCV is not installed, or older than version 5.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's level "quiet"
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    try:
        import cv2
    except ImportError:
        raise InputError(
            "needs OpenCV; install it with: pip install 'vibroswarm[video]'", field="video"
        ) from None
    if int(cv2.__version__.split(".")[0]) < 5:
        raise InputError(
            f"needs OpenCV 5 or later, not {cv2.__version__}; pip install -U 'vibroswarm[video]'",
            field="video",
        )
    return cv2
