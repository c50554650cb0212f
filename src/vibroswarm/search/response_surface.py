"""Fit a quadratic response surface to the scores of all candidates and find its minimum.

The score of one candidate is mostly noise, but a surface that is fitted to hundreds of candidates averages the noise.
The minimum of the surface becomes a finalist of the search. A second surface is fitted to that half of the candidates
where the first surface is lowest, and its minimum becomes a finalist too. The race of the finalists tests both.

| name | equation |
|---|---|
| surface | s(u) = b_0 + sum_i b_i u_i + sum_(i <= j) b_ij u_i u_j |
| weights | runs / s(u)^2, since the standard deviation of a cost is about proportional to the cost |

Here u is the point in the unit cube. Since the weights depend on the surface, it is fitted ``FITS`` times.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from vibroswarm.inference.outcomes import Array
from vibroswarm.search.archive import Archive
from vibroswarm.search.methods import chance
from vibroswarm.search.space import Point

FITS: Final = 5
"""Number of fits; each uses the weights that follow from the fit before."""
STARTS: Final = 2000
"""Random points from which the best is taken to start the search for the minimum."""
RIDGE: Final = 1e-3
"""Ridge penalty relative to the total weight; bounds directions in which no candidate varies."""


def optima(archive: Archive, keys: Sequence[int], seed: int) -> list[Point]:
    """Find the minima of both surfaces of the candidates ``keys``, as points of the unit cube.

    A surface is fitted only if there are at least two candidates for each of its coefficients. With fewer candidates,
    the list has one point or none.

    Args:
        archive: has the candidates. keys: of the candidates; those with an infinite score are left out.
        seed: of the search.
    """
    valid = [k for k in keys if np.isfinite(archive.estimate(k)[0])]
    points = np.array([archive[k].point for k in valid]).reshape(len(valid), archive.space.size)
    scores = np.array([archive.estimate(k)[0] for k in valid])
    runs = np.array([archive.count(k) for k in valid], dtype=np.float64)
    minima: list[Point] = []
    for _ in range(2):  # first with all candidates, then with the half where the first surface is lowest
        if len(points) < 2 * coefficients(archive.space.size):
            break
        surface = fit(points, scores, runs)
        minima.append(lowest(surface, points, seed))
        fitted = features(points) @ surface
        better = fitted <= np.median(fitted)
        points, scores, runs = points[better], scores[better], runs[better]
    return minima


def coefficients(dimensions: int) -> int:
    """Return the number of coefficients of a surface: constant, linear, squares and products."""
    return (dimensions + 1) * (dimensions + 2) // 2


def features(points: Array) -> Array:
    """Compute the terms 1, u_i and u_i u_j (i <= j) of each point, (points, coefficients).

    ``points`` are in the unit cube, (points, dimensions). For the terms, their coordinates are mapped from [0, 1] to
    [-1, 1], since the terms are less correlated then.
    """
    u = 2.0 * points - 1.0
    first, second = np.triu_indices(u.shape[1])
    return np.hstack([np.ones((u.shape[0], 1)), u, u[:, first] * u[:, second]])


def fit(points: Array, scores: Array, runs: Array) -> Array:
    """Fit a surface by weighted least squares with a ridge penalty.

    Args:
        points: of the candidates, (candidates, dimensions). scores: estimated score of each candidate, (candidates,).
        runs: number of runs of each candidate, (candidates,).
    Returns:
        The coefficients of the terms of ``features``, (coefficients,).
    """
    design = features(points)
    ridge = np.eye(design.shape[1])
    ridge[0, 0] = 0.0  # the constant is not penalised
    # The cost at each candidate, which determines the weight of the candidate. In the first fit it is the mean of all
    # scores, afterwards the value of the surface that was fitted before.
    level = np.full(scores.size, max(float(np.abs(scores).mean()), 1e-12))
    for _ in range(FITS):
        weight = runs / level**2
        normal = design.T @ (weight[:, None] * design) + RIDGE * weight.sum() * ridge
        surface: Array = np.linalg.solve(normal, design.T @ (weight * scores))
        fitted = design @ surface
        # Bounded from below: where the surface is close to 0, a candidate would get nearly all the weight.
        level = np.maximum(np.abs(fitted), 0.2 * float(np.abs(fitted).mean()) + 1e-12)
    return surface


def lowest(surface: Array, points: Array, seed: int) -> Point:
    """Return the point at which the surface is lowest, within the range of the candidates in every dimension.

    Args:
        surface: coefficients of the surface. points: of the candidates, (candidates, dimensions). seed: of the search.
    """
    from scipy.optimize import minimize

    # The best of many points is the start of a local optimizer, since the surface may have several local minima.
    low, high = points.min(axis=0), points.max(axis=0)
    starts = low + (high - low) * chance(seed, "surface").random((STARTS, low.size))
    starts = np.vstack([starts, points])
    best = starts[int(np.argmin(features(starts) @ surface))]

    def height(u: Array) -> float:
        return float((features(u[None, :]) @ surface)[0])

    minimum = minimize(height, best, bounds=list(zip(low, high, strict=True)), method="L-BFGS-B")
    # If the optimizer fails, the start may be the better point. Candidates lie in the unit cube, and so do the bounds:
    # ``clip`` only removes rounding errors.
    return np.clip(minimum.x if height(minimum.x) <= height(best) else best, 0.0, 1.0)
