"""Item 4: soft feedback over eta and kappa."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.paper.cell_tables import FIGURES, both_forms, two_forms
from vibroswarm.paper.claim_values import Row
from vibroswarm.paper.columns import published
from vibroswarm.paper.item import Cells, Item, Picture, Settings, Tables, Work, cells_and_claims

FILL: Final = "random:0.48"


def _etas() -> list[int]:
    return [int(eta) for eta in published("parameters.soft_feedback_grid.eta")]


def _kappas() -> list[int]:
    return [int(kappa) for kappa in published("parameters.soft_feedback_grid.kappa")]


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, strategy, eta, kappa)."""
    by_key: Cells = {}
    for column in settings.columns:
        for strategy in ("none", "positive"):
            values = {"floor.source": FILL, "strategy.name": strategy}
            by_key[column, strategy, None, None] = settings.cell(column, values)
        for eta in _etas():
            for kappa in _kappas():
                values = {"floor.source": FILL, "strategy.name": "soft"}
                values |= {"strategy.soft.eta": float(eta), "strategy.soft.kappa": float(kappa)}  # type: ignore[dict-item]
                by_key[column, "soft", eta, kappa] = settings.cell(column, values)
    return by_key


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the rows of the claims about eta and kappa."""
    time, belief, wrong = "decision_time_s", "belief_in_truth", "wrong_share"
    none = (column, "none", None, None)
    most = (column, "soft", max(_etas()), max(_kappas()))
    label = f"eta {most[2]}, kappa {most[3]}"
    yield work.change("grid-approaches-none", column, label, time, most, none)
    for eta in _etas():
        kappa_1, kappa_2, kappa_4 = ((column, "soft", eta, kappa) for kappa in (1, 2, 4))
        for claim, name, first, second in (
            ("grid-kappa-4", time, kappa_4, none),
            ("grid-kappa-1-fast", time, kappa_1, kappa_2),
            ("grid-kappa-1-belief", belief, kappa_1, kappa_2),
            ("grid-kappa-1-wrong", wrong, kappa_1, kappa_2),
        ):
            yield work.change(claim, column, f"eta {eta}", name, first, second)
    for kappa in _kappas():
        low, high = ((column, "soft", eta, kappa) for eta in (min(_etas()), max(_etas())))
        for claim, name in (("grid-eta-fast", time), ("grid-eta-belief", belief)):
            yield work.change(claim, column, f"kappa {kappa}, eta {low[2]} less {high[2]}", name, low, high)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield a line for each kappa (κ) over eta (η), with no feedback and positive feedback across, as in the paper."""
    table = tables["cells"]
    soft = table.filter(pl.col("strategy") == "soft").with_columns(series=pl.format("κ {}", pl.col("kappa")))
    across = table.filter(pl.col("strategy") != "soft").drop("eta").rename({"strategy": "series"})
    lines = across.join(pl.DataFrame({"eta": _etas()}), how="cross")
    names = [name for name in soft.columns if name != "strategy"]
    together = pl.concat([soft.select(names), lines.select(names)]).sort("series", maintain_order=True)
    flat = ("none", "positive")
    yield from both_forms(
        "feedback-grid", together, settings.columns, "eta", "η", "series", FIGURES[:5], flat
    )


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
    compute=cells_and_claims(KEYS, _measured),
    pictures=pictures,
    shown=two_forms("cells", KEYS),
)
