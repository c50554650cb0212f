"""Evidence for patches: rectangles of declared sizes, at all places, not bound to any grid.

| name | symbol | equation |
|---|---|---|
| declared set | j | squares (or cracks, length x width), a quarter of a side apart, at least ``FINEST_M`` |
| share of a sample's place in patch j | q_j | normal in x and y; edges add blur to spread, reach to the patch |
| likelihood of patch j over that of an intact surface | L_j | product over samples of 1 + (r - 1) q_j |
| prior weight of patch j | w_j | sizes alike, places of a size alike |
| damage against none | Lambda | sum of w_j L_j; pi is the prior probability of damage |
| probability of a cell | - | pi sum of w_j L_j over patches that contain it / (1 - pi + pi Lambda): one patch at most |
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.core.displayed import html_view
from vibroswarm.core.jit import kernel
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.inspection.samples import Floats, Samples

SIZES_M: Final = (0.07, 0.10, 0.14, 0.20, 0.28)
"""Sides of the squares of the declared set by default."""
FINEST_M: Final = 0.025
"""Least distance between places of the declared set."""
LEAST_SHARE: Final = 1e-3
"""Smaller shares count as none."""
AT_ONCE: Final = 32
"""Replicates that a kernel takes side by side."""
LARGEST: Final = 1e300
"""Limit of likelihoods over those of an intact surface."""
FACTORS: Final = 32
"""Factors of a product before its logarithm is taken: each is at most e^8, so that their product is finite."""


@dataclass(frozen=True, repr=False)
class Patches(NotebookView):
    """The declared set; (patches,) each."""

    left_m: Floats
    bottom_m: Floats
    width_m: Floats
    height_m: Floats
    size: NDArray[np.int64]
    """Index of the size in ``sides_m``."""
    sides_m: tuple[tuple[float, float], ...]
    """Width and height of each size."""

    @property
    def weights(self) -> Floats:
        """Prior weights w_j, whose sum is 1."""
        number = np.bincount(self.size, minlength=len(self.sides_m))
        return np.asarray(1.0 / number[self.size] / len(self.sides_m))

    @property
    def step_m(self) -> Floats:
        """Distance to the next places of the same size, (patches,)."""
        return np.array([step_of(sides) for sides in self.sides_m])[self.size]

    def at_least(self, side_m: float) -> Patches:
        """Return the patches of which a side, the longer one, is at least ``side_m``."""
        sizes = [index for index, sides in enumerate(self.sides_m) if max(sides) >= side_m - 1e-9]
        kept = np.isin(self.size, sizes)
        left_m, bottom_m, width_m, height_m = (
            column[kept] for column in (self.left_m, self.bottom_m, self.width_m, self.height_m)
        )
        size = np.searchsorted(sizes, self.size[kept]).astype(np.int64)
        return Patches(
            left_m, bottom_m, width_m, height_m, size, tuple(self.sides_m[index] for index in sizes)
        )


def step_of(sides_m: tuple[float, float]) -> float:
    """Return the distance between places of patches of a size."""
    return max(min(sides_m) / 4.0, FINEST_M)


def declared(
    size_m: tuple[float, float], sides_m: Sequence[float | tuple[float, float]] = SIZES_M
) -> Patches:
    """Return the declared set on a surface.

    Args:
        size_m: width and height of the surface. sides_m: sides of squares, or width and height of rectangles.
    Raises:
        InputError: a patch is larger than the surface, or has no size.
    """
    pairs = tuple((float(side), float(side)) if isinstance(side, int | float) else side for side in sides_m)
    parts = []
    for index, sides in enumerate(pairs):
        if not all(0.0 < side <= whole for side, whole in zip(sides, size_m, strict=True)):
            raise InputError(
                f"a patch of {sides[0]:g} m x {sides[1]:g} m is not within the surface", field="--sizes"
            )
        step_m = step_of(sides)
        along = [
            np.linspace(0.0, whole - side, max(int(np.ceil((whole - side) / step_m)), 0) + 1)
            for side, whole in zip(sides, size_m, strict=True)
        ]
        x, y = (places.ravel() for places in np.meshgrid(*along))
        parts.append((x, y, np.full(x.size, sides[0]), np.full(x.size, sides[1]), np.full(x.size, index)))
    left, bottom, width, height, size = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Patches(left, bottom, width, height, size.astype(np.int64), pairs)


class Shares(NamedTuple):
    """Shares of samples' places in patches, patch by patch."""

    first: NDArray[np.int64]
    """(patches + 1,): where the entries of each patch begin."""
    sample: NDArray[np.int32]
    """Index of the sample of each entry, ascending within a patch."""
    share: NDArray[np.float32]
    """q_j of each entry."""

    def _repr_html_(self) -> str:
        return html_view(self)


def shares_of(samples: Samples, patches: Patches) -> Shares:
    """Return the shares of the samples' places in the patches."""
    (qx, of_x), (qy, of_y) = (
        _along(samples, axis, low_m, side_m)
        for axis, low_m, side_m in (
            ("x", patches.left_m, patches.width_m),
            ("y", patches.bottom_m, patches.height_m),
        )
    )
    count = np.empty(patches.left_m.size + 1, dtype=np.int64)
    _count(qx, of_x, qy, of_y, count)
    first = np.cumsum(count)
    # Only samples with a share along x can have one in the patch, and these are few.
    interval, candidate = np.nonzero(qx > LEAST_SHARE)
    begin = np.searchsorted(interval, np.arange(qx.shape[0] + 1))
    sample, share = np.empty(first[-1] + 1, dtype=np.int32), np.empty(first[-1] + 1, dtype=np.float32)
    _fill(qx, of_x, begin, candidate, qy, of_y, first, sample, share)
    return Shares(first, sample[:-1], share[:-1])


def _along(samples: Samples, axis: str, low_m: Floats, side_m: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return the shares of places along an axis in the patches' different intervals, and which is that of each patch.

    Exact places are inside or outside.

    Returns: (intervals, samples) and (patches,).
    """
    sensor = samples.law.sensor
    reach_m = np.array([[-1.0], [1.0]]) * (sensor.edge_reach_m or 0.0)
    intervals, which = np.unique(np.stack([low_m, low_m + side_m]), axis=1, return_inverse=True)
    edges_m, edge = np.unique(intervals + reach_m, return_inverse=True)  # intervals share many edges
    spread_m = np.maximum(np.hypot(samples.column(f"spread_{axis}_m"), sensor.edge_blur_m or 0.0), 1e-9)
    below = ndtr((edges_m[:, None] - samples.column(f"{axis}_m")) / spread_m)
    low, high = edge.reshape(intervals.shape)
    return np.asarray(below[high] - below[low]), which.astype(np.int64).ravel()


@kernel
def _count(
    qx: Floats, of_x: NDArray[np.int64], qy: Floats, of_y: NDArray[np.int64], count: NDArray[np.int64]
) -> None:
    """Write how many samples have a share in each patch to ``count[1:]``, and 0 to its first entry."""
    count[0] = 0
    for j in range(of_x.size):
        x, y, number = qx[of_x[j]], qy[of_y[j]], 0
        for s in range(x.size):
            number += x[s] * y[s] > LEAST_SHARE
        count[j + 1] = number


@kernel
def _fill(qx: Floats, of_x: NDArray[np.int64], begin: NDArray[np.int64], candidate: NDArray[np.int64], qy: Floats,
          of_y: NDArray[np.int64], first: NDArray[np.int64], sample: NDArray[np.int32],
          share: NDArray[np.float32]) -> None:  # fmt: skip
    """Write the entries of each patch.

    Args:
        begin, candidate: samples with a share in each interval along x, (intervals + 1,) and interval by interval.
        sample, share: with room for one entry more.
    """
    for j in range(of_x.size):
        x, y, k = qx[of_x[j]], qy[of_y[j]], first[j]
        for i in range(begin[of_x[j]], begin[of_x[j] + 1]):
            s = candidate[i]
            sample[k], share[k] = s, x[s] * y[s]  # replaced by the next entry, if it is too small
            k += x[s] * y[s] > LEAST_SHARE


@kernel
def _log_likelihoods(first: NDArray[np.int64], sample: NDArray[np.int32], share: NDArray[np.float32],
                     more: NDArray[np.float32], work: Floats, out: Floats) -> None:  # fmt: skip
    """Write ln L_j of each replicate to ``out``, (patches, replicates).

    Args:
        more: r - 1 of each sample and replicate, (samples, replicates), of ``AT_ONCE`` replicates or fewer.
        work: (2, ``AT_ONCE``), room.
    """
    product, total = work[0], work[1]
    replicates = more.shape[1]
    for j in range(first.size - 1):
        product[:] = 1.0
        total[:] = 0.0
        since = 0
        for k in range(first[j], first[j + 1]):
            row, q = more[sample[k]], share[k]
            for b in range(replicates):
                product[b] *= 1.0 + q * row[b]
            since += 1
            if since == FACTORS:
                for b in range(replicates):
                    total[b] += np.log(product[b])
                    product[b] = 1.0
                since = 0
        for b in range(replicates):
            out[j, b] = total[b] + np.log(product[b])


def log_likelihoods(shares: Shares, log_ratio: Floats) -> Floats:
    """Return ln L_j of each patch and replicate, (patches, replicates).

    Args:
        log_ratio: of each sample and replicate, (samples, replicates).
    """
    out = np.empty((shares.first.size - 1, log_ratio.shape[1]))
    for begin in range(0, log_ratio.shape[1], AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        more = np.ascontiguousarray(np.expm1(log_ratio[:, part]), dtype=np.float32)
        some = np.empty((out.shape[0], more.shape[1]))
        _log_likelihoods(*shares, more, np.empty((2, AT_ONCE)), some)
        out[:, part] = some
    return out


def logs_at_looks(shares: Shares, log_ratio: Floats, look: NDArray[np.int64], looks: int) -> Iterator[Floats]:
    """Yield ln L_j of each patch and replicate at each look, (patches, replicates): evidence is added look by look.

    Args:
        look: from which look on each sample counts, from 0, (samples,).
    """
    patch = np.repeat(np.arange(shares.first.size - 1), np.diff(shares.first))
    logs: Floats | float = 0.0
    for now in range(looks):
        new = look[shares.sample] == now
        first = np.append(0, np.cumsum(np.bincount(patch[new], minlength=shares.first.size - 1)))
        logs = logs + log_likelihoods(Shares(first, shares.sample[new], shares.share[new]), log_ratio)
        yield logs


@kernel
def _ratios_at_looks(first: NDArray[np.int64], sample: NDArray[np.int32], share: NDArray[np.float32],
                     more: NDArray[np.float32], look: NDArray[np.int64], size: NDArray[np.int64], weight: Floats,
                     largest: bool, product: Floats, out: Floats) -> None:  # fmt: skip
    """Add weight times L_j of each patch, at each look and replicate, to ``out``, (looks, sizes, replicates).

    Args:
        more: as for ``_log_likelihoods``. look: of each sample, ascending. size: of each patch. weight: of each patch.
        largest: write the largest L_j instead. product: (``AT_ONCE``,), room.
    """
    replicates = more.shape[1]
    for j in range(first.size - 1):
        product[:] = 1.0
        k = first[j]
        for now in range(out.shape[0]):
            while k < first[j + 1] and look[sample[k]] <= now:
                row, q = more[sample[k]], share[k]
                for b in range(replicates):
                    product[b] *= 1.0 + q * row[b]
                k += 1
            into = out[now, size[j]]
            if largest:
                for b in range(replicates):
                    into[b] = max(into[b], product[b])
            else:
                for b in range(replicates):
                    into[b] += weight[j] * product[b]


def ratios_at_looks(
    patches: Patches, shares: Shares, log_ratio: Floats, look: NDArray[np.int64], looks: int, *, strict: bool = False
) -> Floats:  # fmt: skip
    """Return the mean of L_j over the places of each size, at each look, (looks, sizes, replicates).

    Args:
        log_ratio: of each sample and replicate, (samples, replicates). look: from which look on each sample counts,
            from 0, ascending. strict: return the largest L_j in place of the mean.
    """
    out = np.zeros((looks, len(patches.sides_m), log_ratio.shape[1]))
    weight = patches.weights * len(patches.sides_m)
    for begin in range(0, log_ratio.shape[1], AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        more = np.ascontiguousarray(np.expm1(log_ratio[:, part]), dtype=np.float32)
        some = np.zeros((looks, out.shape[1], more.shape[1]))
        _ratios_at_looks(*shares, more, look, patches.size, weight, strict, np.empty(AT_ONCE), some)
        out[..., part] = np.minimum(some, LARGEST)
    return out


def told_risk(ratio: Floats, prior: float) -> Floats:
    """Return the probability of damage given the samples, from Lambda and the prior pi."""
    return np.asarray(prior * ratio / (1.0 - prior + prior * ratio))


def scan_statistic(patches: Patches, logs: Floats) -> Floats:
    """Return T of each replicate: the largest ln L_j - ln(number of places of that size), (replicates,)."""
    number = np.bincount(patches.size)[patches.size]
    return np.asarray((logs - np.log(number)[:, None]).max(axis=0))


def raster(patches: Patches, logs: Floats, prior: float, cells: int, size_m: tuple[float, float]) -> Floats:
    """Return the probability that each cell of a raster is damaged, (cells, cells), top row first.

    Args:
        logs: ln L_j, (patches,). prior: pi. cells: cells along each side of the surface. size_m: its width and height.
    """
    posterior = patches.weights * np.exp(np.minimum(logs, 600.0))
    posterior *= prior / (1.0 - prior + prior * posterior.sum())
    # Each patch adds to the cells whose centres it covers: a difference at its corners, summed up over both axes.
    steps = np.zeros((cells + 1, cells + 1))
    centres = [(np.arange(cells) + 0.5) * whole / cells for whole in size_m]
    x0, x1 = (
        np.searchsorted(centres[0], edge) for edge in (patches.left_m, patches.left_m + patches.width_m)
    )
    y0, y1 = (
        np.searchsorted(centres[1], edge) for edge in (patches.bottom_m, patches.bottom_m + patches.height_m)
    )
    for y, x, sign in ((y0, x0, 1.0), (y0, x1, -1.0), (y1, x0, -1.0), (y1, x1, 1.0)):
        np.add.at(steps, (y, x), sign * posterior)
    return np.asarray(np.clip(steps.cumsum(axis=0).cumsum(axis=1)[:cells, :cells][::-1], 0.0, 1.0))
