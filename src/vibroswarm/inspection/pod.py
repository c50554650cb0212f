"""Probability of detection (PoD) against the size of damage, fitted to inspections of known damage.

| name | symbol | equation |
|---|---|---|
| probability of detection | PoD(a) | p_f + (1 - p_f) F(b0 + b1 g(a)) |
| false calls | p_f | share of intact surfaces that are called, of at least ``INTACT`` inspections of their own |
| size | a | side of the damage |
| curve | F, g | logistic in a, logistic in ln a, or Weibull: F(x) = 1 - exp(-exp(x)) in ln a; by AIC |
| upper asymptote | c | c - p_f in the place of 1 - p_f: places that are not visited are not found, however large |
| size found in 50, 90 % | a50, a90 | PoD(a50) = .5, PoD(a90) = .9 |
| penalised log likelihood | l | log likelihood + ln(det I) / 2, I the Fisher information of b0 and b1 |
| limit of a90 | a90/95 | largest a with 2 (l_max - l(a90 = a)) <= 2.706, l at its largest over b1, with c as fitted; \
4.605 if the best curve ends below 1: a90 and c are then in one joint region |

The most likely curve of few inspections is too steep, and its a90 too small. The penalty (Jeffreys; Firth 1993) takes
most of that away, and keeps the slope finite where all damage above a size was found and none below. Several curves
often fit alike, but differ near the top: a90/95 is the largest of those of all curves, with and without an asymptote,
that are not rejected at the same level. A fit that leaves p_f out takes false calls on small damage for detections, so
that a curve in ln a, which begins at 0, is too flat, and its a90 too large; the logistic curve in a, which does not,
hides them in its own foot.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from scipy import optimize
from scipy.ndimage import minimum_filter
from scipy.special import expit, logit, xlogy

from vibroswarm.errors import InputError, check_choice, whole_number_of
from vibroswarm.inspection.samples import Floats

INTACT: Final = 2000
"""Intact inspections that give p_f to half a percent."""
DROP: Final = 2.706
"""Chi squared with one degree of freedom at 90 %: a one-sided limit of 95 %."""
DROP_OF_TWO: Final = 4.605
"""The same with two degrees of freedom, where the asymptote is fitted, too."""
SEARCH: Final[Any] = {"xatol": 1e-5, "fatol": 1e-8, "maxiter": 4000}
"""Settings of the search for the largest likelihood."""
STEEP: Final = 10.0
"""Where the search begins: b1 over the range of sizes."""
SLOPES: Final = (2.0, 8.0, 30.0)
"""b1 over the range of sizes, at which other beginnings are tried."""
BEYOND: Final = 1.5
"""Sizes are looked for up to so many times the largest that was tried."""
NOTHING: Final = 1e-6
"""A difference of log likelihoods that is none."""
LEAST: Final = 1e-9
"""Least probability in a logarithm."""
STEP: Final = 1e-4
"""Step of the derivative of F."""
ABOUT: Final = np.array([[0.0], [STEP], [-STEP]])
"""Shifts of b0 at which F is computed: none for F itself, and one up and one down for its derivative."""


def _weibull(x: Floats) -> Floats:
    return np.asarray(-np.expm1(-np.exp(np.minimum(x, 30.0))))


def _of_weibull(share: float) -> float:
    return float(np.log(-np.log1p(-share)))


class _Curve(NamedTuple):
    g: Callable[[Any], Any]
    size: Callable[[Any], Any]
    """Inverse of ``g``."""
    share: Callable[[Any], Any]
    """F."""
    x: Callable[[Any], Any]
    """Inverse of ``share``."""


_CURVES: Final = {
    "size": _Curve(np.asarray, float, expit, logit),
    "log size": _Curve(np.log, np.exp, expit, logit),
    "Weibull": _Curve(np.log, np.exp, _weibull, _of_weibull),
}


@dataclass(frozen=True)
class Pod:
    """A fitted probability of detection; sizes are nan where they do not exist."""

    false_calls: float
    b0: float
    b1: float
    curve: Literal["size", "log size", "Weibull"]
    """Logistic in the size or in its logarithm, or Weibull."""
    a50_m: float
    a90_m: float
    a90_95_m: float
    """Upper 95 % limit of a90; nan: does not exist, because too few large patches were found."""
    trials: int
    intact: int
    largest_m: float
    """Largest size that was tried."""
    top: float = 1.0
    """Upper asymptote."""

    def at(self, size_m: Floats | float) -> Floats:
        """Return PoD at sizes; at size 0 of a curve in the logarithm it is the share of false calls."""
        curve = _CURVES[self.curve]
        with np.errstate(divide="ignore"):  # ln 0 is -inf, as it should be
            rise = curve.share(self.b0 + self.b1 * curve.g(np.asarray(size_m, dtype=np.float64)))
        return np.asarray(self.false_calls + (self.top - self.false_calls) * rise)


@dataclass(frozen=True)
class _Trials:
    """Inspections of damage, counted by size, and the curve that is fitted to them."""

    size_m: Floats
    found: Floats
    number: Floats
    p_f: float
    curve: _Curve
    g: Floats
    """``curve.g`` of the sizes."""

    def pod(self, b0: float | Floats, b1: float, top: float) -> Floats:
        rise = self.curve.share(b0 + b1 * self.g)
        # Limits are np.clip's, in half of its time: a fit asks for them thousands of times.
        return np.asarray(np.minimum(np.maximum(self.p_f + (top - self.p_f) * rise, LEAST), 1.0 - LEAST))

    def loss(self, p: Floats) -> float:
        """Return -ln likelihood of probabilities of detection."""
        return -float((xlogy(self.found, p) + xlogy(self.number - self.found, 1.0 - p)).sum())

    def penalised(self, b0: float, b1: float, top: float) -> float:
        """Return -ln likelihood - ln(det I) / 2."""
        p, above, below = self.pod(b0 + ABOUT, b1, top)  # of few sizes, all three take as long as one
        rise = (above - below) / (2.0 * STEP)
        weight = self.number * rise**2 / (p * (1.0 - p)) + LEAST**2
        total = weight.sum()
        about = self.g - (self.g * weight).sum() / total
        return self.loss(p) - 0.5 * float(np.log(total * (weight @ about**2)))

    def x_at(self, share: float, top: float) -> float:
        """Return b0 + b1 g(a) at which PoD is a share."""
        return float(self.curve.x((share - self.p_f) / (top - self.p_f)))


class _Fit(NamedTuple):
    """A curve of largest penalised likelihood."""

    name: Any
    trials: _Trials
    b0: float
    b1: float
    top: float

    @property
    def aic(self) -> float:
        """AIC, less what all curves have alike."""
        likely = self.trials.loss(self.trials.pod(self.b0, self.b1, self.top))
        return 2.0 * likely + 2.0 * (self.top < 1.0)

    def size_at(self, share: float) -> float:
        """Return the size at which PoD is a share, or the least that was tried; nan: none up to ``BEYOND``."""
        trials = self.trials
        if not trials.p_f < share < self.top or self.b1 <= 0.0:
            return float("nan")
        g = (trials.x_at(share, self.top) - self.b0) / self.b1
        if g > trials.curve.g(BEYOND * trials.size_m[-1]):
            return float("nan")
        return max(float(trials.curve.size(g)), float(trials.size_m[0]))

    def limit(self, drop: float) -> float:
        """Return a90/95 by profile likelihood at this asymptote; nan: none up to ``BEYOND``.

        Args:
            drop: twice the loss of log likelihood that is allowed.
        """
        trials, top, a90 = self.trials, self.top, self.size_at(0.9)
        if not np.isfinite(a90):
            return float("nan")
        least = trials.penalised(self.b0, self.b1, top)
        if top < 1.0:  # an asymptote that is not known well may be below 0.9, and then there is no a90
            _, lower = _search(lambda at: trials.penalised(at[0], at[1], 0.9), (self.b0, self.b1))
            if 2.0 * (lower - least) <= DROP:
                return float("nan")
        x = trials.x_at(0.9, top)
        steep = np.log(max(self.b1, 1.0 / np.ptp(trials.g)))

        def excess(size_m: float) -> float:
            """Return twice the loss of log likelihood if a90 is this size, less what is allowed."""
            g = float(trials.curve.g(size_m))
            found = optimize.minimize_scalar(
                lambda log: trials.penalised(x - np.exp(log) * g, np.exp(log), top),
                bounds=(steep - 5.0, steep + 5.0), method="bounded", options={"xatol": 1e-5},
            )  # fmt: skip
            return 2.0 * (float(found.fun) - least) - drop

        if excess(a90) > 0.0:  # the least size that was tried, where the curve's a90 is below it
            return a90
        high = a90
        while high < BEYOND * trials.size_m[-1]:
            high *= 1.04
            if excess(high) > 0.0:
                return float(optimize.brentq(excess, a90, high, xtol=1e-6))
        return float("nan")


def _search(loss: Callable[[Floats], float], start: Sequence[float]) -> tuple[Floats, float]:
    """Return where a loss is smallest, searched from ``start`` by Nelder and Mead's method, and how large it is."""
    minimize: Any = optimize.minimize  # its stubs allow no lambda
    found = minimize(loss, np.array(start), method="Nelder-Mead", options=SEARCH)
    return found.x, float(found.fun)


def _fit(name: str, trials: _Trials, ends_below: bool) -> _Fit:
    """Return the fit of a curve that ends at 1, or below."""
    middle, spread = float(np.average(trials.g, weights=trials.number)), float(np.ptp(trials.g))

    def curve_of(at: Sequence[float] | Floats) -> tuple[float, float, float]:
        """Return b0, b1 and the top from the height at the middle of the sizes, the slope, and the top as logit."""
        slope = at[1] / spread
        top = trials.p_f + (1.0 - trials.p_f) * float(expit(at[2])) if ends_below else 1.0
        return at[0] - slope * middle, slope, min(top, 1.0 - LEAST) if ends_below else top

    def loss(at: Sequence[float] | Floats) -> float:
        return trials.penalised(*curve_of(at))

    highest = [float(logit(np.clip((trials.found / trials.number).max(), 0.5, 0.98)))][:ends_below]
    at, least = _search(loss, [0.0, STEEP, *highest])
    # With few sizes, unevenly spread, there may be several valleys: each is searched. If the curve may end below 1, the
    # first search may run to a top of 1, where the loss is flat, and stay there.
    starts = [
        [[slope * (middle - a50) / spread, slope, *highest] for slope in SLOPES]
        for a50 in np.linspace(trials.g[0] - spread / 3, trials.g[-1] + spread / 3, 9)
    ]
    heights = np.array([[loss(start) for start in row] for row in starts])
    valleys = np.argwhere(heights == minimum_filter(heights, 3, mode="nearest"))
    if ends_below or len(valleys) > 1 or heights.min() < least:
        for row, column in valleys:
            other, lower = _search(loss, starts[row][column])
            if lower < least - NOTHING:
                at, least = other, lower
    return _Fit(name, trials, *curve_of(at))


def _flat(fit: _Fit) -> _Fit:
    """Return a curve that does not rise: at the share of all damage that was found."""
    trials = fit.trials
    share = (trials.found.sum() + 0.5) / (trials.number.sum() + 1.0)
    rise = np.clip((share - trials.p_f) / (1.0 - trials.p_f), LEAST, 1.0 - LEAST)
    return _Fit(fit.name, trials, float(trials.curve.x(rise)), LEAST, 1.0)


def fit_pod(
    size_m: Floats, found: Floats, false: int, intact: int, *, floor: bool = True, asymptote: bool = False,
    curves: Collection[str] = tuple(_CURVES),
) -> Pod:  # fmt: skip
    """Fit PoD to inspections.

    Args:
        size_m, found: size of the damage of each inspection, and whether it was called (1) or not (0), (inspections,).
        false, intact: number of intact surfaces that were called, and that were inspected.
        floor: whether the curve begins at p_f; without, only for the control, which a curve in ln a fails.
        asymptote: whether the curve may end below 1, by AIC, as where coverage is incomplete.
        curves: names of those that are tried.
    Raises:
        InputError: there are fewer than 20 inspections, of fewer than 3 sizes, or none of intact surfaces, or
            more false calls than these; or there is no such curve.
    """
    sizes, at = np.unique(np.asarray(size_m, dtype=np.float64), return_inverse=True)
    if at.size < 20 or sizes.size < 3:
        raise InputError("a curve needs at least 20 inspections, of at least 3 sizes", field="sizes")
    if floor and intact < 1:
        raise InputError("a curve needs inspections of intact surfaces, for its false calls", field="intact")
    if floor:
        whole_number_of(false, "false", 0, intact)
    number = np.bincount(at).astype(np.float64)
    hits = np.bincount(at, np.asarray(found, dtype=np.float64)).astype(np.float64)
    p_f = false / intact if floor else 0.0
    fits = []
    if not curves:
        raise InputError(f"is empty; give some of {', '.join(_CURVES)}", field="curves")
    for name in curves:
        check_choice(name, "curves", _CURVES)
        curve = _CURVES[name]
        trials = _Trials(sizes, hits, number, p_f, curve, curve.g(sizes))
        fits += [_fit(name, trials, ends_below) for ends_below in (False, True)[: 1 + asymptote]]
    # Where nearly all damage is found, a fitted curve may fall with size. A flat one is taken if it fits as well.
    rising, flat = [fit for fit in fits if fit.b1 > 0.0], _flat(fits[0])
    if not rising and flat.aic - min(fit.aic for fit in fits) <= DROP:
        rising = [flat]
    fits = rising or fits
    best = min(fits, key=lambda fit: fit.aic)
    # Beyond the sizes that were tried the curve says nothing.
    a50, a90 = (size if size <= sizes[-1] else float("nan") for size in map(best.size_at, (0.5, 0.9)))
    drop = DROP if best.top == 1.0 else DROP_OF_TWO
    limits = [fit.limit(drop) for fit in fits if fit.aic - best.aic <= DROP]
    limit = float(np.max(limits)) if np.isfinite(a90) else float("nan")  # nan if one of them is
    return Pod(
        p_f, best.b0, best.b1, best.name, a50, a90, limit, int(at.size), intact, float(sizes[-1]), best.top
    )
