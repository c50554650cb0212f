"""The paper's table of difficulties of five floor patterns, with the correct values beside the printed ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import polars as pl

from vibroswarm.floors.difficulty import entropy, moran_index
from vibroswarm.floors.source import pattern
from vibroswarm.paper.claims import constant
from vibroswarm.paper.columns import published
from vibroswarm.paper.item import Made, Work

PATTERNS: Final = {
    "diagonal": "diagonal",
    "stripe": "stripe",
    "block_diagonal": "block-diagonal",
    "alternating": "alternating",
    "random": "random-fixed",
}
"""The paper's five patterns and our names for them."""
FILLS: Final = ("0.48", "0.46")
"""Fill ratios as the paper names them; not all floors have exactly this share of vibrating tiles."""
_PAPER_ONES: Final = 48
"""The number N_v of vibrating tiles that the paper uses for all entropies."""


@dataclass(frozen=True)
class Entry:
    """One number of the paper's table."""

    pattern: str
    measure: str
    printed: float
    as_the_paper: float
    right: float

    @property
    def wrong(self) -> bool:
        """Whether the printed number is not the correct one, rounded to two decimals."""
        return abs(self.printed - self.right) > 0.005 + 1e-9  # 1e-9: for floating-point rounding


def paper_table() -> Iterator[Entry]:
    """Yield the 20 entries of the paper's table of Moran index and entropy, with the correct numbers."""
    printed = published("patterns_10x10")
    for paper_name, kind in PATTERNS.items():
        for fill in FILLS:
            name = f"{kind}:{fill}"
            # At 0.46 the paper's alternating floor has 48 vibrating tiles; the correct one has 46.
            used = pattern("alternating:paper-0.46" if name == "alternating:0.46" else name)
            correct = pattern(name)
            moran, ordered = (float(printed[f"{key}_{fill}"][paper_name]) for key in ("moran", "entropy"))
            yield Entry(name, "Moran index", moran, moran_index(used), moran_index(correct))
            yield Entry(name, "entropy", ordered, entropy(used, _PAPER_ONES), entropy(correct))


def compute(work: Work, made: Made) -> None:
    """Compare the printed table with the right one."""
    rows = []
    for entry in paper_table():
        right = round(entry.right, 12)  # without rounding errors of logarithms
        rows.append((entry.pattern, entry.measure, entry.printed, round(entry.as_the_paper, 12), right))
        label = f"{entry.pattern}, {entry.measure}"
        made.values.append(constant("difficulty-printed", "paper", label, entry.printed - right))
    names = ["pattern", "measure", "printed", "as_the_paper_computed", "correct"]
    made.tables["difficulty"] = pl.DataFrame(rows, schema=names, orient="row")
