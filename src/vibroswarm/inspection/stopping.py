"""May one stop? The told risk of having missed damage, over time, and how often that would be wrong.

| name | symbol | equation |
|---|---|---|
| told risk | - | pi Lambda / (1 - pi + pi Lambda), Lambda the mean of L_j over places, of the worst size and \
contrast; the mean over the laws (``damage.over_laws``) |
| strict | - | the largest L_j of these sizes, places and contrasts; its prior odds bound the risk at every place |
| rule | - | inspection ends, and the surface is cleared, at the first of ``LOOKS`` looks that tolerates the risk |
| missed | - | share of drawn damage that the rule clears all the same, on average and at the worst place |

The risk is that of the worst size and contrast, because an average over them promises too much: told 5 %, damage of
just the least size was there in 12 % of cleared surfaces (squares of 10 cm, those of 10 to 28 cm averaged). Squares of
the least size are always among the sizes, declared or not: without them it was there in 19 % (squares of 15 cm).

What samples share by their tiles and robots is part of L_j (``factors``). Taken as independent, told 0.5 % was 4.9 %
(squares of 20 cm, 2,000 exact places, tiles that differ by 17 %, robots by 12 %).

Damage lies between the declared places: the places of samples have as much more spread (``BETWEEN``). Without it, by
exact places, told 0.7 % was 2.4 %.

Damage is drawn at this inspection's own places. One law judges each drawn surface, which clears more often than the
mean over laws: what is missed is an upper limit, if the law has an error. The worst place is one of ``BLOCKS`` x
``BLOCKS`` blocks of places: the one in which most of the first draws are missed, or nearly so. Its share is of other
draws, so that the choice does not count.

Who stops: a centre that has all samples, or the robots, each by its own samples and the messages that it has heard; the
last of them ends the inspection. A message is one sample; each receiver loses it with the same probability.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.core.child_python import processors
from vibroswarm.errors import InputError, check_kind, keep_plain, number_of, shown
from vibroswarm.floors.surfaces import place_within
from vibroswarm.inspection.damage import (
    by_laws,
    contrast_ratios,
    drawn_parts,
    draws_of,
    patch_of,
    random_places,
)
from vibroswarm.inspection.factors import judge_of, logs_at_node, nodes_of, of_typical_robots, tiles_by
from vibroswarm.inspection.patches import (
    Patches,
    Shares,
    by_tile,
    declared,
    log_likelihoods,
    ratios_at_looks,
    shares_of,
    told_risk,
)
from vibroswarm.inspection.samples import Floats, Law, Samples
from vibroswarm.inspection.scan import EVIDENCE, Box, box_of, looks_of
from vibroswarm.statistics.intervals import Interval, generator, wilson

AT_ONCE: Final = 64
"""Replicates that a core takes side by side."""
MOST_NUMBERS: Final = 2**24
"""Probabilities of nodes, or ratios of one contrast, that a core holds; above it takes fewer replicates."""
LOOKS: Final = 32
"""Times at which the told risk is computed."""
BLOCKS: Final = 5
"""Blocks of places along each side, among which the worst place is found."""
DRAWN: Final = 2000
"""Damaged surfaces drawn at all places."""
AT_WORST: Final = 1000
"""Those drawn at the worst."""
OF_ROBOTS: Final = 200
"""The first of these are also judged by each robot, if messages are lost."""
BETWEEN: Final = 12.0**-0.5
"""Standard deviation of damage about the nearest declared place, in steps: all places between are as likely."""


@dataclass(frozen=True)
class Question:
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
    level: float = 0.05
    """Tolerated share of false calls: intact surfaces that are called damaged."""
    loss: float = 0.0
    """Share of messages that a robot loses, if the robots stop by themselves."""

    def __post_init__(self) -> None:
        """Refuse values of another type, probabilities outside (0, 1), and contrasts outside (0, 1]."""
        keep_plain(self)
        check_kind(self.contrasts, tuple, "--contrasts", "a tuple of numbers, such as (1.0, 0.5)")
        number_of(self.least_m, "least_m", 1e-3)
        for name in ("prior", "risk", "level", "loss"):
            number_of(getattr(self, name), f"--{name}", 0.0, 1.0)
        for contrast in self.contrasts:
            number_of(contrast, "--contrasts", 0.0, 1.0)
        for name in ("prior", "risk", "level"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError(
                    f"{getattr(self, name)} is wrong; give a share above 0 and below 1", field=f"--{name}"
                )
        if not self.contrasts or not all(self.contrasts):
            raise InputError(
                f"{shown(self.contrasts)} is wrong; give contrasts above 0 and at most 1", field="--contrasts"
            )


@dataclass(frozen=True, eq=False)
class Rule:
    """When an inspection ends: the told risk at each look, of the samples or of values in their place."""

    samples: Samples
    patches: Patches
    """Those that must be found."""
    shares: Shares
    """Of ``by_tile``."""
    question: Question
    look: NDArray[np.int64]
    """From which look on each sample counts, (samples,)."""
    looks: int
    tile: NDArray[np.int64]
    """Of each sample, (samples,): samples of a tile share a factor (``tiles_by``)."""

    def told(self, values: Floats, heard: NDArray[np.bool_] | None = None, *, drawn: bool = False) -> Floats:
        """Return the told risk of each replicate at each look, (looks, replicates).

        Args:
            values: measured values, (samples, replicates).
            heard: which of the samples count, (samples, replicates); None: all.
            drawn: whether values are drawn, so that one of the laws that are its error judges each replicate; else the
                risk is the mean over the law and these.
        """
        law = judge_of(self.samples.law)
        judges = draws_of(law)[0]
        if drawn:
            return self._risk_by(judges or [law], values, heard)
        laws = [law, *judges]
        of_each = None if heard is None else np.repeat(heard, len(laws), axis=1)
        risk = self._risk_by(laws, np.repeat(values, len(laws), axis=1), of_each)
        return np.asarray(sum(risk[:, k :: len(laws)] for k in range(len(laws))) / len(laws))

    def _risk_by(self, laws: list[Law], values: Floats, heard: NDArray[np.bool_] | None) -> Floats:
        """Return the told risk of each replicate at each look, (looks, replicates).

        Args:
            laws: replicate b is judged by number b modulo their count.
        """
        read = by_laws(laws, values, self._of_typical_robots if heard is None else self._of_each_robot)
        nodes, prior = nodes_of(judge_of(self.samples.law))
        row, ratio = np.argsort(self.shares.place), np.empty((self.looks, values.shape[1]))
        room = nodes.size * max(self.looks * (int(self.tile.max()) + 1), row.size)
        at_once = max(1, min(AT_ONCE, MOST_NUMBERS // room))

        def fill(begin: int) -> None:
            part, first = slice(begin, begin + at_once), begin % len(laws)
            found = self._at_nodes(nodes, laws[first:] + laws[:first], read[row, part])
            if heard is not None:
                found *= heard[row, None, part]
            ratio[:, part] = ratios_at_looks(
                self.patches, self.shares, found[0], found[1:], self.look, self.looks, self.tile, prior,
                strict=self.question.strict,
            )  # fmt: skip

        with ThreadPoolExecutor(processors()) as threads:
            list(threads.map(fill, range(0, ratio.shape[1], at_once)))
        return told_risk(ratio, self.question.prior)

    def _at_nodes(self, nodes: Floats, laws: list[Law], values: Floats) -> NDArray[np.float32]:
        """Return what ``ratios_at_looks`` reads: the log likelihood of values on intact tiles, and r - 1 for damage.

        Returns: of each contrast, sample, node and replicate, (1 + contrasts, samples, nodes, replicates).
        """
        samples, replicates = values.shape
        contrasts = self.question.contrasts
        found = np.empty((1 + len(contrasts), samples, nodes.size, replicates), dtype=np.float32)
        for k, law in enumerate(laws[:replicates]):
            for m, node in enumerate(nodes):
                logs = logs_at_node(law, values[:, k :: len(laws)], node, contrasts)
                found[0, :, m, k :: len(laws)] = logs[0]
                found[1:, :, m, k :: len(laws)] = np.expm1(logs[1:])
        return found

    def _of_typical_robots(self, law: Law, values: Floats) -> Floats:
        return of_typical_robots(self.samples, law, values, self.look, self.looks)

    def _of_each_robot(self, law: Law, values: Floats) -> Floats:
        """Return values without the factors of their robots, as each knows its own: it sends them so."""
        robots, read = self.samples.frame["robot"].to_numpy(), np.empty_like(values)
        for robot in self.samples.robots:
            own = robots == robot
            read[own] = of_typical_robots(
                self.samples.of(robot), law, values[own], self.look[own], self.looks
            )
        return read

    def suspected(self, value: Floats) -> tuple[Box, float] | None:
        """Return the patch and the contrast that values, (samples,), fit best; None: T is not even ``EVIDENCE``."""
        contrasts, patches = self.question.contrasts, self.patches
        ratios = np.stack([contrast_ratios(self.samples.law, value, c) for c in contrasts], axis=1)
        logs = log_likelihoods(self.shares, ratios) - np.log(patches.places[patches.form])[:, None]
        patch, contrast = divmod(int(logs.argmax()), len(contrasts))
        return (box_of(patches, patch), contrasts[contrast]) if logs.max() > EVIDENCE else None


def check_fits(question: Question, size_m: tuple[float, float]) -> None:
    """Refuse a square of the least size that does not fit the surface.

    Raises:
        InputError: as said.
    """
    if question.least_m > min(size_m):
        raise InputError(
            f"squares of {100 * question.least_m:g} cm do not fit the surface of {size_m[0]:g} m x {size_m[1]:g} m, so "
            f"that none can be missed; give {100 * min(size_m):g} or less",
            field="--least-cm",
        )


def rule_of(samples: Samples, patches: Patches, question: Question, looks: int = 1) -> Rule:
    """Return the rule by which an inspection ends.

    Args:
        patches: the declared set, to which squares of the least size are added. looks: evenly spaced.
    Raises:
        InputError: a square of the least size does not fit the surface.
    """
    check_fits(question, samples.size_m)
    larger = [form for form in patches.forms if form.longest_m >= question.least_m - 1e-9]
    wanted = declared(samples.size_m, [question.least_m, *larger])
    _, look = looks_of(samples, looks)
    seen = samples.with_more_spread(BETWEEN * wanted.forms[0].step_m)
    tile = tiles_by(judge_of(samples.law), samples)
    return Rule(samples, wanted, by_tile(shares_of(seen, wanted), tile), question, look, looks, tile)


@dataclass(frozen=True, eq=False)
class Stopping:
    """When the surface could be cleared, and how often damage would be cleared too."""

    question: Question
    times_s: Floats
    told: Floats
    """Told risk at each time, (times,): of the worst size and contrast; with ``strict`` of the worst place too."""
    patches: Patches
    """Those that must be found; L_j is averaged over the places of each form."""
    cleared_s: float | None
    """First time at which the told risk is tolerated; None: never."""
    missed: Interval
    """Share of damage of the least size and contrast that this rule clears all the same, with 95 % limits."""
    missed_at_end: Interval
    """The same if only the samples of the whole inspection count, and nobody stops before."""
    worst: Interval
    """``missed`` at the worst of the blocks of places, of draws of its own."""
    robots_s: float | None = None
    """Time at which the last of the robots tolerates its told risk for the first time; None: one never does."""
    missed_by_robots: Interval | None = None
    """``missed`` if the robots stop by themselves; None: they hear all, as the centre does."""
    suspected: tuple[Box, float] | None = None
    """The patch and the contrast that all samples fit best (``Rule.suspected``)."""


def stopping(
    samples: Samples, patches: Patches, question: Question, *, drawn: int = DRAWN, seed: int = 1
) -> Stopping:
    """Tell the risk of having missed damage, over time, and how often that would be wrong.

    Args:
        drawn: damaged surfaces, drawn at this inspection's own places with the least size and contrast.
    Raises:
        InputError: a square of the least size does not fit the surface.
    """
    times_s, _ = looks_of(samples, LOOKS)
    rule = rule_of(samples, patches, question, LOOKS)
    value, random = samples.column("value")[:, None], generator(seed, "damaged surfaces")
    lost = generator(seed, "lost messages")
    # Without losses each robot has what the centre has.
    of_each = _heard(rule, lost, 1) if question.loss else []
    told = np.hstack([rule.told(value), *(rule.told(value, heard) for heard in of_each)])
    first = [_first_s(times_s, one <= question.risk) for one in told.T]
    robots_s = first[1:] or first
    centre_m = random_places(random, np.full(drawn, question.least_m), samples.size_m)
    of_robots = OF_ROBOTS if question.loss else 0
    risk, at_end, by_robots = _told_of_damage(rule, random, *centre_m, of_robots, lost)
    worst_m = _in_worst_block(random, *centre_m, risk, question, samples.size_m)
    at_worst, _, _ = _told_of_damage(rule, random, *worst_m, 0, lost)
    return Stopping(
        question,
        times_s,
        told[:, 0],
        rule.patches,
        first[0],
        _share(risk, question),
        _share(at_end, question),
        _share(at_worst, question),
        None if None in robots_s else max(one for one in robots_s if one is not None),
        _share(by_robots, question) if by_robots.size else None,
        rule.suspected(value[:, 0]),
    )


def _share(risk: Floats, question: Question) -> Interval:
    return wilson(int((risk <= question.risk).sum()), risk.size)


def _first_s(times_s: Floats, tolerated: NDArray[np.bool_]) -> float | None:
    return float(times_s[tolerated.argmax()]) if tolerated.any() else None


def _heard(rule: Rule, random: np.random.Generator, replicates: int) -> list[NDArray[np.bool_]]:
    """Draw which samples each robot has, its own and those that it heard, (samples, replicates)."""
    robot = rule.samples.frame["robot"].to_numpy()[:, None]
    loss = rule.question.loss
    return [(robot == one) | (random.random((robot.size, replicates)) >= loss) for one in rule.samples.robots]


def _told_of_damage(
    rule: Rule, random: np.random.Generator, x_m: Floats, y_m: Floats, of_robots: int, lost: np.random.Generator
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Draw damage with these centres, and tell its risk.

    Args:
        of_robots: how many surfaces are also judged by the robots.
    Returns: the least told risk over all looks, that at the end, and the least told risk of the robot with the largest.
    """
    least, at_end, by_robots = [], [], [np.empty(0)]
    damage = patch_of(x_m, y_m, rule.question.least_m, min(rule.question.contrasts))
    for values in drawn_parts(random, rule.samples, x_m.size, damage, 250):
        told = rule.told(values, drawn=True)
        least.append(told.min(axis=0))
        at_end.append(told[-1])
        some = values[:, : max(of_robots, 0)]
        of_robots -= values.shape[1]
        if some.shape[1]:
            heard = _heard(rule, lost, some.shape[1])
            by_robots.append(np.max([rule.told(some, one, drawn=True).min(axis=0) for one in heard], axis=0))
    return np.concatenate(least), np.concatenate(at_end), np.concatenate(by_robots)


def _in_worst_block(
    random: np.random.Generator, x_m: Floats, y_m: Floats, risk: Floats, question: Question, size_m: tuple[float, float]
) -> tuple[Floats, Floats]:  # fmt: skip
    """Draw ``AT_WORST`` centres in the block of places in which most damage is missed, or nearly so.

    Args:
        x_m, y_m, risk: centres of damage, and its least told risk, (drawn,).
    """
    block = [  # of the places that a centre may have, so that all blocks are alike
        np.clip(BLOCKS * (at - 0.5 * question.least_m) // max(whole - question.least_m, 1e-9), 0, BLOCKS - 1)
        for at, whole in zip((x_m, y_m), size_m, strict=True)
    ]
    number = (block[0] * BLOCKS + block[1]).astype(np.int64)
    nearly = np.minimum(question.risk / np.maximum(risk, 1e-300), 1.0)  # 1: missed
    mean = np.bincount(number, nearly, BLOCKS**2) / np.maximum(np.bincount(number, minlength=BLOCKS**2), 1)
    worst = divmod(int(mean.argmax()), BLOCKS)
    x, y = (
        place_within((at + random.random(AT_WORST)) / BLOCKS, question.least_m, 0.0, whole)
        for at, whole in zip(worst, size_m, strict=True)
    )
    return x, y
