"""The camera with which videos are rendered: another lens model than the one that tracking fits.

| name | symbol | unit | equation |
|---|---|---|---|
| distance of a pixel from the lens's centre | r | px | f (theta + k1 theta^3 + k2 theta^5) |
| angle of the ray from the camera's axis | theta | rad | |
| focal length | f | px | |

The equation is the radial part of Kannala and Brandt, "A generic camera model and calibration method for conventional,
wide-angle, and fish-eye lenses", PAMI 2006. Tracking fits Brown-Conrady polynomials in tan(theta) instead
(``tracking.camera``). So a rendered video is a fair test of tracking: the fitted model does not match its lens exactly.
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
    """A camera with its pose. World axes, m: x to the right and y upwards in the arena as seen from above, z up."""

    width_px: int
    height_px: int
    focal_px: float
    """Focal length."""
    centre_px: tuple[float, float]
    """The pixel of the camera's axis."""
    k: tuple[float, float]
    """k1 and k2."""
    rotation: Floats
    """(3, 3): from world to camera axes (x right, y down in the image, z ahead)."""
    position_m: Floats
    """(3,): of the camera in the world."""

    def project(self, points_m: Floats) -> Floats:
        """Return the pixels, (..., 2), of points of the world, (..., 3), m; the centre of a pixel has whole numbers."""
        in_camera = (points_m - self.position_m) @ self.rotation.T
        off_axis = np.hypot(in_camera[..., 0], in_camera[..., 1])
        theta = np.arctan2(off_axis, in_camera[..., 2])
        # The maximum avoids a division by 0 on the axis.
        scale = self.focal_px * self._distorted(theta) / np.maximum(off_axis, 1e-12)
        seen: Floats = in_camera[..., :2] * scale[..., None] + np.array(self.centre_px)
        return seen

    def _distorted(self, theta: Floats) -> Floats:
        """Return r / f of rays at angles ``theta`` from the axis, rad."""
        square = theta * theta
        bent: Floats = theta * (1.0 + square * (self.k[0] + square * self.k[1]))
        return bent

    def tangents(self) -> NDArray[np.float32]:
        """Return x / z and y / z of each pixel's ray in camera axes, (height, width, 2).

        It is the inverse of ``project``, up to the unknown distance along the ray.
        """
        u, v = np.meshgrid(np.arange(self.width_px), np.arange(self.height_px))
        x, y = (u - self.centre_px[0]) / self.focal_px, (v - self.centre_px[1]) / self.focal_px
        radius = np.hypot(x, y)
        # Newton's method for _distorted(theta) = radius; the left side grows with theta over the whole image. The first
        # guess is theta = radius, which is exact without distortion; it is a copy, since theta is changed in place. The
        # number of correct digits about doubles in each step, so 8 steps are enough.
        theta = radius.copy()
        for _ in range(8):
            square = theta * theta
            slope = 1.0 + square * (3.0 * self.k[0] + 5.0 * square * self.k[1])
            theta -= (self._distorted(theta) - radius) / slope
        # On the axis itself radius is 0, and the quotient is replaced by its limit there, which is 1.
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
    """Return a camera above some points of the floor, zoomed so that all of them are in the image.

    It looks at the middle of the points: a tilted camera hangs to the side of it, and its axis still passes through it.
    Like a real camera it is imperfect: a tilt also tilts and turns it a little about its other two axes (see
    ``tilt_deg``), and its axis does not meet the image exactly at the image's centre.

    Args:
        size_px: width and height of the image. around_m: x and y of the points. height_m: of the camera.
        tilt_deg: tilt about the image's horizontal axis. The camera is also tilted by a third of this angle about the
            image's vertical axis, and turned by a fifth of it about its own axis (in addition to ``turned_deg``).
        k: k1 and k2 of the lens. margin_px: least distance of the points from the border of the image.
        turned_deg: angle by which the camera is turned about its axis: 90 if it is hung crosswise.
    """
    points = np.column_stack([np.array(around_m, dtype=np.float64), np.zeros(len(around_m))])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    # Rotation of a camera that looks straight down, the image's top towards +y.
    down = np.diag([1.0, -1.0, -1.0])
    a, b, roll = math.radians(tilt_deg), math.radians(tilt_deg / 3), math.radians(tilt_deg / 5 + turned_deg)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]])
    rotation = about_z @ about_x @ about_y @ down
    axis = rotation[2]  # the direction in which the camera looks
    # From the middle of the points, back along the axis up to the height of the camera (the axis points downwards).
    position = middle - axis * (height_m / -axis[2])
    width, height = size_px
    # The pixel of the camera's axis: the image's centre, moved by about half a percent of its size.
    centre = (width / 2 - 0.5 + 0.004 * width, height / 2 - 0.5 - 0.005 * height)
    # Distances of pixels from the axis are proportional to the focal length. So the points are projected with a focal
    # length of 1 px, and the largest focal length at which all of them are in the image is computed from that.
    unit = Fisheye(
        width, height, focal_px=1.0, centre_px=(0.0, 0.0), k=k, rotation=rotation, position_m=position
    )
    seen = unit.project(points)
    room_before = np.array([centre[0], centre[1]]) - margin_px  # to the left of the axis, and above it
    # To the right of the axis, and below it.
    room_behind = np.array([width - 1, height - 1]) - centre - margin_px
    # A point exactly on the axis allows any focal length: the division by 0 gives infinity, which is never the minimum.
    with np.errstate(divide="ignore"):
        focal_px = np.where(seen < 0, room_before / -seen, room_behind / seen)
    return Fisheye(
        width,
        height,
        focal_px=float(focal_px.min()),
        centre_px=centre,
        k=k,
        rotation=rotation,
        position_m=position,
    )
