"""Evidence for patches: squares, rectangles and discs of declared sizes, at all places, not bound to any grid.

| name | symbol | equation |
|---|---|---|
| declared set | j | forms (squares, cracks, discs), ``Form.step_m`` apart |
| share of a sample's place in patch j | q_j | normal in x and y; edges add blur and reach; discs are strips |
| likelihood of patch j over that of an intact surface | L_j | product over samples of 1 + (r - 1) q_j |
| prior weight of patch j | w_j | forms alike, places of a form alike |
| damage against none | Lambda | sum of w_j L_j; pi is the prior probability of damage |
| probability of a cell | - | pi sum of w_j L_j k_j / (1 - pi + pi Lambda): one patch at most |
| share of patch j that covers a cell | k_j | j lies uniformly within ``AROUND`` steps of its place, along x and y |

Damage lies between the declared places and sizes. A map on which each patch lay just at its place was too sure of cells
at its edge: where it said more than 95 %, 86 % were damaged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from vibroswarm.core.jit import kernel
from vibroswarm.errors import InputError, check_kind, number_of, shown
from vibroswarm.inspection.samples import Floats, Samples

SIZES_M: Final = (0.07, 0.10, 0.14, 0.20, 0.28)
"""Sides of the squares of the declared set by default."""
FINEST_M: Final = 0.025
"""Least distance between places of the declared set, except of forms that are narrower."""
STRIPS: Final = 16
"""Strips that stand for a disc."""
LEAST_SHARE: Final = 1e-3
"""Smaller shares count as none."""
AT_ONCE: Final = 32
"""Replicates that a kernel takes side by side."""
LARGEST: Final = 1e300
"""Limit of likelihoods over those of an intact surface."""
SMALLEST: Final = 1e-300
"""Smaller ones count as 0: processors multiply numbers that are smaller still a hundred times slower."""
FACTORS: Final = 32
"""Factors of a product before its logarithm is taken: each is at most e^8, so that their product is finite."""


AROUND: Final = 0.75
"""Steps: damage is within half a step of a declared place, and its edges differ by as much again between sizes."""
DRAWN_AT_ONCE: Final = 1000
"""Strips that are drawn on a raster at once."""
MOST: Final = 300_000
"""Most patches of a declared set: those of squares of 7 to 28 cm on 65 m2."""


class Form(NamedTuple):
    """Size and shape of declared damage: a rectangle, or a disc, of which both sides are the diameter."""

    width_m: float
    height_m: float
    is_disc: bool = False

    @property
    def longest_m(self) -> float:
        """The longer side, or the diameter."""
        return max(self.width_m, self.height_m)

    @property
    def step_m(self) -> float:
        """Distance between its places in the declared set: no more than its width, so that none lies between them."""
        narrow_m = min(self.width_m, self.height_m)
        return max(narrow_m / 4.0, min(narrow_m, FINEST_M))

    def is_within(self, size_m: tuple[float, float]) -> bool:
        """Return whether it has a size, and fits a surface of that width and height."""
        return all(0.0 < side <= whole for side, whole in zip(self[:2], size_m, strict=True))


Side = float | tuple[float, float] | Form
"""Side of a square, width and height of a rectangle, or a form."""


@dataclass(frozen=True, repr=False)
class Patches:
    """The declared set; (patches,) each."""

    left_m: Floats
    bottom_m: Floats
    form: NDArray[np.int64]
    """Index of the form in ``forms``, ascending."""
    forms: tuple[Form, ...]

    @property
    def width_m(self) -> Floats:
        """Width of each."""
        return np.array([form.width_m for form in self.forms])[self.form]

    @property
    def height_m(self) -> Floats:
        """Height of each."""
        return np.array([form.height_m for form in self.forms])[self.form]

    @property
    def places(self) -> NDArray[np.int64]:
        """Number of the places of each form, (forms,)."""
        return np.bincount(self.form, minlength=len(self.forms))

    @property
    def weights(self) -> Floats:
        """Prior weights w_j, whose sum is 1."""
        return np.asarray(1.0 / self.places[self.form] / len(self.forms))


def _form(side: object) -> Form:
    """Return the form of a declared size.

    Raises:
        InputError: it is something else.
    """
    sides = side if isinstance(side, tuple) else (side, side)
    if len(sides) != 2 and not isinstance(sides, Form):
        raise InputError(f"{shown(side)} is neither a side nor a width and height, in m", field="sides_m")
    return Form(number_of(sides[0], "sides_m"), number_of(sides[1], "sides_m"), *sides[2:])


def declared(size_m: tuple[float, float], sides_m: Sequence[Side] = SIZES_M) -> Patches:
    """Return the declared set on a surface.

    Args:
        size_m: width and height of the surface. sides_m: sizes, each of which counts once; a crack that is declared
            along both axes, but fits the surface along one of them only, lies along that one.
    Raises:
        InputError: no size is declared, a patch is larger than the surface, or has no size, or there are too many
            places.
    """
    check_kind(sides_m, (tuple, list, np.ndarray), "sides_m", "a list of sizes, in m")
    given = dict.fromkeys(_form(side) for side in sides_m)
    forms = tuple(form for form in given if form.is_within(size_m))
    for form in given:
        turned = Form(form.height_m, form.width_m, form.is_disc)
        if form not in forms and turned not in forms:
            width_cm, height_cm, square_cm = 100 * form.width_m, 100 * form.height_m, 100 * min(size_m)
            raise InputError(
                f"a patch of {width_cm:g} cm x {height_cm:g} cm is not within the surface of {size_m[0]:g} m x "
                f"{size_m[1]:g} m; give sizes that are (squares: at most {square_cm:g} cm)",
                field="--sizes",
            )
    if not forms:
        raise InputError("no size is declared", field="sides_m")
    numbers = [
        [math.ceil((whole - side) / form.step_m) + 1 for side, whole in zip(form[:2], size_m, strict=True)]
        for form in forms
    ]
    if (total := sum(across * up for across, up in numbers)) > MOST:
        raise InputError(
            f"damage has {total:,} places on {size_m[0]:g} m x {size_m[1]:g} m, more than {MOST:,}; is the size of the "
            "surface in m? If it is, declare larger or wider damage (--sizes, --least-cm)",
            field="--size",
        )
    parts = []
    for index, (form, number) in enumerate(zip(forms, numbers, strict=True)):
        along = [
            np.linspace(0.0, whole - side, n) for side, whole, n in zip(form[:2], size_m, number, strict=True)
        ]
        x, y = (places.ravel() for places in np.meshgrid(*along))
        parts.append((x, y, np.full(x.size, index, dtype=np.int64)))
    left, bottom, form_of = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Patches(left, bottom, form_of, forms)


class Strips(NamedTuple):
    """Rectangles whose union each patch is: itself, or a disc in horizontal strips; (strips,) each."""

    left_m: Floats
    right_m: Floats
    bottom_m: Floats
    top_m: Floats
    first: NDArray[np.int64]
    """(patches + 1,): where those of each patch begin, the widest one first."""


def strips_of(patches: Patches, beyond_m: float = 0.0) -> Strips:
    """Return the strips of all patches, which reach beyond their edges by ``beyond_m``."""
    left_m, bottom_m = patches.left_m - beyond_m, patches.bottom_m - beyond_m
    right_m, top_m = (
        patches.left_m + patches.width_m + beyond_m,
        patches.bottom_m + patches.height_m + beyond_m,
    )
    is_disc = np.array([form.is_disc for form in patches.forms])[patches.form]
    each = np.where(is_disc, STRIPS, 1)
    first = np.append(0, np.cumsum(each))
    patch = np.repeat(np.arange(each.size), each)
    number, of_disc = np.arange(patch.size) - first[patch], is_disc[patch]
    # In units of the radius, and scaled so that the area is that of the disc.
    height = (np.arange(STRIPS) + 0.5) / STRIPS * 2.0 - 1.0
    height = height[np.argsort(np.abs(height), kind="stable")]
    chord = np.sqrt(1.0 - height**2)
    chord *= 0.25 * np.pi / chord.mean()
    radius_m, x_m = 0.5 * (right_m - left_m)[patch], 0.5 * (left_m + right_m)[patch]
    y_m = 0.5 * (bottom_m + top_m)[patch] + height[number] * radius_m
    half_m = radius_m / STRIPS
    return Strips(
        np.where(of_disc, x_m - chord[number] * radius_m, left_m[patch]),
        np.where(of_disc, x_m + chord[number] * radius_m, right_m[patch]),
        np.where(of_disc, y_m - half_m, bottom_m[patch]),
        np.where(of_disc, y_m + half_m, top_m[patch]),
        first,
    )


class Shares(NamedTuple):
    """Shares of samples' places in patches, patch by patch."""

    first: NDArray[np.int64]
    """(patches + 1,): where the entries of each patch begin."""
    sample: NDArray[np.int32]
    """Index of the sample of each entry, ascending within a patch."""
    share: NDArray[np.float32]
    """q_j of each entry."""
    place: NDArray[np.int32]
    """(samples,): row of each sample in the tables that kernels read. Neighbours are near each other in memory."""


def shares_of(samples: Samples, patches: Patches) -> Shares:
    """Return the shares of the samples' places in the patches."""
    strips = strips_of(patches, samples.law.sensor.edge_reach_m or 0.0)
    qx, of_x = _along(samples, "x", strips.left_m, strips.right_m)
    qy, of_y = _along(samples, "y", strips.bottom_m, strips.top_m)
    # Only samples with a share along x of the widest strip can have one in the patch, and these are few.
    interval, candidate = np.nonzero(qx > LEAST_SHARE)
    begin = np.searchsorted(interval, np.arange(qx.shape[0] + 1))
    most = int(np.diff(begin)[of_x[strips.first[:-1]]].sum()) + 1
    first, sample, share = (
        np.zeros(patches.left_m.size + 1, np.int64),
        np.empty(most, np.int32),
        np.empty(most, np.float32),
    )
    _fill(qx, of_x, begin, candidate, qy, of_y, strips.first, first, sample, share)
    order = np.lexsort((samples.column("x_m"), samples.column("y_m") // FINEST_M))
    place = np.argsort(order).astype(np.int32)
    return Shares(first, sample[: first[-1]], share[: first[-1]], place)


def _along(samples: Samples, axis: str, low_m: Floats, high_m: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Return the shares of places along an axis in the strips' different intervals, and which is that of each strip.

    Exact places are inside or outside.

    Returns: (intervals, samples) and (strips,).
    """
    intervals, which = np.unique(np.stack([low_m, high_m]), axis=1, return_inverse=True)
    edges_m, edge = np.unique(intervals, return_inverse=True)  # intervals share many edges
    blur_m = samples.law.sensor.edge_blur_m or 0.0
    spread_m = np.maximum(np.hypot(samples.column(f"spread_{axis}_m"), blur_m), 1e-10)
    below = ndtr((edges_m[:, None] - samples.column(f"{axis}_m")) / spread_m)
    low, high = edge.reshape(intervals.shape)
    return np.asarray(below[high] - below[low]), which.astype(np.int64).ravel()


@kernel
def _fill(qx: Floats, of_x: NDArray[np.int64], begin: NDArray[np.int64], candidate: NDArray[np.int64], qy: Floats,
          of_y: NDArray[np.int64], strips: NDArray[np.int64], first: NDArray[np.int64], sample: NDArray[np.int32],
          share: NDArray[np.float32]) -> None:  # fmt: skip
    """Write the entries of each patch, and where they begin to ``first``, all 0 at first.

    Args:
        begin, candidate: samples with a share in each interval along x, (intervals + 1,) and interval by interval.
        strips: where the strips of each patch begin. sample, share: with room for all candidates and one entry more.
    """
    k = 0
    for j in range(strips.size - 1):
        widest = of_x[strips[j]]
        for i in range(begin[widest], begin[widest + 1]):
            s, q = candidate[i], 0.0
            for strip in range(strips[j], strips[j + 1]):
                q += qx[of_x[strip], s] * qy[of_y[strip], s]
            sample[k], share[k] = s, q  # replaced by the next entry, if it is too small
            k += q > LEAST_SHARE
        first[j + 1] = k


@kernel
def _log_likelihoods(first: NDArray[np.int64], sample: NDArray[np.int32], share: NDArray[np.float32],
                     place: NDArray[np.int32], more: NDArray[np.float32], work: Floats,
                     out: Floats) -> None:  # fmt: skip
    """Write ln L_j of each replicate to ``out``, (patches, replicates).

    Args:
        more: of ``_parts``.
        work: (2, ``AT_ONCE``), room.
    """
    product, total = work[0], work[1]
    replicates = more.shape[1]
    for j in range(first.size - 1):
        product[:] = 1.0
        total[:] = 0.0
        for k in range(first[j], first[j + 1]):
            row, q = more[place[sample[k]]], share[k]
            for b in range(replicates):
                product[b] *= 1.0 + q * row[b]
            if (k + 1 - first[j]) % FACTORS == 0:
                for b in range(replicates):
                    total[b] += np.log(product[b])
                    product[b] = 1.0
        for b in range(replicates):
            out[j, b] = total[b] + np.log(product[b])


def _parts(shares: Shares, log_ratio: Floats) -> Iterator[tuple[slice, NDArray[np.float32]]]:
    """Yield ``AT_ONCE`` replicates or fewer, and r - 1 of each sample in them, in the rows ``Shares.place``.

    Args:
        log_ratio: of each sample and replicate, (samples, replicates).
    """
    for begin in range(0, log_ratio.shape[1], AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        more = np.empty(log_ratio[:, part].shape, dtype=np.float32)
        more[shares.place] = np.expm1(log_ratio[:, part])
        yield part, more


def log_likelihoods(shares: Shares, log_ratio: Floats) -> Floats:
    """Return ln L_j of each patch and replicate, (patches, replicates).

    Args:
        log_ratio: of each sample and replicate, (samples, replicates).
    """
    out = np.empty((shares.first.size - 1, log_ratio.shape[1]))
    for part, more in _parts(shares, log_ratio):
        some = np.empty((out.shape[0], more.shape[1]))
        _log_likelihoods(*shares, more, np.empty((2, AT_ONCE)), some)
        out[:, part] = some
    return out


def logs_at_looks(shares: Shares, log_ratio: Floats, look: NDArray[np.int64], looks: int) -> Iterator[Floats]:
    """Yield ln L_j of each patch and replicate at each look, (patches, replicates): evidence is added look by look.

    Args:
        look: from which look on each sample counts, from 0, (samples,).
    """
    if looks == 1:
        yield log_likelihoods(shares, log_ratio)
        return
    patch = np.repeat(np.arange(shares.first.size - 1), np.diff(shares.first))
    logs: Floats | float = 0.0
    for now in range(looks):
        new = look[shares.sample] == now
        first = np.append(0, np.cumsum(np.bincount(patch[new], minlength=shares.first.size - 1)))
        some = shares._replace(first=first, sample=shares.sample[new], share=shares.share[new])
        logs = logs + log_likelihoods(some, log_ratio)
        yield logs


def by_tile(shares: Shares, tile: NDArray[np.int64]) -> Shares:
    """Return the same shares, those of each patch tile by tile: the order of ``ratios_at_looks``."""
    if not tile.any():
        return shares
    patch = np.repeat(np.arange(shares.first.size - 1), np.diff(shares.first))
    order = np.lexsort((tile[shares.sample], patch))
    return shares._replace(sample=shares.sample[order], share=shares.share[order])


@kernel
def _node_weights(intact: NDArray[np.float32], look: NDArray[np.int64], tile: NDArray[np.int64],
                  place: NDArray[np.int32], prior: Floats, is_new: NDArray[np.bool_],
                  out: Floats) -> None:  # fmt: skip
    """Write the probability of each node of a tile's factor at each look to ``out``, (tiles, looks, nodes, replicates).

    Args:
        intact: log likelihood of each sample on an intact tile of each node, in the rows ``place``, (samples, nodes,
            replicates). look, tile: of each sample. prior: of each node. out: all 0 at first.
        is_new: written, at which looks a tile has new samples, (tiles, looks); all False at first.
    """
    tiles, looks, nodes, replicates = out.shape
    for s in range(look.size):
        node, row = out[tile[s], look[s]], intact[place[s]]
        is_new[tile[s], look[s]] = True
        for m in range(nodes):
            for b in range(replicates):
                node[m, b] += row[m, b]
    for t in range(tiles):
        for now in range(1, looks):
            for m in range(nodes):
                for b in range(replicates):
                    out[t, now, m, b] += out[t, now - 1, m, b]
        for now in range(looks):
            node = out[t, now]
            for b in range(replicates):
                most, total = node[0, b], 0.0
                for m in range(nodes):
                    most = max(most, node[m, b])
                for m in range(nodes):
                    node[m, b] = prior[m] * math.exp(node[m, b] - most)
                    total += node[m, b]
                for m in range(nodes):
                    node[m, b] /= total


@kernel
def _ratios_at_looks(first: NDArray[np.int64], sample: NDArray[np.int32], share: NDArray[np.float32],
                     place: NDArray[np.int32], more: NDArray[np.float32], look: NDArray[np.int64],
                     tile: NDArray[np.int64], node: Floats, is_new: NDArray[np.bool_], form: NDArray[np.int64],
                     weight: Floats, largest: bool, product: Floats, mean: Floats, found: Floats,
                     out: Floats) -> None:  # fmt: skip
    """Add weight times L_j of each patch, at each look and replicate, to ``out``, (looks, forms, replicates).

    Args:
        first, sample, share, place: of ``by_tile``.
        more: r - 1 of each sample at each node, in the rows ``place``, (samples, nodes, replicates).
        look, tile: of each sample, looks ascending. node, is_new: of ``_node_weights``. form, weight: of each patch.
        largest: write the largest L_j instead.
        product, mean, found: room, (nodes, replicates), (replicates,) and (looks, replicates).
    """
    (nodes, replicates), looks = product.shape, out.shape[0]
    for j in range(first.size - 1):
        found[:] = 1.0
        k, end = first[j], first[j + 1]
        while k < end:
            t = tile[sample[k]]
            product[:] = 1.0
            for now in range(look[sample[k]], looks):
                while k < end and tile[sample[k]] == t and look[sample[k]] <= now:
                    rows, q = more[place[sample[k]]], share[k]
                    for m in range(nodes):
                        row, into = rows[m], product[m]
                        for b in range(replicates):
                            one = min(into[b] * (1.0 + q * row[b]), LARGEST)
                            into[b] = one if one > SMALLEST else 0.0
                    k += 1
                if is_new[t, now]:  # else the mean is as before
                    mean[:] = 0.0
                    for m in range(nodes):
                        of_node, row = node[t, now, m], product[m]
                        for b in range(replicates):
                            mean[b] += of_node[b] * row[b]
                of_patch = found[now]
                for b in range(replicates):
                    of_patch[b] = min(of_patch[b] * mean[b], LARGEST)
        for now in range(looks):
            of_form, of_patch = out[now, form[j]], found[now]
            for b in range(replicates):
                of_form[b] = max(of_form[b], of_patch[b]) if largest else of_form[b] + weight[j] * of_patch[b]


def ratios_at_looks(
    patches: Patches, shares: Shares, intact: NDArray[np.float32], more: NDArray[np.float32],
    look: NDArray[np.int64], looks: int, tile: NDArray[np.int64], prior: Floats, *, strict: bool = False,
) -> Floats:  # fmt: skip
    """Return the mean of L_j over the places of a form, the largest of all forms and contrasts, (looks, replicates).

    L_j is the product over tiles of the mean over nodes of their samples' product: samples of a tile share its factor,
    of which each tile has one of a few (nodes).

    Args:
        shares: of ``by_tile``. intact: log likelihood of each sample on an intact tile of each node, in the rows
            ``Shares.place``, (samples, nodes, replicates). more: r - 1 for each contrast, (contrasts, *those).
        look: from which look on each sample counts, from 0, ascending. tile: of each sample, from 0.
        prior: probability of each node. strict: return the largest in place of the mean.
    """
    _, nodes, replicates = intact.shape
    tiles = int(tile.max()) + 1
    is_new, node = np.zeros((tiles, looks), dtype=np.bool_), np.zeros((tiles, looks, nodes, replicates))
    _node_weights(intact, look, tile, shares.place, prior, is_new, node)
    weight = patches.weights * len(patches.forms)
    room = np.empty((nodes, replicates)), np.empty(replicates), np.empty((looks, replicates))
    out = np.zeros((looks, replicates))
    for each in more:
        some = np.zeros((looks, len(patches.forms), replicates))
        _ratios_at_looks(*shares, each, look, tile, node, is_new, patches.form, weight, strict, *room, some)
        out = np.maximum(out, some.max(axis=1))
    return np.minimum(out, LARGEST)


def told_risk(ratio: Floats, prior: float) -> Floats:
    """Return the probability of damage given the samples, from Lambda and the prior pi."""
    return np.asarray(prior * ratio / (1.0 - prior + prior * ratio))


def scan_statistic(patches: Patches, logs: Floats) -> Floats:
    """Return T of each replicate: the largest ln L_j - ln(number of places of that size), (replicates,)."""
    return np.asarray((logs - np.log(patches.places[patches.form])[:, None]).max(axis=0))


def raster(patches: Patches, logs: Floats, prior: float, cells: int, size_m: tuple[float, float]) -> Floats:
    """Return the probability that each cell of a raster is damaged, (cells, cells), top row first.

    Args:
        logs: ln L_j, (patches,). prior: pi. cells: cells along each side of the surface. size_m: its width and height.
    """
    posterior = patches.weights * np.exp(np.minimum(logs, 600.0))
    posterior *= prior / (1.0 - prior + prior * posterior.sum())
    strips = strips_of(patches)
    across = _edges(
        patches, strips.first, strips.left_m, strips.right_m, patches.left_m, patches.width_m, size_m[0]
    )
    up = _edges(
        patches, strips.first, strips.bottom_m, strips.top_m, patches.bottom_m, patches.height_m, size_m[1]
    )
    each, total = np.repeat(posterior, np.diff(strips.first)), np.zeros((cells, cells))
    for begin in range(0, each.size, DRAWN_AT_ONCE):
        part = slice(begin, begin + DRAWN_AT_ONCE)
        rows, columns = (
            _covered(one[:, part], whole_m, cells) for one, whole_m in ((up, size_m[1]), (across, size_m[0]))
        )
        total += np.einsum("py,px->yx", each[part, None] * rows, columns)
    return np.asarray(np.clip(total, 0.0, 1.0)[::-1])


def _edges(
    patches: Patches, first: NDArray[np.int64], low_m: Floats, high_m: Floats, at_m: Floats, side_m: Floats,
    whole_m: float,
) -> Floats:  # fmt: skip
    """Return along one axis where strips begin and end, and how far before and behind that they may lie, (4, strips).

    Args:
        first: where the strips of each patch begin. low_m, high_m: ends of the strips. at_m, side_m: of the patches.
        whole_m: of the surface.
    """
    around_m = AROUND * np.array([form.step_m for form in patches.forms])[patches.form]
    room_m = np.minimum(around_m, [at_m, whole_m - side_m - at_m])  # within the surface
    return np.vstack([low_m, high_m, np.repeat(room_m, np.diff(first), axis=1)])


def _covered(edges: Floats, whole_m: float, cells: int) -> Floats:
    """Return the probability that strips with these ``_edges`` cover the centre of each cell, (strips, cells)."""
    low, high, before, behind = edges[:, :, None]
    at, wide = (np.arange(cells) + 0.5) * whole_m / cells, np.maximum(before + behind, 1e-9)
    begun, ended = (np.clip((at - edge + before) / wide, 0.0, 1.0) for edge in (low, high))
    return np.asarray(begun - ended)
