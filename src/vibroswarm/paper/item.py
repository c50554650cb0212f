"""Define what an item of the paper is: cells to run, tables made from their results, pictures and claims.

Pictures, claims and the report are made from the tables alone, so an item with saved tables is not computed again.
Saved tables carry a fingerprint of everything they depend on.

Decisions, and the time until them, answer the paper's question only where the readings lean to the side of the truth
(``analysis.decidability``). Edges that were fitted on tiles of one size cannot be applied to smaller ones, of which
they take up a larger share: no recording shows that vibration reaches as far there. Both are judged without a negative
control: what a control does to a column is its effect, and no reason not to ask.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import polars as pl

from vibroswarm.analysis.decidability import decidability, decidability_of_share
from vibroswarm.core.atomic_io import whole_folder
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.core.untrusted_files import entry, read_bytes, read_json, texts
from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.source import is_random
from vibroswarm.observation.decision_boundary import expected_ones
from vibroswarm.paper.cells import WALKED, Cell, CellResults
from vibroswarm.paper.claim_values import Row, frame, mean, share
from vibroswarm.paper.columns import COLUMNS, scenario_of
from vibroswarm.paper.real_data import real_floor
from vibroswarm.plots import picture
from vibroswarm.report.html import Column
from vibroswarm.scenario.scenario import Scenario, preset
from vibroswarm.simulation import versions

Tables = dict[str, pl.DataFrame]
CLAIMS: Final = "measured"
"""The table of measured values that decides the claims."""


@dataclass(frozen=True)
class Settings(NotebookView):
    """Options of a reproduction."""

    runs: int = 1000
    seed: int = 1
    columns: tuple[str, ...] = COLUMNS
    control: str | None = None
    recordings: Path | None = None
    workers: int | None = None

    def scenario(
        self, column: str, values: dict[str, Any] | None = None, *, parameter_set: str = "P*"
    ) -> Scenario:
        """Return the scenario of a column, under the negative control if one is set."""
        return scenario_of(column, values, parameter_set=parameter_set, control=self.control)

    def cell(self, column: str, values: dict[str, Any] | None = None, *, parameter_set: str = "P*") -> Cell:
        """Return the cell of a column, see ``scenario``."""
        return Cell(column, self.scenario(column, values, parameter_set=parameter_set))


Cells = dict[Hashable, Cell]
Drawn = picture.Picture


@dataclass(frozen=True)
class Work:
    """Everything an item computes with."""

    settings: Settings
    cells: Cells
    results: CellResults
    folder: Path
    """Scratch folder for unfinished work."""
    progress: Callable[[float], None] = lambda share: None
    plain: Cells | None = None
    """The cells without the negative control, if one is set."""

    def cannot(self, *keys: Hashable) -> str | None:
        """Return why decisions in these cells cannot answer the question, or None; see ``cannot_ask``."""

        plain = self.cells if self.plain is None else self.plain
        reasons = (cannot_ask(plain[key].scenario) for key in keys)
        return next((reason for reason in reasons if reason), None)

    def rows(self, names: tuple[str, ...], keys: Iterable[tuple[Any, ...]] | None = None) -> pl.DataFrame:
        """Return the table of cells: the parts of each key under these names, then ``CellResults.row``."""
        chosen = [key for key in self.cells if isinstance(key, tuple)] if keys is None else keys
        rows = [{**dict(zip(names, key, strict=True)), **self.results.row(self.cells[key])} for key in chosen]
        return pl.DataFrame(rows, infer_schema_length=None)

    def values(self, key: Hashable, name: str) -> Any:
        """Return a figure of each run of a cell, (runs,)."""
        return self.results.values(self.cells[key], name)

    def difference(self, name: str, first: Hashable, second: Hashable) -> Any:
        """Return the difference of a figure between two cells (first - second), run by run, (runs,)."""
        return self.values(first, name) - self.values(second, name)

    def change(
        self,
        claim: str,
        column: str,
        label: str,
        name: str,
        first: Hashable,
        second: Hashable,
        *,
        check: bool = True,
    ) -> Row:
        """Return the row of a claim about a paired difference between two cells (first - second).

        Args:
            label: names the value. name: of the figure. check: whether the column must be able to answer the question;
                how robots walk can be compared on any floor.
        """
        values = self.difference(name, first, second)
        cannot = self.cannot(first, second) if check and name not in WALKED else None
        if name == "wrong_share":
            return share(claim, column, label, values, cannot=cannot)
        return mean(claim, column, label, values, bounded=name == "belief_in_truth", cannot=cannot)

    def claims(self, measure: Callable[[Work, str], Iterable[Row]]) -> pl.DataFrame:
        """Return the rows that ``measure`` yields for each column, as a table of ``claims.MEASURED``."""
        return frame([row for column in self.settings.columns for row in measure(self, column)])


class Picture(NamedTuple):
    """A picture to be drawn: file name, heading and drawing function."""

    name: str
    title: str
    draw: Callable[[], Drawn]
    folded: bool = False
    """Whether it is shown folded, below the others."""


class TableView(NamedTuple):
    """How a table is shown: its name, caption and columns."""

    table: str
    caption: str
    columns: Mapping[str, Column]


@dataclass(frozen=True)
class Item(NotebookView):
    """One item, see the head of this module."""

    number: int
    name: str
    title: str
    about: tuple[str, ...]
    """Paragraphs: what the paper shows and what to look for here."""
    compute: Callable[[Work], Tables]
    cells: Callable[[Settings], Cells] = lambda settings: {}
    pictures: Callable[[Tables, Settings], Iterator[Picture]] = lambda tables, settings: iter(())
    shown: tuple[TableView, ...] = ()
    skipped: Callable[[Settings], str | None] = lambda settings: None
    """Why it cannot be computed, or None."""
    also: Callable[[Settings], str] = lambda settings: ""
    """Whatever else its tables depend on."""


def cells_and_claims(
    keys: tuple[str, ...], measure: Callable[[Work, str], Iterable[Row]]
) -> Callable[[Work], Tables]:
    """Return the ``compute`` of an item with one table of cells and the claims that ``measure`` yields for each
    column."""
    return lambda work: {"cells": work.rows(keys), CLAIMS: work.claims(measure)}


FITTED_ON: Final = "calibrated"
"""The preset whose edges were fitted, on the real floor."""


@cache
def cannot_ask(scenario: Scenario) -> str | None:
    """Return why decisions in this scenario cannot answer the question, or None."""
    return _edges(scenario) or _side(scenario)


def _side(scenario: Scenario) -> str | None:
    """Return why the readings do not lean to the side of the truth, or None."""
    verdict = decidability(scenario)
    if is_random(scenario.floor.source) and scenario.sensor.edge_reach_m is not None:
        # Random floors of one fill ratio differ in the length of their edges, so the mean over floors is used.
        share = expected_ones(scenario, verdict.fill_ratio or 0.0)
        verdict = decidability_of_share(share, verdict.tested, verdict.truth)
    return (
        None
        if verdict.verdict == "decidable"
        else f"{verdict.verdict}: {verdict.share:.1%} of the readings are ones"
    )


def _edges(scenario: Scenario) -> str | None:
    """Return why the tiles are too small for the fitted edges, or None."""
    reach_m = scenario.sensor.edge_reach_m
    if not reach_m:
        return None
    side_m, fitted_m = _side_m(scenario.floor_for(0, 0)), _fitted_m()
    if side_m >= fitted_m * (1.0 - 1e-9):
        return None
    return (
        f"edges reach {1000 * reach_m:.0f} mm and were fitted on tiles of {1000 * fitted_m:.0f} mm; these have "
        f"{1000 * side_m:.0f} mm"
    )


@cache
def _fitted_m() -> float:
    return _side_m(preset(FITTED_ON).with_values(real_floor()).floor_for(0, 0))


def _side_m(floor: Floor) -> float:
    """Return the shorter side of a tile, m."""
    _, _, width_m, height_m, *_ = floor.geometry
    return float(min(width_m, height_m))


@cache
def code_hash() -> str:
    """Return the hash of the sources and data files that items compute with."""
    digest = hashlib.sha256()
    top = Path(__file__).parent.parent
    for room in ("analysis", "calibrate", "recordings", "optimize", "paper", "study"):
        for path in sorted((top / room).rglob("*")):
            if path.suffix in (".py", ".json", ".toml"):
                digest.update(path.relative_to(top).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def fingerprint(item: Item, settings: Settings, cells: Cells) -> str:
    """Return 16 hexadecimal digits that change with everything the item's tables depend on."""
    data = {
        "item": item.name,
        "cells": sorted({cell.key for cell in cells.values()}),
        "runs": settings.runs,
        "seed": settings.seed,
        "columns": settings.columns,
        "control": settings.control,
        "also": item.also(settings),
        "versions": versions(),
        "room": code_hash(),
    }
    return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]


MARKER: Final = "item.json"
MOST_BYTES: Final = 2**30


def load_tables(folder: Path, fingerprint: str) -> Tables | None:
    """Return the tables saved in a folder; None if they are missing, damaged, or of another fingerprint."""
    path = folder / MARKER
    if not path.exists():
        return None
    try:
        head = read_json(path, "the tables of an item")
        if entry(head, "fingerprint", str, path) != fingerprint:
            return None
        tables = {}
        for name, digest in texts(entry(head, "sha256", dict, path), "sha256", path).items():
            data = read_bytes(folder / Path(f"{name}.parquet").name, MOST_BYTES, "a table")
            if hashlib.sha256(data).hexdigest() != digest:
                return None
            tables[name] = pl.read_parquet(io.BytesIO(data))
        return tables
    except (InputError, pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None


def save_tables(folder: Path, fingerprint: str, tables: Tables) -> None:
    """Save the tables, replacing earlier ones.

    Raises:
        InputError, RunError: they cannot be written.
    """
    with whole_folder(folder, replace=True, marker=MARKER) as part:
        for name, table in tables.items():
            table.write_parquet(part / f"{name}.parquet")
        digests = {
            name: hashlib.sha256((part / f"{name}.parquet").read_bytes()).hexdigest() for name in tables
        }
        head = {"fingerprint": fingerprint, "sha256": digests}
        (part / MARKER).write_text(json.dumps(head, indent=2) + "\n", encoding="utf-8")
