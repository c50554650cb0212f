"""A camera that sees robots further from the middle than they are: x' = c + shift + magnification (x - c).

| name | symbol | unit | equation |
|---|---|---|---|
| magnification | - | - | 1 + h / (H - h), h the height of the marker, H that of a camera over the middle |
| shift | - | m | of what is seen in the middle c of the arena |

What is seen beyond the walls is seen at them, as in the study's logs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.lab.recording import Recording
from vibroswarm.result import Result

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """See the head of this module."""

    magnification: float = 1.0
    shift_x_m: float = 0.0
    shift_y_m: float = 0.0

    def true(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Where things are that are seen at (x, y)."""
        x0, y0 = size_m[0] / 2, size_m[1] / 2
        return (
            x0 + (x_m - x0 - self.shift_x_m) / self.magnification,
            y0 + (y_m - y0 - self.shift_y_m) / self.magnification,
        )

    def seen(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Where things at (x, y) are seen."""
        x0, y0 = size_m[0] / 2, size_m[1] / 2
        x = x0 + self.shift_x_m + self.magnification * (x_m - x0)
        y = y0 + self.shift_y_m + self.magnification * (y_m - y0)
        return np.clip(x, 0.0, size_m[0]), np.clip(y, 0.0, size_m[1])


RIGHT: Final = Camera()
"""A camera that sees all where it is."""


def corrected(result: Result, camera: Camera) -> Result:
    """A recording with its robots where they were: samples and tracks. What is no recording stays as it is."""
    if camera == RIGHT or not isinstance(result, Recording):
        return result
    size = (result.scenario.arena.width_m, result.scenario.arena.height_m)
    return replace(
        result, motion=_moved(result.motion, camera, size), tracks=_moved(result.tracks, camera, size)
    )


def _moved(frame: pl.DataFrame, camera: Camera, size: tuple[float, float]) -> pl.DataFrame:
    x, y = camera.true(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), size)
    return frame.with_columns(x_m=pl.Series(x), y_m=pl.Series(y))
