"""A sensor that draws from measured energies, for one whose law is not known.

| name | symbol | unit | equation |
|---|---|---|---|
| energy | E | as measured | of n sorted energies of the tile's kind, the one with index floor(u n) |
| reading | O | 0, 1 | 1 if E > theta_E |
| likelihood | - | 1 / unit of E | share of a kind's energies in the bin of E (counts plus 0.5) over the bin's width |

Its parameters, ``vibrating_energies`` and ``still_energies``, are fields of the section ``sensor`` itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import numpy as np

from vibroswarm.errors import InputError
from vibroswarm.sensors.base import SensorModel, Values, register
from vibroswarm.sensors.gamma import above_threshold

BINS: Final = 16
"""Number of bins of the likelihood. Each holds the same number of energies, counting both kinds together."""


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


def likelihood(kind: int, value: Values, p: Any) -> Values:
    """Return the density of energies on a kind of tile, from a histogram; energies beyond it are in its outer bins."""
    edges, densities = _histogram_of(tuple(p.still_energies), tuple(p.vibrating_energies))
    return in_bins(edges, densities[kind], value)


def in_bins(edges: Values, densities: Values, value: Values) -> Values:
    """Return the density of each value by that of its bin (``histogram``)."""
    return densities[np.searchsorted(edges, value, side="right")]


@lru_cache(maxsize=2)
def _histogram_of(*measured: tuple[float, ...]) -> tuple[Values, list[Values]]:
    """Return the ``histogram`` of measured energies; cached, as every factor of tiles and robots needs it again."""
    return histogram([np.asarray(energies, dtype=np.float64) for energies in measured])


def histogram(
    measured: Sequence[Values], binned: Sequence[Values] | None = None
) -> tuple[Values, list[Values]]:
    """Return inner edges of bins, and the density of the values measured on each kind of tile in each bin.

    Values beyond the histogram are in its outer bins. Bins are the same for all kinds.

    Args:
        binned: values of which each bin has the same number; None: those that are measured.
    """
    together = np.concatenate(measured if binned is None else binned)
    # If many energies are equal, some quantiles coincide; each is used once, so there are fewer bins.
    edges = np.unique(np.quantile(together, np.arange(1, BINS) / BINS))
    ends = np.concatenate([[together.min()], edges, [together.max()]])
    widths = np.maximum(np.diff(ends), 1e-9)  # a bin of equal energies has no width
    bins = [np.searchsorted(edges, values, side="right") for values in measured]
    counts = [np.bincount(own, minlength=edges.size + 1) + 0.5 for own in bins]  # so that no share is 0
    return edges, [of_kind / of_kind.sum() / widths for of_kind in counts]


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
        likelihood=likelihood,
        check=check,
        in_section=True,
        scales=True,
        claims_truth=True,
        about="energies are drawn from measured ones (--energies FILE)",
    )
)
