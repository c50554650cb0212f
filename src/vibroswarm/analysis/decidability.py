"""Compute whether a question can be decided at all: is the expected share of ones on the right side of the boundary?

A bit is the 0 or 1 that a sample reads. The share of ones is on the right side if it is above the tested boundary
where the fill ratio is above the boundary, and below where it is below.

| name | symbol | equation |
|---|---|---|
| fill ratio, boundary | f, x | the question: is f above x? |
| tested boundary | q(x) | what robots compare the share of ones with: x itself, or q of a floor whose f is x |
| false positive, false negative | a(theta), b(theta) | error rates of the sensor at the threshold theta |
| spillover | s | share of the tiles' area sensed as vibrating minus f; 0 unless vibration crosses tile edges |
| tiled share of the arena | c | tiles' area in the arena / arena's area; places off all tiles read like still tiles |
| share of ones expected | q | c [g (1 - b) + (1 - g) a] + (1 - c) a, g = f + s, at uniformly random places |
| margin | - | q - q(x) where f > x, q(x) - q where f < x: above 0 is the right side |
| correcting ("mending") threshold | theta_- to theta_+ | f and its mirror image 2x - f both have q on x's right side |
| samples needed | n | P(share of n independent bits is not on q's side of q(x)) <= error; of several kinds see \
``samples_needed_of_kinds`` |

With ``boundary_of = "readings"`` robots treat each bit as if the sensor made no errors: q(x) = x. If false positives
and false negatives do not balance at the boundary, q is on the wrong side for fill ratios near the boundary, and **more
samples make the wrong answer surer**. q falls as theta grows. For any single f some theta puts q on the right side, but
this theta may put all floors on that side. A correcting threshold therefore has to be right for the mirror image of f
across the boundary too (with the same spillover). There is none if vibrating tiles do not read higher than still ones.

With ``boundary_of = "tiles"`` robots correct for the errors that they claim (``sensor.claimed_rates``, else the true
ones), while q is always that of the true law. Then q is on the wrong side only if they claim or assume wrong error
rates, or if vibration crosses the edges of this floor more, or less, than on an average random floor.

All this is about a robot's own samples. Under soft or positive feedback robots also hear beliefs or decisions: these
make the answer to which the samples lean, right or wrong, faster and surer, but do not change it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from vibroswarm.analysis.binomial import probability_above, probability_at_most
from vibroswarm.analysis.intervals import ForJson, check_level, wilson_limits
from vibroswarm.core.numbers import number, percent, stated
from vibroswarm.errors import InputError, number_of
from vibroswarm.floors.floor import Floor, Place, place_of
from vibroswarm.inference.outcomes import truth_on
from vibroswarm.observation.decision_boundary import (
    expected_classes_on,
    expected_ones_on,
    readings_boundary,
    sensed_shares_on,
    tiled_share,
)
from vibroswarm.observation.energy_model import claims_differ, error_rates, model_of
from vibroswarm.scenario.fields import Sensor
from vibroswarm.scenario.scenario import Scenario

Word = Literal[
    "decidable", "wrong side", "on the boundary", "indistinguishable from the boundary", "not assessed"
]

ON = 1e-9
"""A share closer to the boundary than this is on it."""
_EXACT_UP_TO = 100_000
"""Above this number, ``samples_needed`` uses the normal approximation."""
_NODES = 64
"""Points of the Gauss-Hermite rule of ``samples_needed_of_kinds``."""
_STEPS = 200
"""Most steps of a bisection; it ends before when no number lies between its limits."""


@dataclass(frozen=True)
class Decidability(ForJson):
    """Whether the question can be decided from own samples.

    The module's docstring explains the terms.
    """

    verdict: Word
    """On which side of the tested boundary the share of ones is, in a word."""
    says: str
    """The verdict in one or two sentences."""
    boundary: float
    """The boundary of the question."""
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
    effective_samples: float | None = None
    """Number of independent samples behind a measured share."""
    samples_needed: int | None = None
    """Independent samples for the wanted error; None unless the verdict is "decidable"."""
    threshold: float | None = None
    """The sensor's threshold theta; None if it reads without one."""
    mending_low: float | None = None
    """theta_-, the lower end of the range of correcting thresholds; None as for ``mending_high``."""
    mending_high: float | None = None
    """theta_- and theta_+: thresholds between them are right for f and its mirror image. None: there are none, or they
    were not computed."""

    @property
    def is_warning(self) -> bool:
        """Whether a report must warn of the verdict: the question was assessed, and is not decidable."""
        return self.verdict not in ("decidable", "not assessed")


def decidability(scenario: Scenario, error: float = 0.05, floor: Floor | None = None) -> Decidability:
    """Compute whether a scenario's question can be decided from the samples that its swarm will take.

    The verdict is "not assessed" for a task other than ``fill_ratio``; and, unless the share of ones is on the right
    side, for robots that weigh readings by error rates. Correcting thresholds are computed for
    ``boundary_of = "readings"`` only: with "tiles" the tested boundary allows for the sensor's errors.

    Args:
        scenario: its task, sensor, arena, floor and decision are used, and whether its strategy knows error rates.
        error: wanted probability of a wrong majority of bits, for ``samples_needed``.
        floor: by default the floor of run 0 with seed 0, which stands for the scenario's other random floors, because
            all have the same fill ratio (unless the arena's border cuts tiles off). At least a part of the floor must
            lie in the arena; this is always true of the scenario's own floors. Of a floor that changes, the one at the
            end of the run counts.
    Raises:
        InputError: the floor lies outside the arena; ``readings_boundary`` refuses the scenario; or ``error`` is not
            between 0 and 0.5, and the verdict is "decidable".
        CodeError: a user's task raised an error, or returned something other than 0, 1 and None.
    """
    floor, sensor = (floor or scenario.floor_for(0, 0)).at(scenario.run.t_end_s), scenario.sensor
    size = (scenario.arena.width_m, scenario.arena.height_m)
    fill, tiled = floor.fill_ratio_within(*size), tiled_share(floor.geometry, size)
    boundary, tested = scenario.decision.decision_boundary, readings_boundary(scenario)
    truth = truth_on(scenario, floor, fill)
    when = "Floor at the end: " if scenario.change.is_given else ""
    if max(sensor.kinds, sensor.readings) > 2:
        of_kinds = _of_kinds(scenario, floor, truth, fill, error)
        return replace(of_kinds, says=when + of_kinds.says)
    sensed = sensed_shares_on(sensor, floor, size)
    # s: area sensed as vibrating (on and off vibrating tiles) minus area that vibrates, as a share of the tiles' area.
    # The three areas are shares of the arena's area.
    spillover = (sensed.detected + sensed.spillover - sensed.vibrating) / tiled
    share = expected_share(sensor, fill, tiled, spillover, place_of(floor))
    if floor.has_contrasts or floor.patches:
        share = expected_ones_on(sensor, floor, size)
    verdict = _side(share, tested, truth)
    left_out = _why_not_assessed(scenario, floor, share, verdict, truth)
    says = left_out or _words(verdict, share, boundary, tested, truth)
    if left_out:
        verdict = "not assessed"
    low, high, mend = None, None, ""
    has_threshold = model_of(sensor).share_at_most is not None
    if not left_out and scenario.decision.boundary_of == "readings" and has_threshold:
        low, high = mending_thresholds(sensor, fill, boundary, tiled, spillover) or (None, None)
        mend = _mend(verdict, sensor.rms_threshold, low, high)
    if not left_out and scenario.decision.boundary_of == "tiles" and claims_differ(sensor, place_of(floor)):
        mend = (
            " Readings are those of the sensor's true law; robots correct them by the rates that they claim."
        )
    return Decidability(
        verdict=verdict,
        says=when + says + mend,
        boundary=boundary,
        tested=tested,
        truth=truth,
        share=share,
        margin=_margin(share, tested, truth),
        fill_ratio=fill,
        samples_needed=samples_needed(share, tested, error) if verdict == "decidable" else None,
        threshold=sensor.rms_threshold if has_threshold else None,
        mending_low=low,
        mending_high=high,
    )


def _why_not_assessed(
    scenario: Scenario, floor: Floor, share: float, verdict: Word, truth: int | None
) -> str:
    """Return why the share of ones says nothing of what robots decide; empty: it does."""
    if scenario.task.name != "fill_ratio" or floor.has_contrasts or floor.patches:
        return (
            f"Whether the task '{scenario.task.name}' is decidable on this floor cannot be computed from the share of "
            "ones."
        )
    strategy, decision = scenario.strategy.entry, scenario.decision
    assumed = (decision.assumed_false_positive, decision.assumed_false_negative)
    knows_rates = strategy is not None and strategy.knows_error_rates and assumed == (None, None)
    if knows_rates and truth is not None and verdict != "decidable":
        return (
            f"{percent(share)} of the samples read as vibrating; robots that weigh each reading by the sensor's error "
            "rates do not compare this share with the boundary."
        )
    return ""


def _of_kinds(scenario: Scenario, floor: Floor, truth: int | None, fill: float, error: float) -> Decidability:
    """Return whether the most common kind of tile can be decided: whether it is read most often on this floor.

    Args:
        truth: the right decision, None if there is none. fill: share of kind 1.
    """
    sensor, arena, boundary = scenario.sensor, scenario.arena, scenario.decision.decision_boundary
    shares = expected_classes_on(sensor, floor, (arena.width_m, arena.height_m))
    asked = partial(
        Decidability,
        boundary=boundary,
        tested=boundary,
        truth=truth,
        share=float(shares[1]),
        fill_ratio=fill,
    )
    if scenario.task.name != "majority" or sensor.kinds != sensor.readings:
        says = f"Whether the task '{scenario.task.name}' is decidable cannot be computed from shares of readings."
        return asked(verdict="not assessed", says=says, margin=None)
    if truth is None:
        says = "Several kinds of tile are equally common: no decision is right."
        return asked(verdict="on the boundary", says=says, margin=None)
    read = int(shares.argmax())
    margin = float(shares[truth] - np.delete(shares, truth).max())
    most = f"{percent(shares[read])} of the samples read as kind {read}, more than as any other"
    if abs(margin) < ON:
        says = f"Kind {truth} is read as often as another: however many samples are taken, it is decided by chance."
        return asked(verdict="on the boundary", says=says, margin=margin)
    if margin > 0.0:
        needed = samples_needed_of_kinds(shares, truth, error)
        says = f"{most}: it can be decided."
        return asked(verdict="decidable", says=says, margin=margin, samples_needed=needed)
    says = f"{most}, but kind {truth} is the most common: more samples make the wrong answer more certain."
    return asked(verdict="wrong side", says=says, margin=margin)


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
        share: share of ones, 0 to 1. boundary: the tested boundary, with which robots compare the share of ones.
        truth: 1 if the fill ratio is above the boundary of the question, 0 if it is below, None if it equals it.
        effective_samples: number of independent samples behind a measured share, which need not be whole. It gives the
            share an interval, and if there is a truth and this interval contains the boundary, the verdict is
            "indistinguishable from the boundary". None or infinite: the share is exact and gets no interval.
        level: of the share's interval. error: wanted probability of a wrong majority, for ``samples_needed``.
    Raises:
        InputError: a share or level outside its range; or an error outside its range, and the verdict is "decidable".
    """
    share = number_of(share, "share", 0.0, 1.0)
    check_level(level)
    verdict, low, high = _side(share, boundary, truth), None, None
    # The boundary of the question is not an argument; the tested boundary is reported in its place too.
    says = _words(verdict, share, boundary=boundary, tested=boundary, truth=truth)
    if effective_samples is not None and math.isfinite(effective_samples):
        limits = wilson_limits(share * effective_samples, effective_samples, level)
        low, high = (float(limit) for limit in limits)
        if truth is not None and low <= boundary <= high:
            verdict = "indistinguishable from the boundary"
            says = (
                f"{percent(share)} of the samples read as vibrating, {percent(low)} to {percent(high)} as the samples "
                f"go: this is indistinguishable from the boundary of {percent(boundary)}."
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


def expected_share(
    sensor: Sensor, fill_ratio: float, tiled: float = 1.0, spillover: float = 0.0, place: Place | None = None
) -> float:
    """Compute q, the share of samples at uniformly random places in the arena that read as vibrating.

    Args:
        sensor: its threshold counts. fill_ratio: f. tiled: c, the share of the arena that lies on tiles.
        spillover: s, area sensed as vibrating minus area that vibrates, as a share of the tiles' area.
        place: grid of the floor, for a sensor whose values depend on the place; None: that of the study.
    """
    false_positive, false_negative = error_rates(sensor, place)
    # g. It is limited to a share, because the spillover may be that of a floor with another fill ratio, as for the
    # mirror image in ``mending_thresholds``.
    sensed = min(max(fill_ratio + spillover, 0.0), 1.0)
    on_tiles = sensed * (1.0 - false_negative) + (1.0 - sensed) * false_positive
    return tiled * on_tiles + (1.0 - tiled) * false_positive  # q


@lru_cache(maxsize=256)
def mending_thresholds(
    sensor: Sensor, fill_ratio: float, boundary: float, tiled: float = 1.0, spillover: float = 0.0
) -> tuple[float, float] | None:
    """Find the range of correcting ("mending") thresholds: those with q on the right side for f and its mirror image.

    The mirror image is 2x - f, clipped to the range 0 to 1. If f is x, both ends of the range are the threshold at
    which the sensor's errors balance.

    Args:
        sensor: its own threshold does not matter. fill_ratio: f. boundary: x. tiled: c, the share of the arena that
            lies on tiles. spillover: s, area sensed as vibrating minus area that vibrates, as a share of the tiles.
    Returns: the range (theta_-, theta_+), or None if no threshold is right for both fill ratios.
    Raises:
        InputError: the boundary is not a number from 0 to 1.
    """
    boundary = number_of(boundary, "boundary", 0.0, 1.0)
    mirror = min(max(2.0 * boundary - fill_ratio, 0.0), 1.0)
    lower, upper = sorted((fill_ratio, mirror))

    def crossing(fill: float) -> float:
        """Find the threshold at which q of this fill ratio falls below the boundary."""
        return _falls_through(
            lambda theta: expected_share(
                sensor.model_copy(update={"rms_threshold": theta}), fill, tiled, spillover
            ),
            boundary,
        )

    # q falls as the threshold grows. At thresholds above ``low``, q of the lower fill ratio is below the boundary. At
    # thresholds below ``high``, q of the upper fill ratio is still above it. Between ``low`` and ``high`` both hold.
    low, high = crossing(lower), crossing(upper)
    # For f = x, low and high are equal for any sensor. So the sensor is checked too: if vibrating tiles read higher
    # than still ones, a floor of only vibrating tiles crosses the boundary at a higher threshold than a still floor.
    vibrating_reads_higher = crossing(1.0) > crossing(0.0)
    return (low, high) if high >= low and vibrating_reads_higher else None


def _falls_through(share: Callable[[float], float], level: float) -> float:
    """Find by bisection the threshold, 0 or more, at which the decreasing function ``share`` falls to ``level``.

    ``level`` must be above 0, as every boundary is, and ``share`` must fall towards 0, as q does when the threshold
    grows; otherwise the search for an upper limit does not end.

    Returns: the threshold; 0 if ``share`` is at most ``level`` already at the threshold 0.
    """
    low, high = 0.0, 1.0
    if share(low) <= level:
        return low
    while share(high) > level:
        high *= 2.0
    for _ in range(_STEPS):
        middle = (low + high) / 2
        if middle in (low, high):  # neighbouring numbers: no number lies between them
            break
        low, high = (middle, high) if share(middle) > level else (low, middle)
    return high


class ObservedShare(NamedTuple):
    """Share of ones with equal weight for each tile, and how precise it is."""

    share: float
    """The share; nan without samples on tiles."""
    standard_error: float
    """Standard error of the share; nan without samples on tiles."""
    effective_samples: float
    """Number of independent samples whose share of ones would have this standard error; 0 without samples on tiles."""
    tiles: int
    """Number of tiles that were sampled; others are left out."""


def observed_share(tile: ArrayLike, bits: ArrayLike) -> ObservedShare:
    """Estimate the share of ones if each tile were sampled equally often, from the tiles that were sampled.

    It is the mean over tiles of each tile's share of ones, so that unequal numbers of samples per tile do not matter.
    The share of ones of a tile with n samples has the variance p (1 - p) / n. The sum of these variances over tiles,
    divided by the squared number of tiles, is the variance of the mean. In it p = (ones + 1/2) / (n + 1), because the
    share of ones itself would give a tile whose bits are all equal the variance 0. Without a sample on any tile, share
    and standard error are nan.

    Args:
        tile: index of the tile of each sample, -1 off all tiles, where the sample is left out. bits: the bit of each
            sample; both of shape (samples,).
    """
    tile_of, bit = np.asarray(tile, dtype=np.int64).ravel(), np.asarray(bits, dtype=np.float64).ravel()
    on = tile_of >= 0
    visits = np.bincount(tile_of[on])
    ones, n = np.bincount(tile_of[on], bit[on])[visits > 0], visits[visits > 0].astype(np.float64)
    if n.size == 0:
        return ObservedShare(share=math.nan, standard_error=math.nan, effective_samples=0.0, tiles=0)
    share, smooth = float((ones / n).mean()), (ones + 0.5) / (n + 1.0)
    variance = float((smooth * (1.0 - smooth) / n).sum()) / n.size**2
    # Variance of a single independent sample: q (1 - q) with the share q. It is at least the mean of the tiles' p (1 -
    # p), which is above 0 even if all bits are equal. Divided by the variance of the share, it gives the effective
    # number of samples.
    variance_of_one = max(share * (1.0 - share), float((smooth * (1.0 - smooth)).mean()))
    return ObservedShare(share, math.sqrt(variance), variance_of_one / variance, n.size)


@lru_cache(maxsize=256)
def samples_needed(share: float, boundary: float, error: float = 0.05) -> int | None:
    """Compute how many independent samples decide on which side of the boundary the true share of ones lies.

    With this number of samples or more, the observed share lies on the same side of the boundary as the true share
    with a probability of at least 1 - ``error``. The number is computed from the binomial law (an observed share on the
    boundary counts as an error), or by the normal approximation if it is above some 100,000. It is None if the true
    share is on the boundary. Divide the number by effective samples per second to get a time.

    Args:
        share: the true share of ones. boundary: share with which it is compared. error: wanted probability that the
            observed share is on the wrong side.
    Raises:
        InputError: an error that is not between 0 and 0.5, or a share that is not from 0 to 1.
    """
    _check_error(error)
    share, boundary = number_of(share, "share", 0.0, 1.0), number_of(boundary, "boundary", 0.0, 1.0)
    distance = abs(share - boundary)
    if distance < ON:
        return None
    z = float(-ndtri(error))
    normal = math.ceil((z * math.sqrt(share * (1.0 - share)) / distance) ** 2)
    if normal > _EXACT_UP_TO:
        return normal
    # The error is not monotonic in n, since counts are whole. So the error is computed for all n up to about twice the
    # normal approximation (and a margin, as small n may need more); the answer is the n after the last one whose error
    # is too large.
    n = np.arange(1, 2 * normal + 2 * math.ceil(1.0 / distance) + 50)
    ones_at_boundary = boundary * n
    # ON: a product that differs from a whole number by rounding alone counts as that number.
    if share > boundary:
        wrong = probability_at_most(np.floor(ones_at_boundary + ON), n, share)  # P(ones <= boundary n)
    else:
        wrong = probability_above(np.ceil(ones_at_boundary - ON) - 1, n, share)  # P(ones >= boundary n)
    over = np.flatnonzero(wrong > error)
    return int(n[over[-1]]) + 1 if over.size else 1


def samples_needed_of_kinds(shares: ArrayLike, kind: int, error: float = 0.05) -> int | None:
    """Compute how many independent samples show that a kind of tile is read most often.

    Numbers of readings are taken as independent and normal, those of kind j with mean and variance n q_j.

    Args:
        shares: q_j, of the samples that read as each class. kind: the one with the largest share. error: wanted
            probability that another kind is read as often, or more.
    Returns: None if no number is enough: another kind has the same share.
    Raises:
        InputError: an error that is not between 0 and 0.5.
    """
    _check_error(error)
    all_shares = np.asarray(shares, dtype=np.float64)
    own, others = float(all_shares[kind]), np.delete(all_shares, kind)
    if own - others.max() < ON:
        return None
    z, weight = np.polynomial.hermite_e.hermegauss(_NODES)
    others = others[others > 0.0]

    def wrong(n: float) -> float:
        # 0.5: numbers are whole, and equal ones do not show it.
        apart = n * (own - others) - 0.5 + math.sqrt(n * own) * z[:, None]
        return 1.0 - float(weight @ ndtr(apart / np.sqrt(n * others)).prod(axis=1)) / float(weight.sum())

    low, high = 0.0, 1.0
    while wrong(high) > error:
        low, high = high, 2.0 * high
    while high - low > 0.5:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if wrong(middle) > error else (low, middle)
    return math.ceil(high)


def _check_error(error: float) -> None:
    """Refuse a wanted probability that cannot be one."""
    if not 0.0 < error < 0.5:
        raise InputError(
            f"{error!r} cannot be the wanted error; give a share above 0 and below 0.5", field="error"
        )


def _side(share: float, boundary: float, truth: int | None) -> Word:
    if truth is None or abs(share - boundary) < ON:
        return "on the boundary"
    return "decidable" if (share > boundary) == (truth == 1) else "wrong side"


def _margin(share: float, boundary: float, truth: int | None) -> float | None:
    """Return how far the share of ones is on the right side of the boundary; negative: on the wrong side."""
    return None if truth is None else (share - boundary) * (1 if truth == 1 else -1)


def _words(verdict: Word, share: float, boundary: float, tested: float, truth: int | None) -> str:
    """Write the verdict as a sentence.

    Args:
        verdict: on which side of the tested boundary the share of ones is.
        share: q, the expected or measured share of ones. boundary: x, the boundary of the fill ratio.
        tested: q(x), the share that robots compare the share of ones with; it is x unless they correct for the errors
            of the sensor.
        truth: 1 if the fill ratio f is above x, 0 if it is below x, None if it is x.
    """
    if truth is None:
        return f"The fill ratio is the boundary itself, {percent(boundary)}: neither decision is right."
    share_of_ones = f"{percent(share)} of the samples read as vibrating"
    tested_boundary = f"the boundary of {percent(boundary)}"
    if tested != boundary:
        tested_boundary = f"the {percent(tested)} by which robots recognise {tested_boundary}"
    if verdict == "decidable":
        return f"{share_of_ones}, on the right side of {tested_boundary}: it can be decided."
    if verdict == "wrong side":
        if tested != boundary:
            problem = f"on the wrong side of {tested_boundary}"
        else:
            problem = f"but {'more' if truth == 1 else 'less'} than {percent(boundary)} vibrates"
        return f"{share_of_ones}, {problem}: more samples make the wrong answer more certain, feedback makes it faster."
    # The remaining verdict: the share of ones equals the tested boundary.
    return f"{share_of_ones}, just {tested_boundary}: however many samples are taken, it is decided by chance alone."


def _mend(verdict: Word, threshold: float, low: float | None, high: float | None) -> str:
    """Write which thresholds would put q on the right side: a sentence to append to the verdict's sentence.

    Args:
        verdict: with the present threshold. threshold: the sensor's present threshold.
        low, high: range of correcting thresholds from ``mending_thresholds``; both None if no threshold corrects.
    Returns: the sentence, with a leading blank; "" if the verdict is "decidable" and the present threshold lies inside
        the range.
    """
    if verdict == "decidable" and low is not None and high is not None and low < threshold < high:
        return ""
    if low is None or high is None:
        return " No threshold helps: vibrating tiles do not read higher than still ones."
    if high - low < ON:
        return f" The sensor's errors balance at a threshold of {number(low, 3)} (it is {stated(threshold)})."
    if verdict == "decidable":
        return (
            f" But the mirror image of this floor across the boundary could not be decided: at a threshold of "
            f"{stated(threshold)} all floors lean this way; between {number(low, 3)} and {number(high, 3)} both can."
        )
    return f" A threshold between {number(low, 3)} and {number(high, 3)} makes it decidable (now {stated(threshold)})."
