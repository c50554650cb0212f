"""Model a camera that sees robots farther from the centre than they are: x' = c + shift + magnification (x - c).

| name | symbol | unit | equation |
|---|---|---|---|
| magnification | - | - | 1 + h / (H - h), h the height of the marker, H that of a camera above the centre |
| shift | - | m | offset of the centre c of the arena in the image |

Positions beyond the walls are clipped to them, as in the study's logs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Camera(NotebookView):
    """Camera model, see the head of this module."""

    magnification: float = 1.0
    shift_x_m: float = 0.0
    shift_y_m: float = 0.0

    @classmethod
    def of(cls, scenario: Scenario) -> Camera:
        """Return the camera of the recordings that a scenario was fitted to."""
        fields = scenario.camera
        return cls(fields.magnification or 1.0, fields.shift_x_m or 0.0, fields.shift_y_m or 0.0)

    def fields(self) -> dict[str, float]:
        """Return the fields of the scenario that hold it; none for a camera without error."""
        if self == RIGHT:
            return {}
        return {f"camera.{name}": round(getattr(self, name), 5) for name in self.__dataclass_fields__}

    @property
    def words(self) -> str:
        """A short description."""
        return (
            f"magnification {self.magnification:.4g}, shift {1000 * self.shift_x_m:+.1f} mm to the right, "
            f"{1000 * self.shift_y_m:+.1f} mm up"
        )

    def true(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return the true positions of objects seen at (x, y), m.

        Args:
            size_m: width and height of the arena.
        """
        x0, y0 = size_m[0] / 2, size_m[1] / 2
        return (
            x0 + (x_m - x0 - self.shift_x_m) / self.magnification,
            y0 + (y_m - y0 - self.shift_y_m) / self.magnification,
        )

    def seen(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return the positions at which objects at (x, y) are seen, m; those beyond a wall are moved onto it.

        Args:
            size_m: width and height of the arena.
        """
        x0, y0 = size_m[0] / 2, size_m[1] / 2
        x = x0 + self.shift_x_m + self.magnification * (x_m - x0)
        y = y0 + self.shift_y_m + self.magnification * (y_m - y0)
        return np.clip(x, 0.0, size_m[0]), np.clip(y, 0.0, size_m[1])


RIGHT: Final = Camera()
"""A camera without error."""


def corrected(result: Result, camera: Camera) -> Result:
    """Correct the positions of a recording, samples and tracks; a simulation is returned unchanged."""
    if camera == RIGHT or not isinstance(result, Recording):
        return result
    size = (result.scenario.arena.width_m, result.scenario.arena.height_m)
    return replace(
        result, motion=_moved(result.motion, camera, size), tracks=_moved(result.tracks, camera, size)
    )


def seen_through(result: Result, camera: Camera) -> Result:
    """Return a simulation with samples where the camera would have seen them; a recording is returned unchanged."""
    if camera == RIGHT or isinstance(result, Recording):
        return result
    motion, arena = result.motion, result.scenario.arena
    x, y = camera.seen(motion["x_m"].to_numpy(), motion["y_m"].to_numpy(), (arena.width_m, arena.height_m))
    return replace(result, motion=motion.with_columns(x_m=pl.Series(x), y_m=pl.Series(y)))


def _moved(frame: pl.DataFrame, camera: Camera, size: tuple[float, float]) -> pl.DataFrame:
    x, y = camera.true(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), size)
    return frame.with_columns(x_m=pl.Series(x), y_m=pl.Series(y))
