"""Is there damage, where, how large, and may one stop? Answers from the declared set of patches (``patches``).

| name | symbol | equation |
|---|---|---|
| scan statistic | T | max over j of ln L_j - ln(number of places of that size) |
| p-value | p | (1 + number of T* >= T) / (B + 1), T* of B intact surfaces drawn at this inspection's own places |
| permuted p-value | - | the same with values exchanged within robots and blocks of ``BLOCK_S`` |
| told risk | - | pi Lambda / (1 - pi + pi Lambda), Lambda the mean of L_j over places, of the worst size and contrast |
| strict | - | the largest L_j of these sizes, places and contrasts; its prior odds bound the risk at every place |
| missed | - | share of drawn damage with which the surface is cleared all the same, on average and at the worst place |

The risk is that of the worst size and contrast, because an average over them promises too much: told 5 %, damage of
just the least size was there in 12 % of cleared surfaces (squares of 10 cm, those of 10 to 28 cm averaged).

Intact surfaces have the differences between robots and tiles that the law states. With several looks T is the largest
over looks, of the surface as of the intact ones, so that false calls are as stated however often is looked.

Who stops: a centre that has all samples, or the robots, each by its own samples and the messages that it has heard,
when the told risk of each of them is tolerated. A message is one sample; each receiver loses it with the same share.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import Interval, generator, wilson
from vibroswarm.core.displayed import html_view
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.errors import InputError
from vibroswarm.inspection.damage import (
    contrast_ratios,
    drawn_values,
    patch_of,
    random_places,
    ratios_at,
)
from vibroswarm.inspection.patches import (
    Patches,
    Shares,
    damage_ratio,
    log_likelihoods,
    logs_at_looks,
    raster,
    scan_statistic,
    told_risk,
)
from vibroswarm.inspection.samples import Floats, Samples

REPLICATES: Final = 999
"""Intact surfaces drawn for a p-value."""
AROUND: Final = 8
"""Points along each side that stand for the places around that of a patch."""
CELLS: Final = 40
"""Cells along each side of the raster."""
BLOCK_S: Final = 120.0
"""Blocks of time within which values are exchanged."""
LOOKS: Final = 32
"""Times at which the risk is told."""
CALLED: Final = 0.05
"""A surface is called damaged if the p-value of its scan is at most this."""
MOST_CALLED: Final = 20
"""Most patches that are called."""
CLEAR_M: Final = 0.05
"""Samples this near to a called patch, beyond the spread of their places, may be on it."""
BLOCKS: Final = 5
"""Blocks of places along each side, among which the worst place is found."""


class Box(NamedTuple):
    """A patch."""

    left_m: float
    bottom_m: float
    width_m: float
    height_m: float

    def _repr_html_(self) -> str:
        return html_view(self)


@dataclass(frozen=True, eq=False)
class Scan(NotebookView):
    """Whether there is damage, and where."""

    statistic: float
    p_value: float
    permuted_p_value: float
    critical: float
    """T that a share ``CALLED`` of the intact surfaces reaches."""
    replicates: int
    called_m: tuple[Box, ...]
    """Patches that are called, the most likely first: each is scanned for without the samples on those before it."""
    sizes: tuple[tuple[float, float], ...]
    """The declared sizes, m."""
    size_posterior: Floats
    """Probability of each size, if there is damage, (sizes,)."""
    region: NDArray[np.bool_]
    """The fewest cells that hold the centre of the damage with 90 %, (CELLS, CELLS), top row first."""
    surface_m2: float
    raster: Floats
    """Probability that each cell is damaged, (CELLS, CELLS), top row first."""
    looks: int = 1
    """Times at which is looked, evenly spaced; T is the largest over them."""
    called_s: float | None = None
    """First look at which T reaches the critical value; None: it does not."""

    @property
    def region_m2(self) -> float:
        """Area of ``region``."""
        return float(self.region.mean() * self.surface_m2)


def scan(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    *,
    prior: float = 0.5,
    replicates: int = REPLICATES,
    seed: int = 1,
    bits: bool = False,
    looks: int = 1,
) -> Scan:
    """Scan a surface for one patch of damage.

    Args:
        shares: of the samples in the patches. prior: probability of damage. replicates: intact surfaces, B.
        seed: of what is drawn. looks: how often is looked.
    Raises:
        InputError: fewer than 19 replicates, with which no p-value is below 5 %.
    """
    if replicates < 19:
        raise InputError(
            f"{replicates} intact surfaces cannot give a p-value below 5 %; at least 19", field="--replicates"
        )
    observed = samples.column("log_ratio")
    times_s, look = looks_of(samples, looks)
    each = _statistics(patches, shares, observed[:, None], look, looks)[:, 0]
    statistic = float(each.max())
    drawn = intact_statistics(samples, patches, shares, replicates, seed, bits=bits, looks=looks)
    permuted = _permuted(samples, observed, replicates, seed)
    exchanged = _statistics(patches, shares, permuted, look, looks).max(axis=0)
    posterior = posterior_of(patches, log_likelihoods(shares, observed[:, None])[:, 0])
    critical = float(np.quantile(drawn, 1.0 - CALLED))
    reached = np.flatnonzero(each >= critical)
    # By the samples of the look with the largest T, which is the last one unless there are several.
    called, cells = _called(samples, patches, shares, critical, prior, look <= each.argmax())
    return Scan(
        statistic,
        p_value(statistic, drawn),
        p_value(statistic, exchanged),
        critical,
        replicates,
        called,
        patches.sides_m,
        np.bincount(patches.size, posterior, len(patches.sides_m)).astype(np.float64),
        credible_region(patches, posterior, samples.size_m),
        float(np.prod(samples.size_m)),
        cells,
        looks,
        float(times_s[reached[0]]) if reached.size else None,
    )


def looks_of(samples: Samples, looks: int) -> tuple[Floats, NDArray[np.int64]]:
    """Return the times of evenly spaced looks, (looks,), and from which look on each sample counts, (samples,)."""
    time_s = samples.column("time_s")
    times_s = np.linspace(0.0, float(time_s.max()), looks + 1)[1:]
    return times_s, np.searchsorted(times_s, time_s)


def _statistics(
    patches: Patches, shares: Shares, ratios: Floats, look: NDArray[np.int64], looks: int
) -> Floats:
    """Return T of each replicate at each look, (looks, replicates).

    Args:
        ratios: log ratios, (samples, replicates). look: from which look on each sample counts, (samples,).
    """
    return np.array([scan_statistic(patches, logs) for logs in logs_at_looks(shares, ratios, look, looks)])


def _called(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    critical: float,
    prior: float,
    there: NDArray[np.bool_],
) -> tuple[tuple[Box, ...], Floats]:
    """Return the patches that are called by the samples that are ``there``, one after the other, and their raster.

    A patch is scanned for without the samples on those before it. The raster joins those of each step, of which each
    presumes one patch at most.
    """
    rest = np.where(there, samples.column("log_ratio"), 0.0)
    penalty = np.log(np.bincount(patches.size))[patches.size]
    called: list[Box] = []
    sound = np.ones((CELLS, CELLS))
    while True:
        logs = log_likelihoods(shares, rest[:, None])[:, 0]
        sound *= 1.0 - raster(patches, logs, prior, CELLS, samples.size_m)
        at = int((logs - penalty).argmax())
        if logs[at] - penalty[at] < critical or len(called) == MOST_CALLED:
            return tuple(called), 1.0 - sound
        sides = (patches.left_m, patches.bottom_m, patches.width_m, patches.height_m)
        called.append(Box(*(float(side[at]) for side in sides)))
        rest[near(samples, called[-1])] = 0.0


def near(samples: Samples, box: Box) -> NDArray[np.bool_]:
    """Return which samples may be on a patch: within ``CLEAR_M`` and 3 standard deviations of their place."""
    inside = np.ones(samples.frame.height, dtype=bool)
    for axis, low, side in (("x", box.left_m, box.width_m), ("y", box.bottom_m, box.height_m)):
        margin = CLEAR_M + 3.0 * samples.column(f"spread_{axis}_m")
        at = samples.column(f"{axis}_m")
        inside &= (at > low - margin) & (at < low + side + margin)
    return inside


def p_value(statistic: float, drawn: Floats) -> float:
    """Return the p-value of a statistic against drawn ones."""
    return float((1 + (drawn >= statistic).sum()) / (drawn.size + 1))


def intact_statistics(
    samples: Samples, patches: Patches, shares: Shares, replicates: int, seed: int, *, bits: bool = False,
    looks: int = 1,
) -> Floats:  # fmt: skip
    """Return T of intact surfaces drawn at the samples' own places, (replicates,)."""
    random = generator(seed, "intact surfaces")
    parts = []
    for begin in range(0, replicates, 256):  # so that memory stays small
        values = drawn_values(random, samples, min(256, replicates - begin))
        parts.append(statistic_of(samples, patches, shares, values, bits=bits, looks=looks))
    return np.concatenate(parts)


def statistic_of(
    samples: Samples, patches: Patches, shares: Shares, values: Floats, *, bits: bool = False, looks: int = 1
) -> Floats:
    """Return T of surfaces on which the samples would have measured ``values``, (samples, replicates)."""
    ratios, (_, look) = ratios_at(samples.law, values, bits=bits), looks_of(samples, looks)
    return np.asarray(_statistics(patches, shares, ratios, look, looks).max(axis=0))


def _permuted(samples: Samples, observed: Floats, replicates: int, seed: int) -> Floats:
    """Return the log ratios exchanged within robots and blocks of time, (samples, replicates)."""
    random = generator(seed, "exchanged values")
    block = (samples.column("time_s") // BLOCK_S).astype(np.int64) * 100_000 + samples.frame[
        "robot"
    ].to_numpy()
    # Sorted by block, and within it by a random number: one exchange within each block.
    order = np.argsort(block, kind="stable")
    out = np.empty((observed.size, replicates))
    for b in range(replicates):
        mixed = np.lexsort((random.random(observed.size), block))
        out[order, b] = observed[mixed]
    return out


def posterior_of(patches: Patches, logs: Floats) -> Floats:
    """Return the probability of each patch, if one of them is there, (patches,), from its ln L_j."""
    posterior = patches.weights * np.exp(logs - logs.max())
    return np.asarray(posterior / posterior.sum())


def credible_region(patches: Patches, posterior: Floats, size_m: tuple[float, float]) -> NDArray[np.bool_]:
    """Return the fewest cells that hold the centre of the damage with 90 %, (CELLS, CELLS), top row first.

    Between the places of the declared set probability is interpolated linearly.
    """
    offset = (np.arange(AROUND) + 0.5) / AROUND * 2.0 - 1.0  # in steps: a patch counts up to the next places
    share = np.outer(1.0 - np.abs(offset), 1.0 - np.abs(offset)).ravel()[:, None]
    x_m, y_m = (
        np.clip(low_m + 0.5 * side_m + part.ravel()[:, None] * patches.step_m, 0.0, whole)
        for low_m, side_m, part, whole in zip(
            (patches.left_m, patches.bottom_m),
            (patches.width_m, patches.height_m),
            np.meshgrid(offset, offset),
            size_m,
            strict=True,
        )
    )
    places, _, _ = np.histogram2d(
        x_m.ravel(),
        y_m.ravel(),
        bins=CELLS,
        range=[[0.0, size_m[0]], [0.0, size_m[1]]],
        weights=(share / share.sum() * posterior).ravel(),
    )
    falling = np.argsort(-places, axis=None, kind="stable")
    count = int(np.searchsorted(np.cumsum(places.ravel()[falling]), 0.9)) + 1
    region = np.zeros(places.size, dtype=bool)
    region[falling[:count]] = True
    return region.reshape(places.shape).T[::-1]


@dataclass(frozen=True)
class Question(NotebookView):
    """What an inspection must find, and how sure it must be to stop."""

    least_m: float = 0.10
    """Side of the smallest patch that must be found."""
    contrasts: tuple[float, ...] = (1.0, 0.75, 0.5)
    """Contrasts that damage may have; the risk is that of the worst."""
    prior: float = 0.5
    """Probability of damage before any sample."""
    risk: float = 0.05
    """Tolerated probability of damage after clearing."""
    strict: bool = False
    """Whether the risk must hold at every place, not on average."""
    loss: float = 0.0
    """Share of messages that a robot loses, if the robots stop by themselves."""

    def __post_init__(self) -> None:
        """Refuse probabilities outside (0, 1), and contrasts outside (0, 1]."""
        for name in ("prior", "risk"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError("must be a share between 0 and 1", field=f"--{name}")
        if not 0.0 <= self.loss <= 1.0:
            raise InputError("must be a share from 0 to 1", field="--loss")
        if not self.contrasts or not all(0.0 < c <= 1.0 for c in self.contrasts):
            raise InputError("must be above 0 and at most 1", field="--contrasts")


@dataclass(frozen=True, eq=False)
class Stopping(NotebookView):
    """When the surface could be cleared, and how often damage would be cleared too."""

    question: Question
    times_s: Floats
    told: Floats
    """Told risk at each time, (times,): of the worst size and contrast; with ``strict`` of the worst place too."""
    cleared_s: float | None
    """First time at which the told risk is tolerated; None: never."""
    missed: Interval
    """Share of damage of the least size and contrast that is cleared all the same at the end, with 95 % limits."""
    worst: Interval
    """The same at the worst of the blocks of places."""
    robots_s: float | None = None
    """First time at which each robot tolerates its own told risk, by what it has heard; None: never."""


def stopping(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    question: Question,
    *,
    drawn: int = 1000,
    seed: int = 1,
) -> Stopping:
    """Tell the risk of having missed damage, over time, and how often that would be wrong.

    Args:
        drawn: damaged surfaces, drawn at this inspection's own places with the least size and contrast.
    """
    times_s, look = looks_of(samples, LOOKS)
    heard = _heard(samples, question.loss, seed)
    told = risks_of(samples, patches, shares, question, samples.column("value")[:, None], look, LOOKS, heard)
    tolerated = told <= question.risk
    random = generator(seed, "damaged surfaces")
    x_m, y_m = random_places(random, np.full(drawn, question.least_m), samples.size_m)
    cleared = np.empty(drawn, dtype=bool)
    for begin in range(0, drawn, 256):  # so that memory stays small
        part = slice(begin, begin + 256)
        patch = patch_of(x_m[part], y_m[part], question.least_m, min(question.contrasts))
        values = drawn_values(random, samples, patch.x_m.size, patch)
        cleared[part] = risk_of(samples, patches, shares, question, values) <= question.risk
    blocks = [  # of the places that a centre may have, so that none has much fewer than the others
        np.clip(BLOCKS * (at - 0.5 * question.least_m) // max(whole - question.least_m, 1e-9), 0, BLOCKS - 1)
        for at, whole in zip((x_m, y_m), samples.size_m, strict=True)
    ]
    block = (blocks[0] * BLOCKS + blocks[1]).astype(np.int64)
    number = np.bincount(block, minlength=BLOCKS**2)
    of_block = np.bincount(block, cleared, BLOCKS**2)
    worst = int(np.argmax(of_block / np.maximum(number, 1)))
    late = np.flatnonzero(~tolerated[:, 1:].all(axis=1))
    return Stopping(
        question,
        times_s,
        told[:, 0],
        _first_s(times_s, int(tolerated[:, 0].argmax()) if tolerated[:, 0].any() else LOOKS),
        wilson(int(cleared.sum()), drawn),
        wilson(int(of_block[worst]), int(number[worst])),
        _first_s(times_s, int(late[-1]) + 1 if late.size else 0),
    )


def _first_s(times_s: Floats, index: int) -> float | None:
    return float(times_s[index]) if index < times_s.size else None


def _heard(samples: Samples, loss: float, seed: int) -> NDArray[np.bool_]:
    """Return which samples a centre has, and each robot: its own and those that it heard, (samples, 1 + robots)."""
    random = generator(seed, "lost messages")
    robot = samples.frame["robot"].to_numpy()
    of_robots = [(robot == one) | (random.random(robot.size) >= loss) for one in samples.robots]
    return np.stack([np.ones(robot.size, dtype=bool), *of_robots], axis=1)


def risk_of(samples: Samples, patches: Patches, shares: Shares, question: Question, values: Floats) -> Floats:
    """Return the told risk of each replicate by all samples, (replicates,); the arguments are those of ``risks_of``."""
    all_at_once = np.zeros(values.shape[0], dtype=np.int64)
    return np.asarray(risks_of(samples, patches, shares, question, values, all_at_once, 1)[0])


def risks_of(
    samples: Samples,
    patches: Patches,
    shares: Shares,
    question: Question,
    values: Floats,
    look: NDArray[np.int64],
    looks: int,
    heard: NDArray[np.bool_] | None = None,
) -> Floats:
    """Return the told risk of each replicate at each look, (looks, replicates).

    Args:
        values: measured values, (samples, replicates). look: from which look on each sample counts, (samples,).
        heard: which samples count at all, (samples, replicates), of values (samples, 1); None: all.
    Raises:
        InputError: no declared size is at least the least one.
    """
    wanted = patches.at_least(question.least_m)
    if not wanted.any():
        raise InputError("no declared size is as large as the smallest to be found", field="--least-cm")
    sizes = _sizes(patches, wanted)
    ratio = np.zeros((looks, values.shape[1] if heard is None else heard.shape[1]))
    for contrast in question.contrasts:
        log_ratio = contrast_ratios(samples.law, contrast, values)
        if heard is not None:
            log_ratio = np.where(heard, log_ratio, 0.0)
        for now, logs in enumerate(logs_at_looks(shares, log_ratio, look, looks)):
            if question.strict:
                found = np.exp(np.minimum(logs[wanted].max(axis=0), 600.0))
            else:
                found = np.max([damage_ratio(patches, logs, weights) for weights in sizes], axis=0)
            ratio[now] = np.maximum(ratio[now], found)
    return told_risk(ratio, question.prior)


def _sizes(patches: Patches, wanted: NDArray[np.bool_]) -> list[Floats]:
    """Return weights of the places of each wanted size, whose sum is 1."""
    sizes = np.unique(patches.size[wanted])
    return [(patches.size == size) / np.count_nonzero(patches.size == size) for size in sizes]
