"""Is there damage, and where? Answers from the declared set of patches (``patches``).

| name | symbol | equation |
|---|---|---|
| scan statistic | T | max over j of ln L_j - ln(number of places of that size) |
| p-value | p | (1 + number of T* >= T) / (B + 1), T* of B intact surfaces drawn at this inspection's own places |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.surfaces import Patch
from vibroswarm.inspection.damage import drawn_parts, judged, ratios_at
from vibroswarm.inspection.patches import Box, Patches, Shares, log_likelihoods, raster, scan_statistic
from vibroswarm.inspection.region import Region, region_of
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.statistics.intervals import generator

REPLICATES: Final = 999
"""Intact surfaces drawn for a p-value."""
CELLS: Final = 40
"""Cells along each side of the raster."""
MOST_CALLED: Final = 20
"""Most patches that are called."""
CLEAR_M: Final = 0.05
"""Samples this near to a called patch, beyond the spread of their places, may be on it."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Whether there is damage, and where."""

    statistic: float
    p_value: float
    critical: float
    """The least T whose p-value is at most the wanted share of false calls."""
    replicates: int
    called_m: tuple[Box, ...]
    """Patches that are called, the most likely first: each is scanned for without the samples on those before it."""
    regions: tuple[Region, ...]
    """Credible region of each of these."""
    raster: Floats
    """Probability that each cell is damaged, (CELLS, CELLS), top row first."""


def scan(
    samples: Samples, patches: Patches, shares: Shares, *, prior: float = 0.5, level: float = 0.05,
    replicates: int = REPLICATES, seed: int = 1,
) -> Scan:  # fmt: skip
    """Scan a surface for patches of damage."""
    if replicates < (least := math.ceil(1.0 / level - 1e-9) - 1):
        raise InputError(f"are too few for a p-value of {level:.3g}: at least {least}", field="--replicates")
    logs = log_likelihoods(shares, samples.column("log_ratio")[:, None])
    statistic = float(scan_statistic(patches, logs)[0])
    drawn = drawn_statistics(generator(seed, "intact surfaces"), samples, patches, shares, replicates)
    critical = critical_value(drawn, level)
    called, regions, steps = _called(samples, patches, shares, critical)
    sound = [1.0 - raster(patches, one, prior, CELLS, samples.size_m) for one in steps]
    damaged = 1.0 - np.prod(sound, axis=0)
    return Scan(statistic, p_value(statistic, drawn), critical, replicates, called, regions, damaged)


def _called(
    samples: Samples, patches: Patches, shares: Shares, critical: float
) -> tuple[tuple[Box, ...], tuple[Region, ...], Sequence[Floats]]:
    there = np.ones(samples.frame.height, dtype=bool)
    penalty, boxes = np.log(patches.places)[patches.form], patches.boxes
    called: list[Box] = []
    regions: list[Region] = []
    steps: list[Floats] = []
    while True:
        rest = np.where(there, samples.column("log_ratio"), 0.0)
        logs = log_likelihoods(shares, rest[:, None])[:, 0]
        steps.append(logs)
        at = int((logs - penalty).argmax())
        if logs[at] - penalty[at] < critical or len(called) == MOST_CALLED:
            return tuple(called), tuple(regions), steps
        called.append(Box(*boxes[at].tolist()))
        regions.append(region_of(samples, patches, there))
        there &= ~near(samples, called[-1])
        # Where no samples are left T is that of no evidence, which may be above the critical value.
        critical = max(critical, 0.0)


def near(samples: Samples, box: Box) -> NDArray[np.bool_]:
    """Return which samples may be on a patch: within ``CLEAR_M`` and 3 standard deviations of their place."""
    beyond = [
        np.abs(samples.column(f"{axis}_m") - centre) - 0.5 * side - 3.0 * samples.column(f"spread_{axis}_m")
        for axis, centre, side in zip("xy", box.centre_m, (box.width_m, box.height_m), strict=True)
    ]
    return np.asarray(np.maximum(*beyond) < CLEAR_M)


def p_value(statistic: float, drawn: Floats) -> float:
    """Return the p-value of a statistic against drawn ones."""
    return float((1 + (drawn >= statistic).sum()) / (drawn.size + 1))


def critical_value(drawn: Floats, level: float) -> float:
    """Return the least statistic whose ``p_value`` is at most a level; infinite if too few were drawn."""
    reached = math.floor(level * (drawn.size + 1) + 1e-9) - 1  # by so many at most
    return math.inf if reached < 0 else float(np.nextafter(np.sort(drawn)[drawn.size - 1 - reached], np.inf))


def drawn_statistics(
    random: np.random.Generator, samples: Samples, patches: Patches, shares: Shares, replicates: int,
    damage: Patch | None = None,
) -> Floats:  # fmt: skip
    """Return T of surfaces drawn at the samples' own places, (replicates,)."""
    parts = drawn_parts(random, samples, replicates, damage)
    return np.concatenate([statistic_of(samples, patches, shares, part) for part in parts])


def statistic_of(samples: Samples, patches: Patches, shares: Shares, values: Floats) -> Floats:
    """Return T of drawn surfaces, on which the samples would have measured ``values``, (samples, replicates)."""
    return scan_statistic(patches, log_likelihoods(shares, judged(samples.law, values, ratios_at)))
