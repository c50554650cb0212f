"""Item 8: the published means of the real experiments beside simulations on the real floor."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import polars as pl

from vibroswarm.page.report import Column
from vibroswarm.paper.columns import STRATEGIES, sizes
from vibroswarm.paper.item import CLAIMS, Drawn, Item, Picture, Settings, Shown, Tables, Work
from vibroswarm.paper.items.experiments_cells import (
    COLUMNS,
    GATES,
    KEYS,
    LOSSES,
    TEXTS,
    THRESHOLDS,
    TIME,
    cells,
    published_points,
)
from vibroswarm.paper.items.experiments_fit import FITTED, draw_fit, fit_table
from vibroswarm.paper.items.experiments_fit import SHOWN as SHOWN_FIT
from vibroswarm.paper.items.experiments_loss import SHOWN as SHOWN_LOSS
from vibroswarm.paper.items.experiments_loss import draw_loss, gaps, loss_table
from vibroswarm.paper.measure import Row, exact, frame, mean
from vibroswarm.paper.published import published
from vibroswarm.paper.show import PROPER_FORM, WALK_FORM
from vibroswarm.plots import draw_error_bars


def compute(work: Work) -> Tables:
    """Cells, bands over thresholds and gates, what loss changes, and claims."""
    table = work.rows(KEYS)
    columns: list[str] = [column for column in COLUMNS if column in work.settings.columns]
    measured = [row for column in columns for row in _measured(work, column)]
    if "paper" in work.settings.columns:
        plotted = published("experiments.packet_loss_percent")
        in_text = published("experiments.packet_loss_percent_in_text")
        ends = zip((min(sizes()), max(sizes())), (plotted[0], plotted[-1]), in_text, strict=True)
        for robots, shown, said in ends:
            measured.append(exact("robots-loss-sizes", "paper", f"{robots} robots", (shown - said) / 100))
    bands = _bands(table)
    return {
        "cells": table,
        "bands": bands,
        "widths": _widths(bands),
        "fit": fit_table(work, columns),
        "loss": loss_table(work, columns),
        CLAIMS: frame(measured),
    }


def _bands(table: pl.DataFrame) -> pl.DataFrame:
    """Published beside the least and the largest of ours, and ours as the text has the robots."""
    chosen = (pl.col("theta_E") == TEXTS) & (pl.col("gate") == GATES[1])
    bands = (
        table.filter(pl.col("packets") == LOSSES[0])
        .group_by("column", "strategy", "robots", maintain_order=True)
        .agg(
            pl.col(TIME).min().alias("least"),
            pl.col(TIME).max().alias("most"),
            pl.col(TIME).filter(chosen).first().alias("as the text has it"),
        )
    )
    rows = [
        (strategy, robots, float(value))
        for strategy in STRATEGIES
        for robots, value in zip(sizes(), published(f"experiments.decision_time_s.{strategy}"), strict=True)
    ]
    means = pl.DataFrame(
        rows,
        schema={"strategy": pl.String, "robots": bands.schema["robots"], "published": pl.Float64},
        orient="row",
    )
    found = bands.join(means, on=["strategy", "robots"], how="left", maintain_order="left")
    inside = (pl.col("published") >= pl.col("least")) & (pl.col("published") <= pl.col("most"))
    return found.with_columns((pl.col("most") - pl.col("least")).alias("width"), inside.alias("inside"))


def _widths(bands: pl.DataFrame) -> pl.DataFrame:
    """How wide the bands are beside the published means they are held against; means over the sizes."""
    return bands.group_by("column", "strategy", maintain_order=True).agg(
        pl.col("published").mean(), pl.col("width").mean(), pl.col("inside").sum()
    )


def _measured(work: Work, column: str) -> Iterator[Row]:
    for robots in sizes():
        for threshold in THRESHOLDS:
            for gate in GATES:
                yield _soft(work, column, threshold, gate, robots)
    for threshold in THRESHOLDS:
        for gate in GATES:
            *_, change = gaps(work, column, threshold, gate, max(sizes()))
            yield mean("robots-loss", column, f"theta_E {threshold}, gate {gate}", change)
    for place, robots in enumerate(sizes()):
        for strategy in STRATEGIES:
            values = work.values((column, LOSSES[0], TEXTS, GATES[1], robots, strategy), TIME)
            there = float(published(f"experiments.decision_time_s.{strategy}")[place])
            yield mean("robots-times", column, f"{robots} robots, {strategy}", values, less=there)
        for claim, name, numbers in (
            ("robots-avoidance", "avoid_per_sample_s", "avoidance_s_per_sample_none"),
            ("robots-distance", "distance_m", "distance_between_samples_m_none"),
        ):
            values = work.values((column, LOSSES[0], TEXTS, GATES[1], robots, "none"), name)
            there = float(published(f"experiments.{numbers}")[place])
            yield mean(claim, column, f"{robots} robots", values, less=there)


def _soft(work: Work, column: str, threshold: float, gate: str, robots: int) -> Row:
    keys = {name: (column, LOSSES[0], threshold, gate, robots, name) for name in STRATEGIES}
    faster = min(STRATEGIES[:2], key=lambda name: float(work.values(keys[name], TIME).mean()))
    words = f"{robots} robots, theta_E {threshold}, gate {gate}"
    return mean("robots-soft", column, words, work.difference(TIME, keys["soft"], keys[faster]))


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Bands beside the published means; what fits them; what loss changes; how the swarms walked."""
    for strategy in STRATEGIES:
        part = tables["bands"].filter(pl.col("strategy") == strategy)
        yield Picture(
            f"experiments-time-{strategy}", f"Decision time, {strategy}", partial(_draw_bands, part)
        )
    part = tables["fit"].filter(pl.col("column") == tables["fit"]["column"].last())
    title = f"Ours at {FITTED[0]:.2f}, gate {FITTED[1]}, less the published means: a fit"
    yield Picture("experiments-fit", title, partial(draw_fit, part))
    for column in COLUMNS:
        part = tables["loss"].filter(pl.col("column") == column)
        if not part.is_empty():
            name = f"experiments-loss-{column}"
            yield Picture(
                name, f"{column}: does loss make positive feedback overtake?", partial(draw_loss, part)
            )
    for figure, label, numbers in (
        ("avoid_per_sample_s", "avoidance per sample (s)", "avoidance_s_per_sample_none"),
        ("distance_m", "distance between samples (m)", "distance_between_samples_m_none"),
    ):
        draw = partial(_draw_walk, tables["cells"], figure, label, numbers)
        title = label.rpartition(" (")[0].capitalize()
        yield Picture(f"experiments-{figure.rpartition('_')[0].replace('_', '-')}", title, draw)


def _draw_bands(part: pl.DataFrame) -> Drawn:
    ours = part.select(
        pl.col("robots").cast(pl.Float64).alias("x"), pl.col("column").alias("series"),
        pl.col("as the text has it").alias("estimate"), pl.col("least").alias("low"), pl.col("most").alias("high"),
    )  # fmt: skip
    together = pl.concat([published_points(part["published"].to_list()[: len(sizes())]), ours])
    interval = f"band over thresholds and gates (mark: theta_E {TEXTS}, the robots' gate)"
    return draw_error_bars(together, x_label="robots", label="decision time (s)", interval=interval)


def _draw_walk(table: pl.DataFrame, figure: str, label: str, numbers: str) -> Drawn:
    chosen = (pl.col("packets") == LOSSES[0]) & (pl.col("strategy") == "none")
    chosen &= (pl.col("theta_E") == TEXTS) & (pl.col("gate") == GATES[1])
    ours = table.filter(chosen).select(
        pl.col("robots").cast(pl.Float64).alias("x"), pl.col("column").alias("series"),
        pl.col(figure).alias("estimate"), pl.col(f"{figure}_low").alias("low"), pl.col(f"{figure}_high").alias("high"),
    )  # fmt: skip
    together = pl.concat([published_points(published(f"experiments.{numbers}")), ours])
    return draw_error_bars(together, x_label="robots", label=label)


_BANDS: Final = {
    "column": Column("column"), "strategy": Column("strategy"), "robots": Column("robots"),
    "published": Column("published mean", "s"), "least": Column("ours, least", "s"),
    "most": Column("ours, most", "s"), "width": Column("width of the band", "s"),
    "as the text has it": Column("ours at 1.55, own gate", "s"),
    "inside": Column("published inside"),
}  # fmt: skip
ITEM: Final = Item(
    number=8,
    name="experiments",
    title="Real experiments",
    about=(
        "Swarms of 5 to 10 robots with P* on the floor of the real robots, 1000 s, with the published packet "
        "loss of each "
        "size (of the messages addressed to a robot: n / (n - 1) times what is plotted). Which threshold the "
        "published experiments had is not known (the recordings have 1.33, 1.40 and 1.55), nor what their O_c "
        "counted; ours are therefore bands over the three, and over O_c counting all observations or a "
        "robot's own. Such a band is hundreds of seconds wide: that a published mean lies inside says little.",
        f"Of all settings preset `calibrated` at {FITTED[0]:.2f} with the gate on the {FITTED[1]} comes nearest to the "
        "published times without feedback. It was chosen by these very times, so that agreement in them is a fit and "
        "no test; the other two strategies had no part in the choice.",
        "Published are means over 15 experiments, without intervals that could be used: their bars take "
        "robots of a run "
        "for independent. They ended when all had decided under all strategies, ours go on to 1000 s.",
        "Is loss what makes positive feedback overtake? The same motion, floor and readings with and without "
        "the loss: what "
        "is left of the gap between positive and no feedback when nothing is lost, is not loss.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        Shown(
            "widths",
            "Width of the bands, mean over the six sizes: so much is left open, and little is said by being inside.",
            {
                "column": Column("column"),
                "strategy": Column("strategy"),
                "published": Column("published mean", "s"),
                "width": Column("width of the band", "s"),
                "inside": Column("published means inside, of 6"),
            },
        ),
        Shown("bands", "Published means and the band of ours.", _BANDS),
        Shown(
            "fit",
            f"Published means beside ours with theta_E {FITTED[0]:.2f} and the gate on the {FITTED[1]}, chosen by the "
            "times without feedback. The error is that of both means; for want of their own, the published ones have "
            "that of 15 of our runs.",
            SHOWN_FIT,
        ),
        Shown(
            "loss",
            "Decision time of positive less no feedback; 95 % intervals over runs, paired.",
            SHOWN_LOSS,
        ),
        Shown(
            "cells",
            "All cells, with 95 % intervals over runs.",
            {key: Column(key) for key in KEYS} | PROPER_FORM | WALK_FORM,
        ),
    ),
)
