"""Can it be decided at all? Whether the bits lean to the right side of the boundary, and what would mend it.

| name | symbol | equation |
|---|---|---|
| fill ratio, boundary | f, x | the question: is f above x? |
| tested boundary | q(x) | what the share of ones is held against: x, or q of a floor at x (``observation.boundary``) |
| false positive, false negative | a(theta), b(theta) | of the sensor at the threshold theta |
| spill | s | share felt as vibrating beyond f, where vibration reaches across tile edges |
| tiled share of the arena | c | places off all tiles read as still ones do, where no vibration reaches them |
| share of ones expected | q | c [g (1 - b) + (1 - g) a] + (1 - c) a, g = f + s, at uniformly random places |
| margin | - | q - q(x) where f > x, q(x) - q where f < x: above 0 is the right side |
| threshold that mends | theta_- < theta < theta_+ | q of f and q of its mirror 2x - f both on their right sides of x |
| samples needed | n | P(share of n independent bits not on q's side of q(x)) <= error |

With ``boundary_of = "readings"`` a robot takes each bit at its word, as if no sensor erred: q(x) = x. So when false
positives and negatives do not balance at the boundary, floors near it lean to the wrong side, and **more samples make
the wrong answer surer**. q falls as theta grows; a threshold that is right for f alone (some always is) may only lean
all floors one way, so it has to do for the mirror image of f across the boundary too (with the same spill). Where
vibrating tiles do not read higher than still ones none does.

With "tiles" robots allow for the errors: only mistaken rates, or a floor whose edges lie otherwise than those of random
floors, can put it on the wrong side.

This speaks of own samples. Under soft or positive feedback robots hear beliefs and decisions in place of readings: an
echo, which makes a lean, right or wrong, faster and surer, and cannot turn it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from vibroswarm.analysis.intervals import check_level, plain, wilson_limits
from vibroswarm.core.notebook_view import NotebookView, html_view
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.inference.outcomes import truth_on
from vibroswarm.observation.decision_boundary import readings_boundary, sensed_shares_on, tiled_share
from vibroswarm.observation.energy_model import error_rates
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario

Word = Literal[
    "decidable", "wrong side", "on the boundary", "indistinguishable from the boundary", "not assessed"
]

ON = 1e-9
"""A share closer to the boundary than this is on it."""
_EXACT_UP_TO = 100_000
_STEPS = 200


@dataclass(frozen=True)
class Decidability(NotebookView):
    """Whether the question can be decided from own samples; see the head of this module."""

    verdict: Word
    says: str
    boundary: float
    """The boundary of the question."""
    tested: float
    """The share of ones with which robots compare: the boundary itself, or the share of ones expected at it."""
    truth: int | None
    share: float
    """Share of ones, expected or observed."""
    margin: float | None
    """Distance to the boundary, positive on the right side; None if neither decision is right."""
    fill_ratio: float | None = None
    share_low: float | None = None
    share_high: float | None = None
    effective_samples: float | None = None
    samples_needed: int | None = None
    """Independent samples for the wanted error; None if no number suffices."""
    threshold: float | None = None
    mending_low: float | None = None
    mending_high: float | None = None
    """Thresholds between these put neither f nor its mirror on the wrong side; None: none, or not computed."""

    @property
    def is_warning(self) -> bool:
        """Whether a report must warn of it."""
        return self.verdict not in ("decidable", "not assessed")

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: plain(value) for name, value in self.__dict__.items()}


def decidability(scenario: Scenario, error: float = 0.05, floor: Floor | None = None) -> Decidability:
    """Decide whether a scenario's question is decidable from the samples that its swarm will take.

    Args:
        error: the probability of a wrong majority that ``samples_needed`` is for.
        floor: by default that of run 0 with seed 0; random floors share its fill ratio unless the arena cuts them.
    """
    floor, sensor = floor or scenario.floor_for(0, 0), scenario.sensor
    size = (scenario.arena.width_m, scenario.arena.height_m)
    fill, tiled = floor.fill_ratio_within(*size), tiled_share(floor.geometry, size)
    boundary, tested = scenario.decision.decision_boundary, readings_boundary(scenario)
    truth = truth_on(scenario, floor, fill)
    felt = sensed_shares_on(sensor, floor, size)
    spillover = (felt.detected + felt.spillover - felt.vibrating) / tiled
    share = expected_share(sensor, fill, tiled, spillover)
    of_shares = scenario.task.name == "fill_ratio"
    verdict = _side(share, tested, truth) if of_shares else "not assessed"
    says = (
        _words(verdict, share, boundary, tested, truth)
        if of_shares
        else f"Whether the task '{scenario.task.name}' is decidable cannot be computed from the share of ones."
    )
    low, high, mend = None, None, ""
    if of_shares and scenario.decision.boundary_of == "readings":
        low, high = mending_thresholds(sensor, fill, boundary, tiled, spillover) or (None, None)
        mend = _mend(verdict, sensor.rms_threshold, low, high)
    return Decidability(
        verdict=verdict,
        says=says + mend,
        boundary=boundary,
        tested=tested,
        truth=truth,
        share=share,
        margin=_margin(share, tested, truth),
        fill_ratio=fill,
        samples_needed=samples_needed(share, tested, error) if verdict == "decidable" else None,
        threshold=sensor.rms_threshold,
        mending_low=low,
        mending_high=high,
    )


def decidability_of_share(
    share: float,
    boundary: float,
    truth: int | None,
    effective_samples: float | None = None,
    level: float = 0.95,
    error: float = 0.05,
) -> Decidability:
    """Judge a measured share of ones as ``decidability`` does the expected one.

    Args:
        share: of ones. truth: 1 if more than the boundary vibrates, else 0; None: neither.
        effective_samples: number of independent samples behind the share; None: it is exact.
        level: of the share's interval. error: of the samples needed.

    Raises:
        InputError: a share, level or error outside its range.
    """
    if not 0.0 <= share <= 1.0:
        raise InputError(f"{share!r} is not a share; give a number from 0 to 1", field="share")
    check_level(level)
    verdict, low, high = _side(share, boundary, truth), None, None
    says = _words(verdict, share, boundary, boundary, truth)
    if effective_samples is not None and math.isfinite(effective_samples):
        limits = wilson_limits(share * effective_samples, effective_samples, level)
        low, high = (float(limit) for limit in limits)
        if truth is not None and low <= boundary <= high:
            verdict = "indistinguishable from the boundary"
            says = (
                f"{share:.1%} of the samples read as vibrating, {low:.1%} to {high:.1%} as the samples go: "
                f"this is indistinguishable from the boundary of {boundary:.1%}."
            )
    return Decidability(
        verdict=verdict,
        says=says,
        boundary=boundary,
        tested=boundary,
        truth=truth,
        share=share,
        margin=_margin(share, boundary, truth),
        share_low=low,
        share_high=high,
        effective_samples=effective_samples,
        samples_needed=samples_needed(share, boundary, error) if verdict == "decidable" else None,
    )


def expected_share(sensor: Sensor, fill_ratio: float, tiled: float = 1.0, spillover: float = 0.0) -> float:
    """Compute q, the share of samples at uniformly random positions that read as vibrating."""
    false_positive, false_negative = error_rates(sensor)
    felt = min(max(fill_ratio + spillover, 0.0), 1.0)
    on_tiles = felt * (1.0 - false_negative) + (1.0 - felt) * false_positive
    return tiled * on_tiles + (1.0 - tiled) * false_positive  # q


@lru_cache(maxsize=256)
def mending_thresholds(
    sensor: Sensor, fill_ratio: float, boundary: float, tiled: float = 1.0, spillover: float = 0.0
) -> tuple[float, float] | None:
    """Find (theta_-, theta_+), between which thresholds are right for the fill ratio and its mirror; None if none are.

    The mirror is 2x - f, or the nearest possible fill ratio. On the boundary itself both are the threshold at which
    the sensor's errors balance.
    """
    mirror = min(max(2.0 * boundary - fill_ratio, 0.0), 1.0)
    lower, upper = sorted((fill_ratio, mirror))

    def crossing(fill: float) -> float:
        """Find the threshold at which q falls below the boundary."""
        return _falls_through(
            lambda theta: expected_share(
                sensor.model_copy(update={"rms_threshold": theta}), fill, tiled, spillover
            ),
            boundary,
        )

    low, high = crossing(lower), crossing(upper)
    right_way = crossing(1.0) > crossing(0.0)
    return (low, high) if high >= low and right_way else None


def _falls_through(share: Callable[[float], float], level: float) -> float:
    """Find the threshold at which the decreasing ``share`` falls to ``level``, by bisection; 0 if it is never above."""
    low, high = 0.0, 1.0
    if share(low) <= level:
        return low
    while share(high) > level:
        high *= 2.0
    for _ in range(_STEPS):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (middle, high) if share(middle) > level else (low, middle)
    return high


class ObservedShare(NamedTuple):
    """Share of ones with equal weight for each tile, and the number of independent samples to which it corresponds."""

    share: float
    standard_error: float
    effective_samples: float
    tiles: int
    """Number of tiles that were sampled; others are left out."""

    def _repr_html_(self) -> str:
        return html_view(self)


def observed_share(tile: ArrayLike, bits: ArrayLike) -> ObservedShare:
    """Estimate the share of ones under unlimited even sampling of the sampled tiles.

    It is the mean over tiles of each tile's share of ones, so that unequal visits do not matter. Its
    variance is the sum of p (1 - p) / n over tiles, over their number squared, with p = (ones + 1/2) / (n + 1).
    Without a sample on a tile the share is nan.

    Args:
        tile: tile of each sample, -1 for none. bits: what it read; both of shape (samples,).
    """
    tile_of, bit = np.asarray(tile, dtype=np.int64).ravel(), np.asarray(bits, dtype=np.float64).ravel()
    on = tile_of >= 0
    visits = np.bincount(tile_of[on])
    ones, n = np.bincount(tile_of[on], bit[on])[visits > 0], visits[visits > 0].astype(np.float64)
    if n.size == 0:
        return ObservedShare(math.nan, math.nan, 0.0, 0)
    share, smooth = float((ones / n).mean()), (ones + 0.5) / (n + 1.0)
    variance = float((smooth * (1.0 - smooth) / n).sum()) / n.size**2
    variance_of_one = max(share * (1.0 - share), float((smooth * (1.0 - smooth)).mean()))
    return ObservedShare(share, math.sqrt(variance), variance_of_one / variance, n.size)


def samples_needed(share: float, boundary: float, error: float = 0.05) -> int | None:
    """Compute how many independent samples put the share of ones on its own side of the boundary but for ``error``.

    Exact (binomial; a share on the boundary counts as an error) up to some 100,000, normal beyond; None on the
    boundary. Divide by effective samples per second to get a time.

    Raises:
        InputError: an error that is not between 0 and 0.5.
    """
    if not 0.0 < error < 0.5:
        raise InputError(f"{error!r} is not an error to aim at; give a share below 0.5", field="error")
    distance = abs(share - boundary)
    if distance < ON:
        return None
    z = float(-ndtri(error))
    normal = math.ceil((z * math.sqrt(share * (1.0 - share)) / distance) ** 2)
    if normal > _EXACT_UP_TO:
        return normal
    from scipy import stats  # half a second, for this alone

    n = np.arange(1, 2 * normal + 2 * math.ceil(1.0 / distance) + 50)
    at = boundary * n
    if share > boundary:
        wrong = stats.binom.cdf(np.floor(at + ON), n, share)
    else:
        wrong = stats.binom.sf(np.ceil(at - ON) - 1, n, share)
    over = np.flatnonzero(wrong > error)
    return int(n[over[-1]]) + 1 if over.size else 1


def _side(share: float, boundary: float, truth: int | None) -> Word:
    if truth is None or abs(share - boundary) < ON:
        return "on the boundary"
    return "decidable" if (share > boundary) == (truth == 1) else "wrong side"


def _margin(share: float, boundary: float, truth: int | None) -> float | None:
    return None if truth is None else (share - boundary) * (1 if truth == 1 else -1)


def _words(verdict: Word, share: float, boundary: float, tested: float, truth: int | None) -> str:
    """Write the verdict as a sentence."""
    if truth is None:
        return f"The fill ratio is the boundary itself, {boundary:.1%}: neither decision is right."
    kind = "more" if truth == 1 else "less"
    seen = f"{share:.1%} of the samples read as vibrating"
    line = f"the boundary of {boundary:.1%}"
    if tested != boundary:
        line = f"the {tested:.1%} by which robots recognise {line}"
    if verdict == "decidable":
        return f"{seen}, on the right side of {line}: it can be decided."
    if verdict == "wrong side":
        problem = f"but {kind} than {boundary:.1%} vibrates"
        if tested != boundary:
            problem = f"on the wrong side of {line}"
        return f"{seen}, {problem}: more samples make the wrong answer surer, and feedback makes it faster."
    return f"{seen}, just {line}: however many samples are taken, it is decided by chance alone."


def _mend(verdict: Word, threshold: float, low: float | None, high: float | None) -> str:
    """Write which thresholds would put the share on the right side; empty if none is needed."""
    if verdict == "decidable" and low is not None and high is not None and low < threshold < high:
        return ""
    if low is None or high is None:
        return " No threshold mends it: vibrating tiles do not read higher than still ones."
    if high - low < ON:
        return f" The sensor's errors balance at a threshold of {low:.3f} (it is {threshold:g})."
    if verdict == "decidable":
        return (
            f" But the mirror image of this floor across the boundary could not be: at a threshold of "
            f"{threshold:g} all floors lean this way; between {low:.3f} and {high:.3f} both can."
        )
    return f" A threshold between {low:.3f} and {high:.3f} mends it (it is {threshold:g})."
