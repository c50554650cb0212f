"""The document of the effect of changing from one scenario to another, under several strategies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import polars as pl

from vibroswarm.analysis.figures import BY_COLUMN, RunFigure
from vibroswarm.analysis.paired import ESTIMATED, Confirmation
from vibroswarm.calibrate.effect import Effect
from vibroswarm.core.numbers import with_limits
from vibroswarm.documents.cell_figures import figure_columns
from vibroswarm.documents.knowledge import told
from vibroswarm.show.document import Column, Document, Table, limits_of


def effect_document(*found: Effect) -> Document:
    """Return what changes from the first scenario to the second, under each strategy: all effects of one comparison."""
    return Document(
        title=" and ".join(found[0].names),
        answer=tuple(map(_change, found)),
        knew=told(scenario for effect in found for scenario in effect.scenarios),
        parts=(_figures(found), _differences(found)),
        data={"consensus": _consensus(found), "differences": _all_differences(found)},
    )


def _change(effect: Effect) -> str:
    """Say how the first figure changes, the decision time or the error, and whether other seeds confirm it."""
    one = effect.differences[0]
    figure = BY_COLUMN[one.first.figure]
    change = with_limits(one.first.difference, figure.unit, _decimals(figure), sign=True)
    return f"{effect.strategy}: {figure.title} {_minus(effect)} {change}; {_says(one)}."


def _decimals(figure: RunFigure) -> int:
    """Return the decimals of a difference: times are written in whole seconds, other figures as in a study."""
    return 4 if figure.by_run in ESTIMATED else 0 if figure.unit else 3


def _minus(effect: Effect) -> str:
    return f"{effect.names[1]} - {effect.names[0]}"


def _says(one: Confirmation) -> str:
    """Return whether other seeds confirm a difference, if it is significant; ``-`` if no run has the figure."""
    if not one.first.pairs:
        return "-"
    return one.says if one.first.difference.excludes(0.0) else "no significant difference"


def _figures(found: Sequence[Effect]) -> Table:
    """Return a row for each strategy and scenario: means over runs, and the shares of runs by consensus.

    Where the task asks for a number, there is no consensus.
    """
    estimates = set(ESTIMATED) == set(found[0].figures[0])
    shown = ESTIMATED if estimates else ("decision_time_s", "belief_in_truth")
    rows = []
    for effect in found:
        for name, figures, shares in zip(effect.names, effect.figures, effect.consensus, strict=True):
            row: dict[str, Any] = {"strategy": effect.strategy, "scenario": name}
            for figure in shown:
                row |= zip((figure, *limits_of(figure)), figures[figure][:3], strict=True)
            if not estimates:
                row |= {f"swarm_{outcome}": share for outcome, share in shares.items()}
            rows.append(row)
    frame = pl.DataFrame(rows)
    caption = f"Means over runs (95 %){'' if estimates else ', and shares of runs by consensus'}."
    return Table(frame, figure_columns(), caption, "figures", names=2)


def _differences(found: Sequence[Effect]) -> Table:
    rows = []
    for effect in found:
        for one in effect.differences:
            figure = BY_COLUMN[one.first.figure]
            difference = with_limits(one.first.difference, decimals=_decimals(figure), sign=True)
            words = f"{figure.title}, {figure.unit}" if figure.unit else figure.title
            rows.append((effect.strategy, words, difference, _says(one)))
    frame = pl.DataFrame(rows, schema=["strategy", "figure", "difference", "verdict"], orient="row")
    columns = {"verdict": Column(prose=True)}
    return Table(frame, columns, f"{_minus(found[0])}, paired by run (95 %).", "differences", names=2)


def _consensus(found: Sequence[Effect]) -> pl.DataFrame:
    return pl.DataFrame(
        [
            {"strategy": effect.strategy, "scenario": name, **shares}
            for effect in found
            for name, shares in zip(effect.names, effect.consensus, strict=True)
        ]
    )


def _all_differences(found: Sequence[Effect]) -> pl.DataFrame:
    """Return the comparison on each of the two seeds in a row of its own."""
    return pl.DataFrame(
        [
            {
                "strategy": effect.strategy,
                "block": place,
                **block.as_row(),
                "confirmed": one.confirmed,
                "says": one.says,
            }
            for effect in found
            for one in effect.differences
            for place, block in enumerate((one.first, one.second), start=1)
        ],
        infer_schema_length=None,
    )
