"""Damage that is not bound to a grid: what samples would have measured on a patch, or on an intact surface.

| name | symbol | equation |
|---|---|---|
| value where still, vibrating | F_still, F_vibrating | of the law |
| value at contrast c | - | F_c^-1(u) = (1 - c) F_still^-1(u) + c F_vibrating^-1(u) |
| probability to sense the patch | P | Phi((reach - d) / blur), d the distance from its edge, negative inside |
| error of the law | - | each replicate is drawn from one of ``Law.draws``, and judged by the law itself |
| factors | - | of each robot and of each tile, log-normal of mean 1, by the spreads of the law |

Tiles without a grid are squares of ``TILE_M``. The laws have no effect of time: drift is tested, not simulated
(``checks``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.core.displayed import html_view
from vibroswarm.core.jit import kernel
from vibroswarm.floors.patches import Patch, mixed, place_within
from vibroswarm.inspection.samples import Floats, Law, Samples, ratios_of_values
from vibroswarm.observation.energy_model import energy_of, readings_of
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors.base import MOST_KINDS

TILE_M: Final = 0.2
"""Side of the tiles that differ where there is no grid: that of the floors of the recordings."""
POINTS: Final = 4000
"""Points of the tables of quantiles and of ratios."""


class Table(NamedTuple):
    """Quantiles and log ratios of a law as tables, which are much faster than the laws themselves."""

    u: Floats
    still: Floats
    vibrating: Floats
    """Quantiles at ``u``."""
    value: Floats
    ratio: Floats
    """Log ratios at ``value``."""

    def _repr_html_(self) -> str:
        return html_view(self)


@lru_cache(maxsize=16)
def tables_of(law: Law, bits: bool) -> Table:
    """Return the tables of a law; with ``bits`` the log ratios are those of the readings that values give."""
    # Denser at the ends of (0, 1), where quantiles change most.
    u = ndtr(np.linspace(-4.5, 4.5, POINTS))
    still, vibrating = (energy_of(law.sensor, kind, u, law.place).astype(np.float64) for kind in (0, 1))
    low, high = min(still[0], vibrating[0]), max(still[-1], vibrating[-1])
    value = np.linspace(low - 0.5 * (high - low), high + (high - low), POINTS)
    few = np.unique((still, vibrating))
    if few.size <= MOST_KINDS:  # a sensor of classes: there is nothing between them
        value = few
    read = readings_of(law.sensor, value).astype(np.float64) if bits else value
    return Table(u, still, vibrating, value, ratios_of_values(law, read, bits=bits))


def values_at(
    law: Law, u: Floats, inside: NDArray[np.bool_] | bool, contrast: Floats | float = 1.0, *, draw: int | None = None
) -> Floats:  # fmt: skip
    """Return what a typical sensor measures at quantile ``u``, on damage of a contrast or off it, in the shape of u.

    Args:
        draw: number of the law in ``Law.draws``; None: the law itself.
    """
    at, still, vibrating = tables_of(law, False)[:3] if draw is None else _drawn_quantiles(law)[draw]
    found = interpolated(u, at, still)
    where = np.broadcast_to(inside, u.shape)
    if where.any():  # damage is small: few samples sense it
        share = np.broadcast_to(contrast, u.shape)[where]
        found[where] = mixed(found[where], interpolated(u[where], at, vibrating), share)
    return found


@lru_cache(maxsize=16)
def _drawn_quantiles(law: Law) -> list[tuple[Floats, Floats, Floats]]:
    """Return u, and the quantiles at u on still and on vibrating places, of each law in ``Law.draws``."""
    u = tables_of(law, False).u
    return [
        (u, *(energy_of(drawn, kind, u, law.place).astype(np.float64) for kind in (0, 1)))  # type: ignore[misc]
        for drawn in law.draws
    ]


def ratios_at(law: Law, value: Floats, *, bits: bool = False) -> Floats:
    """Return the log ratios of values as ``samples.ratios_of_values`` does, by its table."""
    table = tables_of(law, bits)
    return interpolated(value, table.value, table.ratio)


def contrast_ratios(law: Law, contrast: float, value: Floats) -> Floats:
    """Return the log likelihood ratio of values for damage of a contrast, against no damage, in the shape of value.

    At contrast 1 it is that of the law. Below, it is computed from tables: the density of a quantile function Q is
    1 / Q'(u), averaged over the factors of tiles and robots.
    """
    if contrast >= 1.0:
        return ratios_at(law, value)
    grid = tables_of(law, False).value
    return interpolated(value, grid, _contrast_table(law, contrast))


def interpolated(x: Floats, at: Floats, values: Floats) -> Floats:
    """Return what ``np.interp`` returns, bit by bit, in a third of its time; ``values`` are finite.

    Args:
        at: ascending. values: at ``at``.
    """
    edges = np.linspace(at[0], at[-1], at.size, endpoint=False)
    begin = np.maximum(np.searchsorted(at, edges, side="right") - 1, 0)
    out = np.empty(x.shape)
    _interpolate(x.ravel(), at, values, begin, out.reshape(-1))
    return out


@kernel
def _interpolate(x: Floats, at: Floats, values: Floats, begin: NDArray[np.int64], out: Floats) -> None:
    """Write the values at ``x`` to ``out``.

    Args:
        begin: entry of ``at`` at or before the beginning of each of as many equal intervals.
    """
    last = at.size - 1
    span = at[last] - at[0]
    per_unit = begin.size / span if span > 0.0 else 0.0
    for i in range(x.size):
        if at[0] < x[i] < at[last]:
            k = begin[min(int((x[i] - at[0]) * per_unit), begin.size - 1)]
            while at[k] > x[i]:  # the interval is rounded
                k -= 1
            while at[k + 1] <= x[i]:
                k += 1
            slope = (values[k + 1] - values[k]) / (at[k + 1] - at[k])
            out[i] = slope * (x[i] - at[k]) + values[k]
        elif x[i] <= at[0]:
            out[i] = values[0]
        else:
            out[i] = values[last] if x[i] >= at[last] else x[i]  # nan stays


@lru_cache(maxsize=64)
def _contrast_table(law: Law, contrast: float) -> Floats:
    table = tables_of(law, False)
    factors, weights = np.ones(1), np.ones(1)
    if law.sensor.tile_spread is not None or law.sensor.robot_spread is not None:
        from vibroswarm.observation.energy_model import typical_factors

        factors, weights = typical_factors(law.sensor)
    # Coarse steps, so that measured values, whose quantiles are steps, have a density.
    at = np.linspace(0, POINTS - 1, 200).round().astype(np.int64)
    logs = []
    for share in (0.0, contrast):
        quantile = mixed(table.still, table.vibrating, share)[at]
        middle = 0.5 * (quantile[1:] + quantile[:-1])
        density = np.diff(table.u[at]) / np.maximum(np.diff(quantile), 1e-9)
        total = sum(
            w * np.interp(table.value / c, middle, density, left=0.0, right=0.0) / c
            for c, w in zip(factors.tolist(), weights.tolist(), strict=True)
        )
        logs.append(np.log(np.maximum(total, 1e-12)))
    return np.asarray(np.clip(logs[1] - logs[0], -8.0, 8.0))


CRACK_M: Final = 0.02
"""Width of a crack."""
SHAPES: Final = ("square", "disc", "crack")
"""Shapes of drawn damage: its size is the side, the diameter, or the length of a crack that lies along x or y."""


def drawn_patches(
    random: np.random.Generator, side_m: Floats, size_m: tuple[float, float], contrast: float, shape: str
) -> Patch:
    """Return damage of sizes ``side_m`` and of one shape, at random places within the surface, (replicates,)."""
    if shape != "crack":
        return patch_of(*random_places(random, side_m, size_m), side_m, contrast, disc=shape == "disc")
    u, upright = random.random((2, side_m.size)), random.random(side_m.size) < 0.5
    narrow = np.full(side_m.size, CRACK_M)
    sides = np.where(upright, narrow, side_m), np.where(upright, side_m, narrow)
    x_m, y_m = (place_within(at, side, 0.0, whole) for at, side, whole in zip(u, sides, size_m, strict=True))
    return Patch(x_m, y_m, *sides, np.full(side_m.size, contrast))


def patch_of(
    x_m: Floats, y_m: Floats, side_m: Floats | float, contrast: float = 1.0, *, disc: bool = False
) -> Patch:
    """Return squares, or discs of that diameter, with one contrast."""
    side = np.broadcast_to(np.asarray(side_m, dtype=np.float64), x_m.shape)
    return Patch(x_m, y_m, side, side, np.full(x_m.shape, contrast), disc)


def random_places(
    random: np.random.Generator, side_m: Floats, size_m: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Return centres at which squares of these sides lie within the surface, uniformly."""
    x, y = (place_within(random.random(side_m.size), side_m, 0.0, whole) for whole in size_m)
    return x, y


def sensed(
    random: np.random.Generator, sensor: Sensor, patch: Patch, x_m: Floats, y_m: Floats
) -> NDArray[np.bool_]:
    """Return whether a sample at each place senses the patch of each replicate, (samples, replicates).

    Args:
        x_m, y_m: true places, (samples, 1) or (samples, replicates).
    """
    beyond = patch.distance_m(x_m, y_m)
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0
    if blur_m == 0.0:
        return np.asarray(beyond < reach_m)
    return np.asarray(random.random(beyond.shape) < ndtr((reach_m - beyond) / blur_m))


def drawn_values(
    random: np.random.Generator,
    samples: Samples,
    replicates: int,
    patch: Patch | None = None,
) -> Floats:
    """Draw what the samples would have measured, (samples, replicates).

    If the law has an error, each replicate is drawn from one of its draws.

    Args:
        patch: damage, felt at the samples' true places; where these are not known they are drawn about the samples'
            places, by their spreads. None: the surface is intact.
    """
    law, count = samples.law, samples.frame.height
    inside: NDArray[np.bool_] | bool = False
    if patch is not None:
        known = not samples.frame["true_x_m"].has_nulls()
        x_m, y_m = (samples.column(f"{'true_' if known else ''}{axis}_m")[:, None] for axis in "xy")
        if not known and samples.column("spread_x_m").any():
            x_m = x_m + samples.column("spread_x_m")[:, None] * random.standard_normal((count, replicates))
            y_m = y_m + samples.column("spread_y_m")[:, None] * random.standard_normal((count, replicates))
        inside = sensed(random, law.sensor, patch, x_m, y_m)
    contrast = 1.0 if patch is None else patch.contrast
    u = random.random((count, replicates))
    if not law.draws:
        values, laws = values_at(law, u, inside, contrast), [law.sensor] * replicates
    else:
        drawn = random.integers(len(law.draws), size=replicates)
        values, laws = np.empty_like(u), [law.draws[k] for k in drawn]
        for k in np.unique(drawn):
            of_law = drawn == k
            at = False if inside is False else np.asarray(inside)[:, of_law]
            share = contrast if np.ndim(contrast) == 0 else np.asarray(contrast)[of_law]
            values[:, of_law] = values_at(law, u[:, of_law], at, share, draw=int(k))
    return values * _factors(random, samples, laws)


def _factors(random: np.random.Generator, samples: Samples, laws: Sequence[Sensor]) -> Floats:
    """Draw the factors of robots and tiles for each replicate, by its law, (samples, replicates) or (1, 1)."""
    robot = np.unique(samples.frame["robot"].to_numpy(), return_inverse=True)[1]
    total = np.zeros((1, 1))
    for group, name in ((robot, "robot_spread"), (tiles_below(samples), "tile_spread")):
        spread = np.array([getattr(law, name) or 0.0 for law in laws])
        if spread.any():
            normal = random.standard_normal((int(group.max()) + 1, spread.size))[group]
            total = total + spread * normal - 0.5 * spread**2
    return np.asarray(np.exp(total))


def tiles_below(samples: Samples) -> NDArray[np.int64]:
    """Return the number of the tile of each sample, from 0; without a grid, of squares of ``TILE_M``."""
    x_m, y_m = samples.column("x_m"), samples.column("y_m")
    if samples.floor is not None:
        number = samples.floor.tile_at(x_m, y_m)
    else:
        across = math.ceil(samples.size_m[0] / TILE_M) + 2
        number = np.floor(y_m / TILE_M) * across + np.floor(x_m / TILE_M)
    return np.asarray(np.unique(number, return_inverse=True)[1], dtype=np.int64)
