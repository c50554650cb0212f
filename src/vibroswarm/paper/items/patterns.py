"""Items 1 and 7: the five patterns; their table of difficulty, and swarms on them with P0 and P*."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.floors.difficulty import paper_table
from vibroswarm.paper.cell_tables import FIGURES, PAPERS_BAR, bars, limits, two_forms
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import EMPIRICAL, OPTIMISED, STRATEGIES, published
from vibroswarm.paper.item import (
    CLAIMS,
    Cells,
    Drawn,
    Item,
    Picture,
    Settings,
    Tables,
    TableView,
    Work,
    cells_and_claims,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.report.html import Column

PATTERNS: Final = {
    "diagonal": "diagonal",
    "stripe": "stripe",
    "block_diagonal": "block-diagonal",
    "alternating": "alternating",
    "random": "random-fixed",
}
"""The paper's five patterns and our names for them."""
FILLS: Final = ("0.48", "0.46")


def _difficulty_table() -> pl.DataFrame:
    """Return the printed, reproduced and correct values of each pattern and measure."""
    published_names = {own_name: name for name, own_name in PATTERNS.items()}
    rows = []
    for entry in paper_table():
        kind, _, fill = entry.pattern.partition(":")
        key = "moran" if entry.measure == "Moran index" else "entropy"
        printed = float(published("patterns_10x10")[f"{key}_{fill}"][published_names[kind]])
        # Remove the rounding errors of logarithms.
        as_paper, right = round(entry.as_the_paper, 12), round(entry.right, 12)
        rows.append((entry.pattern, entry.measure, printed, as_paper, right, printed - right))
    names = ["pattern", "measure", "printed", "as the paper computed", "right", "printed less right"]
    return pl.DataFrame(rows, schema=names, orient="row")


def compute_difficulty(work: Work) -> Tables:
    """Compute the 20 numbers exactly."""
    table = _difficulty_table()
    measured = [
        exact("difficulty-printed", "paper", f"{row['pattern']}, {row['measure']}", row["printed less right"])
        for row in table.to_dicts()
    ]
    return {"difficulty": table, CLAIMS: frame(measured)}


DIFFICULTY: Final = Item(
    number=1,
    name="difficulty",
    title="Difficulty of the five patterns",
    about=(
        "The paper's table of Moran indices and entropies: printed, as the paper computed it (48 vibrating "
        "tiles in all entropies, and an alternating floor of 48 instead of 46), and correct for the fill "
        "ratio named.",
    ),
    compute=compute_difficulty,
    shown=(
        TableView(
            "difficulty",
            "Printed and computed; nothing here is uncertain.",
            {
                "pattern": Column("pattern"),
                "measure": Column("measure"),
                "printed": Column("printed"),
                "as the paper computed": Column("as the paper computed"),
                "right": Column("correct"),
                "printed less right": Column("printed - correct", digits=2),
            },
        ),
    ),
)

HARD: Final = ("diagonal", "stripe", "block-diagonal")
EASY: Final = ("alternating", "random-fixed")
KEYS: Final = ("column", "parameters", "fill ratio", "pattern", "strategy")


def floor_of(pattern: str, fill: str) -> str:
    """Return the floor that the paper used: its alternating "0.46" has 48 vibrating tiles."""
    return "alternating:paper-0.46" if (pattern, fill) == ("alternating", "0.46") else f"{pattern}:{fill}"


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, parameters, fill ratio as named, pattern, strategy)."""
    return {
        (column, parameters, fill, pattern, strategy): settings.cell(
            column,
            {"floor.source": floor_of(pattern, fill), "strategy.name": strategy},
            parameter_set=parameters,
        )
        for column in settings.columns
        for parameters in (OPTIMISED, EMPIRICAL)
        for fill in FILLS
        for pattern in PATTERNS.values()
        for strategy in STRATEGIES
    }


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the rows of the claims about patterns in one column."""
    for fill in FILLS:
        for strategy in STRATEGIES:
            yield from _of_beliefs(work, column, fill, strategy)
        for pattern in PATTERNS.values():
            pair = ((column, OPTIMISED, fill, pattern, name) for name in ("soft", "none"))
            yield work.change("patterns-soft", column, f"{pattern}:{fill}", "decision_time_s", *pair)


def _of_beliefs(work: Work, column: str, fill: str, strategy: str) -> Iterator[Row]:
    """Yield the rows of the claims about beliefs at one fill ratio with one strategy."""
    keys = {
        (parameters, pattern): (column, parameters, fill, pattern, strategy)
        for parameters in (OPTIMISED, EMPIRICAL)
        for pattern in PATTERNS.values()
    }
    belief: dict[tuple[str, str], Any] = {
        name: work.values(key, "belief_in_truth") for name, key in keys.items()
    }

    def of_five(claim: str, words: str, values: Any, *patterns: str) -> Row:
        cannot = work.cannot(*(keys[OPTIMISED, pattern] for pattern in patterns))
        return mean(claim, column, words, values, bounded=True, cannot=cannot)

    mean_belief = np.mean([belief[OPTIMISED, pattern] for pattern in PATTERNS.values()], axis=0)
    easy = np.mean([belief[EMPIRICAL, pattern] for pattern in EASY], axis=0)
    for pattern in PATTERNS.values():
        words = f"{pattern}:{fill}, {strategy}"
        optimised, empirical = belief[OPTIMISED, pattern], belief[EMPIRICAL, pattern]
        yield of_five("patterns-steady", words, optimised - mean_belief, *PATTERNS.values())
        if pattern in HARD:
            yield of_five("patterns-start-drops", words, empirical - easy, pattern, *EASY)
            yield of_five("patterns-optimised-better", words, optimised - empirical, pattern)
        else:
            yield of_five("patterns-start-easy", words, empirical - optimised, pattern)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures as in the paper: by pattern, P0 and P* with each strategy, for each fill ratio."""
    for place, column in enumerate(settings.columns):
        for fill in FILLS:
            chosen = (pl.col("column") == column) & (pl.col("fill ratio") == fill)
            part = tables["cells"].filter(chosen)
            for figure, label, form, title in FIGURES[:2] + (FIGURES[4:] if place == 0 else FIGURES[4:5]):
                short = figure.removesuffix("_s").replace("_", "-")
                name = f"patterns-{column}-{fill}-{short}-{form}"
                draw = partial(_draw, part, figure, label, form)
                yield Picture(name, f"{column}, fill ratio {fill}: {title}", draw, place > 0)


def _draw(part: pl.DataFrame, figure: str, label: str, form: str) -> Drawn:
    """Draw a figure by pattern, in the paper's form or with intervals."""
    intervals = bars(part, figure) if form == "papers" else limits(part, figure)
    series = pl.format("{}, {}", "parameters", "strategy")
    intervals = intervals.select("estimate", "low", "high", "runs", x=pl.col("pattern"), series=series)
    interval = PAPERS_BAR if form == "papers" else "95 % interval"
    return draw_error_bars(intervals, label=label, interval=interval, percent=figure.startswith("robots"))


FIVE_PATTERNS: Final = Item(
    number=7,
    name="patterns",
    title="Five patterns, P0 and P*",
    about=(
        "Five robots on 10 x 10 tiles in the five patterns, at the two fill ratios, with the empirical "
        "parameters P0 and the optimised P*, with the three strategies. Each pattern is one floor, so "
        "intervals hold for that floor only. The paper's alternating pattern at 0.46 has 48 vibrating tiles, and is "
        "used as in the paper. Preset `calibrated` senses vibration some millimetres beyond a tile's edge: on "
        "floors with so many edges more than half of the readings are ones.",
    ),
    cells=cells,
    compute=cells_and_claims(KEYS, _measured),
    pictures=pictures,
    shown=two_forms("cells", KEYS),
)
