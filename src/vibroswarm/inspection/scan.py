"""Is there damage, where, how large and how strong? Answers from the declared set of patches (``patches``).

| name | symbol | equation |
|---|---|---|
| scan statistic | T | max over j of ln L_j - ln(number of places of that size) |
| p-value | p | (1 + number of T* >= T) / (B + 1), T* of B intact surfaces drawn at this inspection's own places |
| probability of patch j at contrast c | p_jc | w_j L_jc^(1/d) over its sum; all contrasts have the same weight |
| design effect | d | 1 + sum over tiles and robots of rho (m - 1) (Kish 1965) |
| samples that share a tile or robot | m | sum over these of (sum of q)^2, over sum of q, on the likeliest patch |
| share of the variance | rho | that of tiles or robots in the variance of the logarithm of a vibrating value |
| region | - | intervals around the likeliest p_jc, per area of places, that together have ``HELD`` |

L_jc takes samples as independent. Where tiles and robots differ, the power 1 / d gives it the width that it would have
with fewer, independent samples. Places of samples count as at least as uncertain as declared ones are apart: damage
lies between them. One patch is presumed: each called patch has a region, by the samples that are not on those before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.surfaces import Patch
from vibroswarm.inspection.damage import drawn_parts, judged, quantiles_of, ratios_at, tiles_below
from vibroswarm.inspection.patches import (
    AROUND,
    Box,
    Patches,
    Shares,
    log_likelihoods,
    raster,
    scan_statistic,
    shares_of,
    step_of,
)
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.statistics.intervals import generator

HELD: Final = 0.9
"""Probability of the region."""
STRENGTHS: Final = (0.25, 0.5, 0.75, 1.0)
"""Contrasts that are weighed; readings of few values have contrast 1 alone."""

Ends = tuple[float, float]


class Region(NamedTuple):
    """The credible region of a called patch: ends of its centre, its longer side and its contrast."""

    x_m: Ends
    y_m: Ends
    side_m: Ends
    contrast: Ends

    def holds(self, x_m: float, y_m: float, side_m: float, contrast: float) -> bool:
        """Return whether damage with its centre there is in the region."""
        return all(
            low <= at <= high for at, (low, high) in zip((x_m, y_m, side_m, contrast), self, strict=True)
        )


def region_of(samples: Samples, patches: Patches, there: NDArray[np.bool_]) -> Region:
    """Return the credible region of one patch, by the samples that are ``there``."""
    strengths = np.array(STRENGTHS if samples.law.has_contrasts else (1.0,))
    shares, value = shares_of(samples, patches, AROUND / math.sqrt(3.0)), samples.column("value")
    ratios = [np.where(there, ratios_at(samples.law, value, c), 0.0) for c in strengths.tolist()]
    logs = log_likelihoods(shares, np.stack(ratios, axis=1))
    effect = _design_effect(samples, shares, int(logs.max(axis=1).argmax()))
    p = patches.weights[:, None] * np.exp((logs - logs.max()) / effect)
    step_m = np.array([step_of(sides) for sides in patches.sides_m])[patches.form]
    order = np.argsort(-(p / step_m[:, None] ** 2), axis=None)
    held = order[: int(np.searchsorted(np.cumsum(p.ravel()[order]), HELD * p.sum())) + 1]
    patch, strength = np.unravel_index(held, p.shape)
    box, near_m = patches.boxes[patch], AROUND * step_m[patch]
    x_m, y_m, side_m = box[:, 0] + 0.5 * box[:, 2], box[:, 1] + 0.5 * box[:, 3], box[:, 2:].max(axis=1)
    sizes_m = np.unique([max(sides) for sides in patches.sides_m])
    between = math.sqrt(float((sizes_m[1:] / sizes_m[:-1]).max(initial=1.5)))
    apart = 0.5 * float(np.diff(strengths).max(initial=0.0))
    low, high = strengths[strength].min() - apart, min(strengths[strength].max() + apart, 1.0)
    return Region(
        (float((x_m - near_m).min()), float((x_m + near_m).max())),
        (float((y_m - near_m).min()), float((y_m + near_m).max())),
        (float(side_m.min() / between), float(side_m.max() * between)),
        (float(low), float(high)),
    )


def _design_effect(samples: Samples, shares: Shares, patch: int) -> float:
    """Return by how much factors that samples share raise the variance of their mean log value on a patch."""
    sensor, entries = samples.law.sensor, slice(*shares.first[patch : patch + 2].tolist())
    sample, share = shares.sample[entries], shares.share[entries]
    values: Floats = np.abs(quantiles_of(samples.law)[1].astype(np.float64))
    alone = float(np.var(np.log(np.maximum(values, max(1e-3 * float(values.mean()), 1e-300)))))
    of_tile, of_robot = ((spread or 0.0) ** 2 for spread in (sensor.tile_spread, sensor.robot_spread))
    robot, effect = samples.frame["robot"].to_numpy().astype(np.int64), 1.0
    for group, shared in ((tiles_below(samples), of_tile), (robot, of_robot)):
        if shared and share.size:
            together = float((np.bincount(group[sample], share) ** 2).sum() / share.sum())
            effect += shared / (alone + of_tile + of_robot) * max(together - 1.0, 0.0)
    return effect


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
