"""Headings of the figures of a cell (``analysis.cell_summary``), in the order in which tables have them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Final

from vibroswarm.show.document import Column

_TIMES: Final = {
    "decision_time_s": "decision time",
    "consensus_time_s": "time of consensus",
    "consensus_median_s": "median time of consensus",
}
_SHARES: Final = {
    "robots_right": "robots right",
    "robots_wrong": "robots wrong",
    "robots_undecided": "robots undecided",
    "error": "robots wrong",
    "forced_error": "forced error",
    "swarm_right": "swarms right",
    "swarm_wrong": "swarms wrong",
    "swarm_split": "split",
    "swarm_incomplete": "incomplete",
    "swarm_truth_undefined": "without a right answer",
    "swarm_error": "wrong among swarms that agreed",
    "robot_error": "wrong among robots that decided",
    "agreed_on_0": "agreed on 0 (less)",
    "agreed_on_1": "agreed on 1 (more)",
    "agreement_lasted": "lasted",
}
_NUMBERS: Final = {
    "belief_in_truth": Column("belief in the truth", decimals=3),
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


def limits_of(name: str) -> tuple[str, str]:
    """Return the names of the columns with the limits of a figure."""
    return f"{name}_low", f"{name}_high"


def with_limits_of(names: Iterable[str], columns: Collection[str]) -> list[str]:
    """Return the names of figures, each followed by those of its limits if a table has them."""
    return [each for name in names for each in (name, *limits_of(name)) if each in columns]


def figure_columns(columns: Collection[str], wide: Collection[str] = ()) -> dict[str, Column]:
    """Return the formats of the figures in a table.

    Args:
        columns: names of the columns of the table. wide: figures that a terminal prints on request only.
    """
    formats = {name: Column(title, "s", decimals=0) for name, title in _TIMES.items()}
    formats |= {name: Column(title, share=True) for name, title in _SHARES.items()}
    formats |= _NUMBERS
    return columns_of({name: replace(column, wide=name in wide) for name, column in formats.items()}, columns)


def columns_of(formats: Mapping[str, Column], columns: Collection[str]) -> dict[str, Column]:
    """Return the formats of the columns that a table has; a figure whose limits it has too gets them."""
    return {
        name: replace(formats[name], limits=limits_of(name))
        if set(limits_of(name)) <= set(columns)
        else formats[name]
        for name in columns
        if name in formats
    }
