"""Items 1 and 7: the paper's table of difficulty of five floor patterns, and swarms on these patterns with P0 and P*.

A pattern exists at two fill ratios, which the paper names 0.48 and 0.46. P0 are the paper's empirical parameters, P*
the optimised ones. A column is a preset of the reproduction. The measured values of the claims are rows of
``claims.MEASURED``; ``Work.change`` makes a row from the difference of two cells (first - second), paired by run.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.paper.cell_tables import FIGURES, form_picture, two_forms
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import EMPIRICAL, OPTIMISED, STRATEGIES
from vibroswarm.paper.difficulty_table import FILLS, PATTERNS, paper_table
from vibroswarm.paper.item import (
    CLAIMS,
    Cells,
    Item,
    Picture,
    Settings,
    Tables,
    TableView,
    Work,
    cells_and_claims,
)
from vibroswarm.show.document import Column


def compute_difficulty(work: Work) -> Tables:
    """Return the table of difficulty, and the claim's 20 measured values: printed - correct, without sampling error.

    The table has one row for each pattern and measure (Moran index and entropy), with the printed value, the paper's
    computation and the right value.
    """
    rows, measured = [], []
    for entry in paper_table():
        printed = entry.printed
        # Remove the rounding errors of logarithms.
        as_paper, right = round(entry.as_the_paper, 12), round(entry.right, 12)
        rows.append((entry.pattern, entry.measure, printed, as_paper, right, printed - right))
        # Nothing is simulated, so the claim does not depend on a preset; it is decided in the column "paper" alone.
        label = f"{entry.pattern}, {entry.measure}"
        measured.append(exact("printed-difficulty-less-right", "paper", label, printed - right))
    names = ["pattern", "measure", "printed", "as the paper computed", "right", "printed less right"]
    return {"difficulty": pl.DataFrame(rows, schema=names, orient="row"), CLAIMS: frame(measured)}


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
                "printed less right": Column("printed - correct"),
            },
        ),
    ),
)

HARD: Final = ("diagonal", "stripe", "block-diagonal")
"""Patterns on which, according to the paper, P0 is worse than P*."""
EASY: Final = ("alternating", "random-fixed")
"""The other patterns."""
KEYS: Final = ("column", "parameters", "fill ratio", "pattern", "strategy")
"""Parts of the cells' keys; the fill ratio is the one that the paper names."""


def floor_of(pattern: str, fill: str) -> str:
    """Return the name of the floor that the paper used; its alternating pattern at "0.46" has 48 vibrating tiles."""
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
    """Yield the measured values of the claims about patterns in one column (preset).

    They are differences of beliefs (``_of_beliefs``), and with P* the time with soft feedback minus the time without.
    """
    for fill in FILLS:
        for strategy in STRATEGIES:
            yield from _of_beliefs(work, column, fill, strategy)
        for pattern in PATTERNS.values():
            pair = ((column, OPTIMISED, fill, pattern, name) for name in ("soft", "none"))
            yield work.change(
                "time-soft-less-none-by-pattern", column, f"{pattern}:{fill}", "decision_time_s", *pair
            )


def _of_beliefs(work: Work, column: str, fill: str, strategy: str) -> Iterator[Row]:
    """Yield the measured values of the claims about beliefs in the truth, at one fill ratio with one strategy.

    Each value is a difference (first - second) of beliefs, run by run:

    - "belief-on-pattern-less-mean", each pattern: belief with P* - mean belief with P* over all patterns.
    - "start-belief-hard-less-easy", each hard pattern: belief with P0 - mean belief with P0 over the easy patterns.
    - "belief-found-less-start", each hard pattern: belief with P* - belief with P0.
    - "belief-start-less-found", each easy pattern: belief with P0 - belief with P*.

    Args:
        column: preset. fill: fill ratio as the paper names it.
    """
    keys = {
        (parameters, pattern): (column, parameters, fill, pattern, strategy)
        for parameters in (OPTIMISED, EMPIRICAL)
        for pattern in PATTERNS.values()
    }
    belief: dict[tuple[str, str], Any] = {
        name: work.values(key, "belief_in_truth") for name, key in keys.items()
    }

    def value(value_name: str, label: str, values: Any, *patterns: str) -> Row:
        """Return the row of a mean over runs; it states why if a pattern cannot answer the question (``Work.cannot``).

        Only the cells with P* are checked, because those with P0 have the same floors, sensors and decision boundary,
        and nothing else matters.

        Args:
            values: difference of beliefs of each run, (runs,). patterns: patterns whose beliefs are in ``values``.
        """
        cannot = work.cannot(*(keys[OPTIMISED, pattern] for pattern in patterns))
        return mean(value_name, column, label, values, bounded=True, cannot=cannot)

    mean_of_patterns = np.mean([belief[OPTIMISED, pattern] for pattern in PATTERNS.values()], axis=0)
    mean_of_easy = np.mean([belief[EMPIRICAL, pattern] for pattern in EASY], axis=0)
    for pattern in PATTERNS.values():
        label = f"{pattern}:{fill}, {strategy}"
        optimised, empirical = belief[OPTIMISED, pattern], belief[EMPIRICAL, pattern]
        yield value("belief-on-pattern-less-mean", label, optimised - mean_of_patterns, *PATTERNS.values())
        if pattern in HARD:
            yield value("start-belief-hard-less-easy", label, empirical - mean_of_easy, pattern, *EASY)
            yield value("belief-found-less-start", label, optimised - empirical, pattern)
        else:
            yield value("belief-start-less-found", label, empirical - optimised, pattern)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures as in the paper: figures by pattern, with a series for each parameter set and strategy.

    There is a picture for each figure, fill ratio and column (preset). The first two figures, time and belief, have the
    paper's form. The others have intervals over runs: the shares of wrong and of undecided robots for the first column,
    only the share of wrong robots for the later columns, whose pictures the report shows folded.
    """
    for place, column in enumerate(settings.columns):
        # FIGURES[4] is the share of wrong robots, FIGURES[5] that of undecided robots. FIGURES[2:4], the time and the
        # share of right robots with intervals over runs, are not drawn.
        with_intervals = FIGURES[4:] if place == 0 else FIGURES[4:5]
        for fill in FILLS:
            chosen = (pl.col("column") == column) & (pl.col("fill ratio") == fill)
            part = tables["cells"].filter(chosen)
            for figure, label, form, title in FIGURES[:2] + with_intervals:
                short = figure.removesuffix("_s").replace("_", "-")
                name = f"patterns-{column}-{fill}-{short}-{form}"
                series = pl.format("{}, {}", "parameters", "strategy")
                yield form_picture(
                    name, f"{column}, fill ratio {fill}: {title}", part, figure, label, form, "pattern", series,
                    folded=place > 0,
                )  # fmt: skip


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
    shown=two_forms(KEYS),
)
