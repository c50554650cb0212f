"""Reproduce the paper: compute missing items, save all, and decide the claims.

Items that need no cells are computed in a background thread while the cells run; both report to one progress bar.
"""

from __future__ import annotations

import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.fork_guard import check_threads
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.paper.cells import Cell, CellResults, run_cells
from vibroswarm.paper.claim_values import frame
from vibroswarm.paper.claims import Decided, decide
from vibroswarm.paper.item import (
    CLAIMS,
    Cells,
    Item,
    Settings,
    Tables,
    Work,
    fingerprint,
    load_tables,
    save_tables,
)
from vibroswarm.paper.items import all_items
from vibroswarm.study.executors import processors

SWITCH_S: Final = 5e-4
"""Interval at which Python's lock may pass to a waiting thread. Kernels take some ms without it; with Python's
default of
5 ms processors would idle."""
INTERRUPTED_S: Final = 1.0
"""Longest wait for the other thread after Ctrl-C."""
Check = Callable[[], None]
"""Called now and then on either side; raises to end that side's work."""


class Cancelled(Exception):  # noqa: N818  (nothing went wrong here)
    """Raised in the background thread when the main thread has ended early."""


@contextmanager
def background(work: Callable[[Check], None] | None) -> Iterator[Check]:
    """Run ``work`` in a thread while the body runs; leaving the context waits for it.

    An exception on either side ends the other one at its next call of the check it is given.

    Args:
        work: called with a check that raises if it is to stop; None: nothing is run.
    """
    if work is None:
        yield lambda: None
        return
    stop, raised = threading.Event(), list[BaseException]()

    def check_cancelled() -> None:
        if stop.is_set():
            raise Cancelled

    def run() -> None:
        try:
            work(check_cancelled)
        except Cancelled:
            pass
        except BaseException as error:  # raised again in the main thread
            raised.append(error)

    def check_raised() -> None:
        if raised:
            raise raised[0]

    # A daemon thread: Ctrl-C does not wait for one that compiles, which cannot be stopped.
    thread = threading.Thread(target=run, name="vibroswarm-background", daemon=True)
    patience_s: float | None = None
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    thread.start()
    try:
        yield check_raised
        thread.join()
    except KeyboardInterrupt:
        patience_s = INTERRUPTED_S
        raise
    finally:
        stop.set()
        thread.join(patience_s)
        sys.setswitchinterval(before_s)
    check_raised()


class Bar:
    """Share of all work done, reported from several threads.

    Args:
        progress: called with the current task and the share done. weights: of the tasks, by name.
    """

    def __init__(self, progress: Callable[[str, float], None], weights: Mapping[str, float]) -> None:
        self._progress, self._weights, self._lock = progress, dict(weights), threading.Lock()
        self._done = dict.fromkeys(weights, 0.0)
        self.shown: str | None = None
        """What is named; what tells, if None."""

    def update(self, what: str, share: float) -> None:
        """Set the share done of a task, which never falls, and report that of all tasks."""
        with self._lock:
            self._done[what] = max(share, self._done[what])
            total_weight = sum(self._weights.values())
            total = sum(self._weights[name] * done for name, done in self._done.items()) / total_weight
            self._progress(self.shown or what, min(total, 1.0))


ITEMS: Final = "items"
RUNS: Final = "runs"
CELLS: Final = "cells of all items"
CELLS_SHARE: Final = 0.6
"""Share of the bar for the cells; the items have the rest."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class ItemResult(NotebookView):
    """One item with its tables, or why it was skipped."""

    item: Item
    tables: Tables
    skipped: str | None = None


@dataclass(frozen=True)
class Reproduction(NotebookView):
    """Results of a reproduction."""

    settings: Settings
    made: tuple[ItemResult, ...]
    cells: dict[str, Cell]
    """Cells of the items that were not skipped, by key."""
    results: CellResults | None
    """Results of the cells, if any item had to be computed."""

    def __repr__(self) -> str:
        counts = Counter(one.verdict for one in self.decided)
        words = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
        return f"Reproduction({len(self.made)} items, {self.settings.runs:,} runs of each cell; {words or 'no claims'})"

    @property
    def decided(self) -> list[Decided]:
        """Verdicts on the claims that were measured."""
        frames = [entry.tables[CLAIMS] for entry in self.made if CLAIMS in entry.tables]
        return decide(pl.concat([frame([]), *frames]))


def reproduce(
    settings: Settings,
    folder: str | Path,
    items: Sequence[Item] | None = None,
    progress: Progress = lambda what, share: None,
    *,
    with_cells: bool = False,
) -> Reproduction:
    """Compute the items that are missing in ``folder`` and return all.

    It may be stopped at any moment: finished work is saved, and the same call continues from there.

    Args:
        items: default all. progress: called with the current task and the share done.
        with_cells: return results of the cells even if no item is missing.
    Raises:
        InputError, RunError: see the modules of the items.
    """
    check_threads()
    folder = Path(folder)
    items = all_items() if items is None else items
    skipped = {item.name: item.skipped(settings) for item in items}
    cells: dict[str, Cells] = {
        item.name: {} if skipped[item.name] else item.cells(settings) for item in items
    }
    fingerprints = {item.name: fingerprint(item, settings, cells[item.name]) for item in items}
    saved = {item.name: load_tables(folder / ITEMS / item.name, fingerprints[item.name]) for item in items}
    missing = [item for item in items if saved[item.name] is None and not skipped[item.name]]
    results = None
    if missing or with_cells:
        requested = [
            cell for item in (items if with_cells else missing) for cell in cells[item.name].values()
        ]
        todo = _MissingItems(settings, folder, missing, cells, fingerprints, progress)
        results = todo.compute(requested)
        saved |= todo.made
    made = tuple(ItemResult(item, saved[item.name] or {}, skipped[item.name]) for item in items)
    by_key = {cell.key: cell for by_name in cells.values() for cell in by_name.values()}
    return Reproduction(settings, made, by_key, results)


class _MissingItems:
    """Missing items with their cells."""

    def __init__(
        self,
        settings: Settings,
        folder: Path,
        items: Sequence[Item],
        cells: Mapping[str, Cells],
        fingerprints: Mapping[str, str],
        progress: Progress,
    ) -> None:
        self.settings, self.folder = settings, folder
        self.items, self.cells, self.fingerprints = items, cells, fingerprints
        each = (1 - CELLS_SHARE) / max(len(items), 1)
        self.bar = Bar(progress, {CELLS: CELLS_SHARE, **{item.name: each for item in items}})
        self.made: dict[str, Tables] = {}

    def compute(self, wanted: Sequence[Cell]) -> CellResults:
        """Run the cells and compute the items; with several workers, items without cells run in the background."""
        alone = [item for item in self.items if not self.cells[item.name]]
        alone.reverse()  # the search first: it leaves Python's lock to the planning of the cells
        aside = alone if wanted and (self.settings.workers or processors()) > 1 else []
        with background((lambda check: self._compute_items(aside, None, check)) if aside else None) as check:
            results = self._run(wanted, check)
            self._compute_items([item for item in self.items if item not in aside], results, check)
            self.bar.shown = None
        return results

    def _run(self, wanted: Sequence[Cell], check: Check) -> CellResults:
        """Run the requested cells, with progress and cancellation."""
        settings, self.bar.shown = self.settings, CELLS

        def report_progress(share: float) -> None:
            check()
            self.bar.update(CELLS, share)

        return run_cells(
            wanted, settings.runs, settings.seed, self.folder / RUNS, settings.workers, report_progress
        )

    def _compute_items(self, items: Sequence[Item], results: CellResults | None, check: Check) -> None:
        """Compute the tables of several items."""
        for item in items:
            if results is not None:
                self.bar.shown = item.name
            self._compute_item(
                item, results or CellResults(self.settings.seed, self.settings.runs, {}), check
            )

    def _compute_item(self, item: Item, results: CellResults, check: Check) -> None:
        """Compute and save the tables of one item."""

        def report_progress(share: float) -> None:
            check()
            self.bar.update(item.name, share)

        report_progress(0.0)
        place = self.folder / ITEMS / item.name
        plain = item.cells(replace(self.settings, control=None)) if self.settings.control else None
        tables = item.compute(
            Work(
                self.settings,
                self.cells[item.name],
                results,
                self.folder / RUNS / item.name,
                report_progress,
                plain,
            )
        )
        place.parent.mkdir(parents=True, exist_ok=True)
        save_tables(place, self.fingerprints[item.name], tables)
        self.made[item.name] = tables
        report_progress(1.0)
