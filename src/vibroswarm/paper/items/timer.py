"""Item 15: does a sample timer that is always on make the task harder?"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import polars as pl

from vibroswarm.paper.cell_tables import TIME, limits, two_forms
from vibroswarm.paper.claim_values import Row, frame
from vibroswarm.paper.columns import STRATEGIES
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, Work
from vibroswarm.plots import draw_error_bars

COLUMN: Final = "paper"
ALWAYS, FROZEN, RAN = "always", "frozen_in_avoidance", "reset_after_turn"
TIMERS: Final = (ALWAYS, RAN, FROZEN)
"""As in the text, as it ran, and as in earlier work according to the text."""
KEYS: Final = ("timer", "strategy")


def cells(settings: Settings) -> Cells:
    """Return the cells by (timer, strategy)."""
    by_key: Cells = {}
    for timer in TIMERS:
        for strategy in STRATEGIES:
            values: dict[str, Any] = {"floor.source": "random:0.48", "strategy.name": strategy}
            by_key[timer, strategy] = settings.cell(COLUMN, values | {"sample.timer": timer})
    return by_key


def compute(work: Work) -> Tables:
    """Return the cells and claims."""
    return {"cells": work.rows(KEYS), CLAIMS: frame(list(_measured(work)))}


def _measured(work: Work) -> Iterator[Row]:
    """Yield the rows of the claims about the sample timer."""
    pair = (ALWAYS, "none"), (FROZEN, "none")
    yield work.change("timer-near", COLUMN, "always less frozen in avoidance", "distance_m", *pair)
    for strategy in STRATEGIES:
        pair = (ALWAYS, strategy), (FROZEN, strategy)
        for claim, name in (
            ("timer-harder-time", "decision_time_s"),
            ("timer-harder-belief", "belief_in_truth"),
        ):
            yield work.change(claim, COLUMN, strategy, name, *pair, check=False)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield decision time with each timer."""
    points = limits(tables["cells"], "decision_time_s").select(
        "estimate", "low", "high", "runs", x=pl.col("timer").str.replace_all("_", " "), series="strategy"
    )
    draw = partial(draw_error_bars, points, label=TIME)
    yield Picture("timer-decision-time", "Decision time with each timer", draw)


ITEM: Final = Item(
    number=15,
    name="timer",
    title="The sample timer",
    about=(
        "The paper keeps the timer on at all times, and says that this raises the correlation of samples and so the "
        "difficulty of the task, compared with a timer that stops during avoidance. Both are run here, and the timer "
        "as it really ran; preset `paper`, five robots, P*, fill ratio 0.48. A difficult task takes longer or is "
        "judged less accurately: both are tested.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=two_forms("cells", KEYS, walk=True),
)
