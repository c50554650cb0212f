"""Items 5 and 6: decision time and accuracy over the fill ratios, and over swarms of 5 to 10 robots."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.paper.cell_tables import WALK_FIGURES, both_forms, two_forms
from vibroswarm.paper.claim_values import Row, mean, share_saved
from vibroswarm.paper.columns import STRATEGIES, fills, published, sizes
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, Work, cells_and_claims

NEAR: Final = ((0.48, 0.44), (0.52, 0.56))
"""Fill ratios near one half, each with the farther one on the same side."""


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, fill ratio, strategy)."""
    return {
        (column, fill, strategy): settings.cell(
            column, {"floor.source": f"random:{fill}", "strategy.name": strategy}
        )
        for column in settings.columns
        for fill in fills()
        for strategy in STRATEGIES
    }


def compute(work: Work) -> Tables:
    """Return the cells and claims."""
    stated = published("simulation.claim_speed_up_soft_vs_none")
    printed = pl.DataFrame(
        {
            "fill ratio": [NEAR[0][0]] * 2,
            "strategy": ["none", "soft"],
            "printed_s": [float(stated["none_s"]), float(stated["soft_s"])],
        }
    )
    keys = ("column", "fill ratio", "strategy")
    table = work.rows(keys).join(printed, on=keys[1:], how="left", maintain_order="left")
    return {"cells": table, CLAIMS: work.claims(_measured)}


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the rows of the claims about the fill ratios in one column."""
    time, belief, wrong = "decision_time_s", "belief_in_truth", "wrong_share"
    for strategy in STRATEGIES:
        for near, far in NEAR:
            pair = (column, near, strategy), (column, far, strategy)
            for claim, name in (("fill-time", time), ("fill-belief", belief)):
                yield work.change(claim, column, f"{near} less {far}, {strategy}", name, *pair)
    for fill in fills():
        none, positive, soft = ((column, fill, strategy) for strategy in STRATEGIES)
        for claim, name, other in (
            ("soft-faster-than-none", time, none),
            ("soft-faster-than-positive", time, positive),
            ("soft-belief", belief, none),
            ("soft-wrong", wrong, none),
        ):
            yield work.change(claim, column, f"fill ratio {fill}", name, soft, other)
    printed = published("simulation.claim_speed_up_soft_vs_none")
    for near, far in NEAR:
        none, _, soft = ((column, near, strategy) for strategy in STRATEGIES)
        yield share_saved(
            "soft-gain", column, f"fill ratio {near}", work.values(soft, time), work.values(none, time),
            less=printed["percent"] / 100, published_runs=published("simulation.runs"), cannot=work.cannot(none),
        )  # fmt: skip
        saved_far = work.difference(time, (column, far, "none"), (column, far, "soft"))
        saved = work.difference(time, none, soft)
        cannot = work.cannot(none, (column, far, "none"))
        yield mean("soft-gain-most-near-half", column, f"{near} less {far}", saved - saved_far, cannot=cannot)
    for strategy in ("none", "soft"):
        key = (column, NEAR[0][0], strategy)
        yield mean(
            "printed-times", column, strategy, work.values(key, time), less=printed[f"{strategy}_s"],
            published_runs=published("simulation.runs"), cannot=work.cannot(key),
        )  # fmt: skip


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Both forms for each column."""
    yield from both_forms(
        "fill-ratios", tables["cells"], settings.columns, "fill ratio", "fill ratio", "strategy"
    )


FILL_RATIOS: Final = Item(
    number=5,
    name="fill-ratios",
    title="Fill ratios",
    about=(
        "Five robots with P* on floors of 5 x 5 tiles, a fresh one each run, at four fill ratios, with the "
        "three strategies. All strategies and fill ratios share their motion, so comparisons are paired run "
        "by run.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=two_forms("cells", ("column", "fill ratio", "strategy")),
)

SIZE_KEYS: Final = ("column", "robots", "strategy")


def cells_of_sizes(settings: Settings) -> Cells:
    """Return the cells by (column, robots, strategy)."""
    return {
        (column, robots, strategy): settings.cell(
            column, {"floor.source": "random:0.48", "swarm.robots": robots, "strategy.name": strategy}
        )
        for column in settings.columns
        for robots in sizes()
        for strategy in STRATEGIES
    }


def _measured_sizes(work: Work, column: str) -> Iterator[Row]:
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


def pictures_of_sizes(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Both forms for each column; then how the swarms sampled, which does not depend on the strategy."""
    table = tables["cells"]
    yield from both_forms("swarm-sizes", table, settings.columns, "robots", "robots", "strategy")
    alike = table.filter(pl.col("strategy") == "none").with_columns(series=pl.col("column"))
    walked = alike.with_columns(column=pl.lit("all"))
    yield from both_forms("swarm-sizes", walked, ["all"], "robots", "robots", "series", WALK_FIGURES)


SWARM_SIZES: Final = Item(
    number=6,
    name="swarm-sizes",
    title="Swarm sizes",
    about=(
        "Swarms of 5 to 10 robots with P* at a fill ratio of 0.48: decision time, accuracy, avoidance per "
        "sample and distance between samples. Run r has the same floor at each size.",
    ),
    cells=cells_of_sizes,
    compute=cells_and_claims(SIZE_KEYS, _measured_sizes),
    pictures=pictures_of_sizes,
    shown=two_forms("cells", SIZE_KEYS, walk=True),
)
