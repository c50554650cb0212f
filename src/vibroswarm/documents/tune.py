"""The document of a tuning: the settings that were found for each strategy of a league."""

from __future__ import annotations

from typing import Final

import polars as pl

from vibroswarm.core.numbers import count, span
from vibroswarm.documents.file import NO_FIELDS
from vibroswarm.league.tuning import Tuned
from vibroswarm.show.document import Column, Document, Section, Table, Text

COLUMNS: Final = {
    "is_chosen": Column("chosen"),
    "forced_error": Column("forced error", share=True),
    "decision_time_s": Column("decision time", "s", decimals=0),
    "settings": Column(prose=True),
}


def tune_document(tuned: Tuned) -> Document:
    """Return the document of a tuning."""
    settings = pl.when(pl.col("settings") == "").then(pl.lit(NO_FIELDS)).otherwise("settings")
    table = tuned.table.with_columns(settings=settings)
    chosen = table.filter("is_chosen").drop("name", "is_chosen").sort("strategy", "forced_error")
    return Document(
        title="Settings for a league",
        answer=tuple(_found(name, chosen.filter(strategy=name)) for name in tuned.settings),
        warnings=("The figures favour the settings that were lucky: play a league with a seed of no round.",),
        parts=(
            Table(chosen, COLUMNS, name="settings"),
            Text(tuned.how, "aside"),
            Section(
                "All settings of the last round",
                (Table(table.drop("strategy"), COLUMNS, name="finalists"),),
                folded=True,
            ),
        ),
    )


def _found(name: str, chosen: pl.DataFrame) -> str:
    """Say where the chosen settings of a strategy lie."""
    errors, times = (
        span([100 * error for error in chosen["forced_error"]], 1),
        span(chosen["decision_time_s"], 0),
    )
    return f"{name}: {count(chosen.height, 'setting')} along its front, {errors} % forced error in {times} s."
