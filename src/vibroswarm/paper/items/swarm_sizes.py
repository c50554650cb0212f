"""Item 6: swarms of 5 to 10 robots."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.paper.columns import STRATEGIES, sizes
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, Work
from vibroswarm.paper.measure import Row, frame, mean
from vibroswarm.paper.show import WALK_FIGURES, both_forms, two_forms


def cells(settings: Settings) -> Cells:
    """column, robots, strategy."""
    return {
        (column, robots, strategy): settings.cell(
            column, {"floor.source": "random:0.48", "swarm.robots": robots, "strategy.name": strategy}
        )
        for column in settings.columns
        for robots in sizes()
        for strategy in STRATEGIES
    }


def compute(work: Work) -> Tables:
    """Cells and claims."""
    measured = [row for column in work.settings.columns for row in _measured(work, column)]
    return {"cells": work.rows(("column", "robots", "strategy")), CLAIMS: frame(measured)}


def _measured(work: Work, column: str) -> Iterator[Row]:
    few, many = min(sizes()), max(sizes())
    words = f"{many} less {few} robots"
    for strategy in STRATEGIES:
        pair = (column, many, strategy), (column, few, strategy)
        cannot, each = work.cannot(*pair), f"{words}, {strategy}"
        yield mean("size-time", column, each, work.difference("decision_time_s", *pair), cannot=cannot)
        beliefs = work.difference("belief_in_truth", *pair)
        yield mean("size-belief", column, each, beliefs, bounded=True, cannot=cannot)
    pair = (column, many, "none"), (column, few, "none")
    for claim, name in (("size-avoidance", "avoid_per_sample_s"), ("size-distance", "distance_m")):
        yield mean(claim, column, words, work.difference(name, *pair))
    for robots in sizes():
        pair = (column, robots, "soft"), (column, robots, "none")
        saved = work.difference("decision_time_s", *pair)
        yield mean("size-soft", column, f"{robots} robots", saved, cannot=work.cannot(*pair))


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Both forms, column by column; then how the swarms sampled, which no strategy changes."""
    whole = tables["cells"]
    yield from both_forms("swarm-sizes", whole, settings.columns, "robots", "robots", "strategy")
    alike = whole.filter(pl.col("strategy") == "none").with_columns(series=pl.col("column"))
    walked = alike.with_columns(column=pl.lit("all"))
    yield from both_forms("swarm-sizes", walked, ["all"], "robots", "robots", "series", WALK_FIGURES)


ITEM: Final = Item(
    number=6,
    name="swarm-sizes",
    title="Swarm sizes",
    about=(
        "Swarms of 5 to 10 robots with P* at a fill ratio of 0.48: decision time, accuracy, avoidance per "
        "sample and distance between samples. Run r has the same floor at each size.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=two_forms("cells", ("column", "robots", "strategy"), walk=True),
)
