"""Damage that is not bound to a grid: what samples would have measured on a patch, or on an intact surface.

| name | symbol | equation |
|---|---|---|
| value where still, vibrating | F_still, F_vibrating | of the law |
| value at contrast c | - | F_c^-1(u) = (1 - c) F_still^-1(u) + c F_vibrating^-1(u) |
| probability to sense the patch | P | Phi((reach - d) / blur), d the distance from its edge, negative inside |
| error of the law | - | replicate b is drawn and judged by ``Law.draws``, number b modulo their count |
| factors | - | of each robot and of each tile, log-normal of mean 1, by the spreads of the law |

This is the one simulator of inspections: p-values, probability of detection and risk are shares of what it draws, so
that they hold for whatever is drawn here, and for nothing else. A surface is judged by a law that was fitted to a
reference; what it measures was not part of that reference. So are the drawn surfaces: each is judged by a law fitted to
a resampled reference, and measures what this reference left out. A law that judged values like those to which it was
fitted would tell them apart better than any others: with a hundred measured values of each kind one in seven intact
surfaces was called.

Tiles without a grid are squares of ``TILE_M``. Nothing varies with time: drift is tested, not simulated (``checks``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.floors.surfaces import Patch, mixed, place_within
from vibroswarm.inspection.samples import Floats, Law, Samples, ratios_of_values, read_by
from vibroswarm.observation.energy_model import MOST, energy_of, likelihood_at
from vibroswarm.scenario.fields import Sensor
from vibroswarm.sensors.base import MOST_KINDS

TILE_M: Final = 0.2
"""Side of the tiles that differ where there is no grid: that of the floors of the recordings."""
POINTS: Final = 4000
"""Points at which a law is computed."""
EVEN: Final = 2**16
"""Entries of the even tables that are made of these."""
WIDEST: Final = 4.5
"""Ends of the values that a law knows, as standard normal quantiles."""
AT_ONCE: Final = 256
"""Replicates drawn at once, for memory."""


@lru_cache(maxsize=256)
def quantiles_of(law: Law) -> NDArray[np.float32]:
    """Return values where it is still and where it vibrates at even quantiles, (2, EVEN)."""
    u = ndtr(np.linspace(-WIDEST, WIDEST, POINTS))  # denser at the ends, where quantiles change most
    nearest = np.searchsorted(0.5 * (u[1:] + u[:-1]), (np.arange(EVEN) + 0.5) / EVEN)
    return np.stack([energy_of(law.sensor, kind, u, law.place)[nearest] for kind in (0, 1)])


@lru_cache(maxsize=512)
def _ratio_table(law: Law, contrast: float) -> tuple[float, float, float, Floats]:
    """Return the unit of arcsinh(value / unit), its lowest value and its step, and the log ratios at even steps."""
    known = quantiles_of(law).astype(np.float64)
    unit = float(np.median(np.abs(known))) or 1.0
    # Factors of robots and tiles lead beyond what is known.
    low, high = float(np.arcsinh(known.min() / unit)) - 0.5, float(np.arcsinh(known.max() / unit)) + 0.5
    scaled = np.linspace(low, high, POINTS)
    value = unit * np.sinh(scaled)
    if contrast >= 1.0:
        ratio = ratios_of_values(law, value)
    else:
        # Densities of measured energies are never 0, and small numbers where energies are large ones.
        least = 1e-12 if law.sensor.vibrating_energies is None else 0.0
        on, off = (
            np.log(np.maximum(likelihood_at(law.sensor, level, value, law.place), least))
            for level in (contrast, 0.0)
        )
        ratio = np.clip(on - off, -MOST, MOST)
    even = np.linspace(low, high, EVEN)
    return unit, low, float(even[1] - even[0]), np.interp(even, scaled, ratio)


def ratios_at(law: Law, value: Floats, contrast: float = 1.0) -> Floats:
    """Return the log likelihood ratio of values for damage of a contrast against none, in the shape of value."""
    is_measured = law.sensor.vibrating_energies is not None
    if law.bits or (
        not is_measured and np.unique(quantiles_of(law)).size <= MOST_KINDS
    ):  # readings, or classes
        return ratios_of_values(law, value.ravel()).reshape(value.shape)
    unit, low, step, table = _ratio_table(law, contrast)
    at = ((np.arcsinh(value / unit) - low) / step + 0.5).astype(np.int64)
    return np.asarray(table[np.clip(at, 0, EVEN - 1)])


@lru_cache(maxsize=16)
def _draws_of(law: Law) -> tuple[list[Law], list[Law]]:
    """Return the laws that judge drawn surfaces, and those that these surfaces follow."""
    judges = [replace(law, sensor=one.judge, draws=()) for one in law.draws]
    truths = [replace(law, sensor=one.truth, draws=()) for one in law.draws]
    return judges or [law], truths or [law]


def judged(law: Law, values: Floats, judge: Callable[[Law, Floats], Floats]) -> Floats:
    """Return what ``judge`` says of drawn values, (samples, replicates), by a law with its error."""
    laws, out = _draws_of(law)[0], np.empty(values.shape, order="F")
    for k, one in enumerate(laws[: values.shape[1]]):
        out[:, k :: len(laws)] = judge(one, values[:, k :: len(laws)])
    return out


def squares_at(
    random: np.random.Generator, side_m: Floats, size_m: tuple[float, float], contrast: float
) -> Patch:
    """Return squares of these sides at random places within the surface, (replicates,)."""
    x_m, y_m = (place_within(random.random(side_m.size), side_m, 0.0, whole) for whole in size_m)
    return Patch(x_m, y_m, side_m, side_m, np.full(side_m.size, contrast))


def _sensed(
    random: np.random.Generator, samples: Samples, replicates: int, patch: Patch
) -> NDArray[np.bool_]:
    known = not samples.frame["true_x_m"].has_nulls()
    shape = samples.frame.height, replicates
    at_m = []
    for axis in "xy":
        place_m = samples.column(f"{'true_' * known}{axis}_m")[:, None]
        spread_m = samples.column(f"spread_{axis}_m")[:, None]
        is_exact = known or not spread_m.any()
        at_m.append(place_m if is_exact else place_m + spread_m * random.standard_normal(shape))
    reach_m, blur_m = samples.law.sensor.edge_reach_m or 0.0, samples.law.sensor.edge_blur_m or 0.0
    blur = blur_m * random.standard_normal(shape) if blur_m else 0.0
    return np.asarray(patch.distance_m(*at_m) + blur < reach_m)


def drawn_values(
    random: np.random.Generator, samples: Samples, replicates: int, patch: Patch | None = None
) -> Floats:
    """Draw what the samples would have measured, (samples, replicates)."""
    truths = _draws_of(samples.law)[1]
    inside = None if patch is None else _sensed(random, samples, replicates, patch)
    index = random.integers(EVEN, size=(samples.frame.height, replicates), dtype=np.uint16)
    values = np.empty(index.shape, order="F")
    for k, truth in enumerate(truths[:replicates]):
        own = np.s_[:, k :: len(truths)]
        still, vibrating = quantiles_of(truth)
        values[own] = still[index[own]]
        if patch is not None and inside is not None:
            on, part = inside[own], values[own]
            contrast = np.broadcast_to(patch.contrast, values.shape)[own][on]
            part[on] = mixed(part[on], vibrating[index[own][on]], contrast)
    values *= _factors(random, samples, [truths[b % len(truths)].sensor for b in range(replicates)])
    return read_by(samples.law, values)


def drawn_parts(
    random: np.random.Generator, samples: Samples, replicates: int, patch: Patch | None = None
) -> Iterator[Floats]:
    """Draw as ``drawn_values`` does, a few replicates after the other."""
    for begin in range(0, replicates, AT_ONCE):
        part = None if patch is None else patch.some(slice(begin, begin + AT_ONCE))
        yield drawn_values(random, samples, min(AT_ONCE, replicates - begin), part)


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
