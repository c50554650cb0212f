"""The camera with which videos are rendered: another lens model than the one that tracking fits.

| name | symbol | unit | equation |
|---|---|---|---|
| distorted radius | r | px | f (theta + k1 theta^3 + k2 theta^5) |
| angle from the axis | theta | rad | |
| focal length | f | px | |

Kannala and Brandt, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye
lenses", PAMI 2006, its radial part. Tracking fits Brown-Conrady polynomials in tan(theta) instead (``lens``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Fisheye:
    """A camera with its pose; world: x right, y up in the arena, z up from the floor, m."""

    width_px: int
    height_px: int
    focal_px: float
    centre_px: tuple[float, float]
    k: tuple[float, float]
    rotation: Floats
    """(3, 3): from world to camera axes (x right, y down in the image, z ahead)."""
    position_m: Floats
    """(3,): of the camera in the world."""

    def project(self, points_m: Floats) -> Floats:
        """Return the pixels, (..., 2), of points of the world, (..., 3); pixel centres are whole numbers."""
        ahead = (points_m - self.position_m) @ self.rotation.T
        flat = np.hypot(ahead[..., 0], ahead[..., 1])
        theta = np.arctan2(flat, ahead[..., 2])
        scale = self.focal_px * self._distorted(theta) / np.maximum(flat, 1e-12)
        seen: Floats = ahead[..., :2] * scale[..., None] + np.array(self.centre_px)
        return seen

    def _distorted(self, theta: Floats) -> Floats:
        square = theta * theta
        bent: Floats = theta * (1.0 + square * (self.k[0] + square * self.k[1]))
        return bent

    def tangents(self) -> NDArray[np.float32]:
        """Return x / z and y / z of the ray of each pixel in camera axes, (height, width, 2)."""
        u, v = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        x, y = (u - self.centre_px[0]) / self.focal_px, (v - self.centre_px[1]) / self.focal_px
        radius = np.hypot(x, y)
        theta = radius.copy()
        for _ in range(8):  # Newton's method; the lens is monotone over the image
            square = theta * theta
            slope = 1.0 + square * (3.0 * self.k[0] + 5.0 * square * self.k[1])
            theta -= (self._distorted(theta) - radius) / slope
        scale = np.where(radius > 1e-12, np.tan(theta) / np.maximum(radius, 1e-12), 1.0)
        return np.stack([x * scale, y * scale], axis=-1).astype(np.float32)


def overhead(
    size_px: tuple[int, int],
    around_m: Sequence[tuple[float, float]],
    *,
    height_m: float,
    tilt_deg: float,
    k: tuple[float, float],
    margin_px: float = 14.0,
    turned_deg: float = 0.0,
) -> Fisheye:
    """Return a camera above the middle of some points of the floor, zoomed until all are in the image.

    It is tilted by ``tilt_deg`` about the image's horizontal axis and by a third of that about the vertical one, and
    stands aside so that the middle stays in the middle; its axis is a little off the image's centre, as real ones are.
    ``turned_deg`` turns it about its axis, as one that is hung crosswise.
    """
    points = np.column_stack([np.array(around_m, dtype=np.float64), np.zeros(len(around_m))])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    down = np.diag([1.0, -1.0, -1.0])
    a, b, roll = math.radians(tilt_deg), math.radians(tilt_deg / 3), math.radians(tilt_deg / 5 + turned_deg)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
    rotation = about_z @ about_x @ about_y @ down
    axis = rotation[2]  # the direction in which the camera looks
    position = middle - axis * (height_m / -axis[2])
    width, height = size_px
    centre = (width / 2 - 0.5 + 0.004 * width, height / 2 - 0.5 - 0.005 * height)
    unit = Fisheye(width, height, 1.0, (0.0, 0.0), k, rotation, position)
    seen = unit.project(points)
    room = (
        np.array([centre[0], centre[1]]) - margin_px,
        np.array([width - 1, height - 1]) - centre - margin_px,
    )
    with np.errstate(divide="ignore"):
        scales = np.where(seen < 0, room[0] / -seen, room[1] / seen)
    return Fisheye(width, height, float(scales.min()), centre, k, rotation, position)
