"""Reproduce the paper: compute missing items, save all, and decide the claims.

An item is a figure or table of the paper; a cell is a scenario that is run many times. Items that need no cells are
computed in a background thread while the cells run in the main thread. Both threads report to one progress bar.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.child_python import processors
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

SWITCH_S: Final = 5e-4
"""Interval at which Python's global lock may pass to a waiting thread. Kernels run for some ms without this lock, so
with Python's default of 5 ms processors would idle."""
INTERRUPTED_S: Final = 1.0
"""Longest wait for the background thread after Ctrl-C, s."""
Check = Callable[[], None]
"""A function that each thread calls now and then; it raises an exception if the thread's work has to end."""


class Cancelled(Exception):  # noqa: N818  (nothing went wrong here)
    """Raised in the background thread when the main thread has ended early."""


@contextmanager
def background(work: Callable[[Check], None] | None) -> Iterator[Check]:
    """Run ``work`` in a background thread while the body of the ``with`` statement runs in the main thread.

    Each thread gets a check, a function that it calls now and then. The check of the work raises ``Cancelled`` after
    the body has ended by an exception, so that the work ends too. The check of the body raises an exception that the
    work has raised; so does leaving the ``with`` block, which first waits for the thread. If the body itself raises an
    exception, that exception leaves the block, and one that the work has raised is dropped.

    Args:
        work: called with its check; None: nothing is run.
    Yields:
        The check of the body.
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

    # Compilation in a thread cannot be stopped. A daemon thread lets the program end after Ctrl-C all the same.
    thread = threading.Thread(target=run, name="vibroswarm-background", daemon=True)
    patience_s: float | None = None  # longest wait for the thread; None: no limit
    before_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    thread.start()
    try:
        yield check_raised
        thread.join()  # before ``stop`` is set, so that the work completes; Ctrl-C ends this wait too
    except KeyboardInterrupt:
        patience_s = INTERRUPTED_S
        raise
    finally:
        stop.set()
        thread.join(patience_s)
        sys.setswitchinterval(before_s)
    check_raised()


class Bar:
    """A progress bar over several tasks, which several threads may update.

    Args:
        progress: called with the name of a task and the share of all work that is done, 0 to 1.
        weights: share of each task in all work, by name; only their ratios matter.
    """

    def __init__(self, progress: Callable[[str, float], None], weights: Mapping[str, float]) -> None:
        self._progress, self._weights, self._lock = progress, dict(weights), threading.Lock()
        self._done = dict.fromkeys(weights, 0.0)  # share of each task that is done
        self.shown: str | None = None
        """Name of the task that is reported to ``progress``; None: the task that was updated last."""

    def update(self, what: str, share: float) -> None:
        """Set the share of a task that is done, and report the share of all work.

        A share smaller than before is ignored, so the bar never moves back.

        Args:
            what: name of the task. share: share of the task that is done, 0 to 1.
        """
        with self._lock:
            self._done[what] = max(share, self._done[what])
            total_weight = sum(self._weights.values())
            total = sum(self._weights[name] * done for name, done in self._done.items()) / total_weight
            self._progress(self.shown or what, min(total, 1.0))


ITEMS: Final = "items"
"""Folder of the saved tables of items."""
RUNS: Final = "runs"
"""Folder of the saved runs of cells, and of unfinished work."""
CELLS: Final = "cells of all items"
"""Name of the task of the progress bar that runs the cells."""
CELLS_SHARE: Final = 0.6
"""Share of the bar for the cells; the items have the rest."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class ItemResult:
    """One item with its tables."""

    item: Item
    tables: Tables
    """By name; empty if the item was skipped."""
    skipped: str | None = None
    """Why the item was skipped; None: it was not."""


@dataclass(frozen=True)
class Reproduction:
    """Results of a reproduction."""

    settings: Settings
    made: tuple[ItemResult, ...]
    """The requested items with their tables, in the order of the request; skipped items are included."""
    cells: dict[str, Cell]
    """Cells of the items that were not skipped, by key."""

    @property
    def decided(self) -> list[Decided]:
        """Verdicts on the claims that were measured."""
        frames = [entry.tables[CLAIMS] for entry in self.made if CLAIMS in entry.tables]
        return decide(pl.concat([frame([]), *frames]))  # an empty table, as nothing may have been measured


def reproduce(
    settings: Settings,
    folder: str | Path,
    items: Sequence[Item] | None = None,
    progress: Progress = lambda what, share: None,
) -> Reproduction:
    """Compute the items that are missing in ``folder``, and return the results of all items.

    The computation may be stopped at any moment: finished work is saved in ``folder``, and a call with the same
    arguments continues from there.

    Args:
        settings: options of the reproduction. folder: folder of all saved work.
        items: items to reproduce; None: all items.
        progress: called with the name of the current task and the share of the work that is done, 0 to 1.
    Raises:
        InputError, RunError: an item's input is invalid, or its work failed; raised by the items.
    """
    folder = Path(folder)
    items = all_items() if items is None else items
    skipped = {item.name: item.skipped(settings) for item in items}
    cells: dict[str, Cells] = {
        item.name: {} if skipped[item.name] else item.cells(settings) for item in items
    }
    # A skipped item has no fingerprint, which may depend on the very files that it lacks.
    computable = [item for item in items if not skipped[item.name]]
    fingerprints = {item.name: fingerprint(item, settings, cells[item.name]) for item in computable}
    saved = {name: load_tables(folder / ITEMS / name, value) for name, value in fingerprints.items()}
    missing = [item for item in computable if saved[item.name] is None]
    if missing:
        todo = _MissingItems(settings, folder, missing, cells, fingerprints, progress)
        todo.compute()
        saved |= todo.made
    made = tuple(ItemResult(item, saved.get(item.name) or {}, skipped[item.name]) for item in items)
    by_key = {cell.key: cell for by_name in cells.values() for cell in by_name.values()}
    return Reproduction(settings, made, by_key)


class _MissingItems:
    """The items that have to be computed.

    ``cells`` are those of all items, ``fingerprints`` those of all items that are not skipped, by the name of the item.
    ``made`` receives the tables of each computed item, by the name of the item.
    """

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
        item_share = (1 - CELLS_SHARE) / len(items)  # of the progress bar, the same for each item
        self.bar = Bar(progress, {CELLS: CELLS_SHARE, **{item.name: item_share for item in items}})
        self.made: dict[str, Tables] = {}

    def compute(self) -> None:
        """Run the cells, and compute and save the items.

        With several workers, items without cells are computed in a background thread while the cells run.
        """
        wanted = [cell for item in self.items for cell in self.cells[item.name].values()]
        without_cells = [item for item in self.items if not self.cells[item.name]]
        # In reverse order the search for parameters comes first. Its kernels run without Python's global lock, which
        # the main thread needs at the beginning to plan the cells.
        without_cells.reverse()
        in_background = without_cells if wanted and (self.settings.workers or processors()) > 1 else []
        with background(
            (lambda check: self._compute_items(in_background, results=None, check=check))
            if in_background
            else None
        ) as check:
            results = self._run(wanted, check)
            self._compute_items([item for item in self.items if item not in in_background], results, check)
            self.bar.shown = None  # from now on, show which item the background computes

    def _run(self, wanted: Sequence[Cell], check: Check) -> CellResults:
        """Run the requested cells, and return their results; end early if the background thread has failed.

        Args:
            wanted: cells to run. check: called now and then; raises the exception of the background thread.
        """
        settings, self.bar.shown = self.settings, CELLS

        def report_progress(share: float) -> None:
            check()
            self.bar.update(CELLS, share)

        return run_cells(
            wanted, settings.runs, settings.seed, self.folder / RUNS, settings.workers, report_progress
        )

    def _compute_items(self, items: Sequence[Item], results: CellResults | None, check: Check) -> None:
        """Compute and save the tables of several items.

        Args:
            items: items to compute.
            results: results of the cells; None in the background thread, which computes items without cells.
            check: called now and then; raises if the work has to end.
        """
        no_results = CellResults(self.settings.seed, self.settings.runs, cells={})
        for item in items:
            # The bar shows one name, so only the main thread, which has results, sets it.
            if results is not None:
                self.bar.shown = item.name
            self._compute_item(item, results or no_results, check)

    def _compute_item(self, item: Item, results: CellResults, check: Check) -> None:
        """Compute and save the tables of one item, and add them to ``made``.

        Args:
            results: results of the cells, none for an item without cells.
            check: called now and then; raises if the work has to end.
        """

        def report_progress(share: float) -> None:
            check()
            self.bar.update(item.name, share)

        report_progress(0.0)
        place = self.folder / ITEMS / item.name
        tables = item.compute(
            Work(
                settings=self.settings,
                cells=self.cells[item.name],
                results=results,
                folder=self.folder / RUNS / item.name,
                progress=report_progress,
            )
        )
        place.parent.mkdir(parents=True, exist_ok=True)
        save_tables(place, self.fingerprints[item.name], tables)
        self.made[item.name] = tables
        report_progress(1.0)
