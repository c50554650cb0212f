"""Item 1: the table of difficulty of the five patterns."""

from __future__ import annotations

from typing import Final

import polars as pl

from vibroswarm.floors.difficulty import paper_table
from vibroswarm.paper.claim_values import exact, frame
from vibroswarm.paper.columns import published
from vibroswarm.paper.item import CLAIMS, Item, Tables, TableView, Work
from vibroswarm.report.html import Column

PATTERNS: Final = {
    "diagonal": "diagonal",
    "stripe": "stripe",
    "block_diagonal": "block-diagonal",
    "alternating": "alternating",
    "random": "random-fixed",
}
"""The paper's five patterns and our names for them."""
FILLS: Final = ("0.48", "0.46")


def _table() -> pl.DataFrame:
    """Return the printed, reproduced and correct values of each pattern and measure."""
    published_names = {own_name: name for name, own_name in PATTERNS.items()}
    rows = []
    for entry in paper_table():
        kind, _, fill = entry.pattern.partition(":")
        key = "moran" if entry.measure == "Moran index" else "entropy"
        printed = float(published("patterns_10x10")[f"{key}_{fill}"][published_names[kind]])
        # Remove the rounding errors of logarithms.
        as_paper, right = round(entry.as_the_paper, 12), round(entry.right, 12)
        rows.append((entry.pattern, entry.measure, printed, as_paper, right, printed - right))
    names = ["pattern", "measure", "printed", "as the paper computed", "right", "printed less right"]
    return pl.DataFrame(rows, schema=names, orient="row")


def compute(work: Work) -> Tables:
    """Compute the 20 numbers exactly."""
    table = _table()
    measured = [
        exact("difficulty-printed", "paper", f"{row['pattern']}, {row['measure']}", row["printed less right"])
        for row in table.to_dicts()
    ]
    return {"difficulty": table, CLAIMS: frame(measured)}


ITEM: Final = Item(
    number=1,
    name="difficulty",
    title="Difficulty of the five patterns",
    about=(
        "The paper's table of Moran indices and entropies: printed, as the paper computed it (48 vibrating "
        "tiles in all entropies, and an alternating floor of 48 instead of 46), and correct for the fill "
        "ratio named.",
    ),
    compute=compute,
    shown=(
        TableView(
            "difficulty",
            "Printed and computed; nothing here is uncertain.",
            {
                "pattern": Column("pattern"),
                "measure": Column("measure"),
                "printed": Column("printed"),
                "as the paper computed": Column("as the paper computed"),
                "right": Column("correct"),
                "printed less right": Column("printed - correct", digits=2),
            },
        ),
    ),
)
