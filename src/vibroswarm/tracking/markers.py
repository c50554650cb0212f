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
from typing import Any, Final

import numpy as np

from vibroswarm.core.arrays import Floats
from vibroswarm.core.untrusted_files import parsed_toml, read_text
from vibroswarm.errors import InputError, check_choice, check_known_keys, number_of, shown
from vibroswarm.tracking import opencv

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
"""Default edge of a robot's marker."""
HEIGHT_MM: Final = 30.0
"""Default height of a robot's marker above the floor."""
FLOOR_SIZE_MM: Final = 50.0
"""Default edge of a floor marker."""
ASIDE_M: Final = 0.055
"""Default distance of the centres of floor markers from the arena, outwards: from its left or right side for the four
near its corners, from its lower or upper end for those between two cameras."""
INWARD_M: Final = 0.04
"""Default distance, in y, of the centres of the four from the lower or upper end of the arena, inwards."""


@dataclass(frozen=True)
class Markers:
    """All markers of a scene; lengths in m, angles in rad."""

    dictionary: str
    robots: Mapping[int, int]
    """The name of each robot, by its marker. Arrays and lists with an entry per robot have this order."""
    size_m: float
    """Edge of a robot's marker."""
    height_m: float
    """Height of robots' markers above the floor."""
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
    """Return the corners of a marker in the detector's order (top left, top right, bottom right, bottom left).

    Args:
        x_m, y_m, z_m: centre of the marker. up_rad: direction from its centre to its top edge. size_m: of its edges.
    Returns: (4, 3), m.
    """
    up = np.array([math.cos(up_rad), math.sin(up_rad)]) * size_m / 2
    right = np.array([up[1], -up[0]])
    flat = np.array([x_m, y_m]) + np.array([up - right, up + right, right - up, -up - right])
    return np.column_stack([flat, np.full(4, z_m)])


FLOOR_MARKERS: Final = 4
"""Number of default floor markers."""


def usual_markers(
    robots: int | Sequence[int],
    width_m: float,
    height_m: float,
    *,
    size_mm: float = SIZE_MM,
    height_mm: float = HEIGHT_MM,
) -> Markers:
    """Return the default markers for an arena, from the smallest dictionary of 4 by 4 squares that has enough.

    The floor's markers are four beside the arena's corners, and have the largest numbers of the dictionary.

    Args:
        robots: number of robots, or the markers of robots 0, 1, ... width_m, height_m: of the arena.
        size_mm, height_mm: edge and height of robots' markers.
    Raises:
        InputError: there are no robots; or robots' markers repeat, are negative, or are so large that no dictionary has
            room for the floor's markers above them.
    """
    ids = list(range(robots)) if isinstance(robots, int) else list(robots)
    if len(set(ids)) != len(ids) or not ids or min(ids) < 0:
        raise InputError(f"{shown(ids)} must be different numbers from 0 on", field="--markers")
    # Sizes of dictionaries in which the floor's markers, the last ones, are above all robots' markers.
    counts = [count for count in (50, 100, 250, 1000) if max(ids) < count - FLOOR_MARKERS]
    if not counts:
        raise InputError(
            f"{max(ids)} is too large; give numbers below {1000 - FLOOR_MARKERS}", field="--markers"
        )
    left, right, low, high = -ASIDE_M, width_m + ASIDE_M, INWARD_M, height_m - INWARD_M
    places = ((left, low), (right, low), (right, high), (left, high))
    return Markers(
        dictionary=f"4X4_{counts[0]}",
        robots={marker: robot for robot, marker in enumerate(ids)},
        size_m=size_mm / 1000,
        height_m=height_mm / 1000,
        floor={counts[0] - FLOOR_MARKERS + k: (x, y, 0.0) for k, (x, y) in enumerate(places)},
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


def read_markers(path: Path) -> Markers:
    """Read a file of markers.

    Raises:
        InputError: it is not such a file; the message names the key that is wrong.
    """
    name = str(path)
    text = read_text(path, "a file of markers", most=2**20)  # 1 MiB is more than any such file needs
    values = parsed_toml(text, name)
    check_known_keys(values, name, ("dictionary", "robots", "floor"))
    robots, floor = _table(values, "robots", name), _table(values, "floor", name)
    check_known_keys(robots, f"{name}, [robots]", ("size_mm", "height_mm", "forward_deg", "ids"))
    check_known_keys(floor, f"{name}, [floor]", ("size_mm", "height_mm", "at_mm"))
    dictionary = values.get("dictionary", "4X4_50")
    check_choice(dictionary, f"{name}, dictionary", DICTIONARIES)
    count = DICTIONARIES[dictionary]
    of_robots = _robot_ids(robots.get("ids"), count, f"{name}, robots.ids")
    of_floor = _floor_places(floor.get("at_mm"), count, f"{name}, floor.at_mm")
    if twice := sorted(set(of_robots) & set(of_floor)):
        raise InputError(
            f"marker {twice[0]} is on a robot too; give it another", field=f"{name}, floor.at_mm"
        )
    return Markers(
        dictionary=dictionary,
        robots=of_robots,
        size_m=_quantity(robots, "size_mm", SIZE_MM, f"{name}, [robots]", low=0.1) / 1000,
        # No default, since a wrong height would make all positions wrong without notice.
        height_m=_quantity(robots, "height_mm", default=None, field=f"{name}, [robots]") / 1000,
        forward_rad=math.radians(_quantity(robots, "forward_deg", 0.0, f"{name}, [robots]", low=-360.0)),
        floor=of_floor,
        floor_size_m=_quantity(floor, "size_mm", FLOOR_SIZE_MM, f"{name}, [floor]", low=0.1) / 1000,
        floor_height_m=_quantity(floor, "height_mm", 0.0, f"{name}, [floor]") / 1000,
    )


def _table(values: Mapping[str, Any], key: str, name: str) -> Mapping[str, Any]:
    """Return a table of the file ``name``; raise InputError if it is missing."""
    table = values.get(key)
    if not isinstance(table, dict):
        raise InputError(f"has no [{key}]", field=name)
    return table


def _quantity(
    table: Mapping[str, Any], key: str, default: float | None, field: str, low: float = 0.0
) -> float:
    """Return a length (mm) or angle (degrees) of a table, from ``low`` to 10,000; without a default it is required."""
    if key not in table and default is None:
        raise InputError(f"does not state {key}, without which positions are wrong", field=field)
    return number_of(table.get(key, default), f"{field}.{key}", low, 1e4)


def _marker(text: Any, count: int, field: str) -> int:
    """Return the number of a marker as an integer.

    Args:
        text: the number as text (a key of a TOML table) or as a value (an entry of a list).
        count: number of markers of the dictionary. field: name of the table or list, for messages.
    Raises:
        InputError: it is not a whole number from 0 to ``count`` - 1.
    """
    try:
        # -1, as below, is refused by the check of the range.
        marker = int(text) if isinstance(text, str) or _is_whole(text) else -1
    except ValueError:
        marker = -1
    if not 0 <= marker < count:
        raise InputError(
            f"{shown(text)} is not a marker; give a whole number from 0 to {count - 1}", field=field
        )
    return marker


def _is_whole(value: Any) -> bool:
    """Return whether a value of a TOML file is a whole number; true and false are none."""
    return type(value) is int or (isinstance(value, float) and value.is_integer())


def _robot_name(value: Any, field: str) -> int:
    """Return the name of a robot as an integer.

    Raises:
        InputError: it is not a whole number from 0 to 2^31, the range of robots' numbers in logs
            (``recordings.column_map``).
    """
    if not _is_whole(value) or not 0 <= value <= 2**31:
        raise InputError(
            f"{shown(value)} is not the number of a robot; give a whole number from 0 to {2**31}", field=field
        )
    return int(value)


def _robot_ids(value: Any, count: int, field: str) -> dict[int, int]:
    """Return the name of the robot that carries each marker, by the marker's number.

    Args:
        value: a list of the markers of robots 0, 1, ..., or a table of markers and robots' names.
        count: number of markers of the dictionary. field: name of ``value``, for messages.
    Raises:
        InputError: it is missing, empty, or neither list nor table; it has a marker that the dictionary does not have,
            or a robot's name that ``_robot_name`` refuses; or it repeats a marker or a robot.
    """
    pairs = list(value.items()) if isinstance(value, dict) else []  # no pairs are refused below
    if isinstance(value, list):
        pairs = [(marker, robot) for robot, marker in enumerate(value)]
    found = {_marker(marker, count, field): _robot_name(name, field) for marker, name in pairs}
    if not pairs or len(found) != len(pairs) or len(set(found.values())) != len(pairs):
        raise InputError("must list different markers of different robots: [0, 1] or { 10 = 1 }", field=field)
    return found


def _floor_places(value: Any, count: int, field: str) -> dict[int, tuple[float, float, float]]:
    """Return x, y (m) and angle (rad) of each floor marker, by its number.

    Args:
        value: a table of markers and places: [x, y] or [x, y, degrees], in mm.
        count: number of markers of the dictionary. field: name of ``value``, for messages.
    Raises:
        InputError: it is missing, empty or no table, names a marker twice or one that the dictionary does not have, or
            has a place that is not two or three numbers.
    """
    places: dict[int, tuple[float, float, float]] = {}
    for marker, place in (value if isinstance(value, dict) else {}).items():
        if not isinstance(place, list) or len(place) not in (2, 3):
            raise InputError("must be [x, y] or [x, y, degrees], in mm", field=f"{field}.{marker}")
        x_mm, y_mm, *angles_deg = (number_of(part, f"{field}.{marker}", -1e6, 1e6) for part in place)
        angle_deg = angles_deg[0] if angles_deg else 0.0
        number = _marker(marker, count, field)
        if number in places:  # the keys 46 and 046 are two texts, but one marker
            raise InputError(f"gives marker {number} twice", field=field)
        places[number] = (x_mm / 1000, y_mm / 1000, math.radians(angle_deg))
    if not places:
        raise InputError("must give the centre of at least one marker: { 46 = [-55, 40] }", field=field)
    return places
