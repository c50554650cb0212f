"""Define what an item of the paper is: cells to run, tables made from their results, pictures and claims.

Pictures, claims and the report are made from the tables alone, so an item with saved tables is not computed again.
Saved tables carry a fingerprint of everything they depend on.

A **column** is a preset of the reproduction. A claim cannot be asked of a column for one of two reasons. First,
decisions and decision times answer the paper's question only if the expected share of ones lies on the same side of the
boundary as the fill ratio (``statistics.decidability``). Second, a sensor with an edge response fitted on tiles of one
size cannot be used on smaller tiles, of which edges take up a larger share: no recording shows that vibration reaches
as far there.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import polars as pl

from vibroswarm.core.atomic_io import MANIFEST, whole_folder, write_files
from vibroswarm.core.folders import about_file, manifest_text, read_described
from vibroswarm.core.jit import hash_of_files
from vibroswarm.core.numbers import number, percent
from vibroswarm.core.tables import parquet_bytes, read_frame
from vibroswarm.errors import InputError
from vibroswarm.floors import is_random
from vibroswarm.floors.floor import Floor
from vibroswarm.observation.decision_boundary import expected_ones
from vibroswarm.paper.cells import Cell, CellResults
from vibroswarm.paper.claim_values import Row, frame, mean, share
from vibroswarm.paper.columns import COLUMNS, real_floor, scenario_of
from vibroswarm.plots import Picture as Drawn
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.show.document import Column, Figure
from vibroswarm.simulation import versions
from vibroswarm.statistics.decidability import decidability, decidability_of_share
from vibroswarm.study.batch import WALK

Tables = dict[str, pl.DataFrame]
"""Tables of an item, by name."""
CLAIMS: Final = "measured"
"""The table of measured values that decides the claims."""


@dataclass(frozen=True)
class Settings:
    """Options of a reproduction."""

    runs: int = 1000
    """Number of runs of each cell."""
    seed: int = 1
    columns: tuple[str, ...] = COLUMNS
    """Presets of the reproduction to compute."""
    recordings: Path | None = None
    """Folder of the study's recordings; None: items that need them are skipped."""
    workers: int | None = None
    """Number of threads; None: one for each processor."""

    def scenario(
        self, column: str, values: dict[str, Any] | None = None, *, parameter_set: str = "P*"
    ) -> Scenario:
        """Return the scenario of a column.

        Args:
            column: one of ``COLUMNS``. values: fields to set, by dotted name. parameter_set: "P*" or "P0".
        """
        return scenario_of(column, values, parameter_set=parameter_set)

    def cell(self, column: str, values: dict[str, Any] | None = None, *, parameter_set: str = "P*") -> Cell:
        """Return the cell with the scenario of a column (``scenario``) and all runs."""
        return Cell(column, self.scenario(column, values, parameter_set=parameter_set))


Cells = dict[Hashable, Cell]
"""The cells of an item; keys are mostly tuples, such as (column, strategy, fill ratio)."""


@dataclass(frozen=True)
class Work:
    """Everything that an item computes its tables with."""

    settings: Settings
    cells: Cells
    """Cells of this item, by key."""
    results: CellResults
    """Results of the cells of all items."""
    folder: Path
    """Scratch folder for unfinished work."""
    progress: Callable[[float], None] = lambda share: None
    """Called with the share of the item's work that is done, 0 to 1."""

    def cannot(self, *keys: Hashable) -> str | None:
        """Return why decisions in these cells cannot answer the question, or None if they can; see ``cannot_ask``.

        If several cells cannot answer the question, the reason of the first of them is returned. The strategy does not
        matter, so one key is enough for cells that differ in the strategy only.

        Args:
            keys: keys of the cells.
        """
        reasons = (cannot_ask(self.cells[key].scenario) for key in keys)
        return next((reason for reason in reasons if reason), None)

    def rows(self, names: tuple[str, ...], keys: Iterable[tuple[Any, ...]] | None = None) -> pl.DataFrame:
        """Return a table of cells, one row per key: the parts of the key, then the columns of ``CellResults.row``.

        Args:
            names: columns for the parts of a key.
            keys: keys of the cells, tuples; None: all keys that are tuples. Without keys, the table has no columns.
        """
        chosen = [key for key in self.cells if isinstance(key, tuple)] if keys is None else keys
        rows = [{**dict(zip(names, key, strict=True)), **self.results.row(self.cells[key])} for key in chosen]
        return pl.DataFrame(rows, infer_schema_length=None)

    def values(self, key: Hashable, name: str) -> Any:
        """Return the figure ``name`` of each run of a cell, (runs,); NaN where it is undefined in a run."""
        return self.results[self.cells[key]].figures[name]

    def difference(self, name: str, first: Hashable, second: Hashable) -> Any:
        """Return the difference (first - second) of the figure ``name`` between two cells, run by run, (runs,)."""
        return self.values(first, name) - self.values(second, name)

    def change(
        self,
        value_name: str,
        column: str,
        label: str,
        name: str,
        first: Hashable,
        second: Hashable,
        *,
        check: bool = True,
    ) -> Row:
        """Return the row of the paired difference (first - second) of a figure between two cells.

        Args:
            value_name: what claims name (``Claim.value``). column: preset of the reproduction.
            label: names the value for people.
            name: name of the figure. first, second: keys of the cells.
            check: whether to check that the column can answer the question; if it cannot, the row states why. Figures
                of how robots walk (``WALK``) are never checked, because they can be compared on any floor.
        """
        values = self.difference(name, first, second)
        cannot = self.cannot(first, second) if check and name not in WALK else None
        # Wrong decisions may be rare, and the limits of ``share`` hold for rare events too.
        if name == "wrong_share":
            return share(value_name, column, label, values, cannot=cannot)
        # A belief lies between 0 and 1, so a difference of beliefs lies between -1 and 1. ``bounded`` lets ``mean`` use
        # this bound to widen the limits for rare large differences that did not occur in these runs. Times and
        # distances have no such bound.
        return mean(value_name, column, label, values, bounded=name == "belief_in_truth", cannot=cannot)

    def changes(
        self,
        figures: Mapping[str, str],
        column: str,
        label: str,
        first: Hashable,
        second: Hashable,
    ) -> list[Row]:
        """Return the rows of ``change`` for several figures of two cells.

        Args:
            figures: name of the figure, by what claims name.
        """
        return [
            self.change(value_name, column, label, name, first, second)
            for value_name, name in figures.items()
        ]

    def claims(self, measure: Callable[[Work, str], Iterable[Row]]) -> pl.DataFrame:
        """Return the rows that ``measure`` yields for each column, as a table with the columns of ``claims.MEASURED``.

        Args:
            measure: called with this object and a column (preset); yields the rows of the measured values.
        """
        return frame([row for column in self.settings.columns for row in measure(self, column)])


class Picture(NamedTuple):
    """A picture of an item."""

    figure: Figure
    folded: bool = False
    """Whether the page shows it folded, below the others."""


def picture(
    name: str, title: str, draw: Callable[..., Drawn], *data: Any, folded: bool = False, **options: Any
) -> Picture:
    """Return a picture that is drawn when a page or a file needs it.

    Args:
        name: of its files. title: heading. draw: one of ``plots``, which gets ``data``, ``options`` and a ``style``.
    """
    figure = Figure(name, lambda style: draw(*data, style=style, **options), title, on_page="column")
    return Picture(figure, folded)


class TableView(NamedTuple):
    """How a table is shown: its name, caption and columns."""

    table: str
    """Name of the table."""
    caption: str
    columns: Mapping[str, Column]
    """Heading and format of the columns to show, by name of the column, in order; limits of another column are not
    among them."""


@dataclass(frozen=True)
class Item:
    """One figure or table of the paper: how its tables are computed, drawn and shown."""

    number: int
    """Place in the paper's order, from 1."""
    name: str
    """Name on the command line and in file names."""
    title: str
    about: tuple[str, ...]
    """Paragraphs: what the paper shows and what to look for here."""
    compute: Callable[[Work], Tables]
    """Compute the tables by name; a table ``CLAIMS`` holds the measured values of claims."""
    cells: Callable[[Settings], Cells] = lambda settings: {}
    """Return the cells whose results ``compute`` needs."""
    pictures: Callable[[Tables, Settings], Iterator[Picture]] = lambda tables, settings: iter(())
    """Yield the pictures that are drawn from the tables."""
    shown: tuple[TableView, ...] = ()
    """Tables of the report."""
    skipped: Callable[[Settings], str | None] = lambda settings: None
    """Return why it cannot be computed, or None."""
    also: Callable[[Settings], str] = lambda settings: ""
    """Return a text that changes with whatever else the item's tables depend on, such as the hash of a file."""


def cells_and_claims(
    keys: tuple[str, ...], measure: Callable[[Work, str], Iterable[Row]]
) -> Callable[[Work], Tables]:
    """Return an item's ``compute``, which makes a table of all its cells and a table of measured values.

    Args:
        keys: names of the parts of the cells' keys.
        measure: called with the item's ``Work`` and a column (preset); yields the rows of the measured values.
    """
    return lambda work: {"cells": work.rows(keys), CLAIMS: work.claims(measure)}


def needs_column(*columns: str) -> Callable[[Settings], str | None]:
    """Return an item's ``skipped``: the item is skipped if none of these columns (presets) was requested."""
    presets = " or ".join(f"`{column}`" for column in columns)
    reason = f"It needs preset {presets}: add it to `--columns`."
    return lambda settings: None if set(columns) & set(settings.columns) else reason


_reasons: dict[Any, str | None] = {}
"""What ``cannot_ask`` has found, by all that it depends on: cells of many strategies share it."""


def cannot_ask(scenario: Scenario) -> str | None:
    """Return why decisions in this scenario cannot answer the paper's question, or None if they can.

    The reasons are explained at the head of this module.
    """
    key = scenario.arena, scenario.floor, scenario.change, scenario.sensor, scenario.task, scenario.decision
    if key not in _reasons:
        _reasons[key] = _edges(scenario) or _side(scenario)
    return _reasons[key]


def _side(scenario: Scenario) -> str | None:
    """Return a reason if the expected share of ones is not on the side of the boundary where the fill ratio is.

    Otherwise return None.
    """
    verdict = decidability(scenario)
    if is_random(scenario.floor.source) and scenario.sensor.edge_reach_m is not None:
        # Vibration crosses edges, and random floors of one fill ratio differ in the length of their edges, and so in
        # the share of ones. ``decidability`` uses one of these floors; here the mean over floors is used.
        # ``decidability`` always gives a fill ratio; ``or 0.0`` is for type checkers.
        fill_ratio = verdict.fill_ratio or 0.0
        expected_share = expected_ones(scenario, fill_ratio)
        verdict = decidability_of_share(expected_share, verdict.tested, verdict.truth)
    return (
        None
        if verdict.verdict == "decidable"
        else f"{verdict.verdict}: {percent(verdict.share)} of the readings are ones"
    )


def _edges(scenario: Scenario) -> str | None:
    """Return a reason if tiles are smaller than those on which the edge response was fitted, and None otherwise.

    If edges have no reach (None or 0), the size of tiles does not matter, and the result is None.
    """
    reach_m = scenario.sensor.edge_reach_m
    if not reach_m:
        return None
    # The floors of all seeds and runs have tiles of the same size, so any seed and run will do.
    side_m = _side_m(scenario.floor_for(seed=0, run=0))
    fitted_m = _fitted_m()
    if side_m >= fitted_m * (1.0 - 1e-9):  # 1e-9 allows for rounding errors
        return None
    return (
        f"edges reach {number(1000 * reach_m, 0)} mm and were fitted on tiles of {number(1000 * fitted_m, 0)} mm; "
        f"these have {number(1000 * side_m, 0)} mm"
    )


@cache
def _fitted_m() -> float:
    """Return the shorter side of the tiles of the real floor, to which the edges of `calibrated` were fitted, m."""
    return _side_m(preset("calibrated").with_values(real_floor()).floor_for(0, 0))


def _side_m(floor: Floor) -> float:
    """Return the shorter side of a tile, m."""
    _, _, width_m, height_m, *_ = floor.geometry
    return float(min(width_m, height_m))


@cache
def code_hash() -> str:
    """Return hexadecimal digits that change with the sources and data files that items compute with.

    The sources of the simulation are left out, because ``fingerprint`` covers them by ``versions``.
    """
    top = Path(__file__).parent.parent
    packages = ("statistics", "calibrate", "recordings", "search", "paper", "study")
    paths = sorted(path for package in packages for path in (top / package).rglob("*"))
    return hash_of_files(top, [path for path in paths if path.suffix in (".py", ".json", ".toml")])


def fingerprint(item: Item, settings: Settings, cells: Cells) -> str:
    """Return 16 hexadecimal digits that change with everything the item's tables depend on.

    Of the settings, ``workers`` changes no table, and ``Item.also`` covers ``recordings``.

    Args:
        item: the item. settings: options of the reproduction. cells: the item's cells.
    """
    data = {
        "item": item.name,
        "cells": sorted({cell.key for cell in cells.values()}),
        "runs": settings.runs,
        "seed": settings.seed,
        "columns": settings.columns,
        "also": item.also(settings),
        "versions": versions(),  # among them ``core.jit.source_hash``, of the sources of the simulation
        "code": code_hash(),  # the function above, of other sources and of data files
    }
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


def load_tables(folder: Path, fingerprint: str) -> Tables | None:
    """Return the tables of an item that are saved in a folder, by name; None if the item has to be computed again.

    The item has to be computed again if the tables are missing, damaged, or saved with another fingerprint.
    """
    try:
        manifest, files = read_described(folder, "item")
        if manifest["fingerprint"] != fingerprint:
            return None
        tables = {name: read_frame(path, name) for name, path in files.items()}
    except InputError:
        return None
    return tables if CLAIMS not in tables or tables[CLAIMS].schema == frame([]).schema else None


def save_tables(folder: Path, fingerprint: str, tables: Tables) -> None:
    """Save the tables of an item in a folder of their own, whole or not at all; earlier tables there are replaced.

    Raises:
        InputError, RunError: the tables cannot be written.
    """
    contents = {f"{name}.parquet": parquet_bytes(table) for name, table in tables.items()}
    files = {name: about_file(data) for name, data in contents.items()}
    text = manifest_text("item", fingerprint=fingerprint, files=files)
    with whole_folder(folder, replace=True) as part:
        write_files(part, {**contents, MANIFEST: text})
