"""The reproduction: items that are missing are computed, all are kept, and the claims are decided."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.forked import check_threads
from vibroswarm.paper.beside import Bar, Check, beside
from vibroswarm.paper.cells import Came, Cell, run_cells
from vibroswarm.paper.claims import Decided, decide
from vibroswarm.paper.fingerprint import fingerprint
from vibroswarm.paper.item import CLAIMS, Cells, Item, Settings, Tables, Work, no_claims
from vibroswarm.paper.items import all_items
from vibroswarm.paper.kept import keep, read_kept
from vibroswarm.study.executors import processors

ITEMS: Final = "items"
RUNS: Final = "runs"
CELLS: Final = "cells of all items"
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
    check_threads()
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
        todo = _Todo(settings, folder, missing, cells, prints, tell)
        came = todo.done(wanted)
        there |= todo.made
    made = tuple(Made(item, there[item.name] or {}, skipped[item.name]) for item in items)
    by_key = {cell.key: cell for one in cells.values() for cell in one.values()}
    return Reproduction(settings, made, by_key, came)


class _Todo:
    """Items that are missing, with their cells."""

    def __init__(
        self,
        settings: Settings,
        folder: Path,
        items: Sequence[Item],
        cells: Mapping[str, Cells],
        prints: Mapping[str, str],
        tell: Tell,
    ) -> None:
        self.settings, self.folder = settings, folder
        self.items, self.cells, self.prints = items, cells, prints
        each = (1 - CELLS_SHARE) / max(len(items), 1)
        self.bar = Bar(tell, {CELLS: CELLS_SHARE, **{item.name: each for item in items}})
        self.made: dict[str, Tables] = {}

    def done(self, wanted: Sequence[Cell]) -> Came:
        """Run the cells and compute the items: those that need no cells beside them, where workers are several."""
        alone = [item for item in self.items if not self.cells[item.name]]
        alone.reverse()  # the search first, which leaves Python to the planning of the cells
        aside = alone if wanted and (self.settings.workers or processors()) > 1 else []
        with beside((lambda check: self._compute(aside, None, check)) if aside else None) as check:
            came = self._run(wanted, check)
            self._compute([item for item in self.items if item not in aside], came, check)
            self.bar.shown = None
        return came

    def _run(self, wanted: Sequence[Cell], check: Check) -> Came:
        settings, self.bar.shown = self.settings, CELLS

        def told(share: float) -> None:
            check()
            self.bar.told(CELLS, share)

        return run_cells(wanted, settings.runs, settings.seed, self.folder / RUNS, settings.workers, told)

    def _compute(self, items: Sequence[Item], came: Came | None, check: Check) -> None:
        for item in items:
            if came is not None:
                self.bar.shown = item.name
            self._one(item, came or Came(self.settings.seed, self.settings.runs, {}), check)

    def _one(self, item: Item, came: Came, check: Check) -> None:
        def told(share: float) -> None:
            check()
            self.bar.told(item.name, share)

        told(0.0)
        place = self.folder / ITEMS / item.name
        plain = item.cells(replace(self.settings, control=None)) if self.settings.control else None
        tables = item.compute(
            Work(self.settings, self.cells[item.name], came, self.folder / RUNS / item.name, told, plain)
        )
        place.parent.mkdir(parents=True, exist_ok=True)
        keep(place, self.prints[item.name], tables)
        self.made[item.name] = tables
        told(1.0)
