"""Is there damage, what would have been missed, may one stop, and does the law hold? All of one inspection."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Final, Literal

import numpy as np
import polars as pl

from vibroswarm.inspection.checks import law_checks
from vibroswarm.inspection.missed import own_trials
from vibroswarm.inspection.patches import SIZES_M, Sides, declared, shares_of
from vibroswarm.inspection.pod import Pod
from vibroswarm.inspection.samples import Doubt, Samples
from vibroswarm.inspection.scan import REPLICATES, Scan, scan
from vibroswarm.inspection.stopping import Question, Stopping, stopping
from vibroswarm.observation.energy_model import is_sensed

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
