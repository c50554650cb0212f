"""Is there damage, where, and how large? Answers from the declared set of patches (``patches``).

| name | symbol | equation |
|---|---|---|
| scan statistic | T | max over j of ln L_j - ln(number of places of that size) |
| p-value | p | (1 + number of T* >= T) / (B + 1), T* of B intact surfaces drawn at this inspection's own places |
| permuted p-value | - | the same with values exchanged within robots and blocks of ``BLOCK_S`` |

Intact surfaces have the differences between robots and tiles that the law states; exchanged values have no differences
between tiles, so that the permuted p-value is too small where tiles differ. With several looks T is the largest over
looks, of the surface as of the intact ones, so that false calls are as stated however often is looked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.errors import InputError
from vibroswarm.floors.surfaces import Patch
from vibroswarm.inspection.damage import drawn_parts, judged, ratios_at
from vibroswarm.inspection.patches import (
    AT_ONCE,
    Form,
    Patches,
    Shares,
    declared,
    log_likelihoods,
    logs_at_looks,
    raster,
    scan_statistic,
)
from vibroswarm.inspection.region import Region, between, coarse_shares, posterior_of, region_of
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.statistics.intervals import generator

REPLICATES: Final = 999
"""Intact surfaces drawn for a p-value."""
CELLS: Final = 40
"""Cells along each side of the raster."""
BLOCK_S: Final = 120.0
"""Blocks of time within which values are exchanged."""
MOST_CALLED: Final = 20
"""Most patches that are called."""
EVIDENCE: Final = 0.0
"""Least T of a patch that is called after another, or by a part of the samples.

Where no samples are, or none are left, T is that of no evidence, which may be above the critical value of all samples.
"""
CLEAR_M: Final = 0.05
"""Samples this near to a called patch, beyond the spread of their places, may be on it."""


class Box(NamedTuple):
    """A patch."""

    left_m: float
    bottom_m: float
    width_m: float
    height_m: float
    is_disc: bool = False

    @property
    def centre_m(self) -> tuple[float, float]:
        """Its centre, x and y."""
        return self.left_m + 0.5 * self.width_m, self.bottom_m + 0.5 * self.height_m


def box_of(patches: Patches, number: int) -> Box:
    """Return one patch of a declared set."""
    form = patches.forms[patches.form[number]]
    return Box(float(patches.left_m[number]), float(patches.bottom_m[number]), *form)


@dataclass(frozen=True, eq=False)
class Scan:
    """Whether there is damage, and where."""

    statistic: float
    p_value: float
    permuted_p_value: float
    critical: float
    """The least T whose p-value is at most ``level`` (``critical_value``)."""
    replicates: int
    level: float
    """Wanted share of false calls: a surface is called damaged if the p-value is at most this."""
    called_m: tuple[Box, ...]
    """Patches that are called, the most likely first: each is scanned for without the samples on those before it."""
    regions: tuple[Region, ...]
    """Joint credible region of each of these: its place, size and contrast."""
    forms: tuple[Form, ...]
    """The declared sizes and shapes."""
    raster: Floats
    """Probability that each cell is damaged, (CELLS, CELLS), top row first."""
    looks: int = 1
    """Times at which is looked, evenly spaced; T is the largest over them."""
    called_s: float | None = None
    """First look at which T reaches the critical value; None: it does not."""


def scan(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    *,
    prior: float = 0.5,
    level: float = 0.05,
    replicates: int = REPLICATES,
    seed: int = 1,
    looks: int = 1,
) -> Scan:
    """Scan a surface for one patch of damage.

    Args:
        shares: of the samples in the patches. prior: probability of damage. level: wanted share of false calls.
        replicates: intact surfaces, B. seed: of what is drawn. looks: how often is looked.
    Raises:
        InputError: too few replicates, with which no p-value is as small as ``level``, or too many places of damage.
    """
    least = math.ceil(1.0 / level - 1e-9) - 1
    if replicates < least:
        raise InputError(
            f"{replicates} intact surfaces cannot give a p-value of {100 * level:g} %; at least {least}",
            field="--replicates",
        )
    weighed = declared(samples.size_m, between(patches.forms))
    observed = samples.column("log_ratio")
    times_s, look = looks_of(samples, looks)
    each = _statistics(patches, shares, observed[:, None], look, looks)[:, 0]
    statistic = float(each.max())
    drawn = intact_statistics(samples, patches, shares, replicates, seed, looks=looks)
    exchanged = [
        _statistics(patches, shares, part, look, looks).max(axis=0)
        for part in _permuted(samples, observed, replicates, seed)
    ]
    critical = critical_value(drawn, level)
    reached = np.flatnonzero(each >= critical)
    # By the samples of the look with the largest T, which is the last one unless there are several.
    there = look <= each.argmax()
    called, steps = called_patches(samples, patches, shares, critical, there)
    return Scan(
        statistic,
        p_value(statistic, drawn),
        p_value(statistic, np.concatenate(exchanged)),
        critical,
        replicates,
        level,
        called,
        tuple(_regions(samples, weighed, called, there)),
        patches.forms,
        joined(patches, steps, prior, samples.size_m),
        looks,
        float(times_s[reached[0]]) if reached.size else None,
    )


def looks_of(samples: Samples, looks: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the times of evenly spaced looks, (looks,), and from which look on each sample counts, (samples,)."""
    time_s = samples.column("time_s")
    times_s = np.linspace(samples.began_s, float(time_s.max()), looks + 1)[1:]
    return times_s, np.searchsorted(times_s, time_s)


def _statistics(
    patches: Patches, shares: Shares, ratios: Floats, look: NDArray[np.int64], looks: int
) -> Floats:
    """Return T of each replicate at each look, (looks, replicates).

    Args:
        ratios: log ratios, (samples, replicates). look: from which look on each sample counts, (samples,).
    """
    return np.array([scan_statistic(patches, logs) for logs in logs_at_looks(shares, ratios, look, looks)])


def called_patches(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    critical: float,
    there: NDArray[np.bool_],
) -> tuple[tuple[Box, ...], list[Floats]]:
    """Return the patches that are called by the samples that are ``there``, and ln L_j of each step, (patches,).

    A patch is scanned for without the samples on those before it.

    Args:
        critical: least T of the first patch; that of later ones is at least ``EVIDENCE``.
    """
    rest = np.where(there, samples.column("log_ratio"), 0.0)
    penalty = np.log(patches.places)[patches.form]
    called: list[Box] = []
    steps: list[Floats] = []
    while True:
        logs = log_likelihoods(shares, rest[:, None])[:, 0]
        steps.append(logs)
        at = int((logs - penalty).argmax())
        if logs[at] - penalty[at] < critical or len(called) == MOST_CALLED:
            return tuple(called), steps
        called.append(box_of(patches, at))
        rest[near(samples, called[-1])] = 0.0
        critical = max(critical, EVIDENCE)


def joined(patches: Patches, steps: Sequence[Floats], prior: float, size_m: tuple[float, float]) -> Floats:
    """Return the raster of all steps of ``called_patches``, of which each presumes one patch at most."""
    sound = np.ones((CELLS, CELLS))
    for logs in steps:
        sound *= 1.0 - raster(patches, logs, prior, CELLS, size_m)
    return 1.0 - sound


def critical_by(there: NDArray[np.bool_], critical: float) -> float:
    """Return the least T that is called by the samples that are ``there``, from the critical value of all samples."""
    return critical if there.all() else max(critical, EVIDENCE)


def rasters(
    samples: Samples, patches: Patches, shares: Shares, critical: float, prior: float, times_s: Floats
) -> tuple[Floats, dict[int, Floats]]:
    """Return the probability of each cell by each time, (times, CELLS, CELLS), and by each robot's own samples.

    Args:
        critical: T from which a patch is called by all samples. prior: probability of damage.
    """
    robot, time_s = samples.frame["robot"].to_numpy(), samples.column("time_s")

    def of(there: NDArray[np.bool_]) -> Floats:
        _, steps = called_patches(samples, patches, shares, critical_by(there, critical), there)
        return joined(patches, steps, prior, samples.size_m)

    own = {one: of(robot == one) for one in samples.robots if len(samples.robots) > 1}
    return np.stack([of(time_s <= until_s) for until_s in times_s]), own


def _regions(
    samples: Samples, patches: Patches, called: Sequence[Box], there: NDArray[np.bool_]
) -> Iterator[Region]:
    """Yield the region of each called patch, by the samples that are not on those before it."""
    if not called:
        return
    shares = coarse_shares(samples, patches)
    for box in called:
        yield region_of(posterior_of(samples, patches, shares, there))
        there = there & ~near(samples, box)


def within(
    box: Box, x_m: Floats, y_m: Floats, margin_x_m: Floats | float, margin_y_m: Floats | float
) -> NDArray[np.bool_]:
    """Return which places are on a patch, or within margins of it; margins may be one for each place."""
    across_m, up_m = np.abs(x_m - box.centre_m[0]), np.abs(y_m - box.centre_m[1])
    return np.asarray((across_m < 0.5 * box.width_m + margin_x_m) & (up_m < 0.5 * box.height_m + margin_y_m))


def near(samples: Samples, box: Box) -> NDArray[np.bool_]:
    """Return which samples may be on a patch: within ``CLEAR_M`` and 3 standard deviations of their place."""
    margins_m = (CLEAR_M + 3.0 * samples.column(f"spread_{axis}_m") for axis in "xy")
    return within(box, samples.column("x_m"), samples.column("y_m"), *margins_m)


def p_value(statistic: float, drawn: Floats) -> float:
    """Return the p-value of a statistic against drawn ones."""
    return float((1 + (drawn >= statistic).sum()) / (drawn.size + 1))


def critical_value(drawn: Floats, level: float) -> float:
    """Return the least statistic whose ``p_value`` is at most a level: above drawn ones that are equal to each other.

    It is infinite with fewer than 1 / level - 1 drawn statistics, which give no p-value as small as that.
    """
    reached = math.floor(level * (drawn.size + 1) + 1e-9) - 1  # by so many at most
    return math.inf if reached < 0 else float(np.nextafter(np.sort(drawn)[drawn.size - 1 - reached], np.inf))


def intact_statistics(
    samples: Samples, patches: Patches, shares: Shares, replicates: int, seed: int, *, looks: int = 1
) -> Floats:
    """Return T of intact surfaces drawn at the samples' own places, (replicates,)."""
    random = generator(seed, "intact surfaces")
    return drawn_statistics(random, samples, patches, shares, replicates, looks=looks)


def drawn_statistics(
    random: np.random.Generator, samples: Samples, patches: Patches, shares: Shares, replicates: int,
    damage: Patch | None = None, *, looks: int = 1,
) -> Floats:  # fmt: skip
    """Return T of surfaces drawn at the samples' own places, (replicates,).

    Args:
        damage: of each replicate; None: they are intact.
    """
    parts = drawn_parts(random, samples, replicates, damage)
    return np.concatenate([statistic_of(samples, patches, shares, part, looks=looks) for part in parts])


def statistic_of(
    samples: Samples, patches: Patches, shares: Shares, values: Floats, *, looks: int = 1
) -> Floats:
    """Return T of drawn surfaces, on which the samples would have measured ``values``, (samples, replicates)."""
    ratios, (_, look) = judged(samples.law, values, ratios_at), looks_of(samples, looks)
    return np.asarray(_statistics(patches, shares, ratios, look, looks).max(axis=0))


def _permuted(samples: Samples, observed: Floats, replicates: int, seed: int) -> Iterator[Floats]:
    """Yield the log ratios exchanged within robots and blocks of time, (samples, ``AT_ONCE`` or fewer)."""
    random = generator(seed, "exchanged values")
    block = (samples.column("time_s") // BLOCK_S).astype(np.int64) * 100_000 + samples.frame[
        "robot"
    ].to_numpy()
    # Sorted by block, and within it by a random number: one exchange within each block. Small numbers of blocks are
    # sorted much faster.
    block = np.unique(block, return_inverse=True)[1]
    block = block.astype(np.min_scalar_type(block.max()))
    order = np.argsort(block, kind="stable")
    for begin in range(0, replicates, AT_ONCE):
        out = np.empty((observed.size, min(AT_ONCE, replicates - begin)), order="F")
        for column in out.T:
            drawn = np.argsort(random.random(observed.size))
            column[order] = observed[drawn[np.argsort(block[drawn], kind="stable")]]
        yield out
