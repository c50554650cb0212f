"""Is there damage, what would have been missed, may one stop, and does the law hold? All of one inspection.

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

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Final, Literal, NamedTuple

import numpy as np
import polars as pl
from scipy.optimize import minimize
from scipy.special import expit, logit, logsumexp

from vibroswarm.inspection.checks import law_checks
from vibroswarm.inspection.damage import drawn_parts, judged, ratios_at, squares_at
from vibroswarm.inspection.patches import SIZES_M, Sides, declared, log_likelihoods, shares_of
from vibroswarm.inspection.pod import Pod, own_trials
from vibroswarm.inspection.samples import Doubt, Floats, Samples
from vibroswarm.inspection.scan import REPLICATES, Scan, scan
from vibroswarm.observation.energy_model import is_sensed
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


VISITED_M: Final = 0.1
"""Cells of this side are visited if a sample was taken in them."""


class Refusal(Enum):
    """Why nothing is certified, besides a doubt about the samples."""

    REFUSED = "the samples contradict the law of the sensor"
    NEIGHBOURS = (
        "what the sensor measures depends on the tiles around, but its law is a mean over mixed floors"
    )
    UNCHECKED = "too few samples are on still places to check the law"
    ONE_ROBOT = "one robot took all samples: its sensor cannot be compared with another"


@dataclass(frozen=True, eq=False)
class Assessment:
    """All answers of one inspection about damage that is not bound to a grid."""

    question: Question
    scan: Scan
    stopping: Stopping
    pods: dict[float, Pod]
    """Fitted probability of detection of squares, by contrast."""
    checks: pl.DataFrame
    """Checks of the law (``checks.law_checks``)."""
    refusals: tuple[Refusal | Doubt, ...]
    """Reasons not to certify anything; empty: none."""
    visited: float
    """Share of the surface's cells of 10 cm in which a sample was taken."""

    @property
    def verdict(self) -> Literal["damage", "clear", "open", "refused"]:
        """Return "refused" if the samples contradict the law, "damage" if the scan calls it, or "clear" or "open"."""
        if Refusal.REFUSED in self.refusals:
            return "refused"
        if self.scan.p_value <= self.question.level:
            return "damage"
        return "clear" if self.stopping.risk <= self.question.risk else "open"


def assess(
    samples: Samples, question: Question | None = None, *, sides_m: Sequence[float | Sides] = SIZES_M,
    replicates: int = REPLICATES, seed: int = 1, progress: Callable[[float], None] | None = None,
) -> Assessment:  # fmt: skip
    """Answer a question about damage by the samples of one inspection."""
    question = question or Question()
    done = progress or (lambda share: None)
    if not samples.law.has_contrasts:
        question = replace(question, contrasts=(1.0,))
    stops = stopping(samples, question, seed=seed)
    patches = declared(samples.size_m, sides_m)
    shares = shares_of(samples, patches)
    done(0.2)
    found = scan(
        samples, patches, shares,
        prior=question.prior, level=question.level, replicates=replicates, seed=seed,
    )  # fmt: skip
    done(0.5)
    checks = law_checks(samples, found.called_m, seed=seed)
    done(0.6)
    pods = {
        contrast: own_trials(samples, patches, shares, found.critical, contrast=contrast, seed=seed + 1).fit()
        for contrast in question.contrasts
    }
    refusals: tuple[Refusal | Doubt, ...] = (*samples.doubts, *_refusals(samples, checks))
    return Assessment(question, found, stops, pods, checks, refusals, _visited(samples))


def _refusals(samples: Samples, checks: pl.DataFrame) -> Iterator[Refusal]:
    if "refused" in checks["outcome"]:
        yield Refusal.REFUSED
    if is_sensed(samples.law.sensor):
        yield Refusal.NEIGHBOURS
    if checks["outcome"][0] == "not made":
        yield Refusal.UNCHECKED
    if len(samples.robots) == 1:
        yield Refusal.ONE_ROBOT


def _visited(samples: Samples) -> float:
    bins = [max(1, round(whole / VISITED_M)) for whole in samples.size_m]
    ends = [(0.0, whole) for whole in samples.size_m]
    return float((np.histogram2d(samples.column("x_m"), samples.column("y_m"), bins, ends)[0] > 0).mean())
