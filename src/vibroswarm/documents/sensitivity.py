"""The document of a sensitivity analysis: which fields matter."""

from __future__ import annotations

import math
from collections.abc import Iterator

import polars as pl

from vibroswarm.core.numbers import Estimate, count, percent, with_limits
from vibroswarm.optimize.sensitivity import Sensitivity
from vibroswarm.show.document import Column, Document, Table, Text


def sensitivity_document(found: Sensitivity) -> Document:
    """Return the document of the Sobol indices of the fields of a search."""
    frame = pl.DataFrame([vars(index) for index in found.fields])
    columns = {
        "name": Column("field"),
        "total": Column("with interactions", decimals=2),
        "first": Column("alone", decimals=2),
    }
    caption = "Shares of the variance of the mean cost over the space (Sobol indices), with 95 % bootstrap intervals."
    shown = frame.select("name", "total", "total_low", "total_high", "first", "first_low", "first_high")
    made = pl.DataFrame({
        "points": [found.points], "replicates": [found.replicates], "runs": [found.runs],
        "noise_share": [found.noise_share],
    })  # fmt: skip
    words = (
        f"{count(found.runs, 'run')} at {count(found.points, 'point')}, {found.replicates} each; "
        f"none failed. Noise of the runs, {percent(found.noise_share, 0)} of the variance of the "
        "points' mean costs, is removed."
    )
    return Document(
        title="Sensitivity",
        answer=tuple(_answer(found)),
        parts=(Table(shown, columns, caption, "fields"), Text(words, "aside")),
        data={"fields": frame, "design": made},
    )


def _answer(found: Sensitivity) -> Iterator[str]:
    """Name the field that matters most, and those without significant effect."""
    most = found.fields[0]
    if math.isnan(most.total):
        yield "No effect can be estimated: the noise of the runs is as large as all effects, or the cost does not vary."
        return
    if most.total_low > 0:
        share = with_limits(Estimate(most.total, most.total_low, most.total_high), decimals=2)
        yield f"Largest effect on the cost: {most.name}, {share} of the variance with its interactions."
    # `not ... > 0` also holds for nan, which the limits are if the noise of the runs hides all effects.
    if without_effect := [index.name for index in found.fields if not index.total_low > 0]:
        yield (
            f"No significant effect: {', '.join(without_effect)}. Four times the --budget makes intervals half as wide."
        )
