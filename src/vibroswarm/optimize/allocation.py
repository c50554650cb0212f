"""Optimal computing budget allocation: further runs go where they tell most about which candidate is best.

| name | symbol | equation |
|---|---|---|
| best | b | the smallest estimate |
| distance | d_i | estimate_i - estimate_b |
| noise | s_i | standard error times sqrt(runs): the noise of one run |
| runs | N_i, N_b | N_i proportional to (s_i / d_i)^2; N_b = s_b sqrt(sum over i of (N_i / s_i)^2) |

Chen, Lin, Yuecesan and Chick, "Simulation budget allocation for further enhancing the efficiency of ordinal
optimization", Discrete Event Dynamic Systems 10 (2000).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vibroswarm.optimize.archive import Archive
from vibroswarm.optimize.method import Ask


def allocate(
    estimates: Sequence[float], errors: Sequence[float], counts: Sequence[int], more: int
) -> NDArray[np.int64]:
    """How many of ``more`` runs each candidate gets, shape as the inputs.

    Args:
        estimates, errors: score and its standard error; candidates that are not finite get nothing.
        counts: runs that are there.
    """
    value, n = np.asarray(estimates, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    error = np.asarray(errors, dtype=np.float64)
    given = np.zeros(value.size, dtype=np.int64)
    there = np.flatnonzero(np.isfinite(value) & np.isfinite(error))
    if there.size == 0 or more <= 0:
        return given
    if there.size == 1:
        given[there[0]] = more
        return given
    value, n = value[there], n[there]
    noise = np.maximum(error[there] * np.sqrt(n), 1e-12)
    best = int(np.argmin(value))
    # Nearer than their own error cannot be told; so equals share, in place of one that takes all.
    distance = np.maximum(value - value[best], 0.5 * noise / np.sqrt(n) + 1e-12)
    weight = (noise / distance) ** 2
    others = np.arange(value.size) != best
    weight[best] = noise[best] * np.sqrt(float(((weight[others] / noise[others]) ** 2).sum()))
    given[there] = _share_out(weight, n, more)
    return given


def ask_for(archive: Archive, keys: Sequence[int], more: int) -> list[Ask]:
    """``allocate`` for candidates of the archive."""
    found = [archive.estimate(key) for key in keys]
    given = allocate([f[0] for f in found], [f[1] for f in found], [archive.count(k) for k in keys], more)
    return [Ask(key, int(count)) for key, count in zip(keys, given, strict=True) if count]


def _share_out(weight: NDArray[np.float64], there: NDArray[np.float64], more: int) -> NDArray[np.int64]:
    """Whole numbers that bring ``there`` as near to the weights' shares as ``more`` runs can."""
    active = np.ones(weight.size, dtype=np.bool_)
    while True:  # those that have more than their share already get none; the rest share what is left
        total = there[active].sum() + more
        wanted = np.where(active, weight / weight[active].sum() * total - there, 0.0)
        if (wanted[active] >= 0).all():
            break
        active &= wanted >= 0
    whole = np.floor(wanted).astype(np.int64)
    left = more - int(whole.sum())
    rest = np.argsort(-(wanted - whole), kind="stable")[:left]
    whole[rest] += 1
    return whole
