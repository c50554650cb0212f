"""Item 17: what soft feedback gives beyond another credible threshold p_c.

Without feedback, a lower p_c makes decisions faster and more often wrong, so the values of p_c form a front of time
against errors. Soft feedback is compared with the point of this front that has the same mean time.

| name | symbol | equation |
|---|---|---|
| figures of run r without feedback | x_r, y_r | with two neighbouring thresholds, one faster and one slower than soft |
| mixing share | m | so that (1 - m) mean(x) + m mean(y) of the time is the mean time of soft feedback |
| no feedback at this time | a_r | (1 - m) x_r + m y_r |
| gain of soft feedback | g | mean over runs of a_r - soft_r |

A swarm that used the second threshold in a share m of its runs, drawn by chance, would have these means, so every point
of the front between two thresholds can be reached. The thresholds and m are chosen on one half of the runs and used on
the other half, and vice versa, so that neither strategy profits from a lucky choice.

The paper's eta and kappa may not be the best. So soft feedback is also run with those that were found for a
league (``TUNED``); the claim is about the paper's alone.

Cells have the keys (robots, floor, variant, p_c). A figure of a run is the mean over the two floors (``FLOORS``). The
measured values of the claims are rows of ``claims.MEASURED``.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.league.entries import entries_of, frozen_settings, main_entries
from vibroswarm.paper.cells import means_of
from vibroswarm.paper.claim_values import Row, frame, mean
from vibroswarm.paper.columns import published
from vibroswarm.paper.item import (
    CLAIMS,
    Cells,
    Item,
    Picture,
    Settings,
    Tables,
    TableView,
    Work,
    needs_column,
    picture,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column, limits_of

COLUMN: Final = "paper"
"""Preset in which the cells are simulated."""
SIZES: Final = (5, 10)
"""Swarm sizes; the claim has a value for each of them."""
FLOORS: Final = ("random:0.48", "random:0.52")
"""Floors over which the figures of a run are averaged: one fill ratio on each side of one half."""
THRESHOLDS: Final = (0.7, 0.75, 0.8, 0.85, 0.875, 0.9, 0.925, 0.95, 0.975, 0.99, 0.998)
"""Credible thresholds p_c that are simulated with each strategy."""
TUNED: Final = "soft, tuned"
"""Soft feedback with the eta and kappa that were found for a league at ``MAIN_AIM``."""
TUNED_THRESHOLDS: Final = (0.9, 0.925, 0.95, 0.975, 0.99)
"""Credible thresholds that are simulated with ``TUNED``."""
VARIANTS: Final = {"none": THRESHOLDS, "soft": THRESHOLDS, TUNED: TUNED_THRESHOLDS}
"""No feedback and two kinds of soft feedback, and the thresholds of each."""
FIGURES: Final = ("decision_time_s", "wrong_share", "undecided_share")
"""Figures of a run that are compared."""
PUBLISHED: Final[float] = published("simulation.credible_threshold")
"""p_c of the paper."""
Array = NDArray[np.float64]


def cells(settings: Settings) -> Cells:
    """Return the cells by (robots, floor, strategy, p_c)."""
    fields = {"none": {"strategy.name": "none"}, "soft": {"strategy.name": "soft"}, TUNED: tuned_weights()}
    return {
        (robots, floor, variant, threshold): settings.cell(
            COLUMN,
            {
                "swarm.robots": robots,
                "floor.source": floor,
                **fields[variant],
                "decision.credible_threshold": threshold,
            },
        )
        for robots, floor, (variant, thresholds) in product(SIZES, FLOORS, VARIANTS.items())
        for threshold in thresholds
    }


def tuned_weights() -> dict[str, Any]:
    """Return the fields of soft feedback with the eta and kappa of its main entry in a league."""
    (entry,) = main_entries(entries_of(["soft"], frozen_settings()))
    weights = ("strategy.soft.eta", "strategy.soft.kappa")
    return {
        "strategy.name": "soft",
        **{name: entry.settings[name] for name in weights if name in entry.settings},
    }


def compute(work: Work) -> Tables:
    """Return the fronts of all variants, the gains of soft feedback, and the claims' measured values.

    A front has one row per threshold p_c, with the means of all figures. The gains have one row per swarm size, kind
    and threshold of soft feedback: the mean of each figure without feedback, at the same mean time, minus that with
    soft feedback. If no mixture of thresholds without feedback has this mean time (``match``), there is no such row,
    and at the paper's settings no measured value either. The gain in time is near 0, not 0: thresholds and m are chosen
    on other runs.
    """
    figures = {
        (robots, variant, threshold): _over_floors(work, robots, variant, threshold)
        for robots, (variant, thresholds) in product(SIZES, VARIANTS.items())
        for threshold in thresholds
    }
    measured: list[Row] = []
    rows: list[dict[str, Any]] = []
    for (robots, variant, threshold), soft in figures.items():
        front = {p_c: figures[robots, "none", p_c] for p_c in THRESHOLDS}
        matched = None if variant == "none" else match(front, soft)
        if matched is None:
            continue
        without, thresholds = matched
        gains = {name: without[name] - soft[name] for name in FIGURES}
        rows.append(
            {
                "robots": robots,
                "strategy": variant,
                "p_c": threshold,
                "mean p_c": float(np.mean(thresholds)),
                **means_of(gains),
            }
        )
        # The claim is about the share of wrong robots with the paper's settings.
        if variant == "soft" and threshold == PUBLISHED:
            keys = [(robots, floor, one, threshold) for floor in FLOORS for one in ("none", "soft")]
            words, cannot = f"{robots} robots, fill ratios 0.48 and 0.52", work.cannot(*keys)
            measured.append(mean("wrong-at-equal-time", COLUMN, words, gains["wrong_share"], cannot=cannot))
    fronts = [
        {"robots": robots, "strategy": variant, "p_c": threshold} | means_of(of_runs)
        for (robots, variant, threshold), of_runs in figures.items()
    ]
    return {
        "fronts": pl.DataFrame(fronts),
        "gains": pl.DataFrame(rows, infer_schema_length=None),
        CLAIMS: frame(measured),
    }


def _over_floors(work: Work, robots: int, variant: str, threshold: float) -> dict[str, Array]:
    """Return each figure of each run by name, the mean over the floors, (runs,) each.

    Runs with the same number have the same motion on all floors. They are not independent, so their mean counts as one
    run.
    """
    return {
        name: np.mean([work.values((robots, floor, variant, threshold), name) for floor in FLOORS], axis=0)
        for name in FIGURES
    }


def match(
    front: dict[float, dict[str, Array]], soft: dict[str, Array]
) -> tuple[dict[str, Array], list[float]] | None:
    """Mix two thresholds without feedback so that the mean time is that of soft feedback, see the head of this module.

    For each half of the runs, the two thresholds and the mixing share m are chosen on the other half.

    Args:
        front: figures without feedback, by threshold p_c and name, (runs,) each.
        soft: figures with soft feedback, by name, (runs,) each; at least two runs.
    Returns:
        The mixed figures a_r of each run by name, (runs,) each, and for each half of the runs the mean of the two mixed
        thresholds, weighted by the mixing share. None if, in one of the halves, the mean time of soft feedback is
        shorter or longer than all mean times of the front.
    """
    runs = soft["decision_time_s"].size
    figures = {name: np.empty(runs) for name in FIGURES}
    thresholds: list[float] = []
    for half in (0, 1):
        # Half 0 has the runs 0, 2, 4, ...; ``other`` selects the other half, on which thresholds and m are chosen.
        other = slice(1 - half, None, 2)
        times = {p: float(values["decision_time_s"][other].mean()) for p, values in front.items()}
        wanted_s = float(soft["decision_time_s"][other].mean())
        ordered = sorted(times, key=lambda p: times[p])  # from the fastest threshold to the slowest
        # Index of the fastest threshold that takes as long as soft feedback, or longer; None if all are faster.
        slower = next((k for k, p in enumerate(ordered) if times[p] >= wanted_s), None)
        # All thresholds are faster than soft feedback, or all are slower.
        if slower is None or (slower == 0 and times[ordered[0]] > wanted_s):
            return None
        # The two neighbours; the fastest threshold is its own neighbour if it takes exactly as long as soft feedback.
        first, second = ordered[max(slower - 1, 0)], ordered[slower]
        gap_s = times[second] - times[first]
        share = (wanted_s - times[first]) / gap_s if gap_s > 0.0 else 0.0  # m
        for name in FIGURES:
            mixed = (1.0 - share) * front[first][name] + share * front[second][name]
            figures[name][half::2] = mixed[half::2]
        thresholds.append((1.0 - share) * first + share * second)
    return figures, thresholds


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of the shares of wrong and of undecided robots over time, two pictures for each swarm size.

    Each picture has a line for each strategy; its points are the thresholds p_c.
    """
    for robots in SIZES:
        table = tables["fronts"].filter(pl.col("robots") == robots)
        for name, words in (("wrong_share", "wrong"), ("undecided_share", "undecided")):
            marks = table.select(
                x="decision_time_s", series="strategy", estimate=name, low=f"{name}_low", high=f"{name}_high"
            ).sort("series", "x")
            yield picture(
                f"hidden-threshold-{words}-{robots}", f"Robots {words} over time, {robots} robots, p_c varied",
                draw_error_bars, marks, x_label="decision time (s)", label=f"robots {words}", percent=True,
            )  # fmt: skip


def _difference(title: str, unit: str, name: str) -> Column:
    return Column(title, unit, share=unit == "points", sign=True, limits=limits_of(name))


ITEM: Final = Item(
    number=17,
    name="hidden-threshold",
    title="Soft feedback is a hidden threshold",
    about=(
        "Soft feedback makes robots decide earlier. So does a lower threshold p_c without feedback, with more wrong "
        "decisions. Both are run with eleven values of p_c on random floors at 0.48 and 0.52, with five robots and "
        "with ten, and otherwise P*; all share their motion. Soft feedback is then compared with no feedback at the "
        "threshold that takes as long. The paper's weights (eta, kappa) may not be the best, so it is asked again with "
        "those that were found for a league. There, with the best settings of each at equal forced error, soft "
        "feedback takes +11 s [-7, +28] at 15 % and -6 s [-12, -0.2] at 20 % (600 runs, 20 floors, 5 and 10 robots).",
    ),
    cells=cells,
    compute=compute,
    skipped=needs_column(COLUMN),
    pictures=pictures,
    shown=(
        TableView(
            "gains",
            "No feedback at the mean time of soft feedback - soft feedback, paired, with 95 % intervals over runs: a "
            "positive difference is a gain of soft feedback.",
            {
                "robots": Column("robots"),
                "strategy": Column("strategy"),
                "p_c": Column("p_c of soft"),
                "mean p_c": Column("p_c of none"),
                "wrong_share": _difference("wrong", "points", "wrong_share"),
                "undecided_share": _difference("undecided", "points", "undecided_share"),
                "decision_time_s": _difference("time", "s", "decision_time_s"),
            },
        ),
        TableView(
            "fronts",
            "Means over both floors.",
            {
                "robots": Column("robots"),
                "strategy": Column("strategy"),
                "p_c": Column("p_c"),
                "decision_time_s": Column("time", "s"),
                "wrong_share": Column("wrong", share=True),
                "undecided_share": Column("undecided", share=True),
            },
        ),
    ),
)
