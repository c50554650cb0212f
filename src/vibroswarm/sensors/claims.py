"""What follows from the likelihood that a sensor states: rates of reading each class, and the law at a contrast.

| name | symbol | unit | equation |
|---|---|---|---|
| likelihood | L_i(v) | 1 / unit of v, or a share | what robots claim of the value v on a tile of kind i |
| claimed rate | c_ij | - | sum, or integral, of L_i over the values v that read as class j; rows sum to 1 |
| claimed quantile | Q_i(u) | as v | F_i^-1(u), F_i the integral of L_i |
| likelihood at contrast c | L_c(v) | 1 / unit of v | 1 / Q_c'(u) where Q_c(u) = (1 - c) Q_0(u) + c Q_1(u) = v |

What a robot claims need not be true: ``measure`` draws the values, and ``likelihood`` says what robots believe of them.
Values are summed over if there are few of them, or if they are whole numbers: all but those that hardly a sample
measures. Others are integrated over, also beyond those that are measured, up to where the likelihood fades.
"""

from __future__ import annotations

from functools import cache, lru_cache
from typing import Any, Final

import numpy as np
from pydantic import BaseModel

from vibroswarm.core.quadrature import over_interval
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError
from vibroswarm.floors.surfaces import mixed
from vibroswarm.sensors.base import TRIED, SensorModel, Values

FEW: Final = 256
"""At most so many distinct values are summed over, even if they are not whole numbers."""
MOST_WHOLE: Final = 1_000_000
"""Whole numbers are summed over if they span at most so many."""
OFF: Final = 0.01
"""A likelihood of one kind may sum to 1 give or take this."""
FAINT: Final = 1e-7
"""Likelihood beyond the measured values is left out from where a doubling of the distance adds less."""
DOUBLINGS: Final = 60
ENDS: Final = 500
"""The measured values are integrated over from one to another of about so many of them."""
NODES: Final = 8
"""Points of the Gauss-Legendre rule of each interval."""
DEEPEST: Final = 40
"""How often an interval is halved at most."""
MOST_INTERVALS: Final = 100_000
"""No interval is halved again if there are more: a likelihood that is no density may never settle."""
CLAIMED_AS_TRUE: Final = 1e-3
"""Claimed rates that differ by at most this from the true ones count as these."""
SETTLED: Final = 1e-9
"""An interval is halved if that changes its integral by more."""
GRID: Final = 20_001
"""Values at which a claimed law is integrated to find its quantiles."""


@lru_cache(maxsize=64)
def claimed_rates(model: SensorModel, p: BaseModel, threshold: float | None, factor: float = 1.0) -> Values:
    """Return the rates at which robots believe to read each class on each kind of tile, (kinds, classes).

    Args:
        model: of one number (``measure``), with a likelihood. threshold: that of ``p``, which is no field of it
            (``SensorModel.has_threshold``), and part of the key of the cache. factor: the values are multiplied by it.
    Raises:
        CodeError: the likelihood of a kind does not sum to 1.
    """
    measured = _measured(model, p, factor)
    values = _values_to_sum(measured, model.number_of("readings", p))
    found = (
        _summed(model, p, values, factor) if values is not None else _integrated(model, p, measured, factor)
    )
    totals = found.sum(axis=1)
    if values is not None and values.size <= FEW and _is_off(totals):
        # Values of a sensor that draws from a few measured ones may have a density all the same.
        found = _integrated(model, p, measured, factor)
    if _is_off(totals) and _is_off(found.sum(axis=1)):
        kind = int(np.abs(totals - 1.0).argmax())
        raise CodeError(
            f"sensor '{model.name}', likelihood: sums to {totals[kind]:.4g} over all values on kind {kind}, so it does "
            "not say how often each class is read; return a density, or share, that sums to 1 (0 at values that cannot "
            "occur, such as negative ones), or set sensor.claimed_rates"
        )
    rates: Values = found / found.sum(axis=1, keepdims=True)
    rates.setflags(write=False)
    return rates


def _is_off(totals: Values) -> bool:
    return bool((np.abs(totals - 1.0) > OFF).any())


def _values_to_sum(measured: Values, classes: int) -> Values | None:
    """Return the values of a sensor of few or whole values, ascending; None if there are others."""
    if (measured == np.floor(measured)).all():
        first, last = min(float(measured[0]), 0.0), max(float(measured[-1]), classes - 1.0)
        if last - first < MOST_WHOLE:
            return np.arange(first, last + 1.0)
    return measured if measured.size <= FEW else None


def _summed(model: SensorModel, p: Any, values: Values, factor: float) -> Values:
    classes = model.classes(values * factor, p)
    rows = [
        np.bincount(classes, model.densities(kind, values, p), minlength=model.number_of("readings", p))
        for kind in range(model.number_of("kinds", p))
    ]
    return np.array(rows)


def _integrated(model: SensorModel, p: Any, measured: Values, factor: float) -> Values:
    """Integrate over the measured values, and outwards from them until nothing is added."""
    for kind in range(model.number_of("kinds", p)):
        model.densities(kind, measured, p)  # raises an error at what is no density
    ends = np.unique(np.append(measured[:: measured.size // ENDS + 1], measured[-1]))
    found = _between(model, p, ends, factor)
    low, high = float(ends[0]), float(ends[-1])
    steps = np.diff(ends) if ends.size > 1 else np.array([max(abs(low), 1.0)])
    below, above = float(steps[0]), float(steps[-1])
    for _ in range(DOUBLINGS):
        more = _between(model, p, np.linspace(low - below, low, 9), factor)
        more += _between(model, p, np.linspace(high, high + above, 9), factor)
        found += more
        totals = found.sum(axis=1)
        if totals.max() > 1.0 + OFF or (more.sum(axis=1).max() < FAINT and not _is_off(totals)):
            break
        low, high, below, above = low - below, high + above, 2.0 * below, 2.0 * above
    return found


def _between(model: SensorModel, p: Any, ends: Values, factor: float) -> Values:
    """Return the integral of the likelihood between the first and the last of ``ends``, (kinds, classes).

    Intervals in which two halves do not give what the whole gives are halved, and so on, within limits.
    """
    least = _borders(
        model, p, ends, factor
    )  # the class changes there, so that it is one within each interval
    ends = np.unique(np.append(ends, least[np.isfinite(least)]))
    low, high = ends[:-1], ends[1:]
    classes = model.classes(0.5 * (low + high) * factor, p)
    found = np.zeros((model.number_of("kinds", p), model.number_of("readings", p)))
    for depth in range(DEEPEST):
        middle = 0.5 * (low + high)
        halves = _masses(model, p, low, middle) + _masses(model, p, middle, high)
        split = np.abs(halves - _masses(model, p, low, high)).max(axis=0) > SETTLED
        if depth == DEEPEST - 1 or low.size > MOST_INTERVALS:
            split[:] = False
        for kind in range(found.shape[0]):
            found[kind] += np.bincount(classes[~split], halves[kind, ~split], minlength=found.shape[1])
        if not split.any():
            break
        low, high = np.append(low[split], middle[split]), np.append(middle[split], high[split])
        classes = np.tile(classes[split], 2)
    return found


def _masses(model: SensorModel, p: Any, low: Values, high: Values) -> Values:
    """Return the integral of the likelihood over each interval by the Gauss-Legendre rule, (kinds, intervals)."""
    at, weight = over_interval(NODES)
    value = low[:, None] + 0.5 * (high - low)[:, None] * (1.0 + at)
    densities = np.array([_density(model, kind, value, p) for kind in range(model.number_of("kinds", p))])
    return np.asarray((high - low) * (densities * weight).sum(axis=2))


def _density(model: SensorModel, kind: int, value: Values, p: Any) -> Values:
    """Return the likelihood of values; 0 where it has none, as a formula may far from what is measured."""
    assert model.likelihood is not None
    with errors_in(model.code), np.errstate(all="ignore"):
        found = np.asarray(model.likelihood(kind, value.ravel(), p), dtype=np.float64)
    return np.maximum(np.nan_to_num(found, posinf=0.0, neginf=0.0), 0.0).reshape(value.shape)


def _borders(model: SensorModel, p: Any, ends: Values, factor: float) -> Values:
    """Return the least values that read as class 1, 2 and so on, or above, found by bisection between ``ends``.

    Returns: (classes - 1,): -inf if all ends do, inf if none does.
    """
    classes, borders = model.classes(ends * factor, p), np.arange(1, model.number_of("readings", p))
    first = np.searchsorted(classes, borders)
    low, high = ends[np.maximum(first - 1, 0)], ends[np.minimum(first, ends.size - 1)]
    for _ in range(64):
        middle = 0.5 * (low + high)
        is_below = model.classes(middle * factor, p) < borders
        low, high = np.where(is_below, middle, low), np.where(is_below, high, middle)
    return np.where(first == 0, -np.inf, np.where(first == ends.size, np.inf, high))


@lru_cache(maxsize=64)
def class_borders(model: SensorModel, p: BaseModel, threshold: float | None) -> Values:
    """Return the least values that read as class 1, 2 and so on, (classes - 1,); inf if nothing measured does.

    Arguments and errors are those of ``claimed_rates``. Values beyond the measured ones read as the nearest of these.
    """
    return _borders(model, p, _measured(model, p), 1.0)


def _measured(model: SensorModel, p: BaseModel, factor: float = 1.0) -> Values:
    """Return values that are measured, ascending; refuses a reading that falls as they grow."""
    measured = np.unique([model.values(kind, TRIED, p) for kind in range(model.number_of("kinds", p))])
    if (np.diff(model.classes(measured * factor, p)) < 0).any():
        raise CodeError(
            f"sensor '{model.name}': the reading falls as the value grows; see the protocol of sensors"
        )
    return measured


def likelihood_at(model: SensorModel, contrast: float, value: Values, p: BaseModel) -> Values:
    """Return the likelihood that robots claim of values at a contrast between the kinds 0 and 1.

    It is what the sensor states (``likelihood_at``); else it follows from the claimed quantiles of both kinds, in steps
    between those of ``_contrast_u``, and is 0 beyond them.

    Args:
        model: a sensor of strengths (``SensorModel.scales``), of one number.
    Returns: in the shape of ``value``.
    """
    if model.likelihood_at is not None:
        return model.densities_at(contrast, value, p)
    still, vibrating = (_claimed_quantiles(model, kind, p) for kind in (0, 1))
    quantile = mixed(still, vibrating, contrast)
    middle = 0.5 * (quantile[1:] + quantile[:-1])
    density = np.diff(_contrast_u()) / np.maximum(np.diff(quantile), 1e-9)
    return np.asarray(np.interp(value, middle, density, left=0.0, right=0.0))


@cache
def _contrast_u() -> Values:
    """Return the numbers u of the quantiles of which laws at contrasts are made; denser at the ends of (0, 1)."""
    from scipy.special import ndtr  # its import takes long

    return np.asarray(ndtr(np.linspace(-4.5, 4.5, 4000)[np.linspace(0, 3999, 200).round().astype(np.int64)]))


@lru_cache(maxsize=64)
def _claimed_quantiles(model: SensorModel, kind: int, p: BaseModel) -> Values:
    """Return the quantiles of the law that robots claim on a kind of tile at ``_contrast_u``."""
    u = _contrast_u()
    if model.likelihood is None or model.measure is None or model.claims_truth:
        return model.values(kind, u, p).astype(np.float32).astype(np.float64)  # as in tables
    measured = np.concatenate([model.values(kind, TRIED, p) for kind in (0, 1)])
    low, high = measured.min(), measured.max()
    for _ in range(DOUBLINGS):  # until the range holds the law
        at = np.linspace(low, high, GRID)
        density = _density(model, kind, at, p)
        share = np.append(0.0, np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(at)))
        if share[-1] >= 1.0 - CLAIMED_AS_TRUE:
            break
        low, high = low - (high - low), high + (high - low)
    return np.interp(u, share / share[-1], at)
