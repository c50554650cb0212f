"""Floors of patches of damage, by name; and contrasts between still and vibrating.

| name | floor |
|---|---|
| ``patch:0.10`` | still, with a square of 0.10 m at a random place of each run |
| ``patch:disc0.10``, ``patch:0.3x0.02`` | a disc of that diameter, a crack of that length and width |
| ``patch:0.10@0.5`` | at contrast 0.5 |
| ``patch:2*0.10+disc0.05`` | three patches, which do not overlap |
| ``patch:0.05..0.2@0.5..1`` | side and contrast drawn uniformly for each run |
| ``patch:none`` | no patch |

| name | symbol | unit | equation |
|---|---|---|---|
| value, contrast | c | 0 to 1 | a sample measures F_c^-1(u) = (1 - c) F_still^-1(u) + c F_vibrating^-1(u) |
| distance | d | m | from a patch's edge, negative inside |
| area | - | m2 | width x height, of a disc pi (width / 2)^2 |

Values of 0 and 1 are the kinds 0 and 1. Values and contrasts are multiples of 1 / ``STEPS``. Floors of simulated runs
and inspections (``inspection.damage``) have the same patches.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner
from vibroswarm.core.rng import PATCH, uniform
from vibroswarm.errors import InputError, shown

STEPS: Final = 200
"""Values and contrasts have this many steps from 0 to 1."""
TRIES: Final = 1000
"""Places that are tried for a patch before it is refused."""

Numbers = Any
"""A number, or an array of numbers."""
Box = tuple[float, float, float, float]
"""Left, bottom, right and top, m."""

_NUMBER: Final = r"\d*\.?\d+(?:e-?\d+)?"
_RANGE: Final = rf"{_NUMBER}(?:\.\.{_NUMBER})?"
_PATCH: Final = re.compile(
    rf"(?:(?P<number>\d+)\*)?(?:disc(?P<diameter>{_RANGE})|(?P<width>{_RANGE})(?:x(?P<height>{_RANGE}))?)"
    rf"(?:@(?P<contrast>{_RANGE}))?"
)
_FIELD: Final = "floor.source"
_OF_X, _OF_Y, _OF_WIDTH, _OF_HEIGHT, _OF_CONTRAST = range(5)  # peers of a patch's random numbers


class Patch(NamedTuple):
    """Damage: a rectangle or a disc; or several at once, as replicates, whose fields are arrays."""

    x_m: Numbers
    y_m: Numbers
    """Its centre."""
    width_m: Numbers
    height_m: Numbers
    """Of a disc both are the diameter."""
    contrast: Numbers
    is_disc: bool = False

    @property
    def area_m2(self) -> Numbers:
        """Its area."""
        return self.width_m * self.height_m * (math.pi / 4.0 if self.is_disc else 1.0)

    def distance_m(self, x_m: Numbers, y_m: Numbers) -> Numbers:
        """Return the distance of places from its edge, negative inside."""
        return edge_distance(
            np.abs(x_m - self.x_m), np.abs(y_m - self.y_m), self.width_m, self.height_m, self.is_disc
        )

    def some(self, part: slice) -> Patch:
        """Return some of several patches."""
        x_m, y_m, width_m, height_m, contrast = (column[part] for column in self[:5])
        return Patch(x_m, y_m, width_m, height_m, contrast, self.is_disc)

    def overlaps(self, other: Patch) -> bool:
        """Return whether the rectangles around two patches overlap."""
        apart_x = abs(self.x_m - other.x_m) >= 0.5 * (self.width_m + other.width_m)
        apart_y = abs(self.y_m - other.y_m) >= 0.5 * (self.height_m + other.height_m)
        return not (apart_x or apart_y)


@inner
def edge_distance(across: Numbers, up: Numbers, width: Numbers, height: Numbers, is_disc: bool) -> Numbers:
    """Return the distance from the edge of a patch, negative inside; also of arrays, outside of kernels."""
    if is_disc:
        return np.hypot(across, up) - 0.5 * width
    dx, dy = across - 0.5 * width, up - 0.5 * height
    return np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0)) + np.minimum(np.maximum(dx, dy), 0.0)


def place_within(u: Numbers, side_m: Numbers, low_m: float, high_m: float) -> Numbers:
    """Return where the centre of something of this side lies at ``u``, uniform between the ends of an interval."""
    return low_m + 0.5 * side_m + u * (high_m - low_m - side_m)


def mixed(
    still: NDArray[np.float64], vibrating: NDArray[np.float64], contrast: Numbers
) -> NDArray[np.float64]:
    """Return what samples measure at a contrast, from what they would where it is still and where it vibrates."""
    return np.asarray((1.0 - contrast) * still + contrast * vibrating)


def is_patches(name: str) -> bool:
    """Return whether a name is that of a floor of patches."""
    return name.startswith("patch:")


def named_patches(name: str, box_m: Box, seed: int, run: int, *, draw: int = 0) -> tuple[Patch, ...]:
    """Return the patches of a floor by its name, at random places of (seed, run)."""
    text = name.partition(":")[2]
    patches: list[Patch] = []
    for part in () if text in ("none", "0") else text.split("+"):
        match = _PATCH.fullmatch(part)
        if match is None:
            raise InputError(
                f"{shown(part)} of '{name}' is not a patch; give one like patch:0.10, patch:disc0.10 or patch:0.3x0.02",
                field=_FIELD,
            )
        for _ in range(int(match["number"] or 1)):
            patches.append(_placed(match, name, patches, box_m, seed, run, draw * (TRIES + 1)))
    return tuple(patches)


def _placed(
    match: re.Match[str], name: str, others: Sequence[Patch], box_m: Box, seed: int, run: int, first: int
) -> Patch:
    """Return a patch at the first random place at which it overlaps none of the ``others``."""
    k = len(others)
    left, bottom, right, top = box_m

    def drawn(text: str, peer: int, most: float) -> float:
        low, high = float(text.partition("..")[0]), float(text.rpartition("..")[2])
        if max(low, high) > most or (min(low, high) == 0.0 and peer != _OF_CONTRAST):
            raise InputError(f"{text} in '{name}' is not within the floor, {most:.4g}", field=_FIELD)
        return low + (high - low) * uniform(seed, run, k, PATCH, first, peer)

    wide, high = right - left, top - bottom
    width = drawn(
        match["diameter"] or match["width"], _OF_WIDTH, wide if match["height"] else min(wide, high)
    )
    height = drawn(match["height"], _OF_HEIGHT, high) if match["height"] else width
    contrast = round(drawn(match["contrast"] or "1", _OF_CONTRAST, 1.0) * STEPS) / STEPS
    for attempt in range(1, TRIES + 1):
        x = place_within(uniform(seed, run, k, PATCH, first + attempt, _OF_X), width, left, right)
        y = place_within(uniform(seed, run, k, PATCH, first + attempt, _OF_Y), height, bottom, top)
        patch = Patch(x, y, width, height, contrast, match["diameter"] is not None)
        if not any(patch.overlaps(other) for other in others):
            return patch
    raise InputError(f"the patches of '{name}' do not fit side by side", field=_FIELD)
