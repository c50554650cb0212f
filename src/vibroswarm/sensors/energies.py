"""A sensor that draws from measured energies, for one whose law is not known.

| name | symbol | unit | equation |
|---|---|---|---|
| energy | E | as measured | of n sorted energies of the tile's kind, the one with index floor(u n) |
| reading | O | 0, 1 | 1 if E > theta_E |
| likelihood | - | 1 / unit of E | kernel density of asinh(E / s) on its tile's kind, times the slope of asinh(E / s) |

asinh(E / s) is logarithmic beyond s, a share of the median |E|, and holds for zeros and energies below. Its density is
also that of values beyond those measured, which factors of tiles and robots reach: histograms have no tails there.

Its parameters, ``vibrating_energies`` and ``still_energies``, are fields of the section ``sensor`` itself; they may be
read from a CSV file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl

from vibroswarm.core.elementary import exp, log
from vibroswarm.core.read_tables import Column, ColumnMap, Use, read_rows
from vibroswarm.errors import InputError
from vibroswarm.floors.surfaces import mixed
from vibroswarm.sensors.base import SensorModel, Values, register
from vibroswarm.sensors.gamma import above_threshold

LINEAR: Final = 0.3
"""s of asinh(E / s), in medians of the |E| that are not 0."""
POINTS: Final = 1024
"""Points of the table of the density."""
NARROW: Final = 0.9
"""Width of the kernel: this times the spread within kinds times n^-1/5 (Silverman 1986)."""
LEAST: Final = 0.1
"""Least spread within kinds that counts, over the range of all: energies of a kind may all be equal."""
ROUNDING: Final = 1e-9
"""A spread below this is rounding: all energies are equal."""
REACH: Final = 4
"""Half width of a kernel, in its standard deviations."""
WILD: Final = 16
"""Spreads beyond the outer hundredths of all values from which on a value counts as if it were there."""


def measured_of(kind: int, p: Any) -> Values:
    """Return the measured energies of vibrating (``kind`` 1) or of still tiles, sorted."""
    return np.sort(np.asarray(p.vibrating_energies if kind == 1 else p.still_energies, dtype=np.float64))


def measure(kind: int, u: Values, p: Any) -> Values:
    """Return the measured energies at the quantiles ``u``."""
    energies = measured_of(kind, p)
    return energies[(u * energies.size).astype(np.int64)]


def share_at_most(kind: int, thresholds: Values, p: Any) -> Values:
    """Return the share of the measured energies of a kind at or below each threshold."""
    energies = measured_of(kind, p)
    return np.asarray(np.searchsorted(energies, thresholds, side="right") / energies.size)


def likelihood_at(contrast: float, value: Values, p: Any) -> Values:
    """Return the density of energies at a contrast, 0 and 1 for the kinds, by a kernel; it is positive everywhere.

    It is that of energies between the energies of both kinds at equal quantiles.
    """
    return _density_at(contrast, tuple(p.still_energies), tuple(p.vibrating_energies))(value)


@lru_cache(maxsize=512)
def _density_at(
    contrast: float, still: tuple[float, ...], vibrating: tuple[float, ...]
) -> Callable[[Values], Values]:
    """Return the density at a contrast; cached, also of many laws: every factor and every table needs it again."""
    kinds = [np.sort(np.array(energies)) for energies in (still, vibrating)]
    scale = scale_of(kinds)  # which densities at all contrasts share
    if contrast in (0.0, 1.0):
        return density_of(kinds[int(contrast)], scale)
    u = (np.arange(len(vibrating)) + 0.5) / len(vibrating)
    off, on = (energies[(u * energies.size).astype(np.int64)] for energies in kinds)
    return density_of(mixed(off, on, contrast), scale)


class Scale(NamedTuple):
    """By what energies are scaled, and their kernel: the same for all kinds (``scale_of``)."""

    unit: float
    """s of asinh(E / s)."""
    spread: float
    """Of scaled energies within kinds."""
    width: float
    """Standard deviation of the kernel."""
    low: float
    high: float
    """Ends of the scaled energies but wild ones."""
    number: int
    """Energies of the kind that has fewer."""


def scale_of(measured: Sequence[Values]) -> Scale:
    """Return the scale of the measured energies of each kind."""
    size = np.abs(np.concatenate(measured))
    unit = LINEAR * float(np.median(size[size > 0.0])) if size.any() else 1.0
    scaled = [_asinh(each / unit) for each in measured]
    within = math.sqrt(sum(_spread(each) ** 2 for each in scaled) / len(scaled))
    every = np.concatenate(scaled)
    low, high = (float(end) for end in np.quantile(every, (0.01, 0.99)))
    spread = max(within, LEAST * (high - low))
    spread = spread if spread > ROUNDING else 1.0
    number = min(each.size for each in measured)
    return Scale(
        unit,
        spread,
        NARROW * spread * number**-0.2,
        max(float(every.min()), low - WILD * spread),
        min(float(every.max()), high + WILD * spread),
        number,
    )


def density_of(values: Values, scale: Scale) -> Callable[[Values], Values]:
    """Return the density of values of one kind of tile, or between two kinds, as a function.

    All kinds have the same kernel, so that shares count where many energies are equal. One value more of each kind is
    spread widely about its own, by Laplace's distribution: beyond all values the nearer kind stays the likelier one.
    """
    from scipy.ndimage import correlate1d

    unit, spread, width, low, high, number = scale
    margin = REACH * width + 0.5 * (high - low)
    at = np.linspace(low - margin, high + margin, POINTS)
    step = float(at[1] - at[0])
    away = np.abs(np.arange(1 - POINTS, POINTS)) * step
    narrow = exp(-0.5 * (away[away <= REACH * width] / width) ** 2)
    wide = exp(-away / spread)
    places = (np.clip(_asinh(values / unit), low, high) - low + margin) / step
    counts = np.bincount(np.rint(places).astype(np.int64), minlength=POINTS) / values.size
    near, far = (correlate1d(counts, each / each.sum(), mode="constant") for each in (narrow, wide))
    return partial(_density, unit, at, (number * near + far) / (number + 1) / step)


def smoothed(values: Values, scale: Scale, each: int) -> Values:
    """Return values that are distributed as the density of ``values``: ``each`` of them about every one."""
    from scipy.special import ndtri

    offsets = scale.width * ndtri((np.arange(each) + 0.5) / each)
    scaled = np.add.outer(_asinh(values / scale.unit), offsets).ravel()
    return np.asarray(0.5 * scale.unit * (exp(scaled) - exp(-scaled)))  # sinh


def _spread(scaled: Values) -> float:
    """Return the standard deviation, or that of a normal distribution with the same quartiles, if it is smaller."""
    quartiles = float(np.subtract(*np.quantile(scaled, (0.75, 0.25)))) / 1.34
    deviation = float(scaled.std())
    return min(deviation, quartiles) if quartiles > 0.0 else deviation


def _density(unit: float, at: Values, table: Values, value: Values) -> Values:
    """Return the density of values, by that of asinh(value / unit) at the points ``at``."""
    return np.asarray(np.interp(_asinh(value / unit), at, table) / np.hypot(value, unit))


def _asinh(x: Values) -> Values:
    """Return asinh of each number, alike on all processors."""
    return np.copysign(log(np.abs(x) + np.hypot(x, 1.0)), x)


def check(p: Any) -> None:
    """Refuse a scenario without measured energies of both kinds."""
    for field in ("vibrating_energies", "still_energies"):
        if getattr(p, field) is None:
            raise InputError(
                'missing; model = "energies" draws from measured energies', field=f"sensor.{field}"
            )


energies = register(
    SensorModel(
        name="energies",
        measure=measure,
        reading=above_threshold,
        share_at_most=share_at_most,
        likelihood=likelihood_at,
        likelihood_at=likelihood_at,
        check=check,
        in_section=True,
        scales=True,
        about="energies are drawn from measured ones (--energies FILE)",
    )
)


SCHEMA: Final = {
    "kind": Use(pl.Int64, 0, 1, "a kind of tile, 'still' or 'vibrating'", required=True),
    "energy": Use(pl.Float64, -1e300, 1e300, "an energy", required=True),
}
_COLUMNS: Final = ColumnMap(
    columns={
        "kind": Column(name="kind", values={"vibrating": 1, "1": 1, "still": 0, "non-vibrating": 0, "0": 0}),
        "energy": Column(name="energy"),
    }
)


def read_energies(path: str | Path) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Read measured energies; return those of vibrating tiles, then those of still tiles, in the order of the file.

    Args:
        path: a CSV file with the columns ``kind`` (vibrating or still, 1 or 0) and ``energy`` (RMS); other columns are
            ignored.
    Raises:
        InputError: the file cannot be read, or a kind or an energy is wrong, or missing.
    """
    read = read_rows([Path(path)], SCHEMA, _COLUMNS)
    vibrating, still = (tuple(read.rows.filter(kind=one)["energy"].to_list()) for one in (1, 0))
    if read.missing or not (vibrating and still):
        raise InputError("needs a kind and an energy in each line, and both kinds of tile", field=str(path))
    return vibrating, still
