"""What scores of cells say: the best cell, on its own and on fresh runs, and those that tie with it."""

from __future__ import annotations

from dataclasses import replace

from vibroswarm.core.numbers import decimals_of, with_limits
from vibroswarm.search.cell_scores import CellScores
from vibroswarm.show.document import Column, Document, Section, Table


def with_scores(document: Document, scores: CellScores) -> Document:
    """Return the document of a study with the scores of its cells."""
    unit, table = scores.objective.unit, scores.table
    ties = int(table["best_group"].sum()) - 1
    fresh = "" if scores.fresh is None else f", {with_limits(scores.fresh, unit)} on fresh runs"
    sentence = f"Lowest {scores.objective.words}: {scores.best.name}{fresh}; {ties} of {table.height - 1} others tie."
    decimals = decimals_of(table["score"], 4)
    columns = {
        "name": Column("cell"),
        "score": Column("score", unit, decimals=decimals),
        "above_best": Column("above the lowest", unit, decimals=decimals, sign=True),
        "best_group": Column("ties with the best"),
    }
    shown = table.select("name", *table.columns[table.columns.index("score") :])
    caption = "With 95 % intervals; those above the lowest hold together."
    return replace(
        document,
        answer=(sentence, *document.answer),
        parts=(Section("Scores", (Table(shown, columns, caption, "scores"),)), *document.parts),
        data={**document.data, "scores": table},
    )
