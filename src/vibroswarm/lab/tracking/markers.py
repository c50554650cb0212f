"""Describe which ArUco markers are where: on the robots, at one height, and on the floor, at known positions.

A file of markers is TOML, with lengths in mm:

    dictionary = "4X4_50"
    [robots]
    size_mm = 22.0              # outer edge of the black square
    height_mm = 30.0            # of the marker above the floor
    forward_deg = 0.0           # from the marker's top edge to the robot's heading, anticlockwise
    ids = { 10 = 1, 11 = 2 }    # marker = name of its robot; or a list of the markers of robots 0, 1, ...
    [floor]
    size_mm = 50.0
    height_mm = 0.0
    at_mm = { 46 = [-55, 40], 47 = [1055, 40] }   # marker = its centre in the arena; a third number is its angle

A marker's angle is in degrees, anticlockwise; without one it is 0, and the top edge of the marker points to +y. A
robot's name is the number by which its log calls it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vibroswarm.core.arrays import Floats
from vibroswarm.core.read_tables import read_model
from vibroswarm.errors import InputError, check_choice, shown
from vibroswarm.lab.tracking import opencv

DICTIONARIES: Final = {
    **{f"{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "ARUCO_ORIGINAL": 1024,
    "ARUCO_MIP_36h12": 250,
    "APRILTAG_16h5": 30,
    "APRILTAG_25h9": 35,
    "APRILTAG_36h10": 2320,
    "APRILTAG_36h11": 587,
}
"""Number of markers of each dictionary of OpenCV, by its name; "4X4": a marker has 4 by 4 small squares inside its
black border."""
APRILTAG_0: Final = 0xD5D628584
"""The 36 small squares of the first marker of 36h11 as AprilTag's own pictures have it, row by row; 1: white."""
SIZE_MM: Final = 22.0
FLOOR_SIZE_MM: Final = 50.0


@dataclass(frozen=True)
class Markers:
    """All markers of a scene; lengths in m, angles in rad."""

    dictionary: str
    robots: Mapping[int, int]
    """The name of each robot, by its marker. Arrays and lists with an entry per robot have this order."""
    size_m: float
    height_m: float
    floor: Mapping[int, tuple[float, float, float]]
    """x and y of the centre, and the angle, of each floor marker, by its number."""
    floor_size_m: float
    floor_height_m: float = 0.0
    forward_rad: float = 0.0
    """From the direction of the marker's top edge to the robot's heading, anticlockwise."""

    def floor_corners(self, marker: int) -> Floats:
        """Return the corners of a floor marker in the order of the detector, (4, 3), m."""
        x, y, angle = self.floor[marker]
        # At angle 0 the top edge points to +y: a quarter turn is added.
        return corners_at(x, y, angle + math.pi / 2, self.floor_size_m, self.floor_height_m)

    def to_toml(self) -> str:
        """Return the text of the file of these markers, which ``read_markers`` reads."""
        robots = ", ".join(f"{marker} = {name}" for marker, name in self.robots.items())
        floor = ", ".join(
            f"{marker} = [{1000 * x:g}, {1000 * y:g}, {math.degrees(angle):g}]"
            for marker, (x, y, angle) in self.floor.items()
        )
        return (
            f'dictionary = "{self.dictionary}"\n\n[robots]\nsize_mm = {1000 * self.size_m:g}\n'
            f"height_mm = {1000 * self.height_m:g}\nforward_deg = {math.degrees(self.forward_rad):g}\n"
            f"ids = {{ {robots} }}\n\n[floor]\nsize_mm = {1000 * self.floor_size_m:g}\n"
            f"height_mm = {1000 * self.floor_height_m:g}\nat_mm = {{ {floor} }}\n"
        )


def corners_at(x_m: float, y_m: float, up_rad: float, size_m: float, z_m: float) -> Floats:
    """Return the corners of a marker, (4, 3), m; ``up_rad`` is the direction to its top edge."""
    up = np.array([math.cos(up_rad), math.sin(up_rad)]) * size_m / 2
    right = np.array([up[1], -up[0]])
    flat = np.array([x_m, y_m]) + np.array([up - right, up + right, right - up, -up - right])
    return np.column_stack([flat, np.full(4, z_m)])


FLOOR_MARKERS: Final = 4


def usual_markers(
    robots: int | Sequence[int],
    width_m: float,
    height_m: float,
    *,
    size_mm: float = SIZE_MM,
    height_mm: float = 30.0,
) -> Markers:
    """Return the default markers for an arena, from the smallest dictionary of 4 by 4 squares that has enough.

    The floor's markers are four beside the arena's corners, and have the largest numbers of the dictionary.

    Args:
        robots: number of robots, or the markers of robots 0, 1, ... width_m, height_m: of the arena.
        size_mm, height_mm: edge and height of robots' markers.
    """
    ids = list(range(robots)) if isinstance(robots, int) else list(robots)
    if len(set(ids)) != len(ids) or not ids or not 0 <= min(ids) <= max(ids) < 1000 - FLOOR_MARKERS:
        raise InputError(
            f"{shown(ids)} must be different numbers from 0 to {999 - FLOOR_MARKERS}", field="--markers"
        )
    # The smallest dictionary in which the floor's markers, the last ones, are above all robots' markers.
    most = next(count for count in (50, 100, 250, 1000) if max(ids) < count - FLOOR_MARKERS)
    # Centres are 55 mm outside of the arena's left or right side, 40 mm above its lower or below its upper one.
    left, right, low, high = -0.055, width_m + 0.055, 0.04, height_m - 0.04
    places = ((left, low), (right, low), (right, high), (left, high))
    return Markers(
        dictionary=f"4X4_{most}",
        robots={marker: robot for robot, marker in enumerate(ids)},
        size_m=size_mm / 1000,
        height_m=height_mm / 1000,
        floor={most - FLOOR_MARKERS + k: (x, y, 0.0) for k, (x, y) in enumerate(places)},
        floor_size_m=FLOOR_SIZE_MM / 1000,
    )


def dictionary_of(name: str) -> Any:
    """Return OpenCV's dictionary of a name of ``DICTIONARIES``."""
    cv2 = opencv()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))


def first_corner(name: str) -> int:
    """Return which of the four corners that OpenCV gives for a marker of a dictionary is its top left one.

    It is the first, but in AprilTag's families, which OpenCV has had upside down (up to 5.0): there it is the third.
    """
    if not name.startswith("APRILTAG"):
        return 0
    inner = dictionary_of("APRILTAG_36h11").generateImageMarker(0, 8)[1:-1, 1:-1]  # one pixel for each square
    as_printed = "".join("1" if square else "0" for square in inner.ravel()) == f"{APRILTAG_0:036b}"
    return 0 if as_printed else 2


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


Length = Annotated[float, Field(ge=0.0, le=1e4)]
Size = Annotated[float, Field(ge=0.1, le=1e4)]
Number = Annotated[int, Field(ge=0, le=2**31)]


class _Robots(_Part):
    size_mm: Size = SIZE_MM
    height_mm: Length  # no default, since a wrong height would make all positions wrong without notice
    forward_deg: float = Field(0.0, ge=-360.0, le=360.0)
    ids: dict[Number, Number] | list[Number] = Field(min_length=1)


class _Floor(_Part):
    size_mm: Size = FLOOR_SIZE_MM
    height_mm: Length = 0.0
    at_mm: dict[Number, tuple[float, float] | tuple[float, float, float]] = Field(min_length=1)


class _File(_Part):
    dictionary: str = "4X4_50"
    robots: _Robots
    floor: _Floor


def read_markers(path: Path) -> Markers:
    """Read a file of markers."""
    file = read_model(_File, path, "a file of markers")
    check_choice(file.dictionary, f"{path}, dictionary", DICTIONARIES)
    ids, robots, floor = file.robots.ids, file.robots, file.floor
    carried = dict(ids) if isinstance(ids, dict) else {marker: robot for robot, marker in enumerate(ids)}
    all_markers = [*carried, *floor.at_mm]
    is_repeated = len(set(all_markers)) < len(all_markers) or len(set(carried.values())) < len(ids)
    if is_repeated or max(all_markers) >= DICTIONARIES[file.dictionary]:
        raise InputError(
            f"markers must be different numbers below {DICTIONARIES[file.dictionary]}, and robots different",
            field=str(path),
        )
    return Markers(
        dictionary=file.dictionary,
        robots=carried,
        size_m=robots.size_mm / 1000,
        height_m=robots.height_mm / 1000,
        forward_rad=math.radians(robots.forward_deg),
        floor={
            marker: (place[0] / 1000, place[1] / 1000, math.radians(sum(place[2:])))
            for marker, place in floor.at_mm.items()
        },
        floor_size_m=floor.size_mm / 1000,
        floor_height_m=floor.height_mm / 1000,
    )
