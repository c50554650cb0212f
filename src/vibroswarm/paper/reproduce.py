"""The reproduction: items that are missing are computed, all are kept, and the claims are decided."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.paper.cells import Came, Cell, run_cells
from vibroswarm.paper.claims import Decided, decide
from vibroswarm.paper.fingerprint import fingerprint
from vibroswarm.paper.item import CLAIMS, Cells, Item, Settings, Tables, Work, no_claims
from vibroswarm.paper.items import all_items
from vibroswarm.paper.kept import keep, read_kept

ITEMS: Final = "items"
RUNS: Final = "runs"
CELLS_SHARE: Final = 0.6
"""Of the bar, for the cells; the items share the rest."""

Tell = Callable[[str, float], None]


@dataclass(frozen=True)
class Made:
    """One item with its tables; or why it was skipped."""

    item: Item
    tables: Tables
    skipped: str | None = None


@dataclass(frozen=True)
class Reproduction:
    """All that was asked for."""

    settings: Settings
    made: tuple[Made, ...]
    cells: dict[str, Cell]
    """By key, those of the items that were not skipped."""
    came: Came | None
    """What came of the cells, where any item had to be computed."""

    @property
    def decided(self) -> list[Decided]:
        """The claims that were measured."""
        frames = [one.tables[CLAIMS] for one in self.made if CLAIMS in one.tables]
        return decide(pl.concat([no_claims(), *frames]))


def reproduce(
    settings: Settings,
    folder: str | Path,
    items: Sequence[Item] | None = None,
    tell: Tell = lambda what, share: None,
    *,
    again: bool = False,
) -> Reproduction:
    """Compute the items that are missing in ``folder``, and give all.

    May be stopped at any moment: what is done is kept, and the same call goes on from there.

    Args:
        items: without, all. tell: called with what is being done and the share done. again: have what came of the
            cells even where no item is missing.
    Raises:
        InputError, RunError: as their rooms say.
    """
    folder = Path(folder)
    items = all_items() if items is None else items
    skipped = {item.name: item.skipped(settings) for item in items}
    cells: dict[str, Cells] = {
        item.name: {} if skipped[item.name] else item.cells(settings) for item in items
    }
    prints = {item.name: fingerprint(item, settings, cells[item.name]) for item in items}
    there = {item.name: read_kept(folder / ITEMS / item.name, prints[item.name]) for item in items}
    missing = [item for item in items if there[item.name] is None and not skipped[item.name]]
    came = None
    if missing or again:
        wanted = [cell for item in (items if again else missing) for cell in cells[item.name].values()]
        came = run_cells(
            wanted, settings.runs, settings.seed, folder / RUNS, settings.workers,
            lambda share: tell("cells of all items", CELLS_SHARE * share),
        )  # fmt: skip
    for done, item in enumerate(missing):
        assert came is not None
        first = CELLS_SHARE + (1 - CELLS_SHARE) * done / len(missing)

        def told(share: float, first: float = first, item: Item = item) -> None:
            tell(item.name, first + (1 - CELLS_SHARE) * share / len(missing))

        told(0.0)
        place = folder / ITEMS / item.name
        work = Work(settings, cells[item.name], came, folder / RUNS / item.name, told)
        tables = item.compute(work)
        place.parent.mkdir(parents=True, exist_ok=True)
        keep(place, prints[item.name], tables)
        there[item.name] = tables
    made = tuple(Made(item, there[item.name] or {}, skipped[item.name]) for item in items)
    by_key = {cell.key: cell for one in cells.values() for cell in one.values()}
    return Reproduction(settings, made, by_key, came)
