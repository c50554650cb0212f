"""Items 5 and 6: decision time and accuracy over the fill ratios, and over swarms of 5 to 10 robots.

A column is a preset of the reproduction. The accuracy is the mean belief in the truth, as in the paper. The measured
values of the claims are rows of ``claims.MEASURED``; ``Work.change`` makes a row from the difference of two cells
(first - second), paired by run.

Results are drawn and tabulated in two forms (``cell_tables``): the paper's form, with the paper's error bars, and the
proper form, with 95 % intervals over runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.paper.cell_tables import WALK_FIGURES, both_forms, two_forms
from vibroswarm.paper.claim_values import Row, mean, share_saved
from vibroswarm.paper.columns import STRATEGIES, fills, published, sizes
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, Work, cells_and_claims

SIDES: Final = (sorted(f for f in fills() if f < 0.5)[::-1], sorted(f for f in fills() if f > 0.5))
"""The fill ratios on each side of one half, the one nearest to one half, which is the hardest, first."""
HARDEST: Final[float] = published("simulation.claim_speed_up_soft_vs_none.fill_ratio")
"""Fill ratio for which the paper prints decision times in its text."""


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
    """Return the table of cells, with the times that the paper prints in its text, and the claims' measured values.

    The column ``printed_s`` is null except at fill ratio 0.48 with the strategies none and soft.
    """
    stated = published("simulation.claim_speed_up_soft_vs_none")
    printed = pl.DataFrame(
        {
            "fill ratio": [HARDEST] * 2,
            "strategy": ["none", "soft"],
            "printed_s": [float(stated["none_s"]), float(stated["soft_s"])],
        }
    )
    keys = ("column", "fill ratio", "strategy")
    table = work.rows(keys).join(printed, on=keys[1:], how="left", maintain_order="left")
    return {"cells": table, CLAIMS: work.claims(_measured)}


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the measured values of the claims about the fill ratios in one column: differences paired by run.

    They compare, in order: fill ratios near one half with farther ones; soft feedback with the other strategies; the
    share of the time that soft feedback saves with the printed share, and the seconds that it saves near one half with
    those farther away; and our times with the printed ones.
    """
    time, belief, wrong = "decision_time_s", "belief_in_truth", "wrong_share"
    nearness = {"time-near-half-less-far": time, "belief-near-half-less-far": belief}
    for strategy in STRATEGIES:
        for near, far in SIDES:
            pair = (column, near, strategy), (column, far, strategy)
            yield from work.changes(nearness, column, f"{near} less {far}, {strategy}", *pair)
    for fill in fills():
        none, positive, soft = ((column, fill, strategy) for strategy in STRATEGIES)
        for value_name, name, other in (
            ("time-soft-less-none", time, none),
            ("time-soft-less-positive", time, positive),
            ("belief-soft-less-none", belief, none),
            ("wrong-soft-less-none", wrong, none),
        ):
            yield work.change(value_name, column, f"fill ratio {fill}", name, soft, other)
    printed = published("simulation.claim_speed_up_soft_vs_none")
    for near, far in SIDES:
        none, _, soft = ((column, near, strategy) for strategy in STRATEGIES)
        yield share_saved(
            "share-of-time-saved-less-printed", column, f"fill ratio {near}", work.values(soft, time),
            work.values(none, time),
            less=printed["percent"] / 100, published_runs=published("simulation.runs"), cannot=work.cannot(none),
        )  # fmt: skip
        saved_near = work.difference(time, none, soft)
        saved_far = work.difference(time, (column, far, "none"), (column, far, "soft"))
        cannot = work.cannot(none, (column, far, "none"))
        label = f"{near} less {far}"
        yield mean("time-saved-near-half-less-far", column, label, saved_near - saved_far, cannot=cannot)
    for strategy in ("none", "soft"):
        key = (column, HARDEST, strategy)
        yield mean(
            "time-less-printed", column, strategy, work.values(key, time), less=printed[f"{strategy}_s"],
            published_runs=published("simulation.runs"), cannot=work.cannot(key),
        )  # fmt: skip


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of time, belief and decisions over the fill ratio, with a line for each strategy.

    Each picture shows one column (preset), some in the paper's form and some with intervals over runs.
    """
    yield from both_forms(
        "fill-ratios",
        tables["cells"],
        settings.columns,
        x="fill ratio",
        x_label="fill ratio",
        series="strategy",
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
    shown=two_forms(("column", "fill ratio", "strategy")),
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
    """Yield the measured values of the claims about the swarm's size in one column: differences paired by run.

    They compare the largest swarm with the smallest one, and, for each size, soft feedback with no feedback. How swarms
    walk does not depend on the strategy, so avoidance and distance are compared without feedback only.
    """
    few, many = min(sizes()), max(sizes())
    words = f"{many} less {few} robots"
    decided = {"time-many-less-few": "decision_time_s", "belief-many-less-few": "belief_in_truth"}
    for strategy in STRATEGIES:
        pair = (column, many, strategy), (column, few, strategy)
        yield from work.changes(decided, column, f"{words}, {strategy}", *pair)
    walked = {"avoidance-many-less-few": "avoid_per_sample_s", "distance-many-less-few": "distance_m"}
    yield from work.changes(walked, column, words, (column, many, "none"), (column, few, "none"))
    for robots in sizes():
        pair = (column, robots, "soft"), (column, robots, "none")
        yield work.change("time-soft-less-none-by-size", column, f"{robots} robots", "decision_time_s", *pair)


def pictures_of_sizes(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of time, belief and decisions over the swarm size, then pictures of how the swarms walked.

    The first pictures show one column (preset) each, with a line for each strategy, some in the paper's form and some
    with intervals over runs. How swarms walk does not depend on the strategy, so each of the last pictures shows all
    columns, with a line for each.
    """
    table = tables["cells"]
    yield from both_forms(
        "swarm-sizes", table, settings.columns, x="robots", x_label="robots", series="strategy"
    )
    # ``both_forms`` draws one picture per column. To get all columns into one picture, the name of the column becomes
    # the name of a line, and all rows get the same column "all". One strategy stands for all strategies.
    one_strategy = table.filter(pl.col("strategy") == "none").with_columns(series=pl.col("column"))
    walked = one_strategy.with_columns(column=pl.lit("all"))
    yield from both_forms(
        "swarm-sizes", walked, ["all"], x="robots", x_label="robots", series="series", figures=WALK_FIGURES
    )


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
    shown=two_forms(SIZE_KEYS, walk=True),
)
