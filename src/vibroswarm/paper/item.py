"""Items of the reproduction: figures and tables of the paper, made from cells of studies (``items.toml``)."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import import_module
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, NamedTuple

import polars as pl
from pydantic import BaseModel, ConfigDict

from vibroswarm.errors import check_choice
from vibroswarm.paper.cells import Cells
from vibroswarm.paper.claims import Value, all_claims
from vibroswarm.paper.columns import COLUMNS
from vibroswarm.plots import Picture, draw_error_bars
from vibroswarm.statistics.figures import BY_NAME

FUNCTIONS: Final = {
    "difficulty": "difficulty:compute",
    "calibration": "calibration:compute",
    "search": "search:compute",
    "experiments": "experiments:compute",
    "example-run": "paths:example_run",
    "side-claims": "paths:corners",
    "sharing": "search:sharing",
    "experiments-beside": "experiments:beside",
}
"""Module and function of items that are more than figures of cells."""


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


class Drawing(BaseModel):
    """Pictures of cells: figures over a varied field."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    figures: tuple[str, ...]
    x: str
    series: tuple[str, ...] = ("strategy.name",)
    where: dict[str, Any] = {}
    by_column: bool = True
    """Whether each column has its pictures, or they have a series for each column."""


class Item(BaseModel):
    """One figure or table of the paper."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    number: int
    name: str
    title: str
    about: str
    studies: tuple[str, ...] = ()
    columns: tuple[str, ...] = COLUMNS
    """Presets in which its studies run."""
    pictures: tuple[Drawing, ...] = ()


class Drawn(NamedTuple):
    """A picture, drawn when it is needed."""

    title: str
    draw: Callable[[], Picture]
    folded: bool = False


@dataclass
class Made:
    """What comes of an item."""

    item: Item
    tables: dict[str, pl.DataFrame] = field(default_factory=dict)
    values: list[Value] = field(default_factory=list)
    pictures: dict[str, Drawn] = field(default_factory=dict)
    skipped: str = ""


@dataclass(frozen=True)
class Work:
    """What an item is computed from."""

    settings: Settings
    cells: Mapping[tuple[str, str], Cells]
    """Of all studies that were run, by study and column."""
    folder: Path
    """For unfinished work."""


@cache
def all_items() -> tuple[Item, ...]:
    """Return all items, in the paper's order."""
    text = files("vibroswarm.paper").joinpath("items.toml").read_text(encoding="utf-8")
    return tuple(Item(**table) for table in tomllib.loads(text)["item"])


def items_named(names: list[str] | None) -> tuple[Item, ...]:
    """Return the items with these names, in the paper's order; all items if ``names`` is None."""
    for name in names or ():
        check_choice(name, "--only", [item.name for item in all_items()])
    return tuple(item for item in all_items() if names is None or item.name in names)


def make(item: Item, work: Work) -> Made:
    """Compute an item."""
    made = Made(item)
    for study in item.studies:
        parts = [
            work.cells[study, column] for column in work.settings.columns if (study, column) in work.cells
        ]
        if parts:
            made.tables[study] = pl.concat([part.table for part in parts], how="diagonal")
            if study == item.name:
                made.pictures |= {
                    name: one for place in item.pictures for name, one in _pictures(item, place, parts)
                }
    for claim in all_claims():
        if claim.item == item.name and claim.figure:
            study = claim.study or item.name
            for column in claim.columns:
                if (study, column) in work.cells:
                    made.values += work.cells[study, column].measure(claim)
    if item.name in FUNCTIONS:
        module, _, function = FUNCTIONS[item.name].partition(":")
        getattr(import_module(f"vibroswarm.paper.items.{module}"), function)(work, made)
    return made


def _pictures(item: Item, drawing: Drawing, parts: list[Cells]) -> Iterator[tuple[str, Drawn]]:
    groups = {part.column: [part] for part in parts} if drawing.by_column else {"": parts}
    for place, (column, group) in enumerate(groups.items()):
        for figure in drawing.figures:
            frame = pl.concat([_points(part, drawing, figure) for part in group])
            short = figure.removesuffix("_s").removesuffix("_m").replace("_", "-")
            name = "-".join(filter(None, (item.name, column, short)))
            known = BY_NAME.get(figure)
            title = known.title if known else figure.rpartition("_")[0].replace("_", " ")
            label = f"{title} ({known.unit})" if known and known.unit else title
            draw = partial(
                draw_error_bars, frame, x_label=drawing.x.rpartition(".")[2], label=label,
                percent=bool(known and known.is_share),
            )  # fmt: skip
            yield name, Drawn(f"{column}: {title}" if column else title, draw, folded=place > 0)


def _points(part: Cells, drawing: Drawing, figure: str) -> pl.DataFrame:
    """Return the points of a picture; a cell that does not vary in x has the same value at every x."""
    chosen = [
        (part.cells[place], row)
        for place, row in enumerate(part.table.to_dicts())
        if place in part.where(drawing.where)
    ]
    every = list(dict.fromkeys(cell.point[drawing.x] for cell, _ in chosen if drawing.x in cell.point))
    rows = []
    for cell, row in chosen:
        series = cell.text_of(drawing.series) if drawing.by_column else part.column
        ends = [row[figure], row[f"{figure}_low"], row[f"{figure}_high"]]
        xs = [cell.point[drawing.x]] if drawing.x in cell.point else every
        rows += [(x, series, *ends, row["runs"]) for x in xs]
    names = ["x", "series", "estimate", "low", "high", "runs"]
    return pl.DataFrame(rows, schema=names, orient="row").with_columns(
        low=pl.min_horizontal("low", "estimate"), high=pl.max_horizontal("high", "estimate")
    )
