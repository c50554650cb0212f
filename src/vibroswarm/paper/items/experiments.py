"""Item 8: the published means of the real experiments compared with simulations on the real floor.

The threshold and the gate of the experiments are unknown (``SETTINGS``). So our mean of a swarm size
and strategy is a band: the smallest and the largest mean over all thresholds and gates.

A column is a preset of the reproduction; cells have the keys ``KEYS``. The measured values of the
claims are rows of ``claims.MEASURED``; ``Work.change`` makes one from the difference of two cells (first - second),
paired by run.
Two settings of the experiments are unknown: the threshold theta_E, and whether the minimal number of observations O_c
counts those of all robots or a robot's own (the gate). So all combinations are simulated (``SETTINGS``).

| name | symbol | equation |
|---|---|---|
| sd over our runs | s | - |
| sd over the published experiments | S | unknown; s, or the largest s in any of the ``SETTINGS`` |
| error of the difference | e | sqrt(s^2 / runs + S^2 / 15) |
| in standard errors | - | (ours - published) / e |
| gap of a run | - | its time with positive feedback - its time without, on the same motion, floor and readings |
| effect of loss | - | gap with the published loss - gap without loss, run by run |

The best settings (``FITTED``) were chosen by the published times: a fit, not a test.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import number
from vibroswarm.paper.cell_tables import PROPER_FORM, WALK_FORM
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import STRATEGIES, published, real_floor, sizes
from vibroswarm.paper.item import (
    CLAIMS,
    Cells,
    Item,
    Picture,
    Settings,
    Tables,
    TableView,
    Work,
    needs_column,
    picture,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column

COLUMNS: Final = ("paper", "calibrated")
"""Presets in which the experiments are simulated."""
REAL_EXPERIMENTS: Final[int] = published("experiments.per_swarm_size")
"""Number of experiments behind each published mean."""
T_END_S: Final[float] = published("experiments.t_end_s")
"""End of a run; the published experiments ended when all robots had decided."""
THRESHOLDS: Final = (1.33, 1.40, 1.55)
"""Thresholds of the recordings; which one the experiments had is unknown."""
TEXTS: Final[float] = published("experiments.rms_threshold_in_text")
"""Threshold of Algorithm 2, which is for real experiments."""
GATES: Final = ("total", "own")
"""O_c counts the observations of all robots, as in the simulations, or a robot's own, as in the real robots. A robot's
own observations need a fifth of the number, as there are five robots."""
LOSSES: Final = ("with loss", "without loss")
"""With the published share of lost messages, and without lost messages."""
TIME: Final = "decision_time_s"
"""Figure of a run: mean decision time of its robots, s."""
KEYS: Final = ("column", "packets", "theta_E", "gate", "robots", "strategy")
"""Parts of the cells' keys; packets is one of ``LOSSES``."""
SETTINGS: Final = tuple(product(THRESHOLDS, GATES))
"""Thresholds and gates that the experiments may have had."""
AS_TEXT: Final = (TEXTS, GATES[1])
"""Threshold and gate as the text describes the real robots."""


def columns_of(settings: Settings) -> list[str]:
    """Return the requested columns in which the experiments are simulated."""
    return [column for column in COLUMNS if column in settings.columns]


def published_by_size(path: str) -> dict[int, float]:
    """Return the paper's values at ``path`` by swarm size."""
    return dict(zip(sizes(), map(float, published(path)), strict=True))


def largest_sd(work: Work, column: str, robots: int, strategy: str, name: str) -> float:
    """Return the largest standard deviation over runs that the figure ``name`` has in any of the ``SETTINGS``.

    It stands for the unknown standard deviation over the published experiments.

    Args:
        column, robots, strategy: parts of the cells' keys; the cells have message loss.
    """
    keys = [(column, LOSSES[0], *setting, robots, strategy) for setting in SETTINGS]
    return max(float(work.values(key, name).std(ddof=1)) for key in keys)


def points(frame: pl.DataFrame, series: pl.Expr, estimate: str, low: Any, high: Any) -> pl.DataFrame:
    """Return the points of an error-bar plot over the swarm size, one per row of ``frame``.

    Args:
        frame: table with a column ``robots``. series: expression of the name of each row's line.
        estimate: column of the estimate. low, high: columns or expressions of the limits.
    """
    return frame.select(
        x=pl.col("robots").cast(pl.Float64), series=series, estimate=estimate, low=low, high=high
    )


def loss_of(robots: int) -> float:
    """Return the published share of messages addressed to a robot that were lost, for a swarm size.

    The paper plots the share of all messages of n robots, the receiving robot's own included, which are never lost. Of
    the messages addressed to a robot, which n - 1 robots send, the lost share is n / (n - 1) times as large.
    """
    return published_by_size("experiments.packet_loss_percent")[robots] / 100 * robots / (robots - 1)


def cells(settings: Settings) -> Cells:
    """Return the cells of the real experiments, by ``KEYS``.

    Without message loss, only no feedback and positive feedback are run: the effect of loss is measured on the
    difference between these two.
    """
    return {
        (column, packets, threshold, gate, robots, strategy): settings.cell(
            column, _values(packets, threshold, gate, robots, strategy)
        )
        for column in columns_of(settings)
        for packets in LOSSES
        for threshold, gate in SETTINGS
        for robots in sizes()
        for strategy in (STRATEGIES if packets == LOSSES[0] else STRATEGIES[:2])
    }


def _values(packets: str, threshold: float, gate: str, robots: int, strategy: str) -> dict[str, Any]:
    """Return the fields that a cell sets, by dotted name: the real floor, and the parts of the cell's key.

    With the gate "own", the robot's own observations have to reach the published O_c divided by the number of robots in
    the paper's simulations.

    Args: the parts of ``KEYS`` without the column.
    """
    *_, min_observations = published("parameters.P_star")  # O_c is the last parameter
    if gate == "own":
        min_observations //= published("simulation.robots")
    return real_floor() | {
        "run.t_end_s": T_END_S,
        "swarm.robots": robots,
        "strategy.name": strategy,
        "sensor.rms_threshold": threshold,
        "decision.gate": gate,
        "decision.min_observations": min_observations,
        "network.name": "loss",
        "network.loss.share": loss_of(robots) if packets == LOSSES[0] else 0.0,
    }


def published_points(values: dict[int, float]) -> pl.DataFrame:
    """Return the paper's values by swarm size as ``points`` without intervals."""
    rows = [(float(robots), "published", value, value, value) for robots, value in values.items()]
    return pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high"], orient="row")


FITTED: Final = (1.40, "total")
"""Threshold and gate for which `calibrated` comes closest to the published times without feedback."""


def error_of_difference(values: Any, spread: float | None = None) -> float:
    """Return the standard error e of the difference between our mean and a published mean.

    Args:
        values: value of each of our runs, (runs,).
        spread: standard deviation over the ``REAL_EXPERIMENTS`` published experiments; None: that over our runs.
    """
    own = float(np.std(values, ddof=1))
    published_sd = own if spread is None else spread
    return float(np.sqrt(own**2 / np.size(values) + published_sd**2 / REAL_EXPERIMENTS))  # e


def in_standard_errors(less: float, error: float) -> float | None:
    """Return a difference divided by its standard error; None if the error is 0, as in cells where no robot decides."""
    return less / error if error > 0 else None


def beside_published(
    work: Work,
    columns: Sequence[str],
    setting: tuple[float, str],
    path: str,
    name: str,
    *,
    widest: bool = False,
) -> Iterator[dict[str, Any]]:
    """Yield our means with message loss beside the published ones, for each column, strategy and swarm size.

    ``less`` is our mean minus the published one, ``error`` its standard error, which includes that of the published
    mean, and "in errors" their ratio; ``ours_error`` is the standard error of our mean.

    Args:
        setting: threshold and gate. path: of the published means without the strategy. name: of the figure.
        widest: whether the published experiments are taken to vary as our runs do in any setting (``largest_sd``), or
            as in this one.
    """
    for column, strategy, robots in product(columns, STRATEGIES, sizes()):
        values = work.values((column, LOSSES[0], *setting, robots, strategy), name)
        mean, printed = float(values.mean()), published_by_size(f"{path}.{strategy}")[robots]
        sd = largest_sd(work, column, robots, strategy, name) if widest else None
        error = error_of_difference(values, sd)
        yield {
            "column": column, "theta_E": setting[0], "gate": setting[1], "strategy": strategy, "robots": robots,
            "published": printed, "ours": mean,
            "ours_error": float(np.std(values, ddof=1)) / float(np.sqrt(values.size)),
            "less": mean - printed, "error": error, "in errors": in_standard_errors(mean - printed, error),
        }  # fmt: skip


def fit_table(work: Work, columns: list[str]) -> pl.DataFrame:
    """Return our decision times at ``FITTED`` next to the published means, one row per column, strategy and size.

    ``less_s`` is our mean minus the published mean, ``error_s`` its standard error, and "in errors" their ratio. The
    published experiments are taken to have the standard deviation of our runs at ``FITTED``, not ``largest_sd``.
    """
    rows = beside_published(work, columns, FITTED, "experiments.decision_time_s", TIME)
    seconds = (pl.col(name).alias(f"{name}_s") for name in ("published", "ours", "less", "error"))
    table = pl.DataFrame(list(rows), infer_schema_length=None)
    return table.select("column", "strategy", "robots", *seconds, "in errors")


def fit_points(part: pl.DataFrame) -> pl.DataFrame:
    """Return our means minus the published means over the swarm size as points, with bars of two standard errors.

    Args:
        part: rows of ``fit_table`` of one column.
    """
    less, half = pl.col("less_s"), 2 * pl.col("error_s")
    return points(part, pl.col("strategy"), "less_s", less - half, less + half)


Z: Final = 1.96
"""Standard errors of a 95 % interval."""


def loss_table(work: Work, columns: list[str]) -> pl.DataFrame:
    """Return the gap (time with positive feedback - time without) with and without loss, and the effect of loss.

    There is one row per column, setting (threshold and gate) and swarm size; all our differences are paired by run.
    with_s and without_s are our gaps and change_s is the effect of loss: means over runs, each with its standard error
    (NAME_error_s), and change_s also with its limits. published_s is the published gap, and "packets lost" is
    ``loss_of``.
    """
    rows = []
    printed = published_gaps()
    for column, (threshold, gate), robots in product(columns, SETTINGS, sizes()):
        row: dict[str, Any] = {"column": column, "theta_E": threshold, "gate": gate, "robots": robots}
        row["packets lost"] = loss_of(robots)
        of_runs = gaps(work, column, threshold, gate, robots)
        for name, values in zip(("with", "without", "change"), of_runs, strict=True):
            error = float(values.std(ddof=1)) / values.size**0.5
            row |= {f"{name}_s": float(values.mean()), f"{name}_error_s": error}
        half = Z * row["change_error_s"]
        row |= {"change_low": row["change_s"] - half, "change_high": row["change_s"] + half}
        rows.append(row | {"published_s": printed[robots]})
    return pl.DataFrame(rows, infer_schema_length=None)


def published_gaps() -> dict[int, float]:
    """Return the published difference in mean time (positive - none), s, by swarm size."""
    none, positive = (
        published_by_size(f"experiments.decision_time_s.{name}") for name in ("none", "positive")
    )
    return {robots: positive[robots] - none[robots] for robots in none}


def gaps(work: Work, column: str, threshold: float, gate: str, robots: int) -> tuple[Any, Any, Any]:
    """Return the gap of each run with loss, the gap of each run without loss, and the effect of loss, (runs,) each.

    A gap is the time with positive feedback minus the time without feedback, s.
    """
    gaps_of = [
        work.difference(
            TIME,
            (column, packets, threshold, gate, robots, "positive"),
            (column, packets, threshold, gate, robots, "none"),
        )
        for packets in LOSSES
    ]
    return gaps_of[0], gaps_of[1], gaps_of[0] - gaps_of[1]


def loss_points(part: pl.DataFrame) -> pl.DataFrame:
    """Return as points the published gaps, and ours with loss in all settings and without loss in the first setting.

    The first setting has the lowest threshold, where loss matters most.

    Args:
        part: rows of ``loss_table`` of one column.
    """
    frames = [published_points(published_gaps())]
    for name, (threshold, gate) in [*(("with", setting) for setting in SETTINGS), ("without", SETTINGS[0])]:
        of_setting = part.filter((pl.col("gate") == gate) & (pl.col("theta_E") == threshold))
        mean, half = pl.col(f"{name}_s"), Z * pl.col(f"{name}_error_s")
        series = pl.lit(f"{name} loss, θ_E {threshold}, gate {gate}")
        frames.append(points(of_setting, series, f"{name}_s", mean - half, mean + half))
    return pl.concat(frames)


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
