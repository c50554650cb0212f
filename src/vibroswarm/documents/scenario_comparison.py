"""The document of a comparison of two scenarios under one objective."""

from __future__ import annotations

from typing import Final

import polars as pl

from vibroswarm.analysis.figures import BY_COLUMN
from vibroswarm.analysis.intervals import columns_of
from vibroswarm.core.numbers import count, listed, with_limits
from vibroswarm.documents.knowledge import told
from vibroswarm.documents.search_tables import frame_of, parts_of
from vibroswarm.documents.search_words import aim
from vibroswarm.optimize.scenario_comparison import Checked
from vibroswarm.scenario.scenario import changes
from vibroswarm.show.document import Column, Document, Table

ASKED: Final = ("arena", "floor", "change", "task")
"""Sections that say what is inspected and asked."""


def checked_document(found: Checked) -> Document:
    """Return the document of a comparison."""
    unit, scenarios = found.objective.unit, (found.first, found.second)
    failed = [
        f"{count(one.failed, 'run')} of {one.name} FAILED (in no figure)." for one in scenarios if one.failed
    ]
    difference, again = (with_limits(each, sign=True) for each in (found.difference, found.replicate))
    words = (
        f"{found.first.name} - {found.second.name}, {aim(found.objective)}: {difference} on "
        f"{count(found.first.score.n, 'fresh run')} of each, in pairs; {again} on other seeds."
    )
    figures = frame_of([paired.as_row() for paired in found.figures])
    case_names = [str(k + 1) for k in range(len(found.first.cases))]
    return Document(
        title=f"{found.first.name} against {found.second.name}",
        answer=(found.says, words),
        knew=told(found.scenarios),
        warnings=(*_different_questions(found), *failed),
        parts=(_scores(found), *parts_of(scenarios, case_names, unit), _figures(figures, found)),
        made_by={"objective": found.objective.words},
        data={"differences": _differences(found), "figures": figures},
    )


def _different_questions(found: Checked) -> tuple[str, ...]:
    """Warn if the scores are not of the same surface or question: not the settings alone make their difference."""
    differing = [name for name in changes(*found.scenarios) if name.partition(".")[0] in ASKED]
    if not differing:
        return ()
    return (f"The two differ in {listed(differing)} too; --search FILE sets its cases in both.",)


def _scores(found: Checked) -> Table:
    rows = [
        {"name": one.name, **columns_of("score", one.score), "runs": one.score.n, "failed": one.failed}
        for one in (found.first, found.second)
    ]
    columns = {
        "name": Column("scenario"),
        "score": Column("score", found.objective.unit),
        "failed": Column("failed runs", wide=True),
    }
    return Table(frame_of(rows), columns, name="scores")


def _differences(found: Checked) -> pl.DataFrame:
    """Tabulate the difference of the scores on each block of seeds, and whether the second confirms the first."""
    return frame_of(
        [
            {"seeds": seeds, **columns_of("difference", each), "pairs": each.n, "confirmed": found.confirmed}
            for seeds, each in (("first", found.difference), ("second", found.replicate))
        ]
    )


def _figures(figures: pl.DataFrame, found: Checked) -> Table:
    """Tabulate the differences of other figures."""
    numbers = ["first", "second", "difference", "difference_low", "difference_high"]
    declared = [BY_COLUMN[name] for name in figures["figure"]]
    titles = [f"{one.title}, {'%' if one.is_share else one.unit}".rstrip(", ") for one in declared]
    factors = pl.Series([100.0 if one.is_share else 1.0 for one in declared])
    shown = figures.select(pl.Series("figure", titles), pl.col(numbers) * factors)
    columns = {
        "first": Column(found.first.name, decimals=1),
        "second": Column(found.second.name, decimals=1),
        "difference": Column(sign=True, decimals=1),
    }
    return Table(shown, columns, "First - second, run by run, with 95 % intervals.", "figures")
