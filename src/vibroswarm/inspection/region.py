"""Where, how large and how strong is a called patch? A credible region of place, size and contrast.

| name | symbol | equation |
|---|---|---|
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
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.inspection.damage import quantiles_of, ratios_at, tiles_below
from vibroswarm.inspection.patches import AROUND, Patches, Shares, log_likelihoods, shares_of, step_of
from vibroswarm.inspection.samples import Floats, Samples

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
