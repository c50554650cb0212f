"""Patches: damage that is not bound to a grid. Squares, discs and cracks, each of a contrast, at places of their own.

| name | symbol | unit | equation |
|---|---|---|---|
| contrast | c | 0 to 1 | a sample measures F_c^-1(u) = (1 - c) F_still^-1(u) + c F_vibrating^-1(u) |
| distance | d | m | from the patch's edge, negative inside |
| area | - | m2 | width x height, of a disc pi (width / 2)^2 |

The same patches are drawn by floors of simulated runs (``floors.surfaces``) and by inspections (``inspection.damage``).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import inner

Numbers = Any
"""A number, or an array of numbers."""


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
    """Return the distance from the edge of a patch, negative inside; also of arrays, outside of kernels.

    Args:
        across, up: distances from its centre along x and y, at least 0. width, height: its sides, or diameters.
    """
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
