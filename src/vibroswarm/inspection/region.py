"""Where, how large and how strong is a called patch? One joint credible region of place, size and contrast.

| name | symbol | equation |
|---|---|---|
| probability of patch j at contrast c | p_jc | w_j L_jc^(1/d) over its sum; all contrasts have the same weight |
| error of the law | - | p_jc is the mean over the law and those fitted to resampled references (``damage.over_laws``) |
| design effect | d | ``design_effects``: samples on a patch share the factors of its tiles and of their robots |
| size | a | side of a square, diameter of a disc, length of a crack; forms of one shape differ in size only |
| density | f | sum of p_jc times triangles about x_j, y_j, ln a_j and c, each up to the next of its kind |
| region | - | where f is at least what it exceeds in ``HELD`` of its own draws (highest density; Hyndman 1996) |

L_jc takes samples as independent. Where tiles and robots differ, the power 1 / d gives it the width that it would have
with fewer, independent samples: without it the region of squares of 20 cm held their contrast in 65 % (``calibrated``).

Places of samples count as at least as uncertain as declared ones are apart (``coarse_shares``): by 1,000 exact places
of samples the region of squares of 20 to 28 cm held them in 38 %, and holds them in 97.

One patch is presumed: each called patch has a region, by the samples that are not on those called before it. Between
the places, sizes and contrasts of the declared set the probability falls linearly: damage lies between them.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.jit import kernel
from vibroswarm.inspection.damage import contrast_ratios, over_laws, quantiles_of, tiles_below
from vibroswarm.inspection.patches import AROUND, Form, Patches, Shares, log_likelihoods, shares_of
from vibroswarm.inspection.samples import Floats, Law, Samples
from vibroswarm.statistics.intervals import generator

HELD: Final = 0.9
"""Probability of the region."""
STRENGTHS: Final = (0.25, 0.5, 0.75, 1.0)
"""Contrasts that are weighed; readings of few values have contrast 1 alone."""
DRAWN: Final = 2000
"""Draws that describe a density."""
NEGLIGIBLE: Final = 1e-4
"""Patches that together have less probability are left out."""
APART: Final = 1.5
"""Neighbouring sizes that are further apart have others between them: else damage between would look weaker."""
NEXT: Final = float(np.log(np.sqrt(2.0)))
"""Distance in ln a to the next size, where there is none."""
CELL_M: Final = 0.025
"""Side of the cells by which the area of the centres is counted."""


@kernel
def _density(shape: NDArray[np.int64], at: Floats, of_shape: NDArray[np.int64], p: Floats, triangles: Floats,
             out: Floats) -> None:  # fmt: skip
    """Write f at each place to ``out``.

    Args:
        shape, at: as of ``Posterior.density``. of_shape, p, triangles: as in ``Posterior``.
    """
    tiny = 1e-12
    for i in range(out.size):
        out[i] = 0.0
        for term in range(p.size):
            part = p[term] if of_shape[term] == shape[i] else 0.0
            axis = 0
            while part > 0.0 and axis < 4:
                left, top, right = (
                    triangles[axis, 0, term],
                    triangles[axis, 1, term],
                    triangles[axis, 2, term],
                )
                rising = (at[axis, i] - left + tiny) / (top - left + tiny)
                falling = (right - at[axis, i] + tiny) / (right - top + tiny)
                part *= max(min(rising, falling, 1.0), 0.0) * 2.0 / (right - left)
                axis += 1
            out[i] += part


@dataclass(frozen=True, eq=False)
class Posterior:
    """Density of the place, size and contrast of one patch: a mixture of products of triangles."""

    shapes: tuple[tuple[bool, float], ...]
    """Whether discs, and width over height, of each shape."""
    p: Floats
    """(terms,)."""
    shape: NDArray[np.int64]
    triangles: Floats
    """Left end, top and right end along x, y, ln a and c, (4, 3, terms)."""
    strengths: tuple[float, ...] = STRENGTHS
    """Contrasts that are weighed."""

    def drawn(self, random: np.random.Generator, number: int) -> tuple[NDArray[np.int64], Floats]:
        """Draw from the density: the arguments of ``density``."""
        term = random.choice(self.p.size, number, p=self.p)
        return self.shape[term], np.stack([random.triangular(*ends[:, term]) for ends in self.triangles])

    def density(self, shape: NDArray[np.int64], at: Floats) -> Floats:
        """Return f of damage, (number,).

        Args:
            shape: index in ``shapes``, (number,); -1: another shape. at: x, y, ln a and c, (4, number).
        """
        out = np.empty(shape.size)
        _density(shape, at, self.shape, self.p, self.triangles, out)
        return out


@dataclass(frozen=True, eq=False)
class Region:
    """The joint credible region of a called patch."""

    posterior: Posterior
    least: float
    """Least density in the region."""
    size_m: tuple[float, float]
    """Smallest and largest size in the region."""
    contrast: tuple[float, float] | None
    """Smallest and largest contrast in the region; None: readings of few values have one."""
    centre_m2: float
    """Area of the centres in the region."""

    def holds(self, form: Form, x_m: float, y_m: float, contrast: float = 1.0) -> bool:
        """Return whether damage of this form and contrast, with its centre there, is in the region."""
        shape, shapes = _shape(form), self.posterior.shapes
        index = np.array([shapes.index(shape) if shape in shapes else -1])
        at = np.array([[x_m], [y_m], [np.log(form.longest_m)], [contrast]])
        return bool(self.posterior.density(index, at)[0] >= self.least)


def between(forms: tuple[Form, ...]) -> tuple[Form, ...]:
    """Return forms, and others between those of one shape whose sizes are more than ``APART`` times each other."""
    found = list(forms)
    for shape in dict.fromkeys(map(_shape, forms)):
        alike = sorted((form for form in forms if _shape(form) == shape), key=lambda form: form.longest_m)
        for small, large in itertools.pairwise(alike):
            ratio = large.longest_m / small.longest_m
            steps = math.ceil(math.log(ratio) / math.log(APART) - 1e-9)
            scales = [ratio ** (k / steps) for k in range(1, steps)]
            found += [Form(small.width_m * by, small.height_m * by, small.is_disc) for by in scales]
    return tuple(found)


def _shape(form: Form) -> tuple[bool, float]:
    return form.is_disc, round(form.width_m / form.height_m, 6)


def coarse_shares(samples: Samples, patches: Patches) -> Shares:
    """Return the shares of samples whose places are known no better than places of each form are apart.

    Damage lies between declared places: by many sharp places the nearest of them would be as unlikely as any other.
    """
    parts = []
    for k, form in enumerate(patches.forms):
        own, least_m = patches.form == k, AROUND / math.sqrt(3.0) * form.step_m
        spreads = {name: np.maximum(samples.column(name), least_m) for name in ("spread_x_m", "spread_y_m")}
        alone = Patches(patches.left_m[own], patches.bottom_m[own], patches.form[own] - k, (form,))
        parts.append(shares_of(samples.with_columns(**spreads), alone))
    begin = np.cumsum([0, *(part.first[-1] for part in parts)])
    first = [part.first[:-1] + before for part, before in zip(parts, begin, strict=False)]
    return Shares(
        np.append(np.concatenate(first), begin[-1]),
        np.concatenate([part.sample for part in parts]),
        np.concatenate([part.share for part in parts]),
        parts[0].place,
    )


def posterior_of(samples: Samples, patches: Patches, shares: Shares, there: NDArray[np.bool_]) -> Posterior:
    """Return what the samples that are ``there`` say of the place, size and contrast of one patch."""
    strengths = STRENGTHS if samples.law.has_contrasts else (1.0,)
    p = _probabilities(samples, patches, shares, there, strengths)
    rising = np.sort(p, axis=None)
    kept = p >= rising[np.searchsorted(np.cumsum(rising), NEGLIGIBLE)]
    patch, strength = np.nonzero(kept)
    forms, form = patches.forms, patches.form[patch]
    shapes = tuple(dict.fromkeys(map(_shape, forms)))
    step_m = np.array([one.step_m for one in forms])[form]
    x_m = (patches.left_m + 0.5 * patches.width_m)[patch]
    y_m = (patches.bottom_m + 0.5 * patches.height_m)[patch]
    sizes, contrasts = np.array([_size_ends(one, forms) for one in forms]), _ends(np.array(strengths), 0.25)
    contrasts[:, 2] = np.minimum(contrasts[:, 2], np.maximum(1.0, contrasts[:, 1]))
    triangles = [
        (x_m - step_m, x_m, x_m + step_m), (y_m - step_m, y_m, y_m + step_m), sizes[form].T, contrasts[strength].T,
    ]  # fmt: skip
    return Posterior(
        shapes,
        p[kept] / p[kept].sum(),
        np.array([shapes.index(_shape(one)) for one in forms])[form],
        np.array(triangles),
        strengths,
    )


def _probabilities(
    samples: Samples, patches: Patches, shares: Shares, there: NDArray[np.bool_], strengths: tuple[float, ...]
) -> Floats:
    """Return p_jc, (patches, contrasts)."""
    value = samples.column("value")

    def logs_by(law: Law) -> Floats:
        ratios = [np.where(there, contrast_ratios(law, value, c), 0.0) for c in strengths]
        return log_likelihoods(shares, np.stack(ratios, axis=1))

    effect = design_effects(samples, shares)[int(logs_by(samples.law).max(axis=1).argmax())]

    def probabilities_by(law: Law) -> Floats:
        logs = logs_by(law)
        p = patches.weights[:, None] * np.exp((logs - logs.max()) / effect)
        return np.asarray(p / p.sum())

    return over_laws(samples.law, probabilities_by)


def design_effects(samples: Samples, shares: Shares) -> Floats:
    """Return by how much factors that samples share raise the variance of their mean log value (Kish 1965), (patches,).

    It is 1 + rho_t (m_t - 1) + rho_r (m_r - 1): rho is the share of the variance of tiles or of robots in that of the
    logarithm of a vibrating value, and m how many samples on the patch share a tile, or a robot, with a sample.
    """
    sensor, table = samples.law.sensor, quantiles_of(samples.law)
    weight = np.gradient(table.u)
    # Values near 0, and below, count as a thousandth of the mean, whatever the unit.
    least = 1e-3 * float(np.average(np.abs(table.vibrating), weights=weight))
    log_value = np.log(np.maximum(table.vibrating, max(least, 1e-300)))
    mean = np.average(log_value, weights=weight)
    alone = float(np.average((log_value - mean) ** 2, weights=weight))
    of_tile, of_robot = ((spread or 0.0) ** 2 for spread in (sensor.tile_spread, sensor.robot_spread))
    robot = np.unique(samples.frame["robot"].to_numpy(), return_inverse=True)[1]
    effect = np.ones(shares.first.size - 1)
    for group, shared in ((tiles_below(samples), of_tile), (robot, of_robot)):
        if shared:
            together = np.empty_like(effect)
            _together(*shares[:3], group, np.empty(group.max() + 1), together)
            effect += shared / (alone + of_tile + of_robot) * np.maximum(together - 1.0, 0.0)
    return effect


@kernel
def _together(first: NDArray[np.int64], sample: NDArray[np.int32], share: NDArray[np.float32],
              group: NDArray[np.int64], work: Floats, out: Floats) -> None:  # fmt: skip
    """Write m of each patch, how many samples share a group with a sample, to ``out``, (patches,).

    Args:
        group: of each sample. work: (groups,), room.
    """
    for j in range(out.size):
        work[:] = 0.0
        total, squared = 0.0, 0.0
        for k in range(first[j], first[j + 1]):
            q, own = share[k], group[sample[k]]
            squared += q * (q + 2.0 * work[own])
            total += q
            work[own] += q
        out[j] = squared / max(total, 1e-9)


def _size_ends(form: Form, forms: tuple[Form, ...]) -> Floats:
    """Return the ends and the top of the triangle of a form's ln a, among those of its shape, (3,)."""
    alike = np.unique([np.log(one.longest_m) for one in forms if _shape(one) == _shape(form)])
    return np.asarray(_ends(alike, NEXT)[np.searchsorted(alike, np.log(form.longest_m))])


def _ends(at: Floats, alone: float) -> Floats:
    """Return the next smaller, itself and the next larger of ascending values, (values, 3).

    Args:
        alone: distance to the next of a single value; else the distance at the ends is that to the other neighbour.
    """
    gaps = np.diff(at) if at.size > 1 else np.array([alone])
    return np.stack(
        [at - np.append(gaps[0], gaps)[: at.size], at, at + np.append(gaps, gaps[-1])[: at.size]], axis=1
    )


def region_of(posterior: Posterior) -> Region:
    """Return the joint credible region of a patch."""
    shape, at = posterior.drawn(generator(1, "density of damage"), DRAWN)
    density = posterior.density(shape, at)
    least = float(np.quantile(density, 1.0 - HELD))
    x_m, y_m, log_size, contrast = at[:, density >= least]
    cells = np.unique(np.stack([np.floor(x_m / CELL_M), np.floor(y_m / CELL_M)]), axis=1)
    size_m = np.exp(log_size)
    return Region(
        posterior,
        least,
        (float(size_m.min()), float(size_m.max())),
        (float(contrast.min()), float(contrast.max())) if len(posterior.strengths) > 1 else None,
        cells.shape[1] * CELL_M**2,
    )
