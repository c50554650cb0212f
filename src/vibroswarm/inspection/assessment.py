"""Is there damage, what would have been missed, may one stop, and does the law hold? All answers of one inspection."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count, p_value
from vibroswarm.errors import InputError
from vibroswarm.inspection.checks import BETWEEN, LAW_CHECKS, LEAST_PER_ROBOT, PLACES, law_checks
from vibroswarm.inspection.missed import false_calls, lengths_within, own_trials, weakest_found
from vibroswarm.inspection.others import by_patches, by_tiles
from vibroswarm.inspection.patches import SIZES_M, Side, declared, shares_of
from vibroswarm.inspection.pod import Pod
from vibroswarm.inspection.samples import Floats, Samples
from vibroswarm.inspection.scan import (
    CELLS,
    REPLICATES,
    Scan,
    looks_of,
    near,
    rasters,
    scan,
)
from vibroswarm.inspection.stopping import Question, Stopping, check_fits, stopping
from vibroswarm.observation.energy_model import is_sensed

WHOLLY: Final = 0.95
"""Below this share of visited cells PoD may end below 1."""
RASTERS: Final = 6
"""Most times for which the raster is computed."""
VISITED_M: Final = 0.1
"""Cells of this side are visited if a sample was taken in them."""


@dataclass(frozen=True, eq=False)
class Assessment:
    """All answers of one inspection about damage that is not bound to a grid."""

    question: Question
    scan: Scan
    stopping: Stopping
    pods: dict[float, Pod]
    """Fitted probability of detection, by contrast."""
    checks: pl.DataFrame
    """Checks of the law (``checks.law_checks``)."""
    refusals: tuple[str, ...]
    """Reasons not to certify anything; empty: none."""
    visited: float
    """Share of the surface's cells of 10 cm in which a sample was taken."""
    shaped: dict[str, Pod] = field(default_factory=dict)
    """Fitted probability of detection of discs and cracks of the largest contrast, by shape."""
    rasters: Floats = field(default_factory=lambda: np.empty((0, CELLS, CELLS)))
    """Probability of each cell at ``raster_times_s``, top row first, (times, CELLS, CELLS)."""
    raster_times_s: Floats = field(default_factory=lambda: np.empty(0))
    own_rasters: dict[int, Floats] = field(default_factory=dict)
    """Probability of each cell by each robot's own samples, by robot."""
    weakest: pl.DataFrame | None = None
    """The weakest contrast that is found (``missed.weakest_found``); None: readings of few values, which have one."""

    @property
    def verdict(self) -> Literal["damage", "clear", "open"]:
        """Return "damage" if the scan calls it, "clear" if the told risk at the end is tolerated, otherwise "open"."""
        if self.scan.p_value <= self.scan.level:
            return "damage"
        return "clear" if self.stopping.told[-1] <= self.question.risk else "open"


def assess(
    samples: Samples,
    question: Question | None = None,
    *,
    sides_m: Sequence[Side] = SIZES_M,
    replicates: int = REPLICATES,
    seed: int = 1,
    looks: int = 1,
    shapes: Sequence[str] = ("square",),
    progress: Callable[[float], None] | None = None,
) -> Assessment:
    """Answer a question about damage by the samples of one inspection.

    Args:
        question: by default ``Question()``. sides_m: declared sizes and shapes. replicates:
            intact surfaces drawn for the scan. seed: of all that is drawn.
        looks: how often the scan is looked at, evenly spaced. shapes: of ``damage.SHAPES``, of which PoD is fitted.
        progress: called with the share that is done.
    Raises:
        InputError: a declared size, or the smallest that must be found, does not fit the surface.
    """
    question = question or Question()
    done = progress or (lambda share: None)
    _check_contrasts(question, samples)
    patches = declared(samples.size_m, sides_m)
    check_fits(question, samples.size_m)  # before the scan, which may take minutes
    shares = shares_of(samples, patches)
    found = scan(
        samples, patches, shares,
        prior=question.prior, level=question.level, replicates=replicates, seed=seed, looks=looks,
    )  # fmt: skip
    done(0.2)
    if samples.floor is not None:
        checks = law_checks(samples, by_tiles(samples), seed=seed)
    else:
        others = by_patches(samples, patches, shares, found.critical, question.prior)
        away = np.all([~near(samples, box) for box in found.called_m], axis=0)  # from called damage
        checks = law_checks(samples, others, away, seed=seed)
    done(0.3)
    known = samples, patches, shares, found.critical
    visited = _visited(samples)
    drawn: dict[str, Any] = {"seed": seed + 1, "looks": looks}
    false = false_calls(*known, **drawn)
    done(0.4)

    def pod(contrast: float, shape: str = "square") -> Pod:
        sides = lengths_within(samples.size_m, shape)
        trials = own_trials(*known, false, contrast=contrast, sides_m=sides, shape=shape, **drawn)
        return trials.fit(asymptote=visited < WHOLLY)

    raster_times_s = np.unique(looks_of(samples, RASTERS)[0])
    over_time, own = rasters(samples, patches, shares, found.critical, question.prior, raster_times_s)
    stops = stopping(samples, patches, question, seed=seed)
    done(0.8)
    return Assessment(
        question,
        found,
        stops,
        {contrast: pod(contrast) for contrast in question.contrasts},
        checks,
        tuple(_refusals(samples, checks)),
        visited,
        {shape: pod(max(question.contrasts), shape) for shape in shapes if shape != "square"},
        over_time,
        raster_times_s,
        own,
        weakest_found(*known, false, **drawn) if samples.law.has_contrasts else None,
    )


def _check_contrasts(question: Question, samples: Samples) -> None:
    if question.contrasts != (1.0,) and not samples.law.has_contrasts:
        raise InputError(
            "a law of few different readings, such as 0 and 1, has one contrast; give 1", field="--contrasts"
        )


def _refusals(samples: Samples, checks: pl.DataFrame) -> Iterator[str]:
    """Yield the reasons not to certify anything."""
    refused = dict(checks.filter(pl.col("outcome") == "refused").select("check", "corrected").iter_rows())
    others_map = "map of the other robots" if samples.floor is None else "other robots' map of this grid"
    for check, p in refused.items():
        contradicted = others_map if check == PLACES else "law of the sensor"
        yield f"the samples contradict the {contradicted} ({check}, corrected p = {p_value(p)})"
    if is_sensed(samples.law.sensor) and refused.keys() - {PLACES}:
        yield (
            f"what sensor '{samples.law.sensor.model}' measures on a tile depends on the tiles around it, but its law "
            "is the mean over floors on which all kinds are mixed in equal shares: on others still tiles measure "
            "more or less than it says"
        )
    one_robot = len(samples.robots) == 1
    unmade = checks.filter(pl.col("outcome") == "not made", (pl.col("check") != BETWEEN) | (not one_robot))
    for check, number in unmade.select("check", "samples").iter_rows():
        some = f"only {count(number, 'sample')}" if number else "no sample"
        few = f"{some} on still places"
        if check != LAW_CHECKS[0]:
            who = "at most one robot has" if check == BETWEEN else "no robot has"
            few = f"{who} {LEAST_PER_ROBOT} samples on places of a known kind"
        yield f"{check} could not be checked: {few}"
    if samples.warning:
        yield samples.warning[:1].lower() + samples.warning[1:].rstrip(".")
    if one_robot:
        yield "one robot took all samples, so that its sensor cannot be compared with another"


def _visited(samples: Samples) -> float:
    """Return the share of the surface's cells in which a sample was taken."""
    across, up = (max(1, round(whole / VISITED_M)) for whole in samples.size_m)
    visits, _, _ = np.histogram2d(
        samples.column("x_m"),
        samples.column("y_m"),
        bins=(across, up),
        range=[[0.0, samples.size_m[0]], [0.0, samples.size_m[1]]],
    )
    return float((visits > 0).mean())
