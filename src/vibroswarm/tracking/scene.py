"""Draw the frames of an overhead video of a result: floor, markers at their height, lens, blur, noise, a hand.

All chance is addressed by (seed, purpose, index): the frame at a time is the same whichever frames are drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result
from vibroswarm.tracking import opencv
from vibroswarm.tracking.fisheye import Fisheye, overhead
from vibroswarm.tracking.markers import Markers, corners_at, dictionary_of

Floats = NDArray[np.float64]
Gray = NDArray[np.uint8]

TABLE, PLAIN, STILL, VIBRATING, PAPER, BODY, HAND = 116.0, 196.0, 204.0, 172.0, 236.0, 64.0, 150.0
"""Grey levels."""
BLACK: Final = 18.0
PLATE: Final = 0.75
"""Radius of the white plate that carries a marker, as a share of its edge: its corners need a white rim."""
SAMPLES: Final = 4
"""Rays per pixel and axis for what moves and for markers."""
MODULE_PX: Final = 8
OF_NOISE, OF_SHIFT, OF_HAND, OF_BOARD = 0, 1, 2, 3
"""What of a video a random number is for; in the place of the robot's number."""


@dataclass(frozen=True)
class Look:
    """How a video is recorded."""

    size_px: tuple[int, int] = (1920, 1080)
    frames_per_s: float = 15.0
    camera_height_m: float = 1.5
    tilt_deg: float = 5.0
    turned_deg: float = 0.0
    """About the camera's own axis."""
    lens_k: tuple[float, float] = (-0.09, 0.02)
    """Distortion of the rendering camera (``fisheye``)."""
    blur_px: float = 0.6
    noise: float = 2.0
    """Standard deviation of a pixel's noise, grey levels of 255."""
    exposure_s: float = 0.01
    hands_per_min: float = 1.0
    hand_s: float = 2.5
    tiles_visible: bool = True


@dataclass
class Scene:
    """What the camera sees."""

    markers: Markers
    floor: Floor
    arena_m: tuple[float, float]
    body_radius_m: float
    look: Look
    seed: int
    camera: Fisheye
    part_m: tuple[float, float] | None = None
    """From which to which x of the arena the camera sees; None: all of it."""
    background: Gray = field(init=False)
    _tangents: NDArray[np.float32] = field(init=False)
    _textures: dict[int, Gray] = field(init=False)
    _noise: NDArray[np.int8] = field(init=False)

    def __post_init__(self) -> None:
        cv2 = opencv()
        self._tangents = self.camera.tangents()
        dictionary = dictionary_of(self.markers)
        modules = int(self.markers.dictionary[0]) + 2
        self._textures = {
            marker: cv2.aruco.generateImageMarker(dictionary, marker, modules * MODULE_PX)
            for marker in (*self.markers.robots, *self.markers.floor)
        }
        count = self.look.size_px[0] * self.look.size_px[1]
        normal = ndtri(uniforms(self.seed, 0, OF_NOISE, Purpose.VIDEO, count))
        self._noise = np.clip(np.rint(normal * self.look.noise), -127, 127).astype(np.int8)
        self.background = self._drawn_floor()

    def frame(
        self, time_s: float, poses: Floats, end_poses: Floats | None = None
    ) -> tuple[Gray, NDArray[np.bool_]]:
        """Draw a frame.

        Args:
            time_s: middle of the exposure. poses: (robots, 3): x, y, heading when it begins.
            end_poses: when it ends; None: nothing moves.
        Returns: the picture, uint8 (height, width), and for each robot whether the hand covers its centre.
        """
        image = self.background.copy()
        for robot, marker in enumerate(self.markers.robots):
            moves = end_poses is not None and not np.array_equal(poses[robot], end_poses[robot])
            instants = [poses[robot], end_poses[robot]] if moves and end_poses is not None else [poses[robot]]
            self._draw_robot(image, marker, instants)
        hidden = np.zeros(len(poses), dtype=np.bool_)
        mask = self._hand(time_s)
        if mask is not None:
            image[mask > 127] = HAND
            centres = np.column_stack([poses[:, :2], np.full(len(poses), self.markers.height_m)])
            at = np.rint(self.camera.project(centres)).astype(int)
            inside = (at >= 0).all(axis=1) & (at[:, 0] < mask.shape[1]) & (at[:, 1] < mask.shape[0])
            hidden[inside] = mask[at[inside, 1], at[inside, 0]] > 127
        return self.noisy(image, time_s), hidden

    def noisy(self, image: Gray, time_s: float) -> Gray:
        """Add the noise of the frame at a time."""
        if self.look.noise <= 0:
            return image
        cv2 = opencv()
        shift = uniforms(self.seed, 0, OF_SHIFT, Purpose.VIDEO, 1, first=round(time_s * 1000))[0]
        noise = np.roll(self._noise, int(shift * self._noise.size)).reshape(image.shape)
        noisy: Gray = cv2.add(image, noise, dtype=cv2.CV_8U)
        return noisy

    def _draw_robot(self, image: Gray, marker: int, instants: list[Floats]) -> None:
        """Draw a robot's body and its top with the marker, averaged over the instants of the exposure."""
        radius, top = self.body_radius_m, self.markers.height_m
        plate = max(radius, PLATE * self.markers.size_m)
        around = np.concatenate(
            [corners_at(x, y, 0.0, 2.2 * plate, z)[:, :3] for x, y, _ in instants for z in (0.0, top)]
        )
        box = self.box_around(around)
        if box is None:
            return
        rays = self.rays_of(box)
        under = np.repeat(np.repeat(image[box].astype(np.float32), SAMPLES, 0), SAMPLES, 1)
        total = np.zeros_like(under)
        texture = self._textures[marker]
        for x, y, heading in instants:
            part = under.copy()
            on_floor = self._on_plane(rays, 0.0) - np.array([x, y], dtype=np.float32)
            part[np.hypot(on_floor[..., 0], on_floor[..., 1]) < radius] = BODY
            flat = self._on_plane(rays, top) - np.array([x, y], dtype=np.float32)
            square = np.maximum(np.abs(flat[..., 0]), np.abs(flat[..., 1]))
            part[np.hypot(flat[..., 0], flat[..., 1]) < plate] = PAPER
            if square.size:
                self._paint(part, flat, heading - self.markers.forward_rad, self.markers.size_m, texture)
            total += part
        image[box] = self.developed(total / len(instants))

    def _paint(self, image: Any, flat: Any, up_rad: float, size_m: float, texture: Gray) -> None:
        """Paint a marker over rays that meet its plane at ``flat``, relative to its centre."""
        cos, sin = math.cos(up_rad), math.sin(up_rad)
        up, right = flat[..., 0] * cos + flat[..., 1] * sin, flat[..., 0] * sin - flat[..., 1] * cos
        n = texture.shape[0]
        column = np.floor((right / size_m + 0.5) * n).astype(np.int32)
        row = np.floor((0.5 - up / size_m) * n).astype(np.int32)
        on = (column >= 0) & (column < n) & (row >= 0) & (row < n)
        light = texture[row[on], column[on]].astype(np.float32) / 255.0
        image[on] = BLACK + (PAPER - BLACK) * light

    def developed(self, fine: Any) -> Gray:
        """Return the pixels of finer samples, blurred as by the lens."""
        cv2 = opencv()
        if self.look.blur_px > 0:
            fine = cv2.GaussianBlur(
                fine, (0, 0), self.look.blur_px * SAMPLES, borderType=cv2.BORDER_REPLICATE
            )
        size = (fine.shape[1] // SAMPLES, fine.shape[0] // SAMPLES)
        pixels = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        rounded: Gray = np.clip(np.rint(pixels), 0, 255).astype(np.uint8)
        return rounded

    def box_around(self, points_m: Floats, pad_px: int = 6) -> tuple[slice, slice] | None:
        """Return the rows and columns of the image around points of the world; None if these are not in the image."""
        at = self.camera.project(points_m)
        width, height = self.look.size_px
        low = np.maximum(np.floor(at.min(axis=0)).astype(int) - pad_px, 0)
        high = np.minimum(np.ceil(at.max(axis=0)).astype(int) + pad_px + 1, [width, height])
        if (high - low < 2).any():
            return None
        return slice(low[1], high[1]), slice(low[0], high[0])

    def rays_of(self, box: tuple[slice, slice]) -> Any:
        """Return the directions, in the world, of the rays of finer samples of a box, float32 (h, w, 3)."""
        cv2 = opencv()
        coarse = self._tangents[box]
        size = (coarse.shape[1] * SAMPLES, coarse.shape[0] * SAMPLES)
        fine = cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
        rotation = self.camera.rotation.astype(np.float32)
        return fine[..., :1] * rotation[0] + fine[..., 1:] * rotation[1] + rotation[2]

    def _on_plane(self, rays: Any, z_m: float) -> Any:
        """Return x and y where rays meet the plane at a height, (h, w, 2), m."""
        position = self.camera.position_m.astype(np.float32)
        return position[:2] + rays[..., :2] * ((np.float32(z_m) - position[2]) / rays[..., 2:])

    def _drawn_floor(self) -> Gray:
        """Draw the table, the floor and its markers, in strips of rows to limit memory."""
        width, height = self.look.size_px
        image = np.zeros((height, width), dtype=np.uint8)
        size, strip = self.markers.floor_size_m, 64
        for first in range(0, height, strip):
            # A strip is drawn with some rows beyond its ends, so that its blur meets that of the next.
            low, high = max(first - 4, 0), min(first + strip + 4, height)
            rays = self.rays_of((slice(low, high), slice(0, width)))
            flat, raised = self._on_plane(rays, 0.0), self._on_plane(rays, self.markers.floor_height_m)
            x, y = flat[..., 0], flat[..., 1]
            part = np.full(x.shape, TABLE, dtype=np.float32)
            inside = (x >= 0) & (x <= self.arena_m[0]) & (y >= 0) & (y <= self.arena_m[1])
            part[inside] = PLAIN
            if self.look.tiles_visible:
                tile = self.floor.tile_at(x[inside], y[inside])
                kind = np.where(self.floor.tiles.ravel()[np.maximum(tile, 0)] == 1, VIBRATING, STILL)
                part[inside] = np.where(tile >= 0, kind, PLAIN)
            for marker, (at_x, at_y, angle) in self.markers.floor.items():
                self._paint_floor_marker(part, raised, marker, (at_x, at_y), angle, size)
            image[first : first + strip] = self.developed(part)[first - low : first - low + strip]
        return image

    def _paint_floor_marker(
        self, part: Any, flat: Any, marker: int, at_m: tuple[float, float], angle: float, size_m: float
    ) -> None:
        """Paint a floor marker on its paper."""
        relative = flat - np.array(at_m, dtype=np.float32)
        near = np.maximum(np.abs(relative[..., 0]), np.abs(relative[..., 1])) < 1.5 * size_m
        if not near.any():
            return
        rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        local, own = relative[box], part[box]
        cos, sin = math.cos(angle), math.sin(angle)
        across = np.abs(local[..., 0] * cos + local[..., 1] * sin)
        along = np.abs(local[..., 1] * cos - local[..., 0] * sin)
        own[np.maximum(across, along) < 0.65 * size_m] = PAPER
        self._paint(own, local, angle + math.pi / 2, size_m, self._textures[marker])

    def _hand(self, time_s: float) -> Gray | None:
        """Return the mask of a hand that reaches in at a time, (height, width), 255 where it is; None without one."""
        cv2 = opencv()
        look = self.look
        if look.hands_per_min <= 0:
            return None
        every_s = 60.0 / look.hands_per_min
        visit = int(time_s // every_s)
        begin, side, across, depth = uniforms(self.seed, 0, OF_HAND, Purpose.VIDEO, 4, first=4 * visit)
        since = time_s - visit * every_s - begin * max(every_s - look.hand_s, 0.0)
        if not 0.0 <= since < look.hand_s:
            return None
        width, height = look.size_px
        reach = math.sin(math.pi * since / look.hand_s) * (0.2 + 0.5 * depth) * height
        at_x = int((0.2 + 0.6 * across) * width)
        edge, tip = (0, int(reach)) if side < 0.5 else (height, int(height - reach))
        mask = np.zeros((height, width), dtype=np.uint8)
        cv2.line(mask, (at_x, edge), (at_x, tip), 255, int(0.06 * height))
        cv2.circle(mask, (at_x, tip), int(0.055 * height), 255, -1)
        return mask


def scene_of(
    result: Result,
    run: int,
    markers: Markers,
    look: Look,
    seed: int,
    part_m: tuple[float, float] | None = None,
) -> Scene:
    """Return the scene of a run.

    Args:
        part_m: from which to which x of the arena the camera sees, with the floor markers there; None: all of it.
    Raises:
        InputError: the result has no paths.
    """
    if result.segments is None:
        raise InputError("needs paths; simulate with segments=True", field="RESULT")
    arena = result.scenario.arena
    low, high = (0.0, arena.width_m) if part_m is None else part_m
    aside = [x for x, _, _ in markers.floor.values()]
    left = -np.inf if low <= 0.0 else low
    right = np.inf if high >= arena.width_m else high
    near = [marker for marker, x in zip(markers.floor, aside, strict=True) if left <= x <= right]
    corners = [markers.floor_corners(marker) for marker in near]
    # All papers of the floor markers, and the arena with its robots.
    points = [(float(x), float(y)) for corner in corners for x, y, _ in corner * np.array([1.012, 1.0, 1.0])]
    points += [(x, y) for x in (low - 0.005, high + 0.005) for y in (-0.005, arena.height_m + 0.005)]
    camera = overhead(
        look.size_px,
        points,
        height_m=look.camera_height_m,
        tilt_deg=look.tilt_deg,
        k=look.lens_k,
        turned_deg=look.turned_deg,
    )
    return Scene(
        markers=markers,
        floor=result.floor(run),
        arena_m=(arena.width_m, arena.height_m),
        body_radius_m=result.scenario.robot.body_radius_m,
        look=look,
        seed=seed,
        camera=camera,
        part_m=part_m,
    )


def poses_at(result: Result, run: int, robots: int, times_s: Floats) -> Floats:
    """Return the poses of all robots of a run, (times, robots, 3): x, y (m), heading (rad)."""
    segments = result.segments
    assert segments is not None
    return np.stack([pose(segments, run, robot, times_s) for robot in range(robots)], axis=1)
