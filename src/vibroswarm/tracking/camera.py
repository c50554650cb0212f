"""The camera of a video: its lens and its pose, fitted to markers whose places are known; and points from pixels.

| name | symbol | equation |
|---|---|---|
| lens | f, c, k1, k2, p1, p2, k3 | Brown-Conrady (Brown 1966; OpenCV): x (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential |
| point at a height z | - | C + (z - C_z) d / d_z, C the camera, d the ray of the pixel |
| self-calibration | - | least squares of floor corners as projected and of robots' corners as squares of known size |

A marker on a robot stands above the floor. Its place is where the ray meets the plane at its height, not the floor.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vibroswarm.errors import InputError
from vibroswarm.tracking import opencv
from vibroswarm.tracking.video_file import frames_of

Floats = NDArray[np.float64]

BOARD_VIEWS: Final = 24
"""Views of a chessboard that a lens is fitted to, at most."""
CORNER_PX: Final = 0.2
"""Standard deviation of a corner that priors of a self-calibration are weighed against."""
CENTRE_SHARE: Final = 0.01
"""Standard deviation of the lens's centre, as a share of the image's width."""
EDGE_PX: Final = 1.0
"""Standard deviation of how far outwards the edges of black squares are seen: blur and thresholds move all alike."""
HEIGHT_SHARE: Final = 0.01
"""Standard deviation of the camera's height, if it is told."""
FOCAL_SHARE: Final = 0.5
"""Standard deviation of the logarithm of the focal length."""
LENS_SPREAD: Final = 0.4
"""Standard deviation of k1 and k2."""
FOCAL_STARTS: Final = (0.7, 0.9, 1.2, 1.6)
"""Focal lengths, as shares of the image's width, from which a self-calibration starts; the best fit counts."""


@dataclass(frozen=True)
class Lens:
    """A lens: camera matrix (3, 3), px, and distortion (5,) as OpenCV has it."""

    matrix: Floats
    distortion: Floats
    error_px: float
    """Root mean square of the corners that it was fitted to."""


@dataclass(frozen=True)
class Camera:
    """A lens with its pose in the arena: x right, y up, z above the floor, m."""

    lens: Lens
    rotation: Floats
    """(3, 3): from the arena to the camera."""
    position_m: Floats
    """(3,)."""
    floor_error_px: float
    """Root mean square of the floor markers' corners."""
    calibrated: bool
    """Whether the lens was fitted to a chessboard, not to the video itself."""
    edge_px: float = 0.0
    """How far outwards the edges of black squares are seen."""

    def at_height(self, points_px: Floats, height_m: float) -> Floats:
        """Return x and y, (..., 2), m, of what is seen at pixels, (..., 2), at a height above the floor."""
        cv2 = opencv()
        flat = np.ascontiguousarray(points_px.reshape(-1, 1, 2))
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        seen = cv2.undistortPoints(flat, self.lens.matrix, self.lens.distortion, criteria=criteria).reshape(
            -1, 2
        )
        rays = np.column_stack([seen, np.ones(len(seen))]) @ self.rotation
        steps = (height_m - self.position_m[2]) / rays[:, 2]
        found: Floats = self.position_m[:2] + steps[:, None] * rays[:, :2]
        return found.reshape(points_px.shape)

    def project(self, points_m: Floats) -> Floats:
        """Return the pixels, (points, 2), of points of the arena, (points, 3), m."""
        cv2 = opencv()
        turn, _ = cv2.Rodrigues(self.rotation)
        shift = -self.rotation @ self.position_m
        seen, _ = cv2.projectPoints(
            np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 1, 3), turn, shift, self.lens.matrix,
            self.lens.distortion,
        )  # fmt: skip
        return np.asarray(seen.reshape(-1, 2), dtype=np.float64)


def lens_from_chessboard(path: Path, squares: tuple[int, int]) -> tuple[Lens, tuple[int, int]]:
    """Fit a lens to a video of a chessboard that is held before the camera in all directions.

    Args:
        squares: inner corners, across and down.
    Returns: the lens, and the width and height of the video.
    Raises:
        InputError: the board is seen in fewer than 6 frames.
    """
    cv2 = opencv()
    views, size = [], (0, 0)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
    for _, frame in frames_of(path, partial=True):
        size = (frame.shape[1], frame.shape[0])
        found, corners = cv2.findChessboardCorners(frame, squares, flags=flags)
        if found:
            end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
            views.append(cv2.cornerSubPix(frame, corners, (5, 5), (-1, -1), end))
    if len(views) < 6:
        raise InputError(
            f"shows a chessboard of {squares[0]} x {squares[1]} inner corners in {len(views)} frames; hold it before "
            "the camera, tilted in all directions, in at least 6",
            field=str(path),
        )
    step = max(len(views) // BOARD_VIEWS, 1)
    chosen = views[::step][:BOARD_VIEWS]
    board = np.zeros((squares[0] * squares[1], 3), dtype=np.float32)
    board[:, :2] = np.mgrid[0 : squares[0], 0 : squares[1]].T.reshape(-1, 2)
    error, matrix, distortion, _, _ = cv2.calibrateCamera([board] * len(chosen), chosen, size, None, None)
    return Lens(matrix, distortion.ravel()[:5], float(error)), size


@dataclass(frozen=True)
class _Seen:
    """What a camera is fitted to; parameters ``at`` are its turn (3) and shift (3), the lens unless it is given (log of
    the focal length, centre, k1, k2), and how far outwards edges of black squares are seen, px."""

    size_px: tuple[int, int]
    floor_m: Floats
    floor_px: Floats
    robots_px: Floats
    robot_size_m: float
    robot_height_m: float
    lens: Lens | None
    camera_height_m: float | None

    def camera(self, at: Floats) -> Camera:
        """Return the camera that has these parameters."""
        cv2 = opencv()
        used = self.lens
        if used is None:
            width, height = self.size_px
            centre = (np.array([width, height]) - 1) / 2 + width * at[7:9]
            distortion = np.array([at[9], at[10], 0.0, 0.0, 0.0])
            used = Lens(matrix_of(width * np.exp(at[6]), centre), distortion, np.nan)
        rotation, _ = cv2.Rodrigues(at[:3])
        return Camera(used, rotation, -rotation.T @ at[3:6], np.nan, self.lens is not None)

    def floor_errors(self, at: Floats) -> Floats:
        """Return the floor's corners as projected minus as seen without the shift of edges, (points, 2), px."""
        lens = self.camera(at).lens
        shown, _ = opencv().projectPoints(self.floor_m, at[:3], at[3:6], lens.matrix, lens.distortion)
        out = outwards(self.floor_px.reshape(-1, 4, 2)).reshape(-1, 2)
        return np.asarray(shown.reshape(-1, 2) - (self.floor_px - at[-1] * out))

    def errors(self, at: Floats) -> Floats:
        """Return all errors and priors, in standard deviations."""
        parts = [self.floor_errors(at).ravel() / CORNER_PX, at[-1:] / EDGE_PX]
        if self.lens is None:
            now = self.camera(at)
            per_m = now.lens.matrix[0, 0] / max(now.position_m[2] - self.robot_height_m, 1e-3)
            corners = now.at_height(self.robots_px - at[-1] * outwards(self.robots_px), self.robot_height_m)
            parts.append((square_errors(corners, self.robot_size_m) * per_m / CORNER_PX).ravel())
            parts.append(
                at[6:11] / np.array([FOCAL_SHARE, CENTRE_SHARE, CENTRE_SHARE, LENS_SPREAD, LENS_SPREAD])
            )
            if self.camera_height_m is not None:
                parts.append(np.array([(now.position_m[2] / self.camera_height_m - 1.0) / HEIGHT_SHARE]))
        return np.concatenate(parts)

    def start(self, focal: float) -> Floats | None:
        """Return parameters to start from, at a focal length as a share of the image's width; None: no pose fits."""
        cv2 = opencv()
        width, height = self.size_px
        matrix, distortion = matrix_of(focal * width, (np.array([width, height]) - 1) / 2), np.zeros(5)
        if self.lens is not None:
            matrix, distortion = self.lens.matrix, self.lens.distortion
        solved, turn, shift = cv2.solvePnP(
            self.floor_m, self.floor_px, matrix, distortion, flags=cv2.SOLVEPNP_IPPE
        )
        if not solved:
            return None
        own = [] if self.lens is not None else [np.log(focal), 0.0, 0.0, 0.0, 0.0]
        return np.concatenate([turn.ravel(), shift.ravel(), own, [0.0]])


def fit_camera(
    size_px: tuple[int, int],
    floor_m: Floats,
    floor_px: Floats,
    robots_px: Floats,
    robot_size_m: float,
    robot_height_m: float,
    lens: Lens | None = None,
    camera_height_m: float | None = None,
) -> Camera:
    """Fit a camera's pose, and its lens unless it is given.

    Args:
        size_px: width and height. floor_m, floor_px: (points, 3), (points, 2): four corners of each of the floor's
            markers.
        robots_px: (markers, 4, 2): corners of robots' markers, seen anywhere; they are squares of ``robot_size_m`` at
            ``robot_height_m``.
        camera_height_m: of the lens above the floor, if it was measured.
    Raises:
        InputError: fewer than 4 floor corners, or no camera explains them.
    """
    if len(floor_m) < 4:
        raise InputError(
            "no marker of the floor was found in the video; at least one is needed", field="VIDEO"
        )
    seen = _Seen(size_px, floor_m, floor_px, robots_px, robot_size_m, robot_height_m, lens, camera_height_m)
    starts = [seen.start(focal) for focal in ((1.0,) if lens is not None else FOCAL_STARTS)]
    fits = [
        least_squares(seen.errors, start, x_scale="jac", loss="soft_l1", max_nfev=200)
        for start in starts
        if start is not None
    ]
    if not fits:
        raise InputError(
            "the floor markers' places do not fit the picture; check their file", field="--markers"
        )
    found = min(fits, key=lambda fit: float(fit.cost))
    camera = seen.camera(found.x)
    error_px = float(np.sqrt(np.mean(np.sum(seen.floor_errors(found.x) ** 2, axis=1))))
    below = camera.position_m[2] <= robot_height_m
    if not np.isfinite(found.x).all() or below or error_px > 0.02 * size_px[0]:
        raise InputError(
            f"the floor markers' places do not fit the picture (by {error_px:.0f} px); check their file, and that "
            "y grows upwards",
            field="--markers",
        )
    if lens is None:
        lens_error = replace(camera.lens, error_px=error_px)
        return replace(camera, lens=lens_error, floor_error_px=error_px)
    return replace(camera, floor_error_px=error_px)


def matrix_of(focal_px: float, centre_px: Floats) -> Floats:
    """Return a camera matrix, (3, 3)."""
    return np.array([[focal_px, 0.0, centre_px[0]], [0.0, focal_px, centre_px[1]], [0.0, 0.0, 1.0]])


def outwards(corners_px: Floats) -> Floats:
    """Return by how much each corner moves, (markers, 4, 2), if all edges move outwards by a pixel."""
    along = np.roll(corners_px, -1, axis=1) - corners_px
    along = along / np.maximum(np.linalg.norm(along, axis=-1, keepdims=True), 1e-9)
    found: Floats = np.roll(along, 1, axis=1) - along
    return found


def square_errors(corners_m: Floats, size_m: float) -> Floats:
    """Return by how much corners, (markers, 4, 2), differ from the nearest square of this size, m."""
    centre, along = square_of(corners_m)
    return np.asarray(corners_m - centre[:, None] - square_corners(along, size_m))


def square_corners(along_rad: Floats, size_m: float) -> Floats:
    """Return the corners of squares about 0 in the detector's order, (markers, 4, 2), m; ``along``: of the top edge."""
    right = 0.5 * size_m * np.column_stack([np.cos(along_rad), np.sin(along_rad)])
    up = np.column_stack([-right[:, 1], right[:, 0]])
    return np.stack([up - right, up + right, right - up, -up - right], axis=1)


def square_of(corners_m: Floats) -> tuple[Floats, Floats]:
    """Return centres, (markers, 2), and directions of the top edges from left to right, (markers,), rad."""
    centre: Floats = corners_m.mean(axis=1)
    edge: Any = corners_m[:, 1] - corners_m[:, 0] + corners_m[:, 2] - corners_m[:, 3]
    side: Any = corners_m[:, 0] - corners_m[:, 3] + corners_m[:, 1] - corners_m[:, 2]  # upwards
    # Both edges tell the direction: least squares of a rotation.
    return centre, np.arctan2(edge[:, 1] - side[:, 0], edge[:, 0] + side[:, 1])
