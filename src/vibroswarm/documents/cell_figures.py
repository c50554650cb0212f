"""Columns of tables with figures of a cell (``analysis.figures``), and with what else is known of a cell."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Final

from vibroswarm.analysis.figures import BY_NAME, FIGURES, RunFigure
from vibroswarm.show.document import Column, limits_of

_NUMBERS: Final = {
    "icc_decision_time": Column("correlation within a run: decision time", decimals=3),
    "icc_right": Column("correlation within a run: right", decimals=3),
    "icc_undecided": Column("correlation within a run: undecided", decimals=3),
    "design_effect_decision_time": Column("design effect: decision time"),
    "design_effect_right": Column("design effect: right"),
    "design_effect_undecided": Column("design effect: undecided"),
    "runs": Column("runs"),
    "failed_runs": Column("failed runs"),
    "robots": Column("robots in all runs"),
    "t_end_s": Column("end of a run", "s"),
    "level": Column("level of intervals", share=True, decimals=0),
}


def with_limits_of(names: Iterable[str], columns: Collection[str]) -> list[str]:
    """Return the names of figures, each followed by those of its limits if a table has them."""
    return [each for name in names for each in (name, *limits_of(name)) if each in columns]


def column_of(figure: RunFigure) -> Column:
    """Return the format of a figure: seconds without decimals, shares in percent, anything else with three decimals."""
    if figure.unit == "s":
        return Column(figure.title, "s", decimals=0)
    return Column(figure.title, share=True) if figure.is_share else Column(figure.title, decimals=3)


def figure_columns(wide: Collection[str] = ()) -> dict[str, Column]:
    """Return the formats of all figures of a cell; a terminal prints those named in ``wide`` on request only."""
    formats = {figure.name: column_of(figure) for figure in FIGURES} | _NUMBERS
    formats["error"] = column_of(BY_NAME["robots_wrong"])
    return {name: replace(column, wide=name in wide) for name, column in formats.items()}
