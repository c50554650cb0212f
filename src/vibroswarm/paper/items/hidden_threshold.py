"""Item 17: what soft feedback gives beyond another threshold of certainty.

Without feedback, a lower p_c is faster and wrong more often; all values of p_c form a front of time against errors.
Soft feedback is compared with the point of that front that takes as long.

| name | symbol | equation |
|---|---|---|
| no feedback at a mean time | a | (1 - m) x_r + m y_r of run r, between two neighbouring thresholds x and y |
| mixing share | m | so that the mean time is that of soft feedback, on the other half of the runs |
| gain of soft feedback | g | mean over runs of a_r - soft_r |

A swarm that drew one of the two thresholds for each run would have these means, so every point of the front can be
reached. m is chosen on one half of the runs and evaluated on the other, and vice versa: neither side profits from a
lucky choice.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.analysis.intervals import mean_interval, plain
from vibroswarm.paper.claim_values import Row, frame, mean
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, TableView, Work
from vibroswarm.plots import draw_error_bars
from vibroswarm.report.html import Column

COLUMN: Final = "paper"
SIZES: Final = (5, 10)
FLOORS: Final = ("random:0.48", "random:0.52")
THRESHOLDS: Final = (0.7, 0.75, 0.8, 0.85, 0.875, 0.9, 0.925, 0.95, 0.975, 0.99, 0.998)
STRATEGIES: Final = ("none", "soft")
FIGURES: Final = ("decision_time_s", "wrong_share", "undecided_share")
PUBLISHED: Final = 0.95
"""p_c of the paper."""
Array = NDArray[np.float64]


def cells(settings: Settings) -> Cells:
    """Return the cells by (robots, floor, strategy, p_c)."""
    if COLUMN not in settings.columns:
        return {}
    return {
        key: settings.cell(
            COLUMN,
            {
                "swarm.robots": key[0],
                "floor.source": key[1],
                "strategy.name": key[2],
                "decision.credible_threshold": key[3],
            },
        )
        for key in product(SIZES, FLOORS, STRATEGIES, THRESHOLDS)
    }


class Matched(NamedTuple):
    """No feedback at the mean time of soft feedback, see the head of this module; (runs,) each."""

    figures: dict[str, Array]
    thresholds: tuple[float, ...]
    """p_c that were mixed on either half, with equal weight to both."""


def compute(work: Work) -> Tables:
    """Compute both fronts, the gains of soft feedback, and the claims."""
    if COLUMN not in work.settings.columns:
        return {CLAIMS: frame([])}
    measured: list[Row] = []
    rows: list[dict[str, Any]] = []
    for robots, threshold in product(SIZES, THRESHOLDS):
        soft = _over_floors(work, robots, "soft", threshold)
        found = match(_front(work, robots), soft)
        if found is None:
            continue
        row: dict[str, Any] = {
            "robots": robots,
            "p_c": threshold,
            "mean p_c": float(np.mean(found.thresholds)),
        }
        for name in FIGURES:
            gain = found.figures[name] - soft[name]
            limits = mean_interval(gain)
            row |= {
                name: limits.estimate,
                f"{name} from": plain(limits.low),
                f"{name} to": plain(limits.high),
            }
            if threshold == PUBLISHED and name == "wrong_share":
                keys = [(robots, floor, strategy, threshold) for floor in FLOORS for strategy in STRATEGIES]
                words = f"{robots} robots, fill ratios 0.48 and 0.52"
                measured.append(mean("soft-beyond-threshold", COLUMN, words, gain, cannot=work.cannot(*keys)))
        rows.append(row)
    fronts = [
        {"robots": robots, "strategy": strategy, "p_c": threshold}
        | _means(_over_floors(work, robots, strategy, threshold))
        for robots, strategy, threshold in product(SIZES, STRATEGIES, THRESHOLDS)
    ]
    return {
        "fronts": pl.DataFrame(fronts),
        "gains": pl.DataFrame(rows, infer_schema_length=None),
        CLAIMS: frame(measured),
    }


def _over_floors(work: Work, robots: int, strategy: str, threshold: float) -> dict[str, Array]:
    """Return each figure of each run, averaged over the floors, which share their motion; (runs,) each."""
    return {
        name: np.mean([work.values((robots, floor, strategy, threshold), name) for floor in FLOORS], axis=0)
        for name in FIGURES
    }


def _front(work: Work, robots: int) -> dict[float, dict[str, Array]]:
    return {threshold: _over_floors(work, robots, "none", threshold) for threshold in THRESHOLDS}


def _means(figures: dict[str, Array]) -> dict[str, float | None]:
    found: dict[str, float | None] = {}
    for name, values in figures.items():
        limits = mean_interval(values)
        found |= {name: limits.estimate, f"{name}_low": plain(limits.low), f"{name}_high": plain(limits.high)}
    return found


def match(front: dict[float, dict[str, Array]], soft: dict[str, Array]) -> Matched | None:
    """Return no feedback at the mean time of soft feedback; None if its front does not reach that time.

    Args:
        front: figures by threshold. soft: figures to be matched.
    """
    runs = soft["decision_time_s"].size
    figures = {name: np.empty(runs) for name in FIGURES}
    thresholds: list[float] = []
    for half in (0, 1):
        other = slice(1 - half, None, 2)
        times = {p: float(values["decision_time_s"][other].mean()) for p, values in front.items()}
        wanted = float(soft["decision_time_s"][other].mean())
        ordered = sorted(times, key=lambda p: times[p])
        above = next((k for k, p in enumerate(ordered) if times[p] >= wanted), None)
        if above is None or (above == 0 and times[ordered[0]] > wanted):
            return None
        first, second = ordered[max(above - 1, 0)], ordered[above]
        gap = times[second] - times[first]
        share = (wanted - times[first]) / gap if gap > 0.0 else 0.0
        for name in FIGURES:
            mixed = (1.0 - share) * front[first][name] + share * front[second][name]
            figures[name][half::2] = mixed[half::2]
        thresholds.append((1.0 - share) * first + share * second)
    return Matched(figures, tuple(thresholds))


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield wrong and undecided robots over time, with both strategies."""
    if "fronts" not in tables:
        return
    for robots in SIZES:
        table = tables["fronts"].filter(pl.col("robots") == robots)
        for name, words in (("wrong_share", "wrong"), ("undecided_share", "undecided")):
            marks = table.select(
                x="decision_time_s", series="strategy", estimate=name, low=f"{name}_low", high=f"{name}_high"
            ).sort("series", "x")
            draw = partial(
                draw_error_bars, marks, x_label="decision time (s)", label=f"robots {words}", percent=True
            )
            yield Picture(
                f"hidden-threshold-{words}-{robots}",
                f"Robots {words} over time, {robots} robots, p_c varied",
                draw,
            )


def _limits(name: str, title: str, *, percent: bool) -> dict[str, Column]:
    unit = "" if percent else "s"
    return {
        name: Column(title, unit, percent=percent),
        f"{name} from": Column("from", unit, percent=percent),
        f"{name} to": Column("to", unit, percent=percent),
    }


ITEM: Final = Item(
    number=17,
    name="hidden-threshold",
    title="Soft feedback is a hidden threshold",
    about=(
        "Soft feedback makes robots decide earlier. So does a lower threshold p_c without feedback, with more wrong "
        "decisions. Both are run with eleven values of p_c on random floors at 0.48 and 0.52, with five robots and "
        "with ten, and otherwise P*; all share their motion. Soft feedback is then compared with no feedback at the "
        "threshold that takes as long.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        TableView(
            "gains",
            "No feedback at the mean time of soft feedback - soft feedback, paired, with 95 % intervals over runs: a "
            "positive difference is a gain of soft feedback.",
            {
                "robots": Column("robots"),
                "p_c": Column("p_c of soft"),
                "mean p_c": Column("p_c of none", digits=3),
                **_limits("wrong_share", "wrong", percent=True),
                **_limits("undecided_share", "undecided", percent=True),
                **_limits("decision_time_s", "time", percent=False),
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
                "wrong_share": Column("wrong", percent=True),
                "undecided_share": Column("undecided", percent=True),
            },
        ),
    ),
)
