"""What an item of the paper is here: cells that are run, tables made of them, pictures and claims made of the tables.

Pictures, claims and report are made of the tables alone, so an item whose tables are kept is not computed again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import polars as pl

from vibroswarm.page.report import Column
from vibroswarm.paper.cells import Came, Cell
from vibroswarm.paper.claims import MEASURED
from vibroswarm.paper.columns import COLUMNS, scenario_of
from vibroswarm.scenario import Scenario

Tables = dict[str, pl.DataFrame]
CLAIMS: Final = "measured"
"""The table that the claims are decided by."""


@dataclass(frozen=True)
class Settings:
    """What is asked for."""

    runs: int = 1000
    seed: int = 1
    columns: tuple[str, ...] = COLUMNS
    control: str | None = None
    recordings: Path | None = None
    workers: int | None = None

    def scenario(self, column: str, values: dict[str, Any] | None = None, *, with_: str = "P*") -> Scenario:
        """A column's scenario, under the negative control where one is asked for."""
        return scenario_of(column, values, with_=with_, control=self.control)

    def cell(self, column: str, values: dict[str, Any] | None = None, *, with_: str = "P*") -> Cell:
        """A column's cell."""
        return Cell(column, self.scenario(column, values, with_=with_))


Cells = dict[Hashable, Cell]


@dataclass(frozen=True)
class Work:
    """What an item computes with."""

    settings: Settings
    cells: Cells
    came: Came
    folder: Path
    """Where it may keep what it has half done."""
    tell: Callable[[float], None] = lambda share: None
    plain: Cells | None = None
    """The cells without the negative control, where there is one."""

    def cannot(self, *keys: Hashable) -> str | None:
        """Why decisions in these cells cannot answer the question; None where they can, see ``askable``."""
        from vibroswarm.paper.askable import cannot_ask

        plain = self.cells if self.plain is None else self.plain
        reasons = (cannot_ask(plain[key].scenario) for key in keys)
        return next((reason for reason in reasons if reason), None)

    def rows(self, names: tuple[str, ...], keys: Iterable[tuple[Any, ...]] | None = None) -> pl.DataFrame:
        """One row a cell: the parts of its key under these names, then ``Came.row``."""
        chosen = [key for key in self.cells if isinstance(key, tuple)] if keys is None else keys
        made = [{**dict(zip(names, key, strict=True)), **self.came.row(self.cells[key])} for key in chosen]
        return pl.DataFrame(made, infer_schema_length=None)

    def values(self, key: Hashable, name: str) -> Any:
        """One figure of each run of a cell, (runs,)."""
        return self.came.values(self.cells[key], name)

    def difference(self, name: str, first: Hashable, second: Hashable) -> Any:
        """A figure of each run in one cell less that in another."""
        return self.values(first, name) - self.values(second, name)


class Drawn(Protocol):
    """A picture, as ``vibroswarm.plots`` gives it."""

    @property
    def figure(self) -> Any: ...  # noqa: D102
    @property
    def numbers(self) -> pl.DataFrame: ...  # noqa: D102
    @property
    def caption(self) -> str: ...  # noqa: D102
    def svg(self) -> str: ...  # noqa: D102


class Picture(NamedTuple):
    """A picture to be drawn: its file's name, its heading, and how."""

    name: str
    title: str
    draw: Callable[[], Drawn]
    aside: bool = False
    """Whether it is shown folded, below the others."""


class Shown(NamedTuple):
    """A table to be shown: which, its caption, which columns and how."""

    table: str
    caption: str
    columns: Mapping[str, Column]


@dataclass(frozen=True)
class Item:
    """One item: see the head of this module."""

    number: int
    name: str
    title: str
    about: tuple[str, ...]
    """What the paper shows, and what is to be seen here: paragraphs."""
    compute: Callable[[Work], Tables]
    cells: Callable[[Settings], Cells] = lambda settings: {}
    pictures: Callable[[Tables, Settings], Iterator[Picture]] = lambda tables, settings: iter(())
    shown: tuple[Shown, ...] = ()
    skipped: Callable[[Settings], str | None] = lambda settings: None
    """Why it cannot be done, or None."""
    also: Callable[[Settings], str] = lambda settings: ""
    """What else its tables depend on."""


def no_claims() -> pl.DataFrame:
    """A table of measured values that is empty."""
    return pl.DataFrame(schema=MEASURED)
