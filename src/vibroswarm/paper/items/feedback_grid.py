"""Item 4: soft feedback over eta and kappa."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, Work
from vibroswarm.paper.measure import Row, frame, mean, share
from vibroswarm.paper.published import published
from vibroswarm.paper.show import FIGURES, both_forms, two_forms

FILL: Final = "random:0.48"


def _etas() -> list[int]:
    return [int(eta) for eta in published("parameters.soft_feedback_grid.eta")]


def _kappas() -> list[int]:
    return [int(kappa) for kappa in published("parameters.soft_feedback_grid.kappa")]


def cells(settings: Settings) -> Cells:
    """column, strategy, eta, kappa."""
    found: Cells = {}
    for column in settings.columns:
        for strategy in ("none", "positive"):
            values = {"floor.source": FILL, "strategy.name": strategy}
            found[column, strategy, None, None] = settings.cell(column, values)
        for eta in _etas():
            for kappa in _kappas():
                values = {"floor.source": FILL, "strategy.name": "soft"}
                values |= {"strategy.soft.eta": float(eta), "strategy.soft.kappa": float(kappa)}  # type: ignore[dict-item]
                found[column, "soft", eta, kappa] = settings.cell(column, values)
    return found


def compute(work: Work) -> Tables:
    """Cells, what each differs from no feedback, and claims."""
    columns = work.settings.columns
    measured = [row for column in columns for row in _measured(work, column)]
    return {"cells": work.rows(("column", "strategy", "eta", "kappa")), CLAIMS: frame(measured)}


def _measured(work: Work, column: str) -> Iterator[Row]:
    time, belief, wrong = "decision_time_s", "belief_in_truth", "wrong_share"
    none = (column, "none", None, None)
    most = (column, "soft", max(_etas()), max(_kappas()))
    words, cannot = f"eta {most[2]}, kappa {most[3]}", work.cannot(none)
    yield mean("grid-approaches-none", column, words, work.difference(time, most, none), cannot=cannot)
    for eta in _etas():
        words, first, second = f"eta {eta}", (column, "soft", eta, 1), (column, "soft", eta, 2)
        change = work.difference(time, (column, "soft", eta, 4), none)
        yield mean("grid-kappa-4", column, words, change, cannot=cannot)
        yield mean("grid-kappa-1-fast", column, words, work.difference(time, first, second), cannot=cannot)
        beliefs = work.difference(belief, first, second)
        yield mean("grid-kappa-1-belief", column, words, beliefs, bounded=True, cannot=cannot)
        yield share("grid-kappa-1-wrong", column, words, work.difference(wrong, first, second), cannot=cannot)
    for kappa in _kappas():
        low, high = ((column, "soft", eta, kappa) for eta in (min(_etas()), max(_etas())))
        words = f"kappa {kappa}, eta {low[2]} less {high[2]}"
        yield mean("grid-eta-fast", column, words, work.difference(time, low, high), cannot=cannot)
        beliefs = work.difference(belief, low, high)
        yield mean("grid-eta-belief", column, words, beliefs, bounded=True, cannot=cannot)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """A line a kappa, and no feedback across, as the paper draws it."""
    whole = tables["cells"]
    soft = whole.filter(pl.col("strategy") == "soft").with_columns(
        series=pl.format("kappa {}", pl.col("kappa"))
    )
    across = whole.filter(pl.col("strategy") != "soft").drop("eta").rename({"strategy": "series"})
    lines = across.join(pl.DataFrame({"eta": _etas()}), how="cross")
    names = [name for name in soft.columns if name != "strategy"]
    together = pl.concat([soft.select(names), lines.select(names)]).sort("series", maintain_order=True)
    yield from both_forms("feedback-grid", together, settings.columns, "eta", "eta", "series", FIGURES[:5])


KEYS: Final = ("column", "strategy", "eta", "kappa")
ITEM: Final = Item(
    number=4,
    name="feedback-grid",
    title="Soft feedback over eta and kappa",
    about=(
        "The second stage of the paper's optimisation: five robots with P* at a fill ratio of 0.48. No "
        "feedback and positive feedback, which know neither eta nor kappa, are drawn across. All cells of a "
        "column share their motion.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=two_forms("cells", KEYS),
)
