"""The report of a study whose cells are scored under a cost."""

from __future__ import annotations

from dataclasses import replace

from vibroswarm.core.numbers import with_limits
from vibroswarm.report.report import Report, Table
from vibroswarm.search.cell_scores import CellScores


def with_scores(report: Report, scores: CellScores) -> Report:
    """Return the report of a study with the scores of its cells: the best, and those that tie with it."""
    unit, table = scores.objective.unit, scores.table
    ties = int(table["best_group"].sum()) - 1
    fresh = "" if scores.fresh is None else f", {with_limits(scores.fresh, unit)} on fresh runs"
    answer = f"Lowest {scores.objective.words}: {scores.best.name}{fresh}; {ties} of {table.height - 1} others tie."
    shown = table.select("name", *table.columns[table.columns.index("score") :])
    title = f"{scores.objective.words}, {unit}" if unit else scores.objective.words
    titles = {
        "name": "cell",
        "score": title,
        "above_best": "above the lowest",
        "best_group": "ties with the best",
    }
    part = Table(shown, "Scores", "With 95 % intervals; those above the lowest hold together.", titles)
    return replace(report, answer=(answer, *report.answer[:2]), parts={"scores": part, **report.parts})
