"""Compute whether a question can be decided at all: is the expected share of ones on the right side of the boundary?

| name | symbol | equation |
|---|---|---|
| fill ratio, boundary | f, x | the question: is f above x? |
| tested boundary | q(x) | what robots compare the share of ones with: x itself, or q of a floor whose f is x |
| share of ones expected | q | ``decision_boundary.expected_ones_on``, at uniformly random places of the arena |
| margin | - | q - q(x) where f > x, q(x) - q where f < x: above 0 is the right side |
| samples needed | n | P(share of n independent bits is not on q's side of q(x)) <= error |

With ``boundary_of = "readings"`` q(x) = x: if the sensor's errors do not balance at the boundary, q is on the wrong
side near it, and **more samples make the wrong answer surer**. With ``"tiles"`` robots correct for the errors that
they claim; q is that of the true law. Feedback makes the answer to which own samples lean faster and surer, no other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr, bdtrc, ndtri

from vibroswarm.core.numbers import percent
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.outcomes import truth_on
from vibroswarm.observation.decision_boundary import (
    expected_classes_on,
    expected_ones_on,
    readings_boundary,
)
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.statistics.intervals import wilson_limits

Word = Literal[
    "decidable", "wrong side", "on the boundary", "indistinguishable from the boundary", "not assessed"
]
SENTENCES: Final[dict[Word, str]] = {
    "decidable": "on the right side, so that it can be decided",
    "wrong side": "on the wrong side, so that more samples make the wrong answer more certain",
    "on the boundary": "it is decided by chance, or neither decision is right",
    "indistinguishable from the boundary": "the samples are too few to tell on which side that is",
    "not assessed": "this does not say whether these robots can decide the question",
}
"""What each verdict means."""

ON = 1e-9
"""A share closer to the boundary than this is on it."""


@dataclass(frozen=True)
class Decidability:
    """Whether the question can be decided from own samples."""

    verdict: Word
    """On which side of the tested boundary the share of ones is, in a word."""
    seen: str
    """The share, in words."""
    tested: float
    """The share of ones with which robots compare: the boundary itself, or the share of ones expected at it."""
    truth: int | None
    """1: the fill ratio is above the boundary; 0: below; None: neither decision is right."""
    share: float
    """Share of ones, expected or observed."""
    margin: float | None
    """Distance of the share to the tested boundary, positive on the right side; None if neither decision is right."""
    fill_ratio: float | None = None
    """f, if the share is computed from a floor."""
    share_low: float | None = None
    """Lower limit of a measured share."""
    share_high: float | None = None
    """Upper limit of a measured share."""
    samples_needed: int | None = None
    """Independent samples for the wanted error; None unless two kinds of tile are decidable."""

    @property
    def says(self) -> str:
        """The verdict in a sentence."""
        return f"{self.seen}: {SENTENCES[self.verdict]}."

    @property
    def is_warning(self) -> bool:
        """Whether a report must warn of the verdict: the question was assessed, and is not decidable."""
        return self.verdict not in ("decidable", "not assessed")


def decidability(scenario: Scenario, error: float = 0.05, floor: Floor | None = None) -> Decidability:
    """Compute whether a scenario's question can be decided from the samples that its swarm will take.

    "not assessed" for a task other than ``fill_ratio``, and, unless the share of ones is on the right side, for robots
    that weigh readings by error rates.

    Args:
        error: wanted probability of a wrong majority of bits, for ``samples_needed``.
        floor: by default that of run 0 with seed 0; of a floor that changes, the one at the end of the run counts.
    """
    floor, sensor = (floor or scenario.floor_for(0, 0)).at(scenario.run.t_end_s), scenario.sensor
    size = scenario.arena.size_m
    fill = floor.fill_ratio_within(*size)
    truth = truth_on(scenario, floor)
    if max(sensor.kinds, sensor.readings) > 2:
        found = _of_kinds(scenario, floor, truth)
    else:
        share = expected_ones_on(sensor, floor, size)
        found = decidability_of_share(share, readings_boundary(scenario), truth, error=error)
        if not _is_assessed(scenario, floor, found):
            found = replace(found, verdict="not assessed", samples_needed=None)
    when = "Floor at the end: " if scenario.change.is_given else ""
    return replace(found, seen=when + found.seen, fill_ratio=fill)


def _of_kinds(scenario: Scenario, floor: Floor, truth: int | None) -> Decidability:
    """Return whether the most common kind of tile, ``truth``, is read most often on this floor."""
    sensor = scenario.sensor
    verdict: Word = "decidable"
    shares = expected_classes_on(sensor, floor, scenario.arena.size_m)
    read = int(shares.argmax())
    margin = None if truth is None else float(shares[truth] - np.delete(shares, truth).max())
    seen = f"{percent(shares[read])} of the samples read as kind {read}, more than as any other"
    if scenario.task.name != "majority" or sensor.kinds != sensor.readings:
        verdict, margin = "not assessed", None
    elif margin is None or abs(margin) < ON:
        verdict = "on the boundary"
    elif margin < 0.0:
        verdict, seen = "wrong side", f"{seen}, but kind {truth} is the most common"
    boundary = scenario.decision.decision_boundary
    return Decidability(verdict, seen, boundary, truth, float(shares[1]), margin)


def _is_assessed(scenario: Scenario, floor: Floor, found: Decidability) -> bool:
    """Return whether the share of ones says what robots decide."""
    if scenario.task.name != "fill_ratio" or floor.has_contrasts or floor.patches:
        return False
    strategy, decision = scenario.strategy.entry, scenario.decision
    assumed = (decision.assumed_false_positive, decision.assumed_false_negative)
    knows_rates = strategy is not None and strategy.knows_error_rates and assumed == (None, None)
    return not knows_rates or found.truth is None or found.verdict == "decidable"


def decidability_of_share(
    share: float,
    boundary: float,
    truth: int | None,
    effective_samples: float | None = None,
    level: float = 0.95,
    error: float = 0.05,
) -> Decidability:
    """Compute from a share of ones, measured or exact, whether the question can be decided.

    Args:
        boundary: the tested boundary. truth: 1: the fill ratio is above the boundary of the question, 0: below.
        effective_samples: independent samples behind a measured share, which give it an interval; None: it is exact.
    """
    low, high = None, None
    if effective_samples is not None and math.isfinite(effective_samples):
        limits = wilson_limits(share * effective_samples, effective_samples, level)
        low, high = (float(limit) for limit in limits)
    margin = None if truth is None else (share - boundary) * (1 if truth == 1 else -1)
    verdict: Word = "on the boundary"
    if margin is not None and low is not None and high is not None and low <= boundary <= high:
        verdict = "indistinguishable from the boundary"
    elif margin is not None and abs(margin) >= ON:
        verdict = "decidable" if margin > 0.0 else "wrong side"
    seen = f"{percent(share)} of the samples read as vibrating, which robots compare with {percent(boundary)}"
    return Decidability(
        verdict=verdict,
        seen=seen,
        tested=boundary,
        truth=truth,
        share=share,
        margin=margin,
        share_low=low,
        share_high=high,
        samples_needed=samples_needed(share, boundary, error) if verdict == "decidable" else None,
    )


def observed_share(tile: ArrayLike, bits: ArrayLike) -> float:
    """Return the mean over sampled tiles of each tile's share of ones; nan without samples on tiles.

    Args:
        tile, bits: tile (-1: none) and bit of each sample, (samples,).
    """
    tile_of, bit = np.asarray(tile, dtype=np.int64), np.asarray(bits, dtype=np.float64)
    on = tile_of >= 0
    visits = np.bincount(tile_of[on])
    ones = np.bincount(tile_of[on], bit[on])
    return float((ones[visits > 0] / visits[visits > 0]).mean()) if on.any() else math.nan


@lru_cache(maxsize=256)
def samples_needed(share: float, boundary: float, error: float = 0.05) -> int | None:
    """Compute how many independent samples decide on which side of the boundary the true share of ones lies.

    With this number of samples or more, the observed share lies on the same side of the boundary as the true share
    with a probability of at least 1 - ``error``. The number is computed from the binomial law (an observed share on the
    boundary counts as an error), or by the normal approximation if it is above some 100,000. It is None if the true
    share is on the boundary. Divide the number by effective samples per second to get a time.

    Args:
        share: the true share of ones. boundary: share with which it is compared. error: wanted probability, below 0.5,
            that the observed share is on the wrong side.
    """
    distance = abs(share - boundary)
    if distance < ON:
        return None
    normal = math.ceil((float(ndtri(error)) * math.sqrt(share * (1.0 - share)) / distance) ** 2)
    if normal > 100_000:
        return normal
    # The error is not monotonic in n, since counts are whole. So the error is computed for all n up to about twice the
    # normal approximation (and a margin, as small n may need more); the answer is the n after the last one whose error
    # is too large.
    n = np.arange(1, 2 * normal + 2 * math.ceil(1.0 / distance) + 50)
    # ON: a product that differs from a whole number by rounding alone counts as that number.
    if share > boundary:
        wrong = bdtr(np.floor(boundary * n + ON), n, share)  # P(ones <= boundary n)
    else:
        wrong = bdtrc(np.ceil(boundary * n - ON) - 1, n, share)  # P(ones >= boundary n)
    over = np.flatnonzero(wrong > error)
    return int(n[over[-1]]) + 1 if over.size else 1
