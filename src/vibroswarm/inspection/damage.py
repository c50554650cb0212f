"""Damage that is not bound to a grid: what samples would have measured on a patch, or on an intact surface.

| name | symbol | equation |
|---|---|---|
| value where still, vibrating | F_still, F_vibrating | of the law |
| value at contrast c | - | F_c^-1(u) = (1 - c) F_still^-1(u) + c F_vibrating^-1(u) |
| probability to sense the patch | P | Phi((reach - d) / blur), d the distance from its edge, negative inside |
| error of the law | - | replicate b is drawn and judged by ``Law.draws``, number b modulo their count; a probability \
that samples give is a mean over the laws (``over_laws``) |
| factors | - | of each robot and of each tile, log-normal of mean 1, by the spreads of the law |

A surface is judged by a law that was fitted to a reference; what it measures was not part of that reference. So are the
drawn surfaces: each is judged by a law fitted to a resampled reference, and measures what this reference left out,
spread as the kernel of the law spreads it. A law that judged values like those to which it was fitted would tell them
apart better than any others: with a hundred measured values of each kind one in seven intact surfaces was called.

Tiles without a grid are squares of ``TILE_M``. Nothing varies with time: drift is tested, not simulated (``checks``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.core.jit import kernel
from vibroswarm.floors.surfaces import Patch, mixed, place_within
from vibroswarm.inspection.samples import Floats, Law, Samples, ratios_of_values, read_by
from vibroswarm.observation.energy_model import MOST, energy_of, likelihood_at
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors.base import MOST_KINDS

TILE_M: Final = 0.2
"""Side of the tiles that differ where there is no grid: that of the floors of the recordings."""
POINTS: Final = 4000
"""Points of the tables of quantiles and of ratios."""
SAMPLES_AT_ONCE: Final = 200
"""Samples drawn at once. Random numbers are drawn sample by sample, but arrays are stored replicate by replicate."""
FEW: Final = 8
"""Entries of a table that are searched one after the other."""
COARSE: Final = 0.02
"""Largest distance between evenly spaced values of a table, over the distance between the quartiles of a kind."""


class Quantiles(NamedTuple):
    """Quantiles of a law as tables, which are much faster than the law itself."""

    u: Floats
    still: Floats
    vibrating: Floats
    """Quantiles at ``u``."""
    of_u: NDArray[np.int64]
    """``index_of`` u."""


class Table(NamedTuple):
    """Log ratios of a law as a table; those of a law that judges nothing are not computed."""

    value: Floats
    ratio: Floats
    """Log ratios at ``value``."""
    of_value: NDArray[np.int64]
    """``index_of`` value."""


@lru_cache(maxsize=512)
def quantiles_of(law: Law) -> Quantiles:
    """Return the quantiles of a law."""
    # Denser at the ends of (0, 1), where quantiles change most.
    u = ndtr(np.linspace(-4.5, 4.5, POINTS))
    still, vibrating = (energy_of(law.sensor, kind, u, law.place).astype(np.float64) for kind in (0, 1))
    return Quantiles(u, still, vibrating, index_of(u))


@lru_cache(maxsize=512)
def tables_of(law: Law) -> Table:
    """Return the log ratios of a law."""
    u, still, vibrating, _ = quantiles_of(law)
    low, high = min(still[0], vibrating[0]), max(still[-1], vibrating[-1])
    value = np.linspace(low - 0.5 * (high - low), high + (high - low), POINTS)
    if value[1] - value[0] > COARSE * min(
        np.ptp(np.interp((0.25, 0.75), u, each)) for each in (still, vibrating)
    ):
        # Values of a few samples are far from all others, as in a long tail: half of the points are quantiles.
        value = np.unique(np.concatenate([value[::2], still[::4], vibrating[::4]]))
    few = np.unique((still, vibrating))
    # A sensor of classes has nothing between them; damage of a contrast has energies between few measured ones.
    if few.size <= MOST_KINDS and law.sensor.vibrating_energies is None:
        value = few
    if law.bits:
        value = np.array([0.0, 1.0])
    return Table(value, ratios_of_values(law, value), index_of(value))


def values_at(
    law: Law, u: Floats, inside: NDArray[np.bool_] | bool, contrast: Floats | float = 1.0
) -> Floats:
    """Return what a typical sensor measures at quantile ``u``, on damage of a contrast or off it, in the shape of u."""
    table = quantiles_of(law)
    found = interpolated(u, table.u, table.still, table.of_u)
    where = np.broadcast_to(inside, u.shape)
    if where.any():  # damage is small: few samples sense it
        share = np.broadcast_to(contrast, u.shape)[where]
        found[where] = mixed(
            found[where], interpolated(u[where], table.u, table.vibrating, table.of_u), share
        )
    return found


@lru_cache(maxsize=16)
def draws_of(law: Law) -> tuple[list[Law], list[Law]]:
    """Return the laws that judge drawn surfaces, and those that these surfaces follow."""
    judges = [replace(law, sensor=one.judge, draws=()) for one in law.draws]
    truths = [replace(law, sensor=one.truth, draws=()) for one in law.draws]
    return judges, truths


def over_laws(law: Law, probability: Callable[[Law], Floats]) -> Floats:
    """Return the mean of a probability by a law and by those fitted to resampled references, which are its error."""
    laws = [law, *draws_of(law)[0]]
    return np.asarray(sum(map(probability, laws)) / len(laws))


def judged(law: Law, values: Floats, judge: Callable[[Law, Floats], Floats]) -> Floats:
    """Return what ``judge`` says of drawn values, (samples, replicates), by a law with its error."""
    return by_laws(draws_of(law)[0] or [law], values, judge)


def by_laws(laws: Sequence[Law], values: Floats, judge: Callable[[Law, Floats], Floats]) -> Floats:
    """Return what ``judge`` says of values, (samples, replicates): of replicate b by law b modulo their number."""
    out = np.empty(values.shape, order="F")
    for k, one in enumerate(laws[: values.shape[1]]):
        out[:, k :: len(laws)] = judge(one, values[:, k :: len(laws)])
    return out


def ratios_at(law: Law, value: Floats) -> Floats:
    """Return the log ratios of values as ``samples.ratios_of_values`` does, by its table."""
    table = tables_of(law)
    return interpolated(value, table.value, table.ratio, table.of_value)


def contrast_ratios(law: Law, value: Floats, contrast: float) -> Floats:
    """Return the log likelihood ratio of values for damage of a contrast, against no damage, in the shape of value.

    At contrast 1 it is that of the law; below, that of the sensor's likelihood at the contrast
    (``energy_model.likelihood_at``).
    """
    if contrast >= 1.0:
        return ratios_at(law, value)
    table = tables_of(law)
    return interpolated(value, table.value, _contrast_table(law, contrast), table.of_value)


def interpolated(x: Floats, at: Floats, values: Floats, begin: NDArray[np.int64] | None = None) -> Floats:
    """Return what ``np.interp`` returns, bit by bit, in a third of its time; ``values`` are finite.

    Args:
        at: ascending. values: at ``at``, (at,), or of several functions, (functions, at).
        begin: ``index_of(at)``, if it is known.
    Returns: in the shape of x, or (functions, *that).
    """
    order: Literal["C", "F"] = "F" if x.flags.f_contiguous else "C"
    functions = np.atleast_2d(values)
    out = np.empty((len(functions), x.size))
    _interpolate(x.ravel(order), at, functions, index_of(at) if begin is None else begin, out)
    found = out.T.reshape((*x.shape, len(functions)), order=order)
    return found[..., 0] if values.ndim == 1 else np.moveaxis(found, -1, 0)


def index_of(at: Floats) -> NDArray[np.int64]:
    """Return the entry at or before the beginning of each of as many equal intervals between the ends of ``at``."""
    edges = np.linspace(at[0], at[-1], at.size, endpoint=False)
    return np.asarray(np.maximum(np.searchsorted(at, edges, side="right") - 1, 0), dtype=np.int64)


@kernel
def _interpolate(x: Floats, at: Floats, values: Floats, begin: NDArray[np.int64], out: Floats) -> None:
    """Write the values at ``x`` of each function to ``out``, (functions, x).

    Args:
        begin: entry of ``at`` at or before the beginning of each of as many equal intervals.
    """
    last = at.size - 1
    span = at[last] - at[0]
    per_unit = begin.size / span if span > 0.0 else 0.0
    for i in range(x.size):
        if at[0] < x[i] < at[last]:
            interval = min(int((x[i] - at[0]) * per_unit), begin.size - 1)
            k = begin[interval]
            high = begin[interval + 1] if interval + 1 < begin.size else last - 1
            while high - k > FEW:  # one interval may have most entries
                middle = (k + high + 1) // 2
                if at[middle] <= x[i]:
                    k = middle
                else:
                    high = middle - 1
            while at[k] > x[i]:  # the interval is rounded
                k -= 1
            while at[k + 1] <= x[i]:
                k += 1
            for f in range(out.shape[0]):
                slope = (values[f, k + 1] - values[f, k]) / (at[k + 1] - at[k])
                out[f, i] = slope * (x[i] - at[k]) + values[f, k]
        else:
            for f in range(out.shape[0]):
                beyond = values[f, last] if x[i] >= at[last] else x[i]  # nan stays
                out[f, i] = values[f, 0] if x[i] <= at[0] else beyond


@lru_cache(maxsize=512)
def _contrast_table(law: Law, contrast: float) -> Floats:
    value = tables_of(law).value
    return np.asarray(np.clip(log_density(law, contrast, value) - log_density(law, 0.0, value), -MOST, MOST))


def log_density(law: Law, contrast: float, value: Floats) -> Floats:
    """Return the log likelihood of energies on damage of a contrast; finite, also where the law has none."""
    # Densities of measured energies are never 0, and small numbers where energies are large ones.
    least = 1e-12 if law.sensor.vibrating_energies is None else 0.0
    return np.asarray(np.log(np.maximum(likelihood_at(law.sensor, contrast, value, law.place), least)))


CRACK_M: Final = 0.02
"""Width of a crack."""
SHAPES: Final = ("square", "disc", "crack")
"""Shapes of drawn damage: its size is the side, the diameter, or the length of a crack that lies along x or y."""


def drawn_patches(
    random: np.random.Generator, side_m: Floats, size_m: tuple[float, float], contrast: float, shape: str
) -> Patch:
    """Return damage of sizes ``side_m`` and of one shape, at random places within the surface, (replicates,).

    Cracks lie along x or y with the same probability, or along the one axis that they fit.
    """
    if shape != "crack":
        return patch_of(*random_places(random, side_m, size_m), side_m, contrast, disc=shape == "disc")
    u, upright = random.random((2, side_m.size)), random.random(side_m.size) < 0.5
    upright = np.where(side_m <= min(size_m), upright, size_m[1] > size_m[0])
    narrow = np.full(side_m.size, min(CRACK_M, *size_m))
    sides = np.where(upright, narrow, side_m), np.where(upright, side_m, narrow)
    x_m, y_m = (place_within(at, side, 0.0, whole) for at, side, whole in zip(u, sides, size_m, strict=True))
    return Patch(x_m, y_m, *sides, np.full(side_m.size, contrast))


def patch_of(
    x_m: Floats, y_m: Floats, side_m: Floats | float, contrast: Floats | float = 1.0, *, disc: bool = False
) -> Patch:
    """Return squares, or discs of that diameter; sizes and contrasts may be one for each, or one for all."""
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

    Args:
        patch: damage, felt at the samples' true places; where these are not known they are drawn about the samples'
            places, by their spreads. None: the surface is intact.
    """
    if patch is None:
        return values_where(random, samples, replicates, False)
    known = not samples.frame["true_x_m"].has_nulls()
    x_m, y_m = (samples.column(f"{'true_' if known else ''}{axis}_m")[:, None] for axis in "xy")
    if not known and samples.column("spread_x_m").any():
        shape = samples.frame.height, replicates
        x_m = x_m + samples.column("spread_x_m")[:, None] * random.standard_normal(shape)
        y_m = y_m + samples.column("spread_y_m")[:, None] * random.standard_normal(shape)
    inside = np.empty((samples.frame.height, replicates), dtype=bool, order="F")
    for part in _parts_of(inside):
        inside[part] = sensed(random, samples.law.sensor, patch, x_m[part], y_m[part])
    return values_where(random, samples, replicates, inside, patch.contrast)


def _parts_of(drawn: NDArray[Any]) -> Iterator[slice]:
    """Yield slices of ``SAMPLES_AT_ONCE`` rows, in order."""
    for begin in range(0, drawn.shape[0], SAMPLES_AT_ONCE):
        yield slice(begin, begin + SAMPLES_AT_ONCE)


def drawn_parts(
    random: np.random.Generator, samples: Samples, replicates: int, patch: Patch | None = None, at_once: int = 256
) -> Iterator[Floats]:  # fmt: skip
    """Draw as ``drawn_values`` does, ``at_once`` replicates after the other, so that memory stays small."""
    for begin in range(0, replicates, at_once):
        part = None if patch is None else patch.some(slice(begin, begin + at_once))
        yield drawn_values(random, samples, min(at_once, replicates - begin), part)


def values_where(
    random: np.random.Generator,
    samples: Samples,
    replicates: int,
    inside: NDArray[np.bool_] | bool,
    contrast: Floats | float = 1.0,
) -> Floats:
    """Draw what the samples would have measured, if they sense damage or not, (samples, replicates).

    Args:
        inside: which do, (samples, replicates); False: none. contrast: of the damage, (replicates,) or one number.
    """
    law, values = samples.law, np.empty((samples.frame.height, replicates), order="F")
    for part in _parts_of(values):
        values[part] = random.random(values[part].shape)
    truths = draws_of(law)[1] or [law]
    for k, truth in enumerate(truths[:replicates]):
        own = np.s_[:, k :: len(truths)]
        where, share = (np.broadcast_to(each, values.shape)[own] for each in (inside, contrast))
        values[own] = values_at(truth, values[own], where, share)
    sensors = [truths[b % len(truths)].sensor for b in range(replicates)]
    values *= _factors(random, samples, sensors)
    return read_by(law, values)


def _factors(random: np.random.Generator, samples: Samples, sensors: Sequence[Sensor]) -> Floats:
    """Draw the factors of robots and tiles for each replicate, by its sensor, (samples, replicates) or (1, 1)."""
    robot = np.unique(samples.frame["robot"].to_numpy(), return_inverse=True)[1]
    total = np.zeros((1, 1))
    for group, name in ((robot, "robot_spread"), (tiles_below(samples), "tile_spread")):
        spread = np.array([getattr(sensor, name) or 0.0 for sensor in sensors])
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
