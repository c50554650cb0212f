"""Item 15: does a sample timer that is always on make the task harder?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import polars as pl

from vibroswarm.paper.columns import STRATEGIES
from vibroswarm.paper.item import CLAIMS, Cells, Drawn, Item, Picture, Settings, Tables, Work
from vibroswarm.paper.measure import Row, frame, mean
from vibroswarm.paper.show import TIME, limits, two_forms
from vibroswarm.plots import draw_error_bars

COLUMN: Final = "paper"
ALWAYS, FROZEN, RAN = "always", "frozen_in_avoidance", "reset_after_turn"
TIMERS: Final = (ALWAYS, RAN, FROZEN)
"""As the text has it, as it ran, and as the text says that it was in earlier work."""
KEYS: Final = ("timer", "strategy")


def cells(settings: Settings) -> Cells:
    """timer, strategy."""
    found: Cells = {}
    for timer in TIMERS:
        for strategy in STRATEGIES:
            values: dict[str, Any] = {"floor.source": "random:0.48", "strategy.name": strategy}
            found[timer, strategy] = settings.cell(COLUMN, values | {"sample.timer": timer})
    return found


def compute(work: Work) -> Tables:
    """Cells and claims."""
    return {"cells": work.rows(KEYS), CLAIMS: frame(list(_measured(work)))}


def _measured(work: Work) -> Iterator[Row]:
    nearer = work.difference("distance_m", (ALWAYS, "none"), (FROZEN, "none"))
    yield mean("timer-near", COLUMN, "always less frozen in avoidance", nearer)
    for strategy in STRATEGIES:
        pair = (ALWAYS, strategy), (FROZEN, strategy)
        yield mean("timer-harder-time", COLUMN, strategy, work.difference("decision_time_s", *pair))
        beliefs = work.difference("belief_in_truth", *pair)
        yield mean("timer-harder-belief", COLUMN, strategy, beliefs, bounded=True)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Decision time with each timer."""
    yield Picture("timer-decision-time", "Decision time with each timer", lambda: _draw(tables["cells"]))


def _draw(table: pl.DataFrame) -> Drawn:
    made = limits(table, "decision_time_s")
    shown = made.select("estimate", "low", "high", "runs", x=pl.col("timer"), series=pl.col("strategy"))
    return draw_error_bars(shown, label=TIME)


ITEM: Final = Item(
    number=15,
    name="timer",
    title="The sample timer",
    about=(
        "The paper keeps the timer on at all times, and says that this raises the correlation of samples and so the "
        "difficulty of the task, against a timer that stands still in avoidance. Both are run here, and the timer as "
        "it really ran; preset `paper`, five robots, P*, fill ratio 0.48. A difficult task takes long or is judged "
        "less accurately: both are asked.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=two_forms("cells", KEYS, walk=True),
)
