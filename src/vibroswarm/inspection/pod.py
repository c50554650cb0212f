"""Probability of detection (PoD) against the size of damage, fitted to inspections of known damage.

| name | symbol | equation |
|---|---|---|
| probability of detection | PoD(a) | p_f + (1 - p_f) / (1 + exp(-b0 - b1 g(a))) |
| upper asymptote | c | c - p_f in the place of 1 - p_f: places that are not visited are not found, however large |
| false calls | p_f | share of intact surfaces that are called, of at least ``INTACT`` inspections of their own |
| size | a, g(a) | side of the damage; g is the identity or the logarithm, by AIC |
| size found in 50, 90 % | a50, a90 | PoD(a50) = .5, PoD(a90) = .9 |
| limit of a90 | a90/95 | largest a with 2 (l_max - l(a90 = a)) <= 2.706, l the profile log likelihood |

The binomial terms of damaged and of intact inspections make one likelihood, so that the limit allows for p_f not being
known exactly. A fit that leaves p_f out takes false calls on small damage for detections, and its a90 is too large.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from scipy import optimize
from scipy.optimize import brentq, minimize_scalar
from scipy.special import expit, logit, xlogy

from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.inspection.samples import Floats

INTACT: Final = 2000
"""Intact inspections that give p_f to half a percent."""
DROP: Final = 2.706
"""Chi squared with one degree of freedom at 90 %: a one-sided limit of 95 %."""
SEARCH: Final[Any] = {"xatol": 1e-5, "fatol": 1e-8, "maxiter": 4000}
"""Settings of the search for the largest likelihood."""
LEAST: Final = 1e-9
"""Least probability in a logarithm."""


@dataclass(frozen=True)
class Pod(NotebookView):
    """A fitted probability of detection; sizes are nan where they do not exist."""

    false_calls: float
    b0: float
    b1: float
    scale: Literal["size", "log size"]
    a50_m: float
    a90_m: float
    a90_95_m: float
    """Upper 95 % limit of a90; nan: does not exist, because too few large patches were found."""
    trials: int
    intact: int
    top: float = 1.0
    """Upper asymptote."""

    def at(self, size_m: Floats | float) -> Floats:
        """Return PoD at sizes."""
        size = np.asarray(size_m, dtype=np.float64)
        return _pod(size, self.false_calls, self.b0, self.b1, self.scale, self.top)


def _g(size_m: Floats, scale: str) -> Floats:
    return np.log(size_m) if scale == "log size" else np.asarray(size_m)


def _pod(size_m: Floats, p_f: float, b0: float, b1: float, scale: str, top: float = 1.0) -> Floats:
    return np.asarray(p_f + (top - p_f) * expit(b0 + b1 * _g(size_m, scale)))


@dataclass(frozen=True)
class _Trials:
    """Inspections of damaged and intact surfaces, counted by size."""

    size_m: Floats
    found: Floats
    number: Floats
    false: int
    intact: int
    scale: str

    def loss(self, p_f: float, b0: float, b1: float, top: float = 1.0) -> float:
        """Return -ln likelihood."""
        p = np.clip(_pod(self.size_m, p_f, b0, b1, self.scale, top), LEAST, 1.0 - LEAST)
        of_damaged = xlogy(self.found, p) + xlogy(self.number - self.found, 1.0 - p)
        q = min(max(p_f, LEAST), 1.0 - LEAST)
        of_intact = xlogy(self.false, q) + xlogy(self.intact - self.false, 1.0 - q) if self.intact else 0.0
        return -float(of_damaged.sum() + of_intact)


def fit_pod(
    size_m: Floats, found: Floats, false: int, intact: int, *, floor: bool = True, asymptote: bool = False
) -> Pod:
    """Fit PoD to inspections.

    Args:
        size_m, found: size of the damage of each inspection, and whether it was called (1) or not (0), (inspections,).
        false, intact: number of intact surfaces that were called, and that were inspected.
        floor: whether the curve begins at p_f; without, only for the control that such a fit fails.
        asymptote: whether the curve may end below 1, by AIC, as where coverage is incomplete.
    Raises:
        InputError: there are fewer than 20 inspections, of fewer than 3 sizes, or none of intact surfaces.
    """
    sizes, at = np.unique(np.asarray(size_m, dtype=np.float64), return_inverse=True)
    if at.size < 20 or sizes.size < 3:
        raise InputError("a curve needs at least 20 inspections, of at least 3 sizes", field="sizes")
    if floor and intact < 1:
        raise InputError("a curve needs inspections of intact surfaces, for its false calls", field="intact")
    number = np.bincount(at).astype(np.float64)
    hits = np.bincount(at, np.asarray(found, dtype=np.float64)).astype(np.float64)
    fits = []
    for scale in ("size", "log size"):
        trials = _Trials(sizes, hits, number, false if floor else 0, intact if floor else 0, scale)
        p_f, b0, b1, loss = _best(trials, false / intact if floor else 0.0)
        fits.append((trials, p_f, b0, b1, 1.0, loss))
        if asymptote:
            b0, b1, top, loss = _with_top(trials, p_f, b0, b1)
            fits.append((trials, p_f, b0, b1, top, loss + 1.0))  # one parameter more costs 1, by AIC
    trials, p_f, b0, b1, top, loss = min(fits, key=lambda fit: fit[5])
    loss -= float(top < 1.0)
    a50, a90 = (_size_at(share, p_f, b0, b1, trials.scale, top) for share in (0.5, 0.9))
    # Beyond the sizes that were tried the curve says nothing.
    a50, a90 = (size if size <= sizes[-1] else float("nan") for size in (a50, a90))
    limit = _limit(trials, p_f, b0, b1, loss, a90, top)
    return Pod(p_f, b0, b1, trials.scale, a50, a90, limit, int(at.size), intact, top)  # type: ignore[arg-type]


def _search(loss: Callable[[Floats], float], start: Sequence[float]) -> tuple[list[float], float]:
    """Return where a loss is smallest, searched from ``start`` by Nelder and Mead's method, and how large it is."""
    minimize: Any = optimize.minimize  # its stubs allow no lambda
    found = minimize(loss, np.array(start), method="Nelder-Mead", options=SEARCH)
    return found.x.tolist(), float(found.fun)


def _with_top(trials: _Trials, p_f: float, b0: float, b1: float) -> tuple[float, float, float, float]:
    """Return b0, b1 and the asymptote of the largest likelihood at this p_f, and -ln of it."""

    def loss(at: Floats) -> float:
        return trials.loss(p_f, at[0], at[1], top(at))

    def top(at: Sequence[float] | Floats) -> float:
        return p_f + (1.0 - p_f) * float(expit(at[2]))

    highest = logit(min(max(float((trials.found / trials.number).max()), 0.5), 0.98))
    starts = ((steep * b0, steep * b1, highest) for steep in (1.0, 3.0))
    at, least = min((_search(loss, start) for start in starts), key=lambda found: found[1])
    return at[0], at[1], min(top(at), 1.0 - LEAST), least


def _best(trials: _Trials, p_f: float) -> tuple[float, float, float, float]:
    """Return p_f, b0, b1 of the largest likelihood, and -ln of it; p_f stays as it is without intact surfaces."""
    g = _g(trials.size_m, trials.scale)
    middle, spread = float(np.average(g, weights=trials.number)), float(np.ptp(g))

    def loss(at: Floats, p_f: float) -> float:
        """Return the loss by the height at the middle of the sizes, and the slope over their range."""
        return trials.loss(p_f, at[0] - at[1] / spread * middle, at[1] / spread)

    starts = (3.0, 10.0, 30.0)  # from flat to steep, about the middle of the sizes
    at, least = min(
        (_search(lambda at: loss(at, p_f), (0.0, steep)) for steep in starts), key=lambda found: found[1]
    )
    if trials.intact:
        start = (*at, logit(min(max(p_f, 1e-6), 0.5)))
        at, least = _search(lambda at: loss(at, float(expit(at[2]))), start)
        p_f = float(expit(at[2]))
    b1 = at[1] / spread
    return p_f, at[0] - b1 * middle, b1, least


def _size_at(share: float, p_f: float, b0: float, b1: float, scale: str, top: float = 1.0) -> float:
    """Return the size at which PoD is a share; nan: there is none."""
    if not p_f < share < top or b1 <= 0.0:
        return float("nan")
    g = (logit((share - p_f) / (top - p_f)) - b0) / b1
    size = float(np.exp(g)) if scale == "log size" else float(g)
    return size if size > 0.0 else float("nan")


def _limit(
    trials: _Trials, p_f: float, b0: float, b1: float, loss: float, a90: float, top: float = 1.0
) -> float:
    """Return a90/95 by profile likelihood at this p_f and asymptote; nan: none up to 1.5 times the largest size."""
    if not np.isfinite(a90):
        return float("nan")
    if top < 1.0:  # an asymptote that is not known well may be below 0.9, and then there is no a90
        _, lower = _search(lambda at: trials.loss(p_f, at[0], at[1], 0.9), (b0, b1))
        if 2.0 * (lower - loss) <= DROP:
            return float("nan")
    wanted = float(logit((0.9 - p_f) / (top - p_f)))

    def excess(size_m: float) -> float:
        """Return twice the loss of log likelihood if a90 is this size, less what is allowed."""
        g = float(_g(np.array(size_m), trials.scale))

        def of_slope(log_slope: float) -> float:
            slope = np.exp(log_slope)
            return trials.loss(p_f, wanted - slope * g, slope, top)

        at = np.log(max(b1, 1e-6))
        found = minimize_scalar(
            of_slope, bounds=(at - 5.0, at + 5.0), method="bounded", options={"xatol": 1e-5}
        )
        return 2.0 * (float(found.fun) - loss) - DROP

    high = a90
    while high < 1.5 * trials.size_m[-1]:
        high *= 1.04
        if excess(high) > 0.0:
            return float(brentq(excess, a90, high, xtol=1e-6))
    return float("nan")
