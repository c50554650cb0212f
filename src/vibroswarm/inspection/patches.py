"""Evidence for patches: squares and rectangles of declared sizes, at all places, not bound to any grid.

| name | symbol | equation |
|---|---|---|
| declared set | j | sizes, ``step_of`` a size apart |
| share of a sample's place in patch j | q_j | normal in x and y; edges add blur and reach |
| likelihood of patch j over that of an intact surface | L_j | product over samples of 1 + (r - 1) q_j |
| prior weight of patch j | w_j | sizes alike, places of a size alike |
| damage against none | Lambda | sum of w_j L_j; pi is the prior probability of damage |
| probability of a cell | - | pi sum of w_j L_j k_j / (1 - pi + pi Lambda): one patch at most |
| share of patch j that covers a cell | k_j | j lies uniformly within ``AROUND`` steps of its place, along x and y |

Damage lies between the declared places and sizes. A map on which each patch lay just at its place was too sure of cells
at its edge: where it said more than 95 %, 86 % were damaged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.core.jit import kernel
from vibroswarm.errors import InputError
from vibroswarm.inspection.samples import Floats, Samples

SIZES_M: Final = (0.07, 0.10, 0.14, 0.20, 0.28)
"""Sides of the squares of the declared set by default."""
FINEST_M: Final = 0.025
"""Least distance between places of the declared set, except of patches that are narrower."""
LEAST_SHARE: Final = 1e-3
"""Smaller shares count as none."""
AT_ONCE: Final = 32
"""Replicates that a kernel takes side by side."""
FACTORS: Final = 32
"""Factors of a product before its logarithm is taken: each is at most e^8, so that their product is finite."""
AROUND: Final = 0.75
"""Steps: damage is within half a step of a declared place, and its edges differ by as much again between sizes."""
MOST: Final = 300_000
"""Most patches of a declared set: those of squares of 7 to 28 cm on 65 m2."""

Sides = tuple[float, float]


class Box(NamedTuple):
    """A patch."""

    left_m: float
    bottom_m: float
    width_m: float
    height_m: float

    @property
    def centre_m(self) -> tuple[float, float]:
        """Its centre, x and y."""
        return self.left_m + 0.5 * self.width_m, self.bottom_m + 0.5 * self.height_m


def step_of(sides_m: Sides) -> float:
    """Return the distance between places of a size: no more than its width, so that nothing lies between them."""
    narrow_m = min(sides_m)
    return max(narrow_m / 4.0, min(narrow_m, FINEST_M))


@dataclass(frozen=True, repr=False)
class Patches:
    """The declared set, size by size: all pairs of the places of left and of lower edges, x fastest."""

    sides_m: tuple[Sides, ...]
    """Width and height of each size."""
    left_m: tuple[Floats, ...]
    bottom_m: tuple[Floats, ...]

    @property
    def places(self) -> NDArray[np.int64]:
        """Number of the places of each size, (sizes,)."""
        return np.array([x.size * y.size for x, y in zip(self.left_m, self.bottom_m, strict=True)])

    @property
    def form(self) -> NDArray[np.int64]:
        """Which size each patch has, (patches,)."""
        return np.repeat(np.arange(len(self.sides_m)), self.places)

    @property
    def weights(self) -> Floats:
        """Prior weights w_j, whose sum is 1."""
        return np.asarray(1.0 / self.places[self.form] / len(self.sides_m))

    @property
    def boxes(self) -> Floats:
        """Left, bottom, width and height of each patch, (patches, 4)."""
        rows = [
            np.column_stack([np.tile(x, y.size), np.repeat(y, x.size), np.tile(sides, (x.size * y.size, 1))])
            for sides, x, y in zip(self.sides_m, self.left_m, self.bottom_m, strict=True)
        ]
        return np.concatenate(rows)


def declared(size_m: tuple[float, float], sides_m: Sequence[float | Sides] = SIZES_M) -> Patches:
    """Return the declared set on a surface."""
    sides = tuple(dict.fromkeys(one if isinstance(one, tuple) else (one, one) for one in sides_m))
    if any(not 0.0 < side <= whole for each in sides for side, whole in zip(each, size_m, strict=True)):
        raise InputError(f"are not all within {size_m[0]:g} m x {size_m[1]:g} m", field="--sizes")
    at_m = [
        [
            np.linspace(0.0, whole - side, math.ceil((whole - side) / step_of(each)) + 1)
            for side, whole in zip(each, size_m, strict=True)
        ]
        for each in sides
    ]
    if (total := sum(x.size * y.size for x, y in at_m)) > MOST:
        raise InputError(
            f"damage has {total:,} places on {size_m[0]:g} m x {size_m[1]:g} m, more than {MOST:,}; is it in m?",
            field="--size",
        )
    return Patches(sides, tuple(x for x, _ in at_m), tuple(y for _, y in at_m))


class Shares(NamedTuple):
    """Shares of samples' places in patches, patch by patch."""

    first: NDArray[np.int64]
    """(patches + 1,): where the entries of each patch begin."""
    sample: NDArray[np.int32]
    """Index of the sample of each entry, ascending within a patch."""
    share: NDArray[np.float32]
    """q_j of each entry."""


def shares_of(samples: Samples, patches: Patches, coarse: float = 0.0) -> Shares:
    """Return the shares of the samples' places in the patches."""
    sensor = samples.law.sensor
    reach_m, blur_m = sensor.edge_reach_m or 0.0, sensor.edge_blur_m or 0.0

    def along(axis: str, low_m: Floats, side_m: float, least_m: float) -> Floats:
        spread_m = np.hypot(np.maximum(samples.column(f"spread_{axis}_m"), least_m), blur_m) + 1e-10
        ends = np.array([low_m - reach_m, low_m + side_m + reach_m])[..., None]
        below = ndtr((ends - samples.column(f"{axis}_m")) / spread_m)
        return np.asarray(below[1] - below[0])

    parts = []
    for sides, left_m, bottom_m in zip(patches.sides_m, patches.left_m, patches.bottom_m, strict=True):
        least_m = coarse * step_of(sides)
        qx, qy = along("x", left_m, sides[0], least_m), along("y", bottom_m, sides[1], least_m)
        # Only samples with a share along x can have one in the patch, and these are few.
        interval, candidate = np.nonzero(qx > LEAST_SHARE)
        begin = np.searchsorted(interval, np.arange(left_m.size + 1))
        number = np.empty(left_m.size * bottom_m.size, np.int64)
        most = candidate.size * bottom_m.size + 1
        sample, share = np.empty(most, np.int32), np.empty(most, np.float32)
        used = _fill(qx, qy, begin, candidate, number, sample, share)
        parts.append((number, sample[:used], share[:used]))
    numbers, entries, shares = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Shares(np.append(0, np.cumsum(numbers)), entries, shares)


@kernel
def _fill(qx: Floats, qy: Floats, begin: NDArray[np.int64], candidate: NDArray[np.int64], number: NDArray[np.int64],
          sample: NDArray[np.int32], share: NDArray[np.float32]) -> int:  # fmt: skip
    k, across = 0, qx.shape[0]
    for j in range(number.size):
        before, x, y = k, j % across, j // across
        for i in range(begin[x], begin[x + 1]):
            s = candidate[i]
            q = qx[x, s] * qy[y, s]
            sample[k], share[k] = s, q  # replaced by the next entry, if it is too small
            k += q > LEAST_SHARE
        number[j] = k - before
    return k


@kernel
def _log_likelihoods(first: NDArray[np.int64], sample: NDArray[np.int32], share: NDArray[np.float32],
                     more: NDArray[np.float32], work: Floats, out: Floats) -> None:  # fmt: skip
    product, total = work[0], work[1]
    replicates = more.shape[1]
    for j in range(first.size - 1):
        product[:] = 1.0
        total[:] = 0.0
        for k in range(first[j], first[j + 1]):
            row, q = more[sample[k]], share[k]
            for b in range(replicates):
                product[b] *= 1.0 + q * row[b]
            if (k + 1 - first[j]) % FACTORS == 0:
                for b in range(replicates):
                    total[b] += np.log(product[b])
                    product[b] = 1.0
        for b in range(replicates):
            out[j, b] = total[b] + np.log(product[b])


def log_likelihoods(shares: Shares, log_ratio: Floats) -> Floats:
    """Return ln L_j of each patch and replicate, (patches, replicates)."""
    out = np.empty((shares.first.size - 1, log_ratio.shape[1]))
    for begin in range(0, log_ratio.shape[1], AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        more = np.ascontiguousarray(np.expm1(log_ratio[:, part]), dtype=np.float32)
        some = np.empty((out.shape[0], more.shape[1]))
        _log_likelihoods(*shares, more, np.empty((2, AT_ONCE)), some)
        out[:, part] = some
    return out


def scan_statistic(patches: Patches, logs: Floats) -> Floats:
    """Return T of each replicate: the largest ln L_j - ln(number of places of that size), (replicates,)."""
    return np.asarray((logs - np.log(patches.places[patches.form])[:, None]).max(axis=0))


def raster(patches: Patches, logs: Floats, prior: float, cells: int, size_m: tuple[float, float]) -> Floats:
    """Return the probability that each cell of a raster is damaged, (cells, cells), top row first."""
    posterior = patches.weights * np.exp(np.minimum(logs, 600.0))
    posterior *= prior / (1.0 - prior + prior * posterior.sum())
    total = np.zeros((cells, cells))
    for k, (sides, x, y) in enumerate(zip(patches.sides_m, patches.left_m, patches.bottom_m, strict=True)):
        around_m = AROUND * step_of(sides)
        up = _covered(y, sides[1], around_m, size_m[1], cells)
        across = _covered(x, sides[0], around_m, size_m[0], cells)
        total += up.T @ posterior[patches.form == k].reshape(y.size, x.size) @ across
    return np.asarray(np.clip(total, 0.0, 1.0)[::-1])


def _covered(at_m: Floats, side_m: float, around_m: float, whole_m: float, cells: int) -> Floats:
    """Return the probability that patches at these places cover the centre of each cell, (places, cells)."""
    before, behind = np.minimum(around_m, [at_m, whole_m - side_m - at_m])[..., None]  # within the surface
    centre, wide = (np.arange(cells) + 0.5) * whole_m / cells, np.maximum(before + behind, 1e-9)
    begun, ended = (
        np.clip((centre - edge[:, None] + before) / wide, 0.0, 1.0) for edge in (at_m, at_m + side_m)
    )
    return np.asarray(begun - ended)
