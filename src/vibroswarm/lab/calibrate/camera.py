"""Model a camera that sees robots farther from the centre than they are: x' = c + shift + magnification (x - c).

| name | symbol | unit | equation |
|---|---|---|---|
| seen position | x' | m | position of a robot as the camera reports it |
| true position | x | m | position of the robot on the floor |
| centre | c | m | centre of the arena |
| magnification | - | - | 1 + h / (H - h), h the height of the marker on a robot, H the height of the camera |
| shift | - | m | x' - c of a robot at the centre |

Seen positions beyond a wall are clipped to it, as in the study's logs. ``RIGHT`` is a camera without error, whose seen
positions are the true ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.arrays import Floats
from vibroswarm.core.numbers import number
from vibroswarm.lab.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario

Place = Callable[[Floats, Floats, tuple[float, float]], tuple[Floats, Floats]]
"""Takes x and y, m, of objects, and width and height of the arena; returns others in their place."""


@dataclass(frozen=True)
class Camera:
    """A camera that magnifies and shifts the positions of robots; the default is a camera without error."""

    magnification: float = 1.0
    """Seen distance from the arena's centre, divided by the true distance."""
    shift_x_m: float = 0.0
    """Seen minus true x of a robot at the arena's centre."""
    shift_y_m: float = 0.0
    """Seen minus true y of a robot at the arena's centre."""

    @classmethod
    def of(cls, scenario: Scenario) -> Camera:
        """Return the camera of the recordings that a scenario was fitted to; a field that is not set has no effect."""
        fields = scenario.camera
        return cls(fields.magnification or 1.0, fields.shift_x_m or 0.0, fields.shift_y_m or 0.0)

    def fields(self) -> dict[str, float]:
        """Return this camera as scenario fields, value by dotted field name; empty for a camera without error."""
        if self == RIGHT:
            return {}
        # A scenario holds fitted values with five digits after the point: lengths to 0.01 mm.
        return {f"camera.{name}": round(getattr(self, name), 5) for name in self.__dataclass_fields__}

    @property
    def words(self) -> str:
        """A description for people: the magnification, and the shift in mm."""
        return (
            f"magnification {number(self.magnification, digits=4)}, shift "
            f"{number(1000 * self.shift_x_m, 1, sign=True)} mm to the right, "
            f"{number(1000 * self.shift_y_m, 1, sign=True)} mm up"
        )

    def true(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return the true x and y (m) of objects that the camera sees at ``x_m``, ``y_m``.

        This is the inverse of ``seen``, except for objects that ``seen`` clips to a wall.

        Args:
            x_m, y_m: seen coordinates, arrays of one shape; the results have this shape too.
            size_m: width and height of the arena.
        """
        x0, y0 = size_m[0] / 2, size_m[1] / 2  # the centre c
        return (
            x0 + (x_m - x0 - self.shift_x_m) / self.magnification,
            y0 + (y_m - y0 - self.shift_y_m) / self.magnification,
        )

    def seen(self, x_m: Floats, y_m: Floats, size_m: tuple[float, float]) -> tuple[Floats, Floats]:
        """Return the x and y (m) at which the camera sees objects at ``x_m``, ``y_m``.

        Objects that it would see beyond a wall are seen on the wall.

        Args:
            x_m, y_m: true coordinates, arrays of one shape; the results have this shape too.
            size_m: width and height of the arena.
        """
        x0, y0 = size_m[0] / 2, size_m[1] / 2  # the centre c
        x = x0 + self.shift_x_m + self.magnification * (x_m - x0)
        y = y0 + self.shift_y_m + self.magnification * (y_m - y0)
        return np.clip(x, 0.0, size_m[0]), np.clip(y, 0.0, size_m[1])


RIGHT: Final = Camera()
"""A camera without error: it sees robots at their true ("right") positions."""


def corrected(result: Result, camera: Camera) -> Result:
    """Return a recording with the true positions of its samples and tracks; a simulation is returned unchanged.

    The positions of a recording are those that the camera saw. The positions of a simulation are true already. Only the
    tables ``motion`` (of samples) and ``tracks`` change. Positions in ``ends`` and ``poses``, and the tiles in
    ``observations``, stay those that the camera saw.
    """
    if camera == RIGHT or not isinstance(result, Recording):
        return result
    size_m = result.scenario.arena.size_m
    motion, tracks = (moved(table, camera.true, size_m) for table in (result.motion, result.tracks))
    return replace(result, motion=motion, tracks=tracks)


def seen_through(result: Result, camera: Camera) -> Result:
    """Return a simulation with samples where the camera would have seen them; a recording is returned unchanged.

    The positions of a recording are already those that the camera saw. Only the table ``motion`` changes: bits and
    energies stay those read at the true positions.
    """
    if camera == RIGHT or isinstance(result, Recording):
        return result
    return replace(result, motion=moved(result.motion, camera.seen, result.scenario.arena.size_m))


def moved(frame: pl.DataFrame, place: Place, size_m: tuple[float, float]) -> pl.DataFrame:
    """Replace the positions (``x_m``, ``y_m``) of a table by those that ``Camera.true`` or ``Camera.seen`` gives."""
    x, y = place(frame["x_m"].to_numpy(), frame["y_m"].to_numpy(), size_m)
    return frame.with_columns(x_m=pl.Series(x), y_m=pl.Series(y))
