"""Fit a quadratic response surface to the scores of all candidates and find its minimum.

The score of one candidate is mostly noise, but hundreds of candidates surround it. The minimum of the surface becomes a
finalist, and so does that of a second surface, fitted to the better half by the first; the race tests them.

| name | equation |
|---|---|
| surface | s(u) = b_0 + sum_i b_i u_i + sum_(i <= j) b_ij u_i u_j |
| weights | runs / s(u)^2, since the noise of a cost is proportional to it; refitted until stable |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.methods import chance
from vibroswarm.optimize.space import Point

FITS: Final = 5
STARTS: Final = 2000
RIDGE: Final = 1e-3
"""Ridge penalty relative to the total weight; bounds directions in which no candidate varies."""

Array = NDArray[np.float64]


def optima(archive: Archive, keys: Sequence[int], seed: int) -> list[Point]:
    """Find the minima of both surfaces; none if there are too few candidates to fit them."""
    valid = [k for k in keys if np.isfinite(archive.estimate(k)[0])]
    points = np.array([archive[k].point for k in valid]).reshape(len(valid), -1)
    scores = np.array([archive.estimate(k)[0] for k in valid])
    runs = np.array([archive.count(k) for k in valid], dtype=np.float64)
    minima: list[Point] = []
    for _ in range(2):
        if len(points) < 2 * coefficients(archive.space.size):
            break
        surface = fit(points, scores, runs)
        minima.append(lowest(surface, points, seed))
        fitted = features(points) @ surface
        better = fitted <= np.median(fitted)
        points, scores, runs = points[better], scores[better], runs[better]
    return minima


def coefficients(dimensions: int) -> int:
    """Return the number of coefficients of a surface."""
    return (dimensions + 1) * (dimensions + 2) // 2


def features(points: Array) -> Array:
    """Compute the terms 1, u_i and u_i u_j about the centre of the cube, (points, coefficients)."""
    u = 2.0 * points - 1.0
    first, second = np.triu_indices(u.shape[1])
    return np.hstack([np.ones((u.shape[0], 1)), u, u[:, first] * u[:, second]])


def fit(points: Array, scores: Array, runs: Array) -> Array:
    """Fit the coefficients, (coefficients,), by least squares; each fit gives the weights of the next."""
    design = features(points)
    ridge = np.eye(design.shape[1])
    ridge[0, 0] = 0.0
    level = np.full(scores.size, max(float(np.abs(scores).mean()), 1e-12))
    for _ in range(FITS):
        weight = runs / level**2
        normal = design.T @ (weight[:, None] * design) + RIDGE * weight.sum() * ridge
        surface: Array = np.linalg.solve(normal, design.T @ (weight * scores))
        fitted = design @ surface
        level = np.maximum(np.abs(fitted), 0.2 * float(np.abs(fitted).mean()) + 1e-12)
    return surface


def lowest(surface: Array, points: Array, seed: int) -> Point:
    """Return the point at which the surface is lowest, within the range of the candidates in every dimension."""
    from scipy.optimize import minimize

    low, high = points.min(axis=0), points.max(axis=0)
    tried = low + (high - low) * chance(seed, "surface").random((STARTS, low.size))
    tried = np.vstack([tried, points])
    best = tried[int(np.argmin(features(tried) @ surface))]

    def height(u: Array) -> float:
        return float((features(u[None, :]) @ surface)[0])

    minimum = minimize(height, best, bounds=list(zip(low, high, strict=True)), method="L-BFGS-B")
    return np.clip(minimum.x if height(minimum.x) <= height(best) else best, 0.0, 1.0)
