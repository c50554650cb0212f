"""The scene: floor, walls, robots with their beliefs, samples; set to a time."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.view.playback import Playback

STILL: Final = (232, 232, 228)
VIBRATING: Final = (176, 176, 170)
LESS: Final = (33, 102, 172)
MORE: Final = (178, 24, 43)
UNSURE: Final = (247, 247, 247)
"""Colours: a floor in grey; blue for beliefs and readings of less, red for those of more, pale between."""
INK: Final = (60, 60, 60)
WALL_M: Final = 0.03
ROBOT_HEIGHT_M: Final = 0.025
SAMPLE_M: Final = 0.008
CHUNK: Final = 64
"""Samples in one cloud of points: only the latest cloud changes when a sample is added."""
PIXELS: Final = 400


def colour_of(belief: float) -> tuple[int, int, int]:
    """Return the colour of a belief that less vibrates, from red (0) over pale (0.5) to blue (1)."""
    end = LESS if belief > 0.5 else MORE
    share = 2.0 * abs(belief - 0.5)
    red, green, blue = (round(pale + share * (full - pale)) for pale, full in zip(UNSURE, end, strict=True))
    return red, green, blue


def words_of(belief: float, decision: int) -> str:
    """Return what stands over a robot."""
    if decision < 0:
        return f"p {belief:.2f}"
    return f"p {belief:.2f} decided {'less' if decision == 0 else 'more'}"


def floor_picture(playback: Playback) -> NDArray[np.uint8]:
    """Return the floor of the arena as pixels, top row first, (rows, columns, 3)."""
    arena, floor = playback.result.scenario.arena, playback.floor
    pixel_m = max(arena.width_m, arena.height_m) / PIXELS
    x = (np.arange(max(round(arena.width_m / pixel_m), 1)) + 0.5) * pixel_m
    y = arena.height_m - (np.arange(max(round(arena.height_m / pixel_m), 1)) + 0.5) * pixel_m
    width_m, height_m, left_m, bottom_m = floor.geometry[2:]
    rows, columns = floor.tiles.shape
    column = np.floor((x - left_m) / width_m).astype(int)
    row = rows - 1 - np.floor((y - bottom_m) / height_m).astype(int)
    inside = ((row >= 0) & (row < rows))[:, None] & ((column >= 0) & (column < columns))[None, :]
    tile = floor.tiles[np.clip(row, 0, rows - 1)[:, None], np.clip(column, 0, columns - 1)[None, :]]
    picture = np.where(tile[..., None] == 1, np.array(VIBRATING), np.array(STILL)).astype(np.uint8)
    picture[~inside] = 255
    return picture


class Scene:
    """Floor, walls, robots and samples in a viser server.

    Args:
        api: ``viser.SceneApi`` of a server. playback: what is to be shown.
    """

    def __init__(self, api: Any, playback: Playback) -> None:
        self.api, self.playback = api, playback
        arena, body = playback.result.scenario.arena, playback.result.scenario.robot
        width_m, height_m = arena.width_m, arena.height_m
        api.set_up_direction("+z")
        api.configure_environment_map(None)
        api.add_light_ambient("/light", intensity=1.2)
        # viser draws an image with its first row at low y, so it lies turned over.
        api.add_image(
            "/floor", np.ascontiguousarray(floor_picture(playback)), width_m, height_m, format="png",
            position=(width_m / 2, height_m / 2, 0.0), wxyz=(0.0, 1.0, 0.0, 0.0), receive_shadow=False,
        )  # fmt: skip
        thick_m = 0.005
        for name, at, size in (
            ("left", (-thick_m / 2, height_m / 2), (thick_m, height_m)),
            ("right", (width_m + thick_m / 2, height_m / 2), (thick_m, height_m)),
            ("low", (width_m / 2, -thick_m / 2), (width_m, thick_m)),
            ("high", (width_m / 2, height_m + thick_m / 2), (width_m, thick_m)),
        ):
            place = (*at, WALL_M / 2)
            api.add_box(f"/walls/{name}", INK, (*size, WALL_M), opacity=0.35, position=place)
        radius_m = body.body_radius_m
        self.frames, self.bodies, self.labels = [], [], []
        for robot in range(playback.robots):
            path = f"/robots/{robot}"
            self.frames.append(api.add_frame(path, show_axes=False))
            self.bodies.append(
                api.add_cylinder(
                    f"{path}/body", radius_m, ROBOT_HEIGHT_M, UNSURE, position=(0.0, 0.0, ROBOT_HEIGHT_M / 2)
                )
            )
            api.add_box(
                f"{path}/front", INK, (radius_m, radius_m / 3, ROBOT_HEIGHT_M / 3),
                position=(radius_m / 2, 0.0, ROBOT_HEIGHT_M),
            )  # fmt: skip
            self.labels.append(
                api.add_label(
                    f"{path}/belief", "", position=(0.0, 0.0, 2.2 * ROBOT_HEIGHT_M), anchor="bottom-center",
                    font_screen_scale=0.7,
                )
            )  # fmt: skip
        self.clouds: dict[int, Any] = {}
        self.shown: dict[int, int] = {}
        self._poses: dict[int, tuple[float, ...]] = {}
        self._words: dict[int, str] = {}

    def set_time(self, time_s: float) -> None:
        """Show what is where at a time, s; change only what differs."""
        for robot in range(self.playback.robots):
            self._place(robot, time_s)
        self._show_samples(self.playback.samples_by(time_s))

    def _place(self, robot: int, time_s: float) -> None:
        """Set one robot's pose and belief."""
        x_m, y_m, heading_rad = self.playback.poses(robot, time_s)[0].tolist()
        if not math.isfinite(x_m):
            self.frames[robot].visible = False
            return
        if self._poses.get(robot) != (x_m, y_m, heading_rad):
            self._poses[robot] = (x_m, y_m, heading_rad)
            self.frames[robot].position = (x_m, y_m, 0.0)
            self.frames[robot].wxyz = (math.cos(heading_rad / 2), 0.0, 0.0, math.sin(heading_rad / 2))
        belief, decision = self.playback.belief(robot, time_s)
        words = words_of(belief, decision)
        if self._words.get(robot) != words:
            self._words[robot] = words
            self.labels[robot].text, self.bodies[robot].color = f"{robot}: {words}", colour_of(belief)

    def _show_samples(self, count: int) -> None:
        """Show the first ``count`` samples: blue read as still, red as vibrating."""
        chunks = -(-len(self.playback.sample_s) // CHUNK)
        for chunk in range(chunks):
            first = chunk * CHUNK
            shown = min(max(count - first, 0), CHUNK)
            if self.shown.get(chunk, 0) == shown:
                continue
            self.shown[chunk] = shown
            old = self.clouds.pop(chunk, None)
            if old is not None:
                old.remove()
            if shown == 0:
                continue
            rows = slice(first, first + shown)
            heights = np.full((shown, 1), SAMPLE_M / 2)
            self.clouds[chunk] = self.api.add_point_cloud(
                f"/samples/{chunk}",
                np.hstack([self.playback.places[rows], heights]).astype(np.float32),
                np.where(self.playback.readings[rows, None] == 1, np.array(MORE), np.array(LESS)).astype(
                    np.uint8
                ),
                point_size=SAMPLE_M,
                point_shape="circle",
                point_shading="flat",
                precision="float32",
            )
