"""Draw a video of a chessboard before the camera of a scene, from which a lens is calibrated."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.rng import Purpose, uniforms
from vibroswarm.tracking.opencv import opencv
from vibroswarm.tracking.scene import OF_BOARD, SAMPLES, Scene
from vibroswarm.tracking.video_file import VideoWriter

BOARD: Final = (9, 6)
"""Inner corners of the chessboard, across and down."""
SQUARE_MM: Final = 40.0
BOARD_FRAMES: Final = 40


def write_chessboard(scene: Scene, path: Path, frames: int = BOARD_FRAMES) -> None:
    """Write a video of a chessboard that is held before the scene's camera, tilted in all directions."""
    look = scene.look
    with VideoWriter(path, look.size_px, look.frames_per_s) as writer:
        for k in range(frames):
            writer.write(_board_frame(scene, k))


def _board_frame(scene: Scene, k: int) -> NDArray[np.uint8]:
    """Draw a chessboard somewhere over the floor, with a white rim."""
    cv2 = opencv()
    draws = uniforms(scene.seed, 0, OF_BOARD, Purpose.VIDEO, 6, first=6 * k)
    width, height = scene.arena_m
    middle, turned_by = np.array([width, height]) / 2, 0.0
    if scene.part_m is not None:  # a camera that hangs crosswise over a part of the arena
        low, high = scene.part_m
        middle, turned_by = np.array([(low + high) / 2, height / 2]), np.radians(scene.look.turned_deg)
        width = height = high - low
    camera_m = float(scene.camera.position_m[2])
    # Held so that it fills about a third of the image's height, wherever the camera hangs.
    square = SQUARE_MM / 1000
    half = np.array([BOARD[0] + 1, BOARD[1] + 1]) * square / 2
    above = max(camera_m - 1.35, 0.25 * camera_m) + 0.15 * draws[0] * camera_m
    room = np.array([width, height]) * (camera_m - above) / camera_m
    aside = (draws[1:3] - 0.5) * np.array([1.75, 1.0]) * room * 0.62
    cos, sin = np.cos(turned_by), np.sin(turned_by)
    at = middle + np.array([[cos, -sin], [sin, cos]]) @ aside
    a, b, c = (draws[3:6] - 0.5) * np.array([1.0, 1.0, 0.8])
    turned, _ = cv2.Rodrigues(np.array([a, b, 0.0]))
    spun, _ = cv2.Rodrigues(np.array([0.0, 0.0, c + turned_by]))
    axes = (turned @ spun).astype(np.float32)
    centre = np.array([*at, above], dtype=np.float32)
    rim = half + square * 0.6
    box = scene.box_around(
        np.array([centre + axes @ [x, y, 0.0] for x in (-rim[0], rim[0]) for y in (-rim[1], rim[1])])
    )
    image = scene.background.copy()
    if box is None:
        return scene.noisy(image, float(k))
    rays = scene.rays_of(box)
    position = scene.camera.position_m.astype(np.float32)
    along = (axes[:, 2] @ (centre - position)) / (rays @ axes[:, 2])
    local = (position + rays * along[..., None] - centre) @ axes
    x, y = local[..., 0], local[..., 1]
    part = np.repeat(np.repeat(image[box].astype(np.float32), SAMPLES, 0), SAMPLES, 1)
    on_rim = (np.abs(x) < rim[0]) & (np.abs(y) < rim[1])
    on_board = (np.abs(x) < half[0]) & (np.abs(y) < half[1])
    dark = (np.floor((x + half[0]) / square) + np.floor((y + half[1]) / square)) % 2 == 0
    part[on_rim] = 236.0
    part[on_board & dark] = 18.0
    image[box] = scene.developed(part)
    return scene.noisy(image, float(k))
