"""Item 8: the published means of the real experiments compared with simulations on the real floor.

The threshold and the gate of the experiments are unknown (``experiment_times.SETTINGS``). So our mean of a swarm size
and strategy is a band: the smallest and the largest mean over all thresholds and gates.

A column is a preset of the reproduction; cells have the keys ``experiment_times.KEYS``. The measured values of the
claims are rows of ``claims.MEASURED``; ``Work.change`` makes one from the difference of two cells (first - second),
paired by run.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import polars as pl

from vibroswarm.core.numbers import number
from vibroswarm.paper.cell_tables import PROPER_FORM, WALK_FORM
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import STRATEGIES, published, sizes
from vibroswarm.paper.item import (
    CLAIMS,
    Item,
    Picture,
    Settings,
    Tables,
    TableView,
    Work,
    needs_column,
    picture,
)
from vibroswarm.paper.items.experiment_times import (
    AS_TEXT,
    COLUMNS,
    FITTED,
    KEYS,
    LOSSES,
    REAL_EXPERIMENTS,
    SETTINGS,
    TEXTS,
    TIME,
    cells,
    columns_of,
    fit_points,
    fit_table,
    gaps,
    largest_sd,
    loss_points,
    loss_table,
    points,
    published_by_size,
    published_points,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column

WALKED: Final = (
    (
        "avoidance-less-robots",
        "avoid_per_sample_s",
        "avoidance per sample (s)",
        "avoidance_s_per_sample_none",
    ),
    ("distance-less-robots", "distance_m", "distance between samples (m)", "distance_between_samples_m_none"),
)
"""Figures of how robots walk. Of each: claim, name of our figure, label, and name in ``published.json``."""
_AS_TEXT: Final = (pl.col("theta_E") == AS_TEXT[0]) & (pl.col("gate") == AS_TEXT[1])
"""Whether a row of a table of cells has the threshold and the gate of the paper's text."""


def compute(work: Work) -> Tables:
    """Return the table of cells, bands over thresholds and gates, fit, effect of loss, and the claims' measured values.

    One claim compares the paper with itself: the share of lost packets that the paper plots for the smallest and for
    the largest swarm, minus the share that its text states.
    """
    table = work.rows(KEYS)
    columns = columns_of(work.settings)
    measured = [row for column in columns for row in _measured(work, column)]
    if "paper" in work.settings.columns:
        plotted = published_by_size("experiments.packet_loss_percent")
        # Two values: of the smallest and of the largest swarm.
        in_text = published("experiments.packet_loss_percent_in_text")
        for robots, percent in zip((min(sizes()), max(sizes())), in_text, strict=True):
            difference = (plotted[robots] - percent) / 100
            measured.append(exact("plotted-loss-less-text", "paper", f"{robots} robots", difference))
    bands = _bands(table)
    return {
        "cells": table,
        "bands": bands,
        # For each column and strategy, means over the swarm sizes of the published time and of the band's width, and
        # the number of published means that lie inside their band.
        "widths": bands.group_by("column", "strategy", maintain_order=True).agg(
            pl.col("published").mean(), pl.col("width").mean(), pl.col("inside").sum()
        ),
        "fit": fit_table(work, columns),
        "loss": loss_table(work, columns),
        CLAIMS: frame(measured),
    }


def _bands(table: pl.DataFrame) -> pl.DataFrame:
    """Return the band of our mean times for each column, strategy and swarm size, next to the published mean.

    Columns, beside the keys: ``least`` and ``most``, our smallest and largest mean over thresholds and gates, with
    message loss; "as the text has it", our mean with the threshold and gate of the text; ``published``, the published
    mean; ``width``, most - least; and ``inside``, whether the published mean is in the band.

    Args:
        table: table of cells.
    """
    bands = (
        table.filter(pl.col("packets") == LOSSES[0])
        .group_by("column", "strategy", "robots", maintain_order=True)
        .agg(
            pl.col(TIME).min().alias("least"),
            pl.col(TIME).max().alias("most"),
            pl.col(TIME).filter(_AS_TEXT).first().alias("as the text has it"),
        )
    )
    rows = [
        (strategy, robots, value)
        for strategy in STRATEGIES
        for robots, value in published_by_size(f"experiments.decision_time_s.{strategy}").items()
    ]
    means = pl.DataFrame(
        rows,
        # A join needs the same type of "robots" on both sides.
        schema={"strategy": pl.String, "robots": bands.schema["robots"], "published": pl.Float64},
        orient="row",
    )
    joined = bands.join(means, on=["strategy", "robots"], how="left", maintain_order="left")
    inside = (pl.col("published") >= pl.col("least")) & (pl.col("published") <= pl.col("most"))
    return joined.with_columns((pl.col("most") - pl.col("least")).alias("width"), inside.alias("inside"))


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the measured values of the claims about times, loss and walking in a column.

    They are, in order: soft feedback against the better of the other strategies; the effect of loss in the largest
    swarm; our mean times minus the published ones; and our avoidance and distance minus the published ones. Whether the
    column can answer the question (``Work.cannot``) is not checked for avoidance and distance, in which decisions play
    no part.
    """
    for robots in sizes():
        for threshold, gate in SETTINGS:
            yield _soft(work, column, threshold, gate, robots)
    for threshold, gate in SETTINGS:
        *_, change = gaps(work, column, threshold, gate, max(sizes()))
        cannot = work.cannot((column, LOSSES[0], threshold, gate, max(sizes()), "none"))
        yield mean(
            "lead-with-loss-less-without", column, f"theta_E {threshold}, gate {gate}", change, cannot=cannot
        )
    for robots in sizes():
        for strategy in STRATEGIES:
            cannot = work.cannot((column, LOSSES[0], *AS_TEXT, robots, strategy))
            yield _less_published(
                work, "time-less-robots", column, label=f"{robots} robots, {strategy}", robots=robots,
                strategy=strategy, name=TIME, path=f"decision_time_s.{strategy}", cannot=cannot,
            )  # fmt: skip
        for value_name, name, _, path in WALKED:
            yield _less_published(
                work, value_name, column, label=f"{robots} robots", robots=robots, strategy="none", name=name, path=path
            )  # fmt: skip


def _less_published(
    work: Work, value_name: str, column: str, label: str, robots: int, strategy: str, name: str, path: str,
    cannot: str | None = None,
) -> Row:  # fmt: skip
    """Return the row of a claim about the difference between our mean and a published mean.

    Our mean is from cells with message loss, and with the threshold and gate of the text.

    Args:
        label: label of the value. name: name of our figure. path: name of the published values below "experiments".
        cannot: why the column cannot answer the question, or None.
    """
    return mean(
        value_name, column, label, work.values((column, LOSSES[0], *AS_TEXT, robots, strategy), name),
        less=published_by_size(f"experiments.{path}")[robots], published_runs=REAL_EXPERIMENTS,
        published_sd=largest_sd(work, column, robots, strategy, name), cannot=cannot,
    )  # fmt: skip


def _soft(work: Work, column: str, threshold: float, gate: str, robots: int) -> Row:
    """Return the row of the time with soft feedback minus the time with the faster of the other two strategies.

    The faster strategy is the one with the smaller mean time in these cells.
    """
    keys = {name: (column, LOSSES[0], threshold, gate, robots, name) for name in STRATEGIES}
    faster = min(STRATEGIES[:2], key=lambda name: float(work.values(keys[name], TIME).mean()))
    words = f"{robots} robots, theta_E {threshold}, gate {gate}"
    return work.change("time-soft-less-faster", column, words, TIME, keys["soft"], keys[faster])


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of the bands with the published means, of the fit, of the effect of loss, and of walking."""
    for strategy in STRATEGIES:
        part = tables["bands"].filter(pl.col("strategy") == strategy)
        own = points(part, pl.col("column"), "as the text has it", "least", "most")
        printed = published_points(published_by_size(f"experiments.decision_time_s.{strategy}"))
        both = pl.concat([printed, own])
        yield picture(
            f"experiments-time-{strategy}", f"Decision time, {strategy}", draw_error_bars, both, x_label="robots",
            label="decision time (s)", spans=True,
            interval=f"band over thresholds and gates (mark: θ_E {TEXTS}, the robots' gate)",
        )  # fmt: skip
    # The fit is drawn for the last column: `calibrated`, for which the setting was chosen, if it was requested.
    part = tables["fit"].filter(pl.col("column") == tables["fit"]["column"].last())
    title = f"Ours at {number(FITTED[0], 2)}, gate {FITTED[1]} - the published means: a fit"
    yield picture(
        "experiments-fit", title, draw_error_bars, fit_points(part), x_label="robots", label="ours - published (s)",
        interval="two standard errors",
    )  # fmt: skip
    for column in COLUMNS:
        part = tables["loss"].filter(pl.col("column") == column)
        if not part.is_empty():
            title = f"{column}: does loss make positive feedback overtake?"
            yield picture(
                f"experiments-loss-{column}", title, draw_error_bars, loss_points(part), x_label="robots",
                label="difference in time, positive - none (s)",
            )  # fmt: skip
    for _, figure, label, numbers in WALKED:
        chosen = tables["cells"].filter(
            _AS_TEXT, pl.col("packets") == LOSSES[0], pl.col("strategy") == "none"
        )
        own = points(chosen, pl.col("column"), figure, f"{figure}_low", f"{figure}_high")
        both = pl.concat([published_points(published_by_size(f"experiments.{numbers}")), own])
        # The title is the label without its unit, and the file's name has the name of the figure without its unit.
        name, title = figure.rpartition("_")[0].replace("_", "-"), label.rpartition(" (")[0].capitalize()
        yield picture(f"experiments-{name}", title, draw_error_bars, both, x_label="robots", label=label)


ITEM: Final = Item(
    number=8,
    name="experiments",
    title="Real experiments",
    about=(
        "Swarms of 5 to 10 robots with P* on the floor of the real robots, 1000 s, with the published packet "
        "loss of each size (of the messages addressed to a robot: n / (n - 1) times the plotted share). The threshold "
        "of the published experiments is unknown (the recordings have 1.33, 1.40 and 1.55), and so is what their O_c "
        "counted; our results are therefore bands over the three, and over O_c counting all observations or a "
        "robot's own. Such a band is hundreds of seconds wide: that a published mean lies inside says little.",
        f"Of all settings, preset `calibrated` at {number(FITTED[0], 2)} with the gate on the {FITTED[1]} comes "
        f"closest to "
        "the published times without feedback. It was chosen by these times, so agreement with them is a fit, "
        "not a test; the other two strategies were not used for the choice.",
        "The published values are means over 15 experiments. Their bars treat the robots of a run as independent, so "
        "claims use the error that 15 of our runs would have, with the largest variation of any setting. "
        "The experiments ended when all robots had decided with all strategies; ours continue to 1000 s.",
        "Does loss explain why positive feedback overtakes? The same motion, floor and readings with and without "
        "loss: the part of the difference between positive and no feedback that remains without loss is not due "
        "to loss.",
    ),
    cells=cells,
    compute=compute,
    skipped=needs_column(*COLUMNS),
    pictures=pictures,
    shown=(
        TableView(
            "widths",
            "Width of the bands, mean over the six sizes: the wider, the less it means to lie inside.",
            {
                "column": Column("column"),
                "strategy": Column("strategy"),
                "published": Column("published mean", "s"),
                "width": Column("width of the band", "s"),
                "inside": Column("published means inside, of 6"),
            },
        ),
        TableView(
            "bands",
            "Published means and the band of ours.",
            {
                "column": Column("column"), "strategy": Column("strategy"), "robots": Column("robots"),
                "published": Column("published mean", "s"), "least": Column("ours, least", "s"),
                "most": Column("ours, most", "s"), "width": Column("width of the band", "s"),
                "as the text has it": Column("ours at 1.55, own gate", "s"),
                "inside": Column("published inside"),
            },
        ),
        TableView(
            "fit",
            f"Published means and ours with theta_E {number(FITTED[0], 2)} and the gate on the {FITTED[1]}, chosen "
            f"by the "
            "times without feedback. The standard error is that of the difference, with the error of 15 of our runs "
            "for the published mean.",
            {
                "column": Column("column"), "strategy": Column("strategy"), "robots": Column("robots"),
                "published_s": Column("published mean", "s"), "ours_s": Column("ours", "s"),
                "less_s": Column("ours - published", "s"), "error_s": Column("standard error", "s"),
                "in errors": Column("in standard errors"),
            },
        ),
        TableView(
            "loss",
            "Difference in decision time (positive - none); 95 % intervals over runs, paired.",
            {
                "column": Column("column"), "theta_E": Column("theta_E"), "gate": Column("gate"),
                "robots": Column("robots"),
                "packets lost": Column("packets lost", share=True), "published_s": Column("published", "s"),
                "with_s": Column("with loss", "s"), "without_s": Column("without", "s"),
                "change_s": Column("effect of loss", "s", limits=("change_low", "change_high")),
            },
        ),
        TableView(
            "cells",
            "All cells, with 95 % intervals over runs.",
            {key: Column(key) for key in KEYS} | PROPER_FORM | WALK_FORM,
        ),
    ),
)  # fmt: skip
