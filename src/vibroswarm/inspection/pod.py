"""Probability of detection (PoD) against the size of damage, fitted to inspections of known damage.

| name | symbol | equation |
|---|---|---|
| probability of detection | PoD(a) | p_f + (1 - p_f) F(b0 + b1 ln a), F logistic (log-odds, MIL-HDBK-1823A) |
| false calls | p_f | share of intact surfaces that are called |
| size found in 50, 90 % | a50, a90 | PoD(a50) = .5, PoD(a90) = .9 |
| penalised log likelihood | l | log likelihood + ln(det I) / 2, I the Fisher information of b0 and b1 |
| limit of a90 | a90/95 | largest a with 2 (l_max - l(a90 = a)) <= 2.706, l at its largest over b1 |

The most likely curve of few inspections is too steep, and its a90 too small. The penalty (Jeffreys; Firth 1993) takes
most of that away, and keeps the slope finite where all damage above a size was found and none below. A fit that leaves
p_f out takes false calls on small damage for detections.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from scipy import optimize
from scipy.special import expit, logit, xlogy

from vibroswarm.inspection.samples import Floats

INTACT: Final = 2000
"""Intact inspections that give p_f to half a percent."""
DROP: Final = 2.706
"""Chi squared with one degree of freedom at 90 %: a one-sided limit of 95 %."""
BEYOND: Final = 1.5
"""a90/95 is looked for up to so many times the largest size that was tried."""
STARTS: Final = (2.0, 6.0, 20.0)
"""Slopes b1 from which the largest likelihood is looked for."""


class Pod(NamedTuple):
    """A fitted probability of detection; sizes are nan where they do not exist."""

    false_calls: float
    b0: float
    b1: float
    a50_m: float
    a90_m: float
    a90_95_m: float
    """Upper 95 % limit of a90."""
    trials: int

    def at(self, size_m: Floats | float) -> Floats:
        """Return PoD at sizes."""
        return np.asarray(
            self.false_calls + (1.0 - self.false_calls) * expit(self.b0 + self.b1 * np.log(size_m))
        )


def fit_pod(size_m: Floats, found: Floats, false: int, intact: int) -> Pod:
    """Fit PoD to inspections."""
    sizes, at = np.unique(size_m, return_inverse=True)
    number, hits = np.bincount(at), np.bincount(at, found)
    p_f, log_size = false / intact, np.log(sizes)
    centre, largest = float(log_size.mean()), float(log_size[-1])

    def penalised(b0: float, b1: float) -> float:
        rise = expit(b0 + b1 * (log_size - centre))
        p = np.clip(p_f + (1.0 - p_f) * rise, 1e-9, 1.0 - 1e-9)
        weight = number * ((1.0 - p_f) * rise * (1.0 - rise)) ** 2 / (p * (1.0 - p)) + 1e-18
        about = log_size - np.average(log_size, weights=weight)
        likely = float((xlogy(hits, p) + xlogy(number - hits, 1.0 - p)).sum())
        return -likely - 0.5 * float(np.log(weight.sum() * (weight @ about**2)))

    minimize: Any = optimize.minimize  # its stubs allow no lambda
    fits = [minimize(lambda b: penalised(*b), [0.0, start], method="Nelder-Mead") for start in STARTS]
    (b0, b1), least = min(((fit.x, fit.fun) for fit in fits), key=lambda fit: fit[1])

    def log_size_at(share: float) -> float:
        """Return ln of the size found in a share of inspections; nan: none that was tried."""
        at = (logit((share - p_f) / (1.0 - p_f)) - b0) / b1 + centre if p_f < share and b1 > 0.0 else np.nan
        return float(at) if at <= largest else float("nan")

    a90 = log_size_at(0.9)

    def excess(log_a: float) -> float:
        """Return twice the loss of log likelihood if ln a90 is this, less what is allowed."""
        x, steep = logit((0.9 - p_f) / (1.0 - p_f)), np.log(max(b1, 0.3))
        found = optimize.minimize_scalar(
            lambda log: penalised(x - np.exp(log) * (log_a - centre), np.exp(log)),
            bounds=(steep - 5.0, steep + 5.0), method="bounded",
        )  # fmt: skip
        return float(2.0 * (found.fun - least) - DROP)

    high, limit = largest + np.log(BEYOND), float("nan")
    if np.isfinite(a90) and excess(high) > 0.0:
        limit = float(optimize.brentq(excess, a90, high, xtol=1e-5))
    a50_m, a90_m, a90_95_m = np.exp([log_size_at(0.5), a90, limit]).tolist()
    return Pod(p_f, float(b0 - b1 * centre), float(b1), a50_m, a90_m, a90_95_m, at.size)
