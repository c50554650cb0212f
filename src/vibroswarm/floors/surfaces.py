"""Floors that are more than kinds of tile, by name: patches of damage, and a value for each tile.

| name | floor |
|---|---|
| ``patch:0.10`` | still, with a square of 0.10 m at a random place of each run |
| ``patch:disc0.10``, ``patch:0.3x0.02`` | a disc of that diameter, a crack of that length and width |
| ``patch:0.10@0.5`` | at contrast 0.5 |
| ``patch:2*0.10+disc0.05`` | three patches, which do not overlap |
| ``patch:0.05..0.2@0.5..1`` | side and contrast drawn uniformly for each run |
| ``patch:none`` | no patch |
| ``gradient:0.2..0.8`` | a value that rises from the left to the right; ``gradient:0.2..0.8@90`` upwards |
| ``hill:0.3,0.6,0.2`` | exp(-d^2 / 2 r^2) about a place; x, y and r as shares of the floor's sides |
| ``field:2`` | for each run a random field: values uniform in (0, 1), of correlation exp(-(d / 2 tiles)^2) before |

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
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.elementary import exp
from vibroswarm.core.jit import inner
from vibroswarm.core.rng import PATCH, Purpose, uniform, uniforms
from vibroswarm.errors import InputError, shown

STEPS: Final = 200
"""Values and contrasts have this many steps from 0 to 1."""
PATCHES, VALUES = "patch", ("gradient", "hill", "field")
"""What names of such floors begin with, before a colon."""
EXAMPLES: Final = ("patch:0.10", "gradient:0.2..0.8", "hill:0.3,0.6,0.2", "field:2")
"""A name of each kind."""
TRIES: Final = 1000
"""Places that are tried for a patch before it is refused."""

Steps = NDArray[np.uint8]
"""Values in steps, from 0 to ``STEPS``."""
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


class Surface(NamedTuple):
    """What a floor has beside kinds of tile."""

    values: Steps | None = None
    """(rows, columns), of each tile; None: its kind says all."""
    patches: tuple[Patch, ...] = ()
    """They do not overlap, and lie on still tiles."""


PLAIN: Final = Surface()
"""A floor whose kinds of tile say all."""


def kind_of_name(name: str) -> str:
    """Return ``patch``, ``gradient``, ``hill`` or ``field`` if a name begins so, else an empty string."""
    first, colon, _ = name.partition(":")
    return first if colon and first in (PATCHES, *VALUES) else ""


def rectangle(values: ArrayLike, most: float, field: str) -> NDArray[np.float64]:
    """Return the numbers of a floor, (rows, columns).

    Raises:
        InputError: they are no rectangle of numbers from 0 to ``most``.
    """
    try:
        grid = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        grid = np.empty(0)
    if grid.ndim != 2 or grid.size == 0 or not ((grid >= 0.0) & (grid <= most)).all():
        raise InputError(f"is not a rectangle of numbers from 0 to {most:g}, row by row", field=field)
    return grid


def steps_of(values: ArrayLike, field: str = "floor.values") -> Steps:
    """Return values as steps.

    Raises:
        InputError: they are no rectangle of numbers from 0 to 1.
    """
    return np.rint(rectangle(values, 1.0, field) * STEPS).astype(np.uint8)


def kinds_of(values: Steps) -> NDArray[np.uint8]:
    """Return the kinds that stand for values where kinds are needed: 1 from 1/2 on."""
    return (2 * values.astype(np.int64) >= STEPS).astype(np.uint8)


def named_values(name: str, rows: int, columns: int, seed: int, run: int) -> Steps:
    """Return the values of a floor by its name.

    Raises:
        InputError: the name is not one of these, or a number is out of range.
    """
    kind, _, text = name.partition(":")
    # Places of tiles as shares of the sides, x from the left, y from below.
    x = (np.arange(columns) + 0.5)[None, :] / columns
    y = (np.arange(rows)[::-1] + 0.5)[:, None] / rows
    try:
        if kind == "gradient":
            ends, _, angle = text.partition("@")
            low, high = map(float, ends.split(".."))
            turn = math.radians(float(angle or 0.0))
            along = (x - 0.5) * math.cos(turn) + (y - 0.5) * math.sin(turn)
            along = (
                along / (abs(math.cos(turn)) + abs(math.sin(turn))) + 0.5
            )  # 0 and 1 at the outermost corners
            values = low + (high - low) * along
        elif kind == "hill":
            at_x, at_y, radius = map(float, text.split(","))
            values = exp(-0.5 * ((x - at_x) ** 2 + (y - at_y) ** 2) / radius**2)
        else:
            values = random_field(rows, columns, float(text), seed, run)
    except (ValueError, ZeroDivisionError):
        raise InputError(
            f"'{name}' is not a floor; give one like {', '.join(EXAMPLES)}", field=_FIELD
        ) from None
    return steps_of(values, _FIELD)


def random_field(rows: int, columns: int, length: float, seed: int, run: int) -> NDArray[np.float64]:
    """Return a random field with values uniform in (0, 1), (rows, columns).

    It is Phi(g), with g normal and of correlation exp(-(d / length)^2) at a distance of d tiles. Tiles are too coarse
    for lengths below 1.5 tiles: the correlation is lower, of neighbours 0.26 at a length of 1, in place of 0.37.

    Args:
        length: correlation length, tiles.
    """
    from scipy.special import ndtr, ndtri

    # White noise, smoothed by a normal kernel of standard deviation length / 2 along each axis.
    reach = math.ceil(2.0 * length)  # 4 standard deviations
    kernel = exp(-2.0 * (np.arange(-reach, reach + 1) / length) ** 2)
    kernel /= math.sqrt(float((kernel * kernel).sum()))  # so that g has variance 1
    shape = rows + 2 * reach, columns + 2 * reach
    noise = ndtri(uniforms(seed, run, 0, Purpose.PATCH, shape[0] * shape[1])).reshape(shape)
    smooth = sum(weight * noise[i : i + rows] for i, weight in enumerate(kernel))
    return np.asarray(ndtr(sum(weight * smooth[:, i : i + columns] for i, weight in enumerate(kernel))))


def named_patches(name: str, box_m: Box, seed: int, run: int, *, draw: int = 0) -> tuple[Patch, ...]:
    """Return the patches of a floor by its name, at random places of (seed, run).

    Args:
        box_m: the part of the floor that is in the arena. draw: number of the draw of patches in a run: each has places
            of its own.
    Raises:
        InputError: the name is not one of these, a number is out of range, or the patches do not fit.
    """
    text = name.partition(":")[2]
    patches: list[Patch] = []
    for part in () if text in ("none", "0") else text.split("+"):
        match = _PATCH.fullmatch(part)
        if match is None:
            raise InputError(
                f"{shown(part)} of '{name}' is not a patch; give for example patch:0.10, patch:disc0.10, "
                "patch:0.3x0.02, patch:0.10@0.5, patch:2*0.10 or patch:none",
                field=_FIELD,
            )
        _check_sizes(match, name, box_m)
        for _ in range(int(match["number"] or 1)):
            patches.append(_placed(match, name, patches, box_m, seed, run, draw))
    return tuple(patches)


def _ends(text: str) -> tuple[float, float]:
    low, _, high = text.partition("..")
    return float(low), float(high or low)


def _check_sizes(match: re.Match[str], name: str, box_m: Box) -> None:
    """Check that every patch that may be drawn has a size, fits the floor, and has a valid contrast."""
    widths = _ends(match["diameter"] or match["width"])
    heights = _ends(match["height"]) if match["height"] else widths
    left, bottom, right, top = box_m
    fits = min(*widths, *heights) > 0.0 and max(widths) <= right - left and max(heights) <= top - bottom
    if not fits or max(_ends(match["contrast"] or "1")) > 1.0:
        raise InputError(
            f"a patch of '{name}' is not within the floor of {right - left:.4g} m x {top - bottom:.4g} m, or has no "
            "contrast from 0 to 1",
            field=_FIELD,
        )


def _placed(
    match: re.Match[str], name: str, others: Sequence[Patch], box_m: Box, seed: int, run: int, draw: int
) -> Patch:
    """Return a patch at the first random place at which it overlaps none of the ``others``."""
    k, first = len(others), draw * (TRIES + 1)

    def drawn(text: str, peer: int) -> float:
        low, high = _ends(text)
        return low + (high - low) * uniform(seed, run, k, PATCH, first, peer)

    width = drawn(match["diameter"] or match["width"], _OF_WIDTH)
    height = drawn(match["height"], _OF_HEIGHT) if match["height"] else width
    contrast = round(drawn(match["contrast"] or "1", _OF_CONTRAST) * STEPS) / STEPS
    left, bottom, right, top = box_m
    for attempt in range(1, TRIES + 1):
        x = place_within(uniform(seed, run, k, PATCH, first + attempt, _OF_X), width, left, right)
        y = place_within(uniform(seed, run, k, PATCH, first + attempt, _OF_Y), height, bottom, top)
        patch = Patch(x, y, width, height, contrast, match["diameter"] is not None)
        if not any(patch.overlaps(other) for other in others):
            return patch
    raise InputError(f"the patches of '{name}' do not fit side by side", field=_FIELD)
