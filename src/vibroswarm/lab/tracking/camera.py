"""The camera of a video: its lens and pose, fitted to markers at known places; and its conversion of pixels to places.

The lens is Brown-Conrady's (Brown 1966; OpenCV): f, c, k1, k2, p1, p2, k3. A marker on a robot is above the floor, so
its place is where the ray of its pixel meets the plane at the marker's height: C + (z - C_z) d / d_z, C the camera, d
the ray.

The lens is fitted to a video of a chessboard, or to the video itself (self-calibration): least squares of the pixels to
which the corners of the floor's markers are projected minus those where they are seen, and of the corners of robots'
markers minus squares of the known size. Prior distributions make unlikely lenses costly.

The fitted parameters are one array, which the functions call ``at``:

| index | parameter |
|---|---|
| 0 to 2 | rotation vector (Rodrigues), from the arena to the camera |
| 3 to 5 | translation, from the arena to the camera, m |
| 6 | log(focal length / width of the image); this and the next only if no lens is given |
| 7 and 8 | centre of the lens minus centre of the image, as a share of the image's width |
| 9 and 10 | k1 and k2 |
| last | distance by which blur and thresholds move the edges of black squares outwards, px |

Corners of a marker are always in the detector's order: top left, top right, bottom right, bottom left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from vibroswarm.core.arrays import Floats
from vibroswarm.core.child_python import with_one_blas_thread
from vibroswarm.errors import InputError
from vibroswarm.lab.tracking import opencv
from vibroswarm.lab.tracking.video_file import frames_of

BOARD_VIEWS: Final = 24
"""Most views of a chessboard that a lens is fitted to."""
CORNER_PX: Final = 0.2
"""Standard deviation of a detected corner, px. It weighs the corners against the priors below."""
CENTRE_SHARE: Final = 0.01
"""Prior standard deviation of the lens's centre about the image's centre, as a share of the image's width."""
EDGE_PX: Final = 1.0
"""Prior standard deviation of how far outwards the edges of black squares are seen, px: blur and thresholds move all
edges by the same distance."""
SIZE_PX: Final = 0.1
"""By how much farther outwards the edges of robots' markers may be seen than those of the floor's markers, which have
another size, px. The fit takes both as equal; rendered markers differ by up to 0.16 px."""
RIMLESS_PX: Final = 0.8
"""The same if markers of the floor have no white rim: then their edges lie between black and the floor's grey."""
HEIGHT_SHARE: Final = 0.01
"""Standard deviation of a measured camera height, as a share of it."""
FOCAL_SHARE: Final = 0.5
"""Prior standard deviation of the logarithm of the focal length about the image's width."""
LENS_SPREAD: Final = 0.4
"""Prior standard deviation of k1 and k2 about 0."""
FOCAL_STARTS: Final = (0.7, 0.9, 1.2, 1.6)
"""Focal lengths, as shares of the image's width, from which a self-calibration starts; the best fit is taken."""


@dataclass(frozen=True)
class Lens:
    """A lens: camera matrix (3, 3), px, and distortion (5,) as OpenCV has it."""

    matrix: Floats
    distortion: Floats
    error_px: float


@dataclass(frozen=True)
class Camera:
    """A lens with its pose in the arena: x right, y up, z above the floor, m."""

    lens: Lens
    rotation: Floats
    """(3, 3): from the arena to the camera."""
    position_m: Floats
    """(3,)."""
    floor_error_px: float
    calibrated: bool
    """Whether the lens was fitted to a chessboard, not to the video itself."""
    edge_px: float = 0.0
    """Distance by which the edges of black squares are seen too far outwards, px."""
    place_error_m: float = 0.0
    """How far the places of robots may be off, m, the largest: the larger of two standard errors, by errors of
    ``CORNER_PX`` of the corners, and of how far places move if robots' markers are seen wider by ``SIZE_PX`` at each
    edge than those of the floor (not if the lens is given: then places do not depend on the size of these markers);
    by ``RIMLESS_PX`` if those of the floor have no white rims."""

    def at_height(self, points_px: Floats, height_m: float) -> Floats:
        """Return x and y in the arena, (..., 2), m, of the pixels of points at a given height above the floor."""
        cv2 = opencv()
        flat = np.ascontiguousarray(points_px.reshape(-1, 1, 2))
        # The inverse of the lens is iterated up to 40 times, or until it is exact to 1e-9.
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        seen = cv2.undistortPoints(flat, self.lens.matrix, self.lens.distortion, criteria=criteria).reshape(
            -1, 2
        )
        # ``rotation`` turns columns from the arena to the camera. Rows times ``rotation`` are turned by its inverse,
        # from the camera to the arena.
        rays = np.column_stack([seen, np.ones(len(seen))]) @ self.rotation
        # The multiple of its ray at which each point is, from the camera to the plane at the given height.
        steps = (height_m - self.position_m[2]) / rays[:, 2]
        return np.asarray(self.position_m[:2] + steps[:, None] * rays[:, :2]).reshape(points_px.shape)

    def project(self, points_m: Floats) -> Floats:
        """Return the pixels, (points, 2), of points of the arena, (points, 3), m."""
        cv2 = opencv()
        # OpenCV takes the pose as a rotation vector and the translation from the arena to the camera.
        turn, _ = cv2.Rodrigues(self.rotation)
        shift = -self.rotation @ self.position_m
        seen, _ = cv2.projectPoints(
            np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 1, 3), turn, shift, self.lens.matrix,
            self.lens.distortion,
        )  # fmt: skip
        return np.asarray(seen.reshape(-1, 2), dtype=np.float64)


def lens_from_chessboard(path: Path, squares: tuple[int, int]) -> tuple[Lens, tuple[int, int]]:
    """Fit a lens to a video of a chessboard that is held before the camera, tilted in all directions.

    Args:
        squares: number of inner corners of the board (where four squares meet), across and down.
    Returns: the lens, and the width and height of the video, px.
    """
    cv2 = opencv()
    views, size = [], (0, 0)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_FAST_CHECK
    for _, frame in frames_of(path, partial=True):  # a video that ends early may show the board often enough
        size = (frame.shape[1], frame.shape[0])
        found, corners = cv2.findChessboardCorners(frame, squares, flags=flags)
        if found:
            # Corners are refined up to 40 times, or until they move by less than 1e-3 px.
            end = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
            # A corner is refined in the pixels up to 5 px away from it; -1: none of them are left out.
            views.append(cv2.cornerSubPix(frame, corners, winSize=(5, 5), zeroZone=(-1, -1), criteria=end))
    if len(views) < 6:
        raise InputError(
            f"shows a chessboard of {squares[0]} x {squares[1]} inner corners in {len(views)} frames; hold it before "
            "the camera, tilted in all directions, in at least 6",
            field=str(path),
        )
    chosen = views[:: max(len(views) // BOARD_VIEWS, 1)][:BOARD_VIEWS]
    # The corners on the board, (corners, 3), in squares: their size does not change the lens.
    board = np.zeros((squares[0] * squares[1], 3), dtype=np.float32)
    board[:, :2] = np.mgrid[0 : squares[0], 0 : squares[1]].T.reshape(-1, 2)
    # Each view shows the same board. ``None``: there is no first guess of matrix and distortion. The poses of the board
    # in the views, which are returned last, are not used.
    error, matrix, distortion, _, _ = cv2.calibrateCamera([board] * len(chosen), chosen, size, None, None)
    return Lens(matrix, distortion.ravel()[:5], error_px=float(error)), size  # k1, k2, p1, p2, k3


@dataclass(frozen=True)
class _Seen:
    """What a camera is fitted to (the arguments of ``fit_camera``), and the errors of the fit."""

    size_px: tuple[int, int]
    floor_m: Floats
    floor_px: Floats
    robots_px: Floats
    robot_size_m: float
    robot_height_m: float
    lens: Lens | None
    camera_height_m: float | None
    have_rims: bool

    def camera(self, at: Floats) -> Camera:
        """NaN stands for the errors that ``fit_camera`` sets after the fit."""
        lens = self.lens
        if lens is None:
            width, height = self.size_px
            # The middle of the image is at (size - 1) / 2, since the centre of a pixel has whole coordinates.
            centre = (np.array([width, height]) - 1) / 2 + width * at[7:9]
            distortion = np.array([at[9], at[10], 0.0, 0.0, 0.0])
            lens = Lens(matrix_of(width * np.exp(at[6]), centre), distortion, error_px=np.nan)
        rotation, _ = opencv().Rodrigues(at[:3])
        position_m = -rotation.T @ at[3:6]
        return Camera(
            lens,
            rotation,
            position_m,
            floor_error_px=np.nan,
            calibrated=self.lens is not None,
            edge_px=float(at[-1]),
        )

    @cached_property
    def floor_outwards(self) -> Floats:
        """``outwards`` of the floor's corners, (points, 2)."""
        return outwards(self.floor_px.reshape(-1, 4, 2)).reshape(-1, 2)

    @cached_property
    def robots_outwards(self) -> Floats:
        """``outwards`` of the corners of the robots' markers, (markers, 4, 2)."""
        return outwards(self.robots_px)

    def floor_errors(self, at: Floats, lens: Lens) -> Floats:
        """Return projected minus seen corners of the floor, (points, 2), px; those seen are moved inwards first."""
        projected, _ = opencv().projectPoints(self.floor_m, at[:3], at[3:6], lens.matrix, lens.distortion)
        corners_px = self.floor_px - at[-1] * self.floor_outwards
        return np.asarray(projected.reshape(-1, 2) - corners_px)

    def errors(self, at: Floats) -> Floats:
        """Return what the fit minimises: errors, and distances from the priors, each divided by its standard deviation.

        Robots' markers are used only if the lens is fitted: the pose is determined by the floor's markers.
        """
        camera = self.camera(at)
        parts = [self.floor_errors(at, camera.lens).ravel() / CORNER_PX, at[-1:] / EDGE_PX]
        if self.lens is None:
            # Errors of squares are lengths, and are converted to px. The fit may try a camera below the robots: then
            # its height above them is taken as 1 mm.
            px_per_m = camera.lens.matrix[0, 0] / max(camera.position_m[2] - self.robot_height_m, 1e-3)
            corners_px = self.robots_px - at[-1] * self.robots_outwards
            corners_m = camera.at_height(corners_px, self.robot_height_m)
            parts.append((square_errors(corners_m, self.robot_size_m) * px_per_m / CORNER_PX).ravel())
            lens_spreads = np.array([FOCAL_SHARE, CENTRE_SHARE, CENTRE_SHARE, LENS_SPREAD, LENS_SPREAD])
            parts.append(at[6:11] / lens_spreads)  # parameters of the lens; their priors have mean 0
        if self.camera_height_m is not None:
            parts.append(np.array([(camera.position_m[2] / self.camera_height_m - 1.0) / HEIGHT_SHARE]))
        return np.concatenate(parts)

    def fitted(self, start: Floats) -> OptimizeResult:
        """Return the fit of the parameters that begins at ``start``."""
        # The loss "soft_l1" gives less weight to large errors, such as those of a misread corner. ``x_scale="jac"``
        # scales each parameter by its effect on the errors, since angles, metres and pixels are of different sizes.
        return least_squares(self.errors, start, x_scale="jac", loss="soft_l1", max_nfev=200)

    def place_error_m(self, found: OptimizeResult) -> float:
        """Return ``Camera.place_error_m`` of the fit ``found``; 0 without robots."""
        if not self.robots_px.size:
            return 0.0
        # The rows of ``directions`` are independent combinations of the parameters; 1 / scale is the standard error of
        # each. Places are linear in small steps only.
        _, scales, directions = np.linalg.svd(found.jac, full_matrices=False)
        steps = 1e-4 * directions / np.maximum(scales, 1e-6)[:, None]
        moved_m = [self.moved_m(found.x, found.x + step) / 1e-4 for step in steps]
        by_corners_m = 2.0 * np.linalg.norm(moved_m, axis=0)
        if self.lens is not None:
            return float(by_corners_m.max())
        size_px = SIZE_PX if self.have_rims else RIMLESS_PX
        wider = replace(self, robots_px=self.robots_px + size_px * self.robots_outwards)
        by_size_m = self.moved_m(found.x, wider.fitted(found.x).x)
        return float(np.maximum(by_corners_m, by_size_m).max())

    def moved_m(self, before: Floats, after: Floats) -> Floats:
        """Return how far robots' places move, (markers,), m, if the parameters are ``after`` instead of ``before``."""
        centres_px = self.robots_px.mean(axis=1)
        before_m, after_m = (
            self.camera(at).at_height(centres_px, self.robot_height_m) for at in (before, after)
        )
        return np.asarray(np.linalg.norm(after_m - before_m, axis=1))

    def start(self, focal: float) -> Floats | None:
        """Return parameters from which the fit starts, by a focal length as a share of the image's width, or None."""
        cv2 = opencv()
        # Focal length, centre (2), k1 and k2; see the table of parameters.
        of_lens = [] if self.lens is not None else [np.log(focal), 0.0, 0.0, 0.0, 0.0]
        at = np.array([*np.zeros(6), *of_lens, 0.0])
        lens = self.camera(at).lens
        # IPPE, for points in a plane, finds wrong poses from exactly above.
        solved, turn, shift = cv2.solvePnP(
            self.floor_m, self.floor_px, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_SQPNP
        )
        if not solved or not np.isfinite([turn, shift]).all():
            return None
        at[:6] = np.concatenate([turn, shift]).ravel()
        return at


@with_one_blas_thread
def fit_camera(
    size_px: tuple[int, int],
    floor_m: Floats,
    floor_px: Floats,
    robots_px: Floats,
    robot_size_m: float,
    robot_height_m: float,
    lens: Lens | None = None,
    camera_height_m: float | None = None,
    *,
    have_rims: bool = True,
) -> Camera:
    """Fit a camera's pose, and its lens unless it is given.

    Args:
        size_px: width and height of the image.
        floor_m, floor_px: corners of the floor's markers, four for each, in the arena, (points, 3), and as they are
            seen, (points, 2).
        robots_px: corners of robots' markers as they are seen at any places, (markers, 4, 2).
        robot_size_m, robot_height_m: edge of a robot's marker, and its height above the floor.
        camera_height_m: height of the lens above the floor, if it was measured.
        have_rims: whether the floor's markers have white rims; if not, places are less sure.
    Raises:
        InputError: the camera is not above the robots, or corners are off by more than 2 % of the image's width.
    """
    seen = _Seen(
        size_px=size_px,
        floor_m=floor_m,
        floor_px=floor_px,
        robots_px=robots_px,
        robot_size_m=robot_size_m,
        robot_height_m=robot_height_m,
        lens=lens,
        camera_height_m=camera_height_m,
        have_rims=have_rims,
    )
    # A lens that is given is not fitted, so one start is enough; its focal length is not used.
    focal_starts = FOCAL_STARTS if lens is None else (1.0,)
    fits = [seen.fitted(start) for focal in focal_starts if (start := seen.start(focal)) is not None]
    if not fits:
        raise InputError(
            "the floor markers' places do not fit the picture; check their file", field="--markers"
        )
    found = min(fits, key=lambda fit: float(fit.cost))
    camera = seen.camera(found.x)
    error_px = float(np.sqrt(np.mean(np.sum(seen.floor_errors(found.x, camera.lens) ** 2, axis=1))))
    is_below_robots = camera.position_m[2] <= robot_height_m
    if not np.isfinite(found.x).all() or is_below_robots or error_px > 0.02 * size_px[0]:
        raise InputError(
            f"the floor markers' places do not fit the picture (by {error_px:.0f} px); check their file, that y grows "
            "upwards, and that each marker is turned as its third number says",
            field="--markers",
        )
    if lens is None:  # the lens was fitted to the floor's corners too, so their error is also its own
        camera = replace(camera, lens=replace(camera.lens, error_px=error_px))
    return replace(camera, floor_error_px=error_px, place_error_m=seen.place_error_m(found))


def matrix_of(focal_px: float, centre_px: Floats) -> Floats:
    """Return the camera matrix of a lens with square pixels, (3, 3), px."""
    return np.array([[focal_px, 0.0, centre_px[0]], [0.0, focal_px, centre_px[1]], [0.0, 0.0, 1.0]])


def outwards(corners_px: Floats) -> Floats:
    """Return by how much each corner moves, (markers, 4, 2), if all edges of its marker move outwards by one pixel.

    The corners of a square move along the diagonal: by one pixel along each of the two edges that meet there.
    """
    # Unit vectors from each corner to the next one. A corner moves against the edge that leaves it, and along the edge
    # that arrives at it.
    leaving = np.roll(corners_px, -1, axis=1) - corners_px
    # The maximum avoids a division by 0 if two corners are equal.
    leaving = leaving / np.maximum(np.linalg.norm(leaving, axis=-1, keepdims=True), 1e-9)
    return np.asarray(np.roll(leaving, 1, axis=1) - leaving)


def square_errors(corners_m: Floats, size_m: float) -> Floats:
    """Return how corners of markers, (markers, 4, 2), differ from the best fitting squares of this size, m."""
    centre, along_rad = square_of(corners_m)
    right = 0.5 * size_m * np.column_stack([np.cos(along_rad), np.sin(along_rad)])
    up = np.column_stack([-right[:, 1], right[:, 0]])
    squares = np.stack([up - right, up + right, right - up, -up - right], axis=1)
    return np.asarray(corners_m - centre[:, None] - squares)


def square_of(corners_m: Floats) -> tuple[Floats, Floats]:
    """Fit a square to the four corners of each marker, (markers, 4, 2).

    Returns: centres, (markers, 2), and directions of the top edges from left to right, (markers,), rad.
    """
    centre: Floats = corners_m.mean(axis=1)
    # Sum of the two edges that lead to the right (top and bottom), and of the two that lead upwards (left and right).
    to_right: Any = corners_m[:, 1] - corners_m[:, 0] + corners_m[:, 2] - corners_m[:, 3]
    upwards: Any = corners_m[:, 0] - corners_m[:, 3] + corners_m[:, 1] - corners_m[:, 2]
    # The rotation of a square with the least squared errors of the corners: ``upwards`` turned by -90 degrees is added
    # to ``to_right``, and the direction of the sum is taken.
    return centre, np.arctan2(to_right[:, 1] - upwards[:, 0], to_right[:, 0] + upwards[:, 1])
