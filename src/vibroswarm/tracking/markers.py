"""Which ArUco markers are where: on the robots, at a height, and on the floor at known positions.

A file of markers is TOML, with lengths in mm:

    dictionary = "4X4_50"
    [robots]
    size_mm = 22.0              # outer edge of the black square
    height_mm = 30.0            # of the marker above the floor
    forward_deg = 0.0           # from the marker's top edge to the robot's heading, anticlockwise
    ids = { 10 = 1, 11 = 2 }    # marker and robot's name; or a list of markers, named 0, 1, ...
    [floor]
    size_mm = 50.0
    height_mm = 0.0
    at_mm = { 46 = [-55, 40], 47 = [1055, 40] }   # centre, in the arena; third: turned, degrees anticlockwise
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.untrusted_files import read_bytes
from vibroswarm.errors import InputError, check_choice, nearest, shown
from vibroswarm.tracking import opencv

Floats = NDArray[np.float64]

DICTIONARIES: Final = {
    f"{bits}X{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)
}
SIZE_MM: Final = 22.0
HEIGHT_MM: Final = 30.0
FLOOR_SIZE_MM: Final = 50.0
ASIDE_M: Final = 0.055
INWARD_M: Final = 0.04
"""Centres of the usual floor markers: this far left and right of the arena, and this far from its lower and upper
ends."""


@dataclass(frozen=True)
class Markers:
    """All markers of a scene; lengths in m, angles in rad."""

    dictionary: str
    robots: Mapping[int, int]
    """Marker to the robot's name in its log."""
    size_m: float
    height_m: float
    floor: Mapping[int, tuple[float, float, float]]
    """Marker to x, y of its centre and its angle."""
    floor_size_m: float
    floor_height_m: float = 0.0
    forward_rad: float = 0.0
    """From the direction of the marker's top edge to the robot's heading, anticlockwise."""

    def floor_corners(self, marker: int) -> Floats:
        """Return the corners of a floor marker in the order of the detector, (4, 3), m."""
        x, y, angle = self.floor[marker]
        return corners_at(x, y, angle + math.pi / 2, self.floor_size_m, self.floor_height_m)

    def to_toml(self) -> str:
        """Return the file of these markers."""
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
        up_rad: direction of the marker's top edge from its centre.
    Returns: (4, 3), m.
    """
    up = np.array([math.cos(up_rad), math.sin(up_rad)]) * size_m / 2
    right = np.array([up[1], -up[0]])
    flat = np.array([x_m, y_m]) + np.array([up - right, up + right, right - up, -up - right])
    return np.column_stack([flat, np.full(4, z_m)])


def usual_floor(
    width_m: float, height_m: float, last: int, cameras: int = 1
) -> dict[int, tuple[float, float, float]]:
    """Return the floor markers that ``lab video`` draws: beside the arena's corners, numbers up to ``last``.

    With several cameras side by side there are two more where the views of neighbours meet, below and above the arena.
    """
    left, right, low, high = -ASIDE_M, width_m + ASIDE_M, INWARD_M, height_m - INWARD_M
    places = ((left, low), (right, low), (right, high), (left, high))
    found = {last - 3 + k: (x, y, 0.0) for k, (x, y) in enumerate(places)}
    for seam in range(1, cameras):
        for k, y in enumerate((-ASIDE_M, height_m + ASIDE_M)):
            found[last - 3 - 2 * seam + k] = (width_m * seam / cameras, y, 0.0)
    return dict(sorted(found.items()))


def usual_markers(
    robots: int | Sequence[int],
    width_m: float,
    height_m: float,
    *,
    size_mm: float | None = None,
    height_mm: float | None = None,
    cameras: int = 1,
) -> Markers:
    """Return the usual markers for an arena.

    Args:
        robots: number of robots, or the markers of robots 0, 1, ... width_m, height_m: of the arena.
        size_mm, height_mm: edge and height of robots' markers; None: the usual ones.
        cameras: how many film side by side.
    Raises:
        InputError: markers that repeat, or too many for a dictionary.
    """
    ids = list(range(robots)) if isinstance(robots, int) else list(robots)
    if len(set(ids)) != len(ids) or not ids or min(ids) < 0:
        raise InputError(f"{shown(ids)} must be different numbers from 0 on", field="--markers")
    counts = [count for count in (50, 100, 250, 1000) if max(ids) < count - 2 - 2 * cameras]
    if not counts:
        raise InputError(f"{max(ids)} is too large; give numbers below 996", field="--markers")
    return Markers(
        dictionary=f"4X4_{counts[0]}",
        robots={marker: robot for robot, marker in enumerate(ids)},
        size_m=(SIZE_MM if size_mm is None else size_mm) / 1000,
        height_m=(HEIGHT_MM if height_mm is None else height_mm) / 1000,
        floor=usual_floor(width_m, height_m, counts[0] - 1, cameras),
        floor_size_m=FLOOR_SIZE_MM / 1000,
    )


def dictionary_of(markers: Markers) -> Any:
    """Return OpenCV's dictionary of the markers."""
    cv2 = opencv()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{markers.dictionary}"))


def read_markers(path: Path) -> Markers:
    """Read a file of markers.

    Raises:
        InputError: not such a file; names the key.
    """
    name = str(path)
    try:
        values = tomllib.loads(read_bytes(path, 2**20, "a file of markers").decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not TOML: {error}", field=name) from None
    _known(values, ("dictionary", "robots", "floor"), name)
    robots, floor = _table(values, "robots", name), _table(values, "floor", name)
    _known(robots, ("size_mm", "height_mm", "forward_deg", "ids"), f"{name}, [robots]")
    _known(floor, ("size_mm", "height_mm", "at_mm"), f"{name}, [floor]")
    dictionary = values.get("dictionary", "4X4_50")
    check_choice(dictionary, f"{name}, dictionary", DICTIONARIES)
    count = DICTIONARIES[dictionary]
    return Markers(
        dictionary=dictionary,
        robots=_robot_ids(robots.get("ids"), count, f"{name}, robots.ids"),
        size_m=_length(robots, "size_mm", SIZE_MM, f"{name}, [robots]", low=0.1) / 1000,
        height_m=_length(robots, "height_mm", None, f"{name}, [robots]") / 1000,
        forward_rad=math.radians(_length(robots, "forward_deg", 0.0, f"{name}, [robots]", low=-360.0)),
        floor=_floor_places(floor.get("at_mm"), count, f"{name}, floor.at_mm"),
        floor_size_m=_length(floor, "size_mm", FLOOR_SIZE_MM, f"{name}, [floor]", low=0.1) / 1000,
        floor_height_m=_length(floor, "height_mm", 0.0, f"{name}, [floor]") / 1000,
    )


def _known(values: Mapping[str, Any], known: Sequence[str], field: str) -> None:
    unknown = [key for key in values if key not in known]
    if unknown:
        raise InputError(f"unknown key '{unknown[0]}'{nearest(unknown[0], known)}", field=field)


def _table(values: Mapping[str, Any], key: str, name: str) -> Mapping[str, Any]:
    table = values.get(key)
    if not isinstance(table, dict):
        raise InputError(f"has no [{key}]", field=name)
    return table


def _number(value: Any, field: str, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise InputError(f"{shown(value)} must be a number from {low:g} to {high:g}", field=field)
    return float(value)


def _length(table: Mapping[str, Any], key: str, default: float | None, field: str, low: float = 0.0) -> float:
    if key not in table and default is None:
        raise InputError(f"does not state {key}, without which positions are wrong", field=field)
    return _number(table.get(key, default), f"{field}.{key}", low, 1e4)


def _marker(text: Any, count: int, field: str) -> int:
    try:
        marker = int(text)
    except (TypeError, ValueError):
        marker = -1
    if not 0 <= marker < count:
        raise InputError(f"{shown(text)} is not a marker; give a number from 0 to {count - 1}", field=field)
    return marker


def _robot_ids(value: Any, count: int, field: str) -> dict[int, int]:
    """Return the robot's name of each marker, from a list of markers or a table.

    Raises:
        InputError: empty, no such marker, or a marker or robot that repeats.
    """
    if isinstance(value, list):
        pairs = [(marker, robot) for robot, marker in enumerate(value)]
    elif isinstance(value, dict):
        pairs = list(value.items())
    else:
        pairs = []
    found = {_marker(marker, count, field): int(_number(name, field, 0, 2**31)) for marker, name in pairs}
    if not pairs or len(found) != len(pairs) or len(set(found.values())) != len(pairs):
        raise InputError("must list different markers of different robots: [0, 1] or { 10 = 1 }", field=field)
    return found


def _floor_places(value: Any, count: int, field: str) -> dict[int, tuple[float, float, float]]:
    """Return x, y (m) and angle (rad) of each floor marker.

    Raises:
        InputError: no marker, no such marker, or a place that is not two or three numbers.
    """
    places: dict[int, tuple[float, float, float]] = {}
    for marker, place in (value if isinstance(value, dict) else {}).items():
        if not isinstance(place, list) or len(place) not in (2, 3):
            raise InputError("must be [x, y] or [x, y, degrees], in mm", field=f"{field}.{marker}")
        x, y, *turned = (_number(part, f"{field}.{marker}", -1e6, 1e6) for part in place)
        places[_marker(marker, count, field)] = (x / 1000, y / 1000, math.radians(sum(turned)))
    if not places:
        raise InputError("must give the centre of at least one marker: { 46 = [-55, 40] }", field=field)
    return places
