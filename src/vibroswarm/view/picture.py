"""Draw the state of a run at one time as a picture in three dimensions, without a display or browser.

MuJoCo draws it, by one of two OpenGL libraries: EGL or OSMesa.
"""

from __future__ import annotations

import io
import math
import os
import subprocess
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vibroswarm.core import child_python
from vibroswarm.core.atomic_io import write_file
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.view.scene import (
    INK,
    SAMPLE_M,
    WALL_M,
    Playback,
    floor_picture,
    kind_colours,
    robot_parts,
    shape_of,
    walls,
)

WIDTH, HEIGHT = 1280, 960
"""Size of the picture in pixels."""
WAYS: Final = ("egl", "osmesa")
"""Values of ``MUJOCO_GL`` that are tried one after the other, unless it is set."""
SECONDS: Final = 120
"""Time limit of drawing with one value of ``MUJOCO_GL``."""
FOV_DEG: Final = 57.0
"""Vertical field of view of the camera."""


def write_picture(result: Result, run: int, path: Path, time_s: float | None = None) -> str:
    """Write a picture of a run at ``time_s`` (by default at its end) as PNG.

    Args:
        run: number of the run. path: of the file. time_s: time of the run, s.
    Returns: the value of ``MUJOCO_GL`` with which it was drawn, such as "egl".
    Raises:
        InputError: MuJoCo is missing, neither EGL nor OSMesa works, there is no such run or time, or the run has no
            samples.
        RunError: the disk is full or failed.
    """
    if find_spec("mujoco") is None:
        raise InputError(
            "needs MuJoCo, which is not installed: pip install 'vibroswarm[physics]'", field="--picture"
        )
    playback = Playback(result, run)
    at_s = playback.end_s if time_s is None else time_s
    if not 0.0 <= at_s <= playback.end_s:
        raise InputError(f"{at_s:g} is not from 0 to {playback.end_s:g} s", field="--at")
    pixels, way = _drawn(scene_xml(playback, at_s), floor_picture(playback, at_s))
    encoded = io.BytesIO()
    Image.fromarray(pixels).save(encoded, "png")
    write_file(path, encoded.getvalue())
    return way


def _drawn(xml: str, floor: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], str]:
    """Draw a scene in a separate process, the program ``view.render``.

    The process uses the OpenGL library that the environment variable ``MUJOCO_GL`` names. If the variable is not set,
    the libraries in ``WAYS`` are tried until one works.

    Args:
        xml: the scene as MJCF, which refers to the picture of the floor as "floor.png". floor: RGB pixels of this
            picture, (rows, columns, 3).
    Returns: the pixels, (HEIGHT, WIDTH, 3), and the value of ``MUJOCO_GL`` with which they were drawn.
    Raises:
        InputError: no library works.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    reasons = []
    with tempfile.TemporaryDirectory(prefix="vibroswarm-") as name:
        folder = Path(name)
        (folder / "scene.xml").write_text(xml, encoding="utf-8")
        Image.fromarray(floor).save(folder / "floor.png")
        for way in (chosen,) if chosen else WAYS:
            command = child_python.command(
                "-m", "vibroswarm.view.render", "scene.xml", str(WIDTH), str(HEIGHT), "out.rgb"
            )
            environment = child_python.environment(MUJOCO_GL=way)
            environment.pop("PYOPENGL_PLATFORM", None)  # MuJoCo refuses a value other than that of MUJOCO_GL
            try:
                done = subprocess.run(
                    command, cwd=folder, env=environment, capture_output=True, text=True, timeout=SECONDS
                )
            except subprocess.TimeoutExpired:
                reasons.append(f"{way}: no picture after {SECONDS} s")
                continue
            out = folder / "out.rgb"
            if done.returncode == 0 and out.is_file() and out.stat().st_size == WIDTH * HEIGHT * 3:
                return np.frombuffer(out.read_bytes(), dtype=np.uint8).reshape(HEIGHT, WIDTH, 3), way
            # The last line that the process printed names the error.
            error_lines = done.stderr.strip().splitlines() or [f"ended with exit code {done.returncode}"]
            reasons.append(f"{way}: {error_lines[-1][:160]}")
    raise InputError(
        f"cannot be drawn here without a display ({'; '.join(reasons)}); install EGL or OSMesa (Debian: libegl1 or "
        "libosmesa6), or use --html",
        field="--picture",
    )


def camera_of(result: Result) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the camera's place, x, y, z (m), and its axes.

    The camera stands above the arena's lower edge and looks at the middle of the floor.

    Returns: the place, (3,), and unit vectors to its right, up and back, (3, 3), one per row.
    """
    arena = result.scenario.arena
    across_m = max(arena.width_m, arena.height_m)
    middle = np.array([arena.width_m / 2.0, arena.height_m / 2.0, 0.0])
    # With the field of view ``FOV_DEG`` the whole arena is visible from here.
    eye = middle + np.array([0.0, -0.55 * across_m, 0.95 * across_m])
    back = (eye - middle) / np.linalg.norm(eye - middle)
    right = np.array([1.0, 0.0, 0.0])
    return eye, np.stack([right, np.cross(back, right), back])


def scene_xml(playback: Playback, time_s: float) -> str:
    """Return the scene at a time as MJCF, the XML of MuJoCo: floor, walls, robots, and the samples taken by then.

    All bodies are fixed. MJCF gives the sizes of boxes, cylinders and planes as half lengths; the third size of a plane
    is the spacing of its grid lines.
    """
    arena = playback.result.scenario.arena
    eye, axes = camera_of(playback.result)
    right_and_up = axes[:2]
    geoms = [
        _geom("box", (size_x / 2, size_y / 2, WALL_M / 2), (*at, WALL_M / 2), INK, alpha=0.35)
        for at, (size_x, size_y) in walls(arena).values()
    ]
    for robot in range(playback.robots):
        geoms += _robot(playback, robot, time_s)
    for k in range(playback.samples_by(time_s)):
        x_m, y_m = playback.places[k]
        geoms.append(_sample(x_m, y_m, playback.readings[k]))
    return f"""<mujoco>
  <visual>
    <global offwidth="{WIDTH}" offheight="{HEIGHT}"/>
    <headlight ambient="0.8 0.8 0.8" diffuse="0.2 0.2 0.2" specular="0 0 0"/>
  </visual>
  <asset>
    <texture name="floor" type="2d" file="floor.png"/>
    <texture name="sky" type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="16" height="16"/>
    <material name="floor" texture="floor" texuniform="false" texrepeat="1 1"/>
  </asset>
  <worldbody>
    <camera pos="{_numbers(eye)}" xyaxes="{_numbers(right_and_up.ravel())}" fovy="{FOV_DEG}"/>
    <geom type="plane" size="{arena.width_m / 2!r} {arena.height_m / 2!r} 1" material="floor"
          pos="{arena.width_m / 2!r} {arena.height_m / 2!r} 0"/>
    {"".join(geoms)}
  </worldbody>
</mujoco>"""


BOXES: Final = ((0.0033, 0.0033, 45.0), (0.0033, 0.0033, 0.0), (0.006, 0.0015, 90.0), (0.006, 0.0015, 0.0))
"""Half lengths (m) and rotation (degrees) of samples read as kind 1, 2, ...; see ``scene.shape_of``. Of kind 0 they are
discs."""


def _sample(x_m: float, y_m: float, reading: int) -> str:
    """Return a sample as MJCF, flat on the floor and 1 mm high, in the shape and colour of its reading."""
    at, colour = (x_m, y_m, 0.0005), kind_colours(reading)[1]
    if reading == 0:
        return _geom("cylinder", (SAMPLE_M / 2, 0.0005), at, colour)
    ahead_m, left_m, turned_deg = BOXES[shape_of(reading) - 1]
    return _geom("box", (ahead_m, left_m, 0.0005), at, colour, turned_deg=turned_deg)


def _robot(playback: Playback, robot: int, time_s: float) -> list[str]:
    """Return a robot as MJCF: its body in the colour of its belief, and its dark parts.

    The list is empty if the robot's place is not known at this time.
    """
    x_m, y_m, heading_rad = playback.poses(robot, time_s)[0].tolist()
    if not math.isfinite(x_m):
        return []
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    _, body_colour = playback.looks(robot, time_s)
    geoms = []
    for k, (kind, size_m, (ahead, left, up)) in enumerate(robot_parts(playback.result)):
        at = (x_m + ahead * cos - left * sin, y_m + ahead * sin + left * cos, up)
        # MJCF has half lengths of boxes; of cylinders the radius, and half of the height.
        halves = tuple(length / 2 for length in size_m) if kind == "box" else (size_m[0], size_m[1] / 2)
        colour = INK if k else body_colour
        geoms.append(_geom(kind, halves, at, colour, turned_deg=math.degrees(heading_rad)))
    return geoms


def _geom(
    kind: str,
    size: tuple[float, ...],
    at: tuple[float, float, float],
    colour: tuple[int, int, int],
    *,
    alpha: float = 1.0,
    turned_deg: float = 0.0,
) -> str:
    """Return one body of the scene as MJCF.

    Args:
        kind: "box" or "cylinder". size: half lengths, or radius and half height, m. at: middle, m. colour: 0 to 255.
        alpha: opacity. turned_deg: rotation about the vertical.
    """
    rgba = _numbers((*(part / 255.0 for part in colour), alpha))
    place = f'pos="{_numbers(at)}" euler="0 0 {turned_deg:.6g}"'
    return f'<geom type="{kind}" size="{_numbers(size)}" {place} rgba="{rgba}"/>'


def _numbers(values: NDArray[np.float64] | tuple[float, ...]) -> str:
    return " ".join(f"{float(value):.6g}" for value in values)
