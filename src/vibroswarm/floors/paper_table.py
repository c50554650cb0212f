"""The paper's table of difficulties beside the right values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from vibroswarm.floors.difficulty import entropy, moran_index
from vibroswarm.floors.patterns import pattern

_PRINTED: Final = {
    # pattern: Moran index at 0.48, entropy at 0.48, Moran index at 0.46, entropy at 0.46
    "diagonal": (0.73, 1.00, 0.71, 0.99),
    "stripe": (0.88, 1.00, 0.88, 0.99),
    "block-diagonal": (0.76, 0.85, 0.75, 0.84),
    "alternating": (-0.96, 0.00, -0.91, 0.00),
    "random-fixed": (0.00, 0.51, -0.05, 0.46),
}
_PAPER_ONES: Final = 48  # the N_v of all its entropies


@dataclass(frozen=True)
class Entry:
    """One number of the table.

    Args:
        pattern: its name here. measure: "Moran index" or "entropy".
        printed: as the paper has it.
        as_the_paper: computed as the paper did: on the floor that it used, with N_v = 48.
        right: on the floor of the fill ratio named, with its own N_v.
    """

    pattern: str
    measure: str
    printed: float
    as_the_paper: float
    right: float

    @property
    def wrong(self) -> bool:
        """Whether the printed number is not the right one to its two digits."""
        return abs(self.printed - self.right) > 0.005 + 1e-9


def paper_table() -> list[Entry]:
    """All 20 numbers of the paper's table of Moran index and entropy, side by side with the right ones."""
    table: list[Entry] = []
    for kind, printed in _PRINTED.items():
        for fill, moran, clustering in (("0.48", *printed[:2]), ("0.46", *printed[2:])):
            name = f"{kind}:{fill}"
            used = pattern("alternating:paper-0.46" if name == "alternating:0.46" else name)
            true = pattern(name)
            table.append(Entry(name, "Moran index", moran, moran_index(used), moran_index(true)))
            table.append(Entry(name, "entropy", clustering, entropy(used, _PAPER_ONES), entropy(true)))
    return table
