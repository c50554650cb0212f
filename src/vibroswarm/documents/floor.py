"""The documents of floors: one with its picture in text, measures of several, and the paper's table of difficulties."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

import polars as pl

from vibroswarm.floors.design import FloorDesign
from vibroswarm.floors.difficulty import Difficulty, Entry
from vibroswarm.show.document import Column, Document, Table, Text
from vibroswarm.show.numbers import count, number

MEASURES: Final = {
    "ones": Column("vibrating"),
    "fill_ratio": Column("fill", decimals=4),
    "moran_index": Column("Moran", decimals=3),
    "entropy": Column(decimals=3),
    "clusters": Column(),
}
"""How measures are written, by column."""


def floor_document(name: str, difficulty: Difficulty, drawing: str) -> Document:
    """Return a floor, drawn in text, and its measures of difficulty."""
    return Document(
        title=f"Floor {name}",
        answer=(f"{_in_words(difficulty)}.",),
        parts=(Text(drawing, "code"),),
        data={"floors": _rows({name: difficulty})},
    )


def floors_document(found: Mapping[str, Difficulty], remark: str = "") -> Document:
    """Return measures of several floors, by name.

    Args:
        remark: a sentence below the table; empty: none.
    """
    frame = _rows(found)
    tiles = pl.format("{}x{}", "rows", "columns").alias("tiles")
    table = Table(frame.select("floor", tiles, *MEASURES), MEASURES, name="floors")
    return Document(
        title="Floors",
        answer=(f"{count(len(found), 'floor')}, {_range(found.values())}.",),
        parts=(table, *([Text(remark)] if remark else [])),
        data={"floors": frame},
    )


def design_document(
    design: FloorDesign, target: Mapping[str, float | None], seed: int, drawing: str
) -> Document:
    """Return a floor that was made to order.

    Args:
        target: the measures that were asked for; None: any.
    """
    made = {"reached": design.reached, "words": design.words}
    tiles = ["".join(map(str, row)) for row in design.tiles.tolist()]
    return Document(
        title="Floor made to order",
        answer=(design.words,),
        parts=(Text(drawing, "code"),),
        made_by={"seed": str(seed)},
        data={
            "asked": pl.DataFrame([dict(target)], schema=dict.fromkeys(target, pl.Float64)),
            "floors": _rows({f"made with seed {seed}": design.difficulty}).with_columns(
                pl.lit(value).alias(name) for name, value in made.items()
            ),
            "tiles": pl.DataFrame({"row": tiles}),
        },
    )


def paper_floors_document(entries: Sequence[Entry]) -> Document:
    """Return the paper's table of difficulties beside what its program computed, and what is right."""
    frame = pl.DataFrame([asdict(entry) | {"wrong": entry.wrong} for entry in entries])
    wrong = sum(entry.wrong for entry in entries)
    columns = {
        "printed": Column(decimals=2),
        "as_the_paper": Column("recomputed", decimals=4),
        "right": Column(decimals=4),
        "differs": Column("printed number", tones={"differs": "bad"}),
    }
    shown = frame.with_columns(differs=pl.when("wrong").then(pl.lit("differs")).otherwise(pl.lit("right")))
    return Document(
        title="The paper's table of difficulties",
        answer=(f"{wrong} of {count(len(entries), 'printed number')} differ from the right ones.",),
        parts=(
            Table(shown.drop("wrong"), columns, name="difficulty", names=2),
            Text(
                "'recomputed': as in the paper, with 48 vibrating tiles for every entropy, and with the floor "
                "alternating:paper-0.46, which has 48 of them, in place of alternating:0.46."
            ),
        ),
        data={"difficulty": frame},
    )


def _rows(found: Mapping[str, Difficulty]) -> pl.DataFrame:
    rows: list[dict[str, Any]] = [{"floor": name, **asdict(difficulty)} for name, difficulty in found.items()]
    return pl.DataFrame(rows, schema_overrides={"moran_index": pl.Float64, "entropy": pl.Float64})


def _range(found: Any) -> str:
    shares = [difficulty.fill_ratio for difficulty in found]
    low, high = number(min(shares), digits=4), number(max(shares), digits=4)
    return f"fill ratio {low}" if low == high else f"fill ratios {low} to {high}"


def _in_words(d: Difficulty) -> str:
    """Describe a floor in one line: size, vibrating tiles, and its measures of difficulty."""
    largest = "" if d.clusters == 1 else f", the largest has {count(d.largest_cluster, 'tile')}"
    return (
        f"{d.rows} x {d.columns} tiles, {d.ones} vibrating: fill ratio {d.fill_ratio:.4g}, Moran index "
        f"{_measure(d.moran_index)}, entropy {_measure(d.entropy)}, {count(d.clusters, 'cluster')}{largest}"
    )


def _measure(value: float) -> str:
    return "none" if math.isnan(value) else number(value, 3)
