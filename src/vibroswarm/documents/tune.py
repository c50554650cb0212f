"""The document of a tuning: the settings that were found for each strategy of a league."""

from __future__ import annotations

from typing import Final

import polars as pl

from vibroswarm.league.tuning import Tuned
from vibroswarm.show.document import Column, Document, Section, Table, Text
from vibroswarm.show.numbers import listed, percent

COLUMNS: Final = {
    "forced_error": Column("forced error", share=True, limits=("forced_error_low", "forced_error_high")),
    "decision_time_s": Column(
        "decision time", "s", decimals=0, limits=("decision_time_s_low", "decision_time_s_high")
    ),
    "is_chosen": Column("chosen"),
    "settings": Column(prose=True),
}


def tune_document(tuned: Tuned) -> Document:
    """Return the document of a tuning."""
    chosen = tuned.table.filter("is_chosen").sort("decision_time_s")
    above = chosen.filter(pl.col("forced_error") > tuned.target)["strategy"]
    answer = [f"Settings by the smallest decision time with at most {percent(tuned.target)} forced error."]
    if len(above):
        answer.append(f"None has so little: {listed(above)}, with the settings of the smallest forced error.")
    unchanged = "no fields set (as in the scenario, else the strategy's defaults)"
    settings = pl.when(pl.col("settings") == "").then(pl.lit(unchanged)).otherwise("settings")
    frame = chosen.drop("name", "is_chosen").with_columns(settings=settings)
    return Document(
        title="Settings for a league",
        answer=tuple(answer),
        warnings=("The figures favour the settings that were lucky: play a league with another seed.",),
        parts=(
            Table(frame, COLUMNS, name="settings"),
            Text(tuned.how, "aside"),
            Section(
                "All settings of the second round",
                (Table(tuned.table.drop("strategy"), COLUMNS, name="finalists"),),
                folded=True,
            ),
        ),
    )
