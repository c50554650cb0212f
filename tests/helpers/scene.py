"""Draw the frames of an overhead video of a result: floor, markers at their height, lens, blur, noise, a hand.

Everything is drawn by ray casting: each pixel has a ray from the camera, and gets the grey level of what the ray meets
on the floor, on the plane of the markers, or on the table around the arena. For what has edges, several finer samples
per pixel are drawn and averaged. A hand that reaches into the picture hides robots now and then.

Random numbers are addressed by (seed, purpose, index), so the frame at a time is the same whichever frames are drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from helpers.fisheye import Fisheye, overhead
from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.lab.tracking import opencv
from vibroswarm.lab.tracking.markers import Markers, corners_at, dictionary_of
from vibroswarm.motion.pose import pose
from vibroswarm.result import Result

Floats = NDArray[np.float64]
Gray = NDArray[np.uint8]

TABLE, PLAIN, STILL, VIBRATING, PAPER, BODY, HAND = 116.0, 196.0, 204.0, 172.0, 236.0, 64.0, 150.0
"""Grey levels; ``TABLE`` is around the arena, and ``PLAIN`` is floor without visible tiles."""
BLACK: Final = 18.0
"""Grey level of the black of markers."""
PLATE: Final = 0.75
"""Least radius of the white plate that carries a robot's marker, as a share of the marker's edge: the marker's corners,
at 0.71 of the edge, need a white rim."""
MODULE_PX: Final = 8
"""Width of a marker's module (one of its small squares) in the image from which it is painted."""
OF_NOISE, OF_SHIFT, OF_HAND, OF_BOARD = 0, 1, 2, 3
"""What a random number of a video is for; part of its address, in the place of a robot's number."""


@dataclass(frozen=True)
class Look:
    """How a video is recorded."""

    size_px: tuple[int, int] = (1920, 1080)
    frames_per_s: float = 15.0
    camera_height_m: float = 1.5
    tilt_deg: float = 5.0
    """Tilt of the camera about the horizontal axis of its image; 0: it looks straight down."""
    lens_k: tuple[float, float] = (-0.09, 0.02)
    """Distortion of the rendering camera (``fisheye``)."""
    blur_px: float = 0.6
    """Standard deviation of the lens's blur; 0: none."""
    noise: float = 2.0
    """Standard deviation of a pixel's noise, grey levels of 255."""
    exposure_s: float = 0.01
    hands_per_min: float = 1.0
    """How often a hand reaches in; 0: never."""
    hand_s: float = 2.5
    """How long it stays."""
    samples: int = 4
    """Finer samples (rays) per pixel, along each axis."""
    tiles_visible: bool = True
    """Whether vibrating and still tiles have different grey levels."""


@dataclass
class Scene:
    """Draws what a camera sees.

    ``background`` is the picture without robots, hand and noise, drawn once. A "box" is a part of the image, as slices
    of rows and columns. "Fine samples" are rays: each pixel has ``look.samples`` of them along each axis.
    """

    markers: Markers
    floor: Floor
    arena_m: tuple[float, float]
    """Width and height of the arena."""
    body_radius_m: float
    look: Look
    seed: int
    camera: Fisheye
    background: Gray = field(init=False)
    _tangents: NDArray[np.float32] = field(init=False)
    """x / z and y / z of each pixel's ray in camera axes, (height, width, 2)."""
    _textures: dict[int, Gray] = field(init=False)
    """The image of each marker, ``MODULE_PX`` per module, by its number."""
    _noise: NDArray[np.int8] = field(init=False)
    """Noise of all pixels, (height * width,)."""

    def __post_init__(self) -> None:
        cv2 = opencv()
        self._tangents = self.camera.tangents()
        dictionary = dictionary_of(self.markers.dictionary)
        modules = dictionary.markerSize + 2  # small squares along an edge, with a border of one on both sides
        self._textures = {
            marker: cv2.aruco.generateImageMarker(dictionary, marker, modules * MODULE_PX)
            for marker in (*self.markers.robots, *self.markers.floor)
        }
        count = self.look.size_px[0] * self.look.size_px[1]
        # Standard normal numbers, from uniform ones by the inverse of the normal distribution function. They are scaled
        # to grey levels, which are rounded and cut to the range of int8.
        normal = ndtri(uniforms(self.seed, 0, OF_NOISE, Purpose.VIDEO, count))
        self._noise = np.clip(np.rint(normal * self.look.noise), -127, 127).astype(np.int8)
        self.background = self._drawn_floor()

    def frame(
        self, time_s: float, poses: Floats, end_poses: Floats | None = None
    ) -> tuple[Gray, NDArray[np.bool_]]:
        """Draw a frame.

        Args:
            time_s: middle of the exposure.
            poses: x, y and heading of each robot when the exposure begins, (robots, 3), in the order of
                ``markers.robots``.
            end_poses: the same when the exposure ends; None: nothing moves.
        Returns: the picture, uint8 (height, width); and whether the hand covers the centre of each robot's marker when
            the exposure begins, (robots,).
        """
        image = self.background.copy()  # robots and hand are drawn into it
        for robot, marker in enumerate(self.markers.robots):
            # A robot that moves is drawn at both ends of the exposure and averaged; one that stands, once.
            instants = [poses[robot]]
            if end_poses is not None and not np.array_equal(poses[robot], end_poses[robot]):
                instants.append(end_poses[robot])
            self._draw_robot(image, marker, instants)
        hidden = np.zeros(len(poses), dtype=np.bool_)
        hand = self._hand(time_s)  # 255 where the hand is, else 0
        if hand is not None:
            image[hand > 127] = HAND
            centres = np.column_stack([poses[:, :2], np.full(len(poses), self.markers.height_m)])
            at = np.rint(self.camera.project(centres)).astype(int)  # the pixel of each marker's centre
            # A robot outside the picture has no pixel there, and is not hidden by the hand.
            inside = (at >= 0).all(axis=1) & (at[:, 0] < hand.shape[1]) & (at[:, 1] < hand.shape[0])
            hidden[inside] = hand[at[inside, 1], at[inside, 0]] > 127
        return self.noisy(image, time_s), hidden

    def noisy(self, image: Gray, time_s: float) -> Gray:
        """Return an image with the noise of the frame at a time.

        All frames have the same noise, shifted along the pixels by a number that is random in each frame. Drawing new
        noise for each frame would take much longer.
        """
        if self.look.noise <= 0:
            return image
        cv2 = opencv()
        # The address of the random number is the time in ms, so the frame at a time always has the same shift.
        shift = uniforms(self.seed, 0, OF_SHIFT, Purpose.VIDEO, 1, first=round(time_s * 1000))[0]
        noise = np.roll(self._noise, int(shift * self._noise.size)).reshape(image.shape)
        noisy: Gray = cv2.add(image, noise, dtype=cv2.CV_8U)
        return noisy

    def _draw_robot(self, image: Gray, marker: int, instants: list[Floats]) -> None:
        """Draw a robot into an image, in place: its body on the floor, and above it a white plate with the marker.

        Args:
            marker: number of the robot's marker.
            instants: x, y and heading of the robot at one or several times of the exposure; the pictures of all are
                averaged.
        """
        radius, top = self.body_radius_m, self.markers.height_m
        plate = max(radius, PLATE * self.markers.size_m)  # its radius, never less than the body's
        # Only the box of the image around the robot is drawn. To compute it, the robot is enclosed in squares a little
        # larger than the plate, at the height of the floor and at that of the marker.
        around = np.concatenate(
            [corners_at(x, y, 0.0, 2.2 * plate, z) for x, y, _ in instants for z in (0.0, top)]
        )
        box = self.box_around(around)
        if box is None:  # the robot is outside the picture
            return
        rays = self.rays_of(box)
        # What was in the image before, with each pixel repeated for its fine samples.
        under = np.repeat(
            np.repeat(image[box].astype(np.float32), self.look.samples, 0), self.look.samples, 1
        )
        total = np.zeros_like(under)
        texture = self._textures[marker]
        for x, y, heading in instants:
            part = under.copy()
            on_floor = self._on_plane(rays, 0.0) - np.array([x, y], dtype=np.float32)
            part[np.hypot(on_floor[..., 0], on_floor[..., 1]) < radius] = BODY
            on_top = self._on_plane(rays, top) - np.array([x, y], dtype=np.float32)
            part[np.hypot(on_top[..., 0], on_top[..., 1]) < plate] = PAPER
            self._paint(part, on_top, heading - self.markers.forward_rad, self.markers.size_m, texture)
            total += part
        image[box] = self.developed(total / len(instants))

    def _paint(self, image: Any, places_m: Any, up_rad: float, size_m: float, texture: Gray) -> None:
        """Paint a marker into an image of fine samples, in place.

        Args:
            image: (h, w). places_m: where the ray of each sample meets the plane of the marker, as x and y from the
                marker's centre, (h, w, 2).
            up_rad: direction from the marker's centre to its top edge. size_m: of its edge.
            texture: the marker as an image of ``MODULE_PX`` per module.
        """
        cos, sin = math.cos(up_rad), math.sin(up_rad)
        up = places_m[..., 0] * cos + places_m[..., 1] * sin
        right = places_m[..., 0] * sin - places_m[..., 1] * cos
        n = texture.shape[0]  # the texture is square
        # Row and column of the texture at each sample; those outside it are left as they are.
        column = np.floor((right / size_m + 0.5) * n).astype(np.int32)
        row = np.floor((0.5 - up / size_m) * n).astype(np.int32)
        on = (column >= 0) & (column < n) & (row >= 0) & (row < n)
        light = texture[row[on], column[on]].astype(np.float32) / 255.0
        image[on] = BLACK + (PAPER - BLACK) * light

    def developed(self, fine: Any) -> Gray:
        """Blur an image of fine samples, as the lens does, and average the samples of each pixel.

        Args:
            fine: grey levels, (h * self.look.samples, w * self.look.samples).
        Returns: the pixels, uint8 (h, w).
        """
        cv2 = opencv()
        if self.look.blur_px > 0:
            # Kernel size (0, 0): OpenCV chooses the size from the standard deviation, which is in fine samples.
            fine = cv2.GaussianBlur(
                fine, (0, 0), self.look.blur_px * self.look.samples, borderType=cv2.BORDER_REPLICATE
            )
        size = (fine.shape[1] // self.look.samples, fine.shape[0] // self.look.samples)
        pixels = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        rounded: Gray = np.clip(np.rint(pixels), 0, 255).astype(np.uint8)
        return rounded

    def box_around(self, points_m: Floats, pad_px: int = 6) -> tuple[slice, slice] | None:
        """Return the rows and columns of the part of the image that contains points of the world, (points, 3), m.

        Args:
            pad_px: margin on all sides, so that the blur of what is drawn fits in.
        Returns: None if less than 2 px of its width or height are in the image.
        """
        at = self.camera.project(points_m)
        width, height = self.look.size_px
        low = np.maximum(np.floor(at.min(axis=0)).astype(int) - pad_px, 0)
        high = np.minimum(np.ceil(at.max(axis=0)).astype(int) + pad_px + 1, [width, height])
        if (high - low < 2).any():
            return None
        return slice(low[1], high[1]), slice(low[0], high[0])

    def rays_of(self, box: tuple[slice, slice]) -> Any:
        """Return the directions, in world axes, of the rays of a box's fine samples, float32 (h, w, 3).

        h and w are the height and width of the box, px, times ``look.samples``. The vectors are not of unit length.
        """
        cv2 = opencv()
        coarse = self._tangents[box]  # one ray per pixel
        size = (coarse.shape[1] * self.look.samples, coarse.shape[0] * self.look.samples)
        fine = cv2.resize(coarse, size, interpolation=cv2.INTER_LINEAR)
        rotation = self.camera.rotation.astype(np.float32)
        # The rows of the rotation are the camera's axes in the world.
        return fine[..., :1] * rotation[0] + fine[..., 1:] * rotation[1] + rotation[2]

    def _on_plane(self, rays: Any, z_m: float) -> Any:
        """Return x and y where rays meet the plane at a height, (h, w, 2), m."""
        position = self.camera.position_m.astype(np.float32)
        return position[:2] + rays[..., :2] * ((np.float32(z_m) - position[2]) / rays[..., 2:])

    def _drawn_floor(self) -> Gray:
        """Draw the table around the arena, the floor and its markers, in strips of rows to limit memory."""
        width, height = self.look.size_px
        image = np.zeros((height, width), dtype=np.uint8)
        strip_px, beyond_px = 64, 4
        for first in range(0, height, strip_px):
            # A strip is drawn with some rows beyond its ends, so that the blur makes no seam between strips.
            low, high = max(first - beyond_px, 0), min(first + strip_px + beyond_px, height)
            rays = self.rays_of((slice(low, high), slice(0, width)))
            flat, raised = self._on_plane(rays, 0.0), self._on_plane(rays, self.markers.floor_height_m)
            x, y = flat[..., 0], flat[..., 1]
            part = np.full(x.shape, TABLE, dtype=np.float32)
            inside = (x >= 0) & (x <= self.arena_m[0]) & (y >= 0) & (y <= self.arena_m[1])
            part[inside] = PLAIN
            if self.look.tiles_visible:
                tile = self.floor.tile_at(x[inside], y[inside])
                # -1: no tile. The maximum only makes -1 a valid index; what is found there is not used below.
                kind = np.where(self.floor.tiles.ravel()[np.maximum(tile, 0)] == 1, VIBRATING, STILL)
                part[inside] = np.where(tile >= 0, kind, PLAIN)
            for marker, (at_x, at_y, angle) in self.markers.floor.items():
                self._paint_floor_marker(part, raised, marker, (at_x, at_y), angle, self.markers.floor_size_m)
            # Without the rows beyond the ends of the strip.
            image[first : first + strip_px] = self.developed(part)[first - low : first - low + strip_px]
        return image

    def _paint_floor_marker(
        self, part: Any, places_m: Any, marker: int, at_m: tuple[float, float], angle: float, size_m: float
    ) -> None:
        """Paint a floor marker on its square paper, in place.

        Args:
            part: image of fine samples, (h, w). places_m: x and y where their rays meet the marker's plane, (h, w, 2).
            marker: its number. at_m, angle: its centre and angle, as in ``Markers.floor``. size_m: its edge.
        """
        relative = places_m - np.array(at_m, dtype=np.float32)
        # Only the box of the image around the marker is painted, which is faster.
        near = np.maximum(np.abs(relative[..., 0]), np.abs(relative[..., 1])) < 1.5 * size_m
        if not near.any():
            return
        rows, columns = np.flatnonzero(near.any(axis=1)), np.flatnonzero(near.any(axis=0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        local, own = relative[box], part[box]  # views, so painting into ``own`` changes ``part``
        cos, sin = math.cos(angle), math.sin(angle)
        across = np.abs(local[..., 0] * cos + local[..., 1] * sin)
        along = np.abs(local[..., 1] * cos - local[..., 0] * sin)
        # The paper is 1.3 times as wide as the marker, so that the marker has a white rim. At angle 0 the marker's top
        # edge points to +y: a quarter turn is added for ``_paint``.
        own[np.maximum(across, along) < 0.65 * size_m] = PAPER
        self._paint(own, local, angle + math.pi / 2, size_m, self._textures[marker])

    def _hand(self, time_s: float) -> Gray | None:
        """Return where a hand is in the picture at a time, (height, width), 255 where it is; None if there is none.

        Time is divided into periods. A hand visits once in each period; start, side, place and depth of the visit are
        random.
        """
        cv2 = opencv()
        look = self.look
        if look.hands_per_min <= 0:
            return None
        every_s = 60.0 / look.hands_per_min  # length of a period
        visit = int(time_s // every_s)
        begin, side, across, depth = uniforms(self.seed, 0, OF_HAND, Purpose.VIDEO, 4, first=4 * visit)
        # Time since the visit began; it ends within its period.
        since_s = time_s - visit * every_s - begin * max(every_s - look.hand_s, 0.0)
        if not 0.0 <= since_s < look.hand_s:
            return None
        width, height = look.size_px
        # How far the hand reaches into the picture, px: in and out again, by 20 to 70 % of the picture's height.
        reach = math.sin(math.pi * since_s / look.hand_s) * (0.2 + 0.5 * depth) * height
        at_x = int((0.2 + 0.6 * across) * width)
        edge, tip = (0, int(reach)) if side < 0.5 else (height, int(height - reach))
        # An arm, which is a thick line from the picture's edge, with a filled circle (thickness -1) as the hand.
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
) -> Scene:
    """Return the scene of a run, with a camera that sees the arena and its floor markers.

    Raises:
        InputError: the result has no paths.
    """
    if result.poses is None:
        raise InputError("needs paths; simulate with poses=True", field="RESULT")
    arena = result.scenario.arena
    corners = [markers.floor_corners(marker) for marker in markers.floor]
    # The image must contain the floor markers, and the arena with 5 mm around it. The x of the markers is
    # made 1.2 % larger, which leaves some room to the right of them; those on the left, near x = 0, hardly move.
    points = [(float(x), float(y)) for corner in corners for x, y, _ in corner * np.array([1.012, 1.0, 1.0])]
    points += [(x, y) for x in (-0.005, arena.width_m + 0.005) for y in (-0.005, arena.height_m + 0.005)]
    camera = overhead(
        look.size_px,
        points,
        height_m=look.camera_height_m,
        tilt_deg=look.tilt_deg,
        k=look.lens_k,
    )
    return Scene(
        markers=markers,
        floor=result.floor(run),
        arena_m=(arena.width_m, arena.height_m),
        body_radius_m=result.scenario.robot.body_radius_m,
        look=look,
        seed=seed,
        camera=camera,
    )


def poses_at(result: Result, run: int, robots: int, times_s: Floats) -> Floats:
    """Return the poses of the robots 0 to ``robots`` - 1 of a run, (times, robots, 3): x, y (m), heading (rad)."""
    poses = result.poses
    assert poses is not None  # ``scene_of`` has refused a result without paths
    return np.stack([pose(poses, run, robot, times_s) for robot in range(robots)], axis=1)
