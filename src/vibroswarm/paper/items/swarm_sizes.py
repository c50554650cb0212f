"""Item 6: swarms of 5 to 10 robots."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.paper.cell_tables import WALK_FIGURES, both_forms, two_forms
from vibroswarm.paper.claim_values import Row
from vibroswarm.paper.columns import STRATEGIES, sizes
from vibroswarm.paper.item import Cells, Item, Picture, Settings, Tables, Work, cells_and_claims

KEYS: Final = ("column", "robots", "strategy")


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, robots, strategy)."""
    return {
        (column, robots, strategy): settings.cell(
            column, {"floor.source": "random:0.48", "swarm.robots": robots, "strategy.name": strategy}
        )
        for column in settings.columns
        for robots in sizes()
        for strategy in STRATEGIES
    }


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the rows of the claims about the swarm's size."""
    few, many = min(sizes()), max(sizes())
    words = f"{many} less {few} robots"
    for strategy in STRATEGIES:
        pair = (column, many, strategy), (column, few, strategy)
        for claim, name in (("size-time", "decision_time_s"), ("size-belief", "belief_in_truth")):
            yield work.change(claim, column, f"{words}, {strategy}", name, *pair)
    pair = (column, many, "none"), (column, few, "none")
    for claim, name in (("size-avoidance", "avoid_per_sample_s"), ("size-distance", "distance_m")):
        yield work.change(claim, column, words, name, *pair)
    for robots in sizes():
        pair = (column, robots, "soft"), (column, robots, "none")
        yield work.change("size-soft", column, f"{robots} robots", "decision_time_s", *pair)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Both forms for each column; then how the swarms sampled, which does not depend on the strategy."""
    table = tables["cells"]
    yield from both_forms("swarm-sizes", table, settings.columns, "robots", "robots", "strategy")
    alike = table.filter(pl.col("strategy") == "none").with_columns(series=pl.col("column"))
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
    compute=cells_and_claims(KEYS, _measured),
    pictures=pictures,
    shown=two_forms("cells", KEYS, walk=True),
)
