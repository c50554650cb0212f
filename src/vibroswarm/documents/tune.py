"""The document of a tuning: the settings that were found for each strategy of a league."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import polars as pl

from vibroswarm.league.entries import AIM, LEAST
from vibroswarm.league.tuning import AIMS, Tuned
from vibroswarm.show.document import Column, Document, Section, Table, Text
from vibroswarm.show.numbers import listed, percent

COLUMNS: Final = {
    "aim": Column("tuned for", share=True, decimals=0),
    "forced_error": Column("forced error", share=True, limits=("forced_error_low", "forced_error_high")),
    "decision_time_s": Column(
        "decision time", "s", decimals=0, limits=("decision_time_s_low", "decision_time_s_high")
    ),
    "settings": Column(prose=True),
}


def tune_document(tuned: Tuned) -> Document:
    """Return the document of a tuning."""
    unchanged = "no fields set (as in the scenario, else the strategy's defaults)"
    settings = pl.when(pl.col("settings") == "").then(pl.lit(unchanged)).otherwise("settings")
    table = tuned.table.with_columns(settings=settings)
    chosen = table.filter(pl.col("aim").is_not_null()).sort("strategy", "aim", maintain_order=True)
    return Document(
        title="Settings for a league",
        answer=tuple(_reached(name, settings) for name, settings in tuned.settings.items()),
        warnings=("The figures favour the settings that were lucky: play a league with another seed.",),
        parts=(
            Table(chosen.drop("name"), COLUMNS, name="settings"),
            Text(tuned.how, "aside"),
            Section(
                "All settings of the last round",
                (Table(table.drop("strategy"), COLUMNS, name="finalists"),),
                folded=True,
            ),
        ),
    )


def _reached(name: str, settings: Sequence[Mapping[str, Any]]) -> str:
    """Say for which forced errors a strategy has settings."""
    aims = [one[AIM] for one in settings if one[AIM] != LEAST]
    if not aims:
        return f"{name} reaches none of the forced errors up to {percent(AIMS[-1], 0)}: the setting with the least."
    return (
        f"{name} has settings for {listed(percent(aim, 0) for aim in aims)} forced error, and for the least."
    )
