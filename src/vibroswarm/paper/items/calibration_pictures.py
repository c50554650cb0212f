"""Pictures of the calibration: the paper's three figures, and the similarities."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.calibrate.features import WORDS
from vibroswarm.paper.calibration_histograms import draw_maps, draw_shares
from vibroswarm.paper.item import Drawn, Picture, Settings, Tables
from vibroswarm.plots import draw_error_bars

LABELS: Final = {
    "avoidance": "avoidance time per sample (s)",
    "vibrating": "energy on vibrating tiles (RMS)",
    "still": "energy on still tiles (RMS)",
}


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """States and energies, positions, steps: real robots next to each source; then the similarities."""
    yield Picture("calibration-states", "Time in each state", partial(_draw_states, tables["states"]))
    histograms = tables["histograms"]
    for feature in ("avoidance", "vibrating", "still"):
        part = histograms.filter(pl.col("feature") == feature)
        draw = partial(draw_shares, part.select("x", "share", series="source"), x_label=LABELS[feature])
        yield Picture(f"calibration-{feature}", WORDS[feature].capitalize(), draw)
    for feature in ("places", "distances", "steps"):
        part = histograms.filter(pl.col("feature") == feature)
        maps = partial(draw_maps, part.select("x", "y", "share", panel="source"), feature)
        yield Picture(f"calibration-{feature}", WORDS[feature].capitalize(), maps)
    # The mark is the similarity, the bar goes from null to ceiling.
    spans = tables["similarities"].select(
        x="feature", series="source", estimate="at equal counts",
        low=pl.min_horizontal("null", "at equal counts"), high=pl.max_horizontal("ceiling", "at equal counts"),
    )  # fmt: skip
    span = "span from uniform values to a perfect simulation"
    draw = partial(draw_error_bars, spans, label="cosine similarity", interval=span)
    yield Picture("calibration-similarities", "Similarities between null and ceiling", draw)


def _draw_states(states: pl.DataFrame) -> Drawn:
    rows = [
        (state, source[0], *mean_interval(part[state].to_numpy())[:3], part.height)
        for state in ("walking", "sensing", "avoiding")
        for source, part in states.group_by("source", maintain_order=True)
    ]
    made = pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high", "runs"], orient="row")
    return draw_error_bars(made, label="share of time", percent=True, interval="95 % interval over sessions")
