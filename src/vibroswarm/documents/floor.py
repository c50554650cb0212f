"""The documents of floors: one with its picture in text, and measures of several."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final

import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import count, number
from vibroswarm.errors import shown
from vibroswarm.floors.difficulty import Difficulty, measure_floor
from vibroswarm.floors.floor import Floor
from vibroswarm.floors.surfaces import Patch
from vibroswarm.show.document import Column, Document, Figure, Table, Text, if_any

if TYPE_CHECKING:  # their imports take long
    from vibroswarm.plots.picture import Picture

MEASURES: Final = {
    "ones": Column("vibrating"),
    "fill_ratio": Column("fill", decimals=4),
    "moran_index": Column("Moran", decimals=3),
    "entropy": Column(decimals=3),
    "clusters": Column(),
}
"""How measures are written, by column."""


def floor_document(floor: Floor, drawing: str) -> Document:
    """Return a floor and its measures of difficulty.

    Args:
        drawing: of the floor, in text.
    """
    difficulty = measure_floor(floor)
    patches = floor.patches
    words = (
        f"{count(len(patches), 'patch', 'patches')} on a still floor: fill ratio "
        f"{number(difficulty.fill_ratio, digits=4)}."
        if patches
        else f"{_measures_in_words(difficulty)}."
    )
    name = shown(floor.name)
    return Document(
        title=f"Floor {name}",
        answer=(words,),
        parts=(Text(drawing, "code"), *if_any(patches, _listed), _picture(floor.drawn_tiles, words)),
        data={"floors": _rows({name: difficulty})},
    )


def _listed(patches: Sequence[Patch]) -> tuple[Table, ...]:
    frame = pl.DataFrame([{"shape": "disc" if p.is_disc else "rectangle"} | p._asdict() for p in patches])
    columns = {f"{name}_m": Column(f"{name} (m)", decimals=3) for name in ("x", "y", "width", "height")}
    columns["contrast"] = Column(decimals=3)
    return (Table(frame.drop("is_disc"), columns, name="patches"),)


def _picture(tiles: NDArray[Any], caption: str) -> Figure:
    def draw(style: str) -> Picture:
        # imported here, since a terminal draws no figure
        from vibroswarm.plots.picture import Picture
        from vibroswarm.plots.run import floor_figure
        from vibroswarm.plots.style import settings

        rows, columns = tiles.nonzero()
        with settings():
            return Picture(floor_figure(tiles), pl.DataFrame({"row": rows, "column": columns}), caption)

    return Figure("floor", draw)


def _rows(found: Mapping[str, Difficulty]) -> pl.DataFrame:
    rows: list[dict[str, Any]] = [{"floor": name, **asdict(difficulty)} for name, difficulty in found.items()]
    return pl.DataFrame(rows, schema_overrides={"moran_index": pl.Float64, "entropy": pl.Float64})


def _measures_in_words(d: Difficulty) -> str:
    largest = "" if d.clusters == 1 else f", the largest has {count(d.largest_cluster, 'tile')}"
    return (
        f"{d.rows} x {d.columns} tiles, {d.ones} vibrating: fill ratio {number(d.fill_ratio, digits=4)}, Moran index "
        f"{_measure(d.moran_index)}, entropy {_measure(d.entropy)}, {count(d.clusters, 'cluster')}{largest}"
    )


def _measure(value: float) -> str:
    return "none" if math.isnan(value) else number(value, 3)
