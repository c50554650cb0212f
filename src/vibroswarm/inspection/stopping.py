"""May one stop? The posterior risk of damage that was missed, and how often damage would be cleared.

| name | symbol | equation |
|---|---|---|
| statistic | T | ln of the mean of L_j over all places of the least size, at the weakest contrast |
| posterior risk | - | logit = b0 + b1 T + logit pi, fitted to ``DRAWN`` intact and as many damaged surfaces |
| missed | - | share of the drawn damage that would be cleared all the same |

Surfaces are drawn at this inspection's own places, with the error of the law and the factors of robots and tiles
(``damage``). Damage is of the least size and the weakest contrast: an average over sizes promises too much. T takes
samples as independent; what they share makes b1 smaller than 1, so that the risk holds all the same. Knowing which
samples share a tile would clear weak damage on a known grid earlier; this rule does not use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit, logsumexp

from vibroswarm.inspection.damage import drawn_parts, judged, ratios_at, squares_at
from vibroswarm.inspection.patches import declared, log_likelihoods, shares_of
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.statistics.intervals import Interval, generator, wilson

DRAWN: Final = 500
"""Intact, and damaged, surfaces that are drawn."""


@dataclass(frozen=True)
class Question:
    """What an inspection must find, and how sure it must be to stop."""

    least_m: float = 0.10
    """Side of the smallest patch that must be found."""
    contrasts: tuple[float, ...] = (1.0, 0.75, 0.5)
    """Contrasts that damage may have; the risk is that of the weakest."""
    prior: float = 0.5
    """Probability of damage before any sample."""
    risk: float = 0.05
    """Tolerated probability of damage after clearing."""
    level: float = 0.05
    """Tolerated share of false calls: intact surfaces that are called damaged."""


class Stopping(NamedTuple):
    """The posterior risk of damage, and how often the rule clears."""

    risk: float
    """Probability of damage, given the samples."""
    missed: Interval
    """Share of damage of the least size and the weakest contrast that would be cleared, with 95 % limits."""
    cleared: Interval
    """Share of intact surfaces that would be cleared."""


def stopping(samples: Samples, question: Question, *, drawn: int = DRAWN, seed: int = 1) -> Stopping:
    """Return the risk of having missed damage, by drawn surfaces."""
    statistic = statistic_for(samples, question)
    random, contrast = generator(seed, "risk"), min(question.contrasts)
    squares = squares_at(random, np.full(drawn, question.least_m), samples.size_m, contrast)
    intact, damaged = (
        np.concatenate([statistic(part, True) for part in drawn_parts(random, samples, drawn, patch)])
        for patch in (None, squares)
    )
    risk = risk_curve(intact, damaged, question.prior)
    missed, cleared = (wilson(int((risk(t) <= question.risk).sum()), drawn) for t in (damaged, intact))
    observed = statistic(samples.column("value")[:, None], False)
    return Stopping(float(risk(observed)[0]), missed, cleared)


def statistic_for(samples: Samples, question: Question) -> Callable[[Floats, bool], Floats]:
    """Return the function that gives T of values, (samples, replicates), and whether these are drawn."""
    patches = declared(samples.size_m, [question.least_m])
    shares = shares_of(samples, patches)
    ratios = partial(ratios_at, contrast=min(question.contrasts))

    def statistic(values: Floats, is_drawn: bool) -> Floats:
        logs = judged(samples.law, values, ratios) if is_drawn else ratios(samples.law, values)
        return np.asarray(logsumexp(log_likelihoods(shares, logs), axis=0) - np.log(patches.places[0]))

    return statistic


def risk_curve(intact: Floats, damaged: Floats, prior: float) -> Callable[[Floats], Floats]:
    """Return the posterior risk as a function of T, by T of as many intact and damaged surfaces."""
    t, sign = np.concatenate([intact, damaged]), np.repeat([-1.0, 1.0], [intact.size, damaged.size])
    centre, scale = t.mean(), t.std() + 1e-12

    def loss(b: Floats) -> float:
        wrong = np.logaddexp(0.0, -sign * (b[0] + b[1] * (t - centre) / scale)).sum()
        return float(wrong + 1e-3 * (b @ b))  # where all are told apart the slope stays finite

    b = minimize(loss, [0.0, 1.0]).x
    return lambda at: np.asarray(expit(b[0] + b[1] * (at - centre) / scale + logit(prior)))
