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
    """Import OpenCV and return its module ``cv2``; its own messages are switched off, as problems are reported here."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's level "quiet"
    os.environ.setdefault("OPENCV_LOG_LEVEL", "OFF")
    try:
        import cv2
    except ImportError:
        raise InputError(
            "needs OpenCV; install it with: pip install 'vibroswarm[video]'", field="video"
        ) from None
    return cv2
