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

A value v is a contrast: samples on its tile measure (1 - v) F_still^-1(u) + v F_vibrating^-1(u), so that 0 and 1 are
the kinds 0 and 1. Values and contrasts are multiples of 1 / ``STEPS``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibroswarm.core.elementary import exp
from vibroswarm.core.rng import PATCH, Purpose, uniform, uniforms
from vibroswarm.errors import InputError, shown
from vibroswarm.floors.patches import Patch, place_within

STEPS: Final = 200
"""Values and contrasts have this many steps from 0 to 1."""
PATCHES, VALUES = "patch", ("gradient", "hill", "field")
"""What names of such floors begin with, before a colon."""
EXAMPLES: Final = ("patch:0.10", "gradient:0.2..0.8", "hill:0.3,0.6,0.2", "field:2")
"""A name of each kind."""
MOST_PATCHES: Final = 100
"""Largest number of patches of a floor."""
TRIES: Final = 1000
"""Places that are tried for a patch before it is refused."""

Steps = NDArray[np.uint8]
"""Values in steps, from 0 to ``STEPS``."""
_NUMBER: Final = r"\d*\.?\d+(?:e-?\d+)?"
_RANGE: Final = rf"{_NUMBER}(?:\.\.{_NUMBER})?"
_PATCH: Final = re.compile(rf"(?:(\d+)\*)?(disc)?({_RANGE})(?:x({_RANGE}))?(?:@({_RANGE}))?")
_FIELD: Final = "floor.source"
_OF_X, _OF_Y, _OF_WIDTH, _OF_HEIGHT, _OF_CONTRAST = range(5)  # peers of a patch's random numbers


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
    first = first.strip()
    return first if colon and first in (PATCHES, *VALUES) else ""


def rectangle(
    values: ArrayLike,
    field: str,
    what: str,
    are_right: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
    words: str,
) -> NDArray[np.float64]:
    """Return the numbers of a floor, (rows, columns).

    Args:
        field, what: field and thing that have them, for errors. are_right: which numbers may be there. words: the same
            in words.
    Raises:
        InputError: they are no rectangle of such numbers.
    """
    try:
        grid = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} is a rectangle of numbers; {words}", field=field) from None
    if grid.ndim != 2 or grid.size == 0:
        raise InputError(f"{what} is a rectangle, not of shape {grid.shape}", field=field)
    wrong = ~are_right(grid)
    if wrong.any():
        row, column = (int(index[0]) for index in np.nonzero(wrong))
        raise InputError(
            f"row {row + 1}, column {column + 1} holds {grid[row, column]:g}; {words}", field=field
        )
    return grid


def steps_of(values: ArrayLike, field: str = "floor.values") -> Steps:
    """Return values as steps.

    Raises:
        InputError: they are no rectangle of numbers from 0 to 1.
    """
    words = "a value is from 0 (still) to 1 (vibrating)"
    grid = rectangle(values, field, "a floor of values", lambda of: (of >= 0.0) & (of <= 1.0), words)
    return np.rint(grid * STEPS).astype(np.uint8)


def kinds_of(values: Steps) -> NDArray[np.uint8]:
    """Return the kinds that stand for values where kinds are needed: 1 from 1/2 on."""
    return (2 * values.astype(np.int64) >= STEPS).astype(np.uint8)


def named_values(name: str, rows: int, columns: int, seed: int, run: int) -> Steps:
    """Return the values of a floor by its name.

    Raises:
        InputError: the name is not one of these, or a number is out of range.
    """
    kind, _, text = name.strip().lower().partition(":")
    # Places of tiles as shares of the sides, x from the left, y from below.
    x = (np.arange(columns) + 0.5)[None, :] / columns
    y = (np.arange(rows)[::-1] + 0.5)[:, None] / rows
    if kind == "gradient":
        ends, _, angle = text.partition("@")
        low, high = _parts(ends, "..", 2, name, "gradient:0.2..0.8")
        turn = math.radians(_parts(angle, "..", 1, name, "gradient:0.2..0.8@90")[0] if angle else 0.0)
        along = (x - 0.5) * math.cos(turn) + (y - 0.5) * math.sin(turn)
        along = along / (abs(math.cos(turn)) + abs(math.sin(turn))) + 0.5  # 0 and 1 at the outermost corners
        return steps_of(low + (high - low) * along, _FIELD)
    if kind == "hill":
        at_x, at_y, radius = _parts(text, ",", 3, name, "hill:0.3,0.6,0.2")
        if radius <= 0.0:
            raise InputError(f"the radius of '{name}' must be above 0", field=_FIELD)
        return steps_of(exp(-0.5 * ((x - at_x) ** 2 + (y - at_y) ** 2) / radius**2), _FIELD)
    (length,) = _parts(text, ",", 1, name, "field:2")
    if not 0.0 < length <= max(rows, columns):
        raise InputError(
            f"the correlation length of '{name}' must be above 0 and at most the floor's longer side, "
            f"{max(rows, columns)} tiles",
            field=_FIELD,
        )
    return steps_of(random_field(rows, columns, length, seed, run), _FIELD)


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


def named_patches(
    name: str, box_m: tuple[float, float, float, float], seed: int, run: int, *, draw: int = 0
) -> tuple[Patch, ...]:
    """Return the patches of a floor by its name, at random places of (seed, run).

    Args:
        box_m: left, bottom, right and top of the part of the floor that is in the arena. draw: number of the draw of
            patches in a run: each has places of its own.
    Raises:
        InputError: the name is not one of these, a number is out of range, or the patches do not fit.
    """
    text = name.partition(":")[2].replace(" ", "").lower()
    if text in ("none", "0"):
        return ()
    patches: list[Patch] = []
    for part in text.split("+"):
        match = _PATCH.fullmatch(part)
        if match is None:
            raise InputError(
                f"{shown(part)} of '{name}' is not a patch; give for example patch:0.10, patch:disc0.10, "
                "patch:0.3x0.02, patch:0.10@0.5, patch:2*0.10 or patch:none",
                field=_FIELD,
            )
        number, disc, width, height, contrast = match.groups()
        if disc and height:
            raise InputError(f"{shown(part)} of '{name}': a disc has one diameter", field=_FIELD)
        if len(patches) + int(number or 1) > MOST_PATCHES:
            raise InputError(f"'{name}' has more than {MOST_PATCHES} patches", field=_FIELD)
        for _ in range(int(number or 1)):
            patches.append(
                _placed(name, patches, bool(disc), (width, height, contrast or "1"), box_m, seed, run, draw)
            )
    return tuple(patches)


def _placed(
    name: str,
    others: Sequence[Patch],
    is_disc: bool,
    words: tuple[str, str | None, str],
    box_m: tuple[float, float, float, float],
    seed: int,
    run: int,
    draw: int,
) -> Patch:
    """Return a patch at the first random place at which it overlaps none of the ``others``.

    Args:
        words: width, height (None: as the width) and contrast, as in the name.
    """
    k, first = len(others), draw * (TRIES + 1)

    _check_sizes(name, words, box_m)  # of all that may be drawn, so that no later run is refused

    def drawn(text: str, peer: int) -> float:
        low, high = _ends(text)
        return low + (high - low) * uniform(seed, run, k, PATCH, first, peer)

    width = drawn(words[0], _OF_WIDTH)
    height = width if words[1] is None else drawn(words[1], _OF_HEIGHT)
    contrast = round(drawn(words[2], _OF_CONTRAST) * STEPS) / STEPS
    left, bottom, right, top = box_m
    for attempt in range(1, TRIES + 1):
        x = place_within(uniform(seed, run, k, PATCH, first + attempt, _OF_X), width, left, right)
        y = place_within(uniform(seed, run, k, PATCH, first + attempt, _OF_Y), height, bottom, top)
        patch = Patch(x, y, width, height, contrast, is_disc)
        if not any(patch.overlaps(other) for other in others):
            return patch
    raise InputError(f"the patches of '{name}' do not fit side by side", field=_FIELD)


def _ends(text: str) -> tuple[float, float]:
    low, _, high = text.partition("..")
    return float(low), float(high or low)


def _check_sizes(
    name: str, words: tuple[str, str | None, str], box_m: tuple[float, float, float, float]
) -> None:
    """Refuse patches of which one that may be drawn has no size, is larger than the floor, or of a wrong contrast."""
    widths, heights, contrasts = _ends(words[0]), _ends(words[1] or words[0]), _ends(words[2])
    left, bottom, right, top = box_m
    for contrast in contrasts:
        if not 0.0 <= contrast <= 1.0:
            raise InputError(f"a contrast of '{name}' is {contrast:g}; give one from 0 to 1", field=_FIELD)
    for width, height in zip(widths, heights, strict=True):
        if not (0.0 < width <= right - left and 0.0 < height <= top - bottom):
            raise InputError(
                f"a patch of '{name}', {width:.4g} m x {height:.4g} m, is not within the floor of {right - left:.4g} m "
                f"x {top - bottom:.4g} m that is inside the arena",
                field=_FIELD,
            )


def _parts(text: str, separator: str, count: int, name: str, example: str) -> list[float]:
    try:
        parts = [float(part) for part in text.split(separator)]
    except ValueError:
        parts = []
    if len(parts) != count or not all(map(math.isfinite, parts)):
        raise InputError(f"'{name}' is not a floor; give for example {example}", field=_FIELD)
    return parts
