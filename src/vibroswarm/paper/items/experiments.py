"""Item 8: the published means of the real experiments beside simulations on the real floor."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import polars as pl

from vibroswarm.page.report import Column
from vibroswarm.paper.columns import STRATEGIES, sizes
from vibroswarm.paper.item import CLAIMS, Cells, Drawn, Item, Picture, Settings, Shown, Tables, Work
from vibroswarm.paper.measure import Row, exact, frame, mean
from vibroswarm.paper.published import published
from vibroswarm.paper.real_floor import real_floor
from vibroswarm.paper.show import PROPER_FORM, WALK_FORM
from vibroswarm.plots import draw_error_bars

COLUMNS: Final = ("paper", "calibrated")
T_END_S: Final = 1000.0
THRESHOLDS: Final = (1.33, 1.55)
"""Of the sensor, the lowest and the highest of the recordings; which one the experiments had is not known."""
TEXTS: Final = 1.55
"""The one of Algorithm 2, which is for real experiments."""
GATES: Final = ("total", "own")
"""O_c counts all observations, as in the simulations, or a robot's own, as the real robots do (a fifth as many)."""
LOSSES: Final = ("with loss", "without loss")
TIME: Final = "decision_time_s"
KEYS: Final = ("column", "packets", "theta_E", "gate", "robots", "strategy")


def loss_of(robots: int) -> float:
    """Share of messages addressed to a robot that were lost: plotted is that of all, its own included."""
    plotted = dict(zip(sizes(), published("experiments.packet_loss_percent"), strict=True))[robots]
    return float(plotted) / 100 * robots / (robots - 1)


def cells(settings: Settings) -> Cells:
    """column, packets, threshold, gate, robots, strategy; without loss soft feedback is left out."""
    return {
        (column, packets, threshold, gate, robots, strategy): settings.cell(
            column, _values(packets, threshold, gate, robots, strategy)
        )
        for column in COLUMNS
        if column in settings.columns
        for packets in LOSSES
        for threshold in THRESHOLDS
        for gate in GATES
        for robots in sizes()
        for strategy in (STRATEGIES if packets == LOSSES[0] else STRATEGIES[:2])
    }


def _values(packets: str, threshold: float, gate: str, robots: int, strategy: str) -> dict[str, Any]:
    counted = published("parameters.P_star")[4]
    return real_floor() | {
        "run.t_end_s": T_END_S,
        "swarm.robots": robots,
        "strategy.name": strategy,
        "sensor.rms_threshold": threshold,
        "decision.gate": gate,
        "decision.min_observations": counted
        if gate == "total"
        else counted // published("simulation.robots"),
        "network.loss": loss_of(robots) if packets == LOSSES[0] else 0.0,
    }


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
    return {"cells": table, "bands": _bands(table), "loss": _loss(work, columns), CLAIMS: frame(measured)}


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
    return found.with_columns(inside.alias("inside"))


def _loss(work: Work, columns: list[str]) -> pl.DataFrame:
    """Time of positive less none, with loss and without, and what loss changes; paired run by run."""
    rows = []
    gaps = dict(zip(sizes(), _published_gaps(), strict=True))
    for column in columns:
        for threshold in THRESHOLDS:
            for gate in GATES:
                for robots in sizes():
                    row: dict[str, Any] = {
                        "column": column,
                        "theta_E": threshold,
                        "gate": gate,
                        "robots": robots,
                    }
                    row["packets lost"] = loss_of(robots)
                    for name, values in zip(
                        ("with", "without", "change"),
                        _gaps(work, column, threshold, gate, robots),
                        strict=True,
                    ):
                        one = mean("", column, "", values)
                        row |= {f"{name}_s": one["estimate"], f"{name}_error_s": one["standard_error"]}
                    row |= {"change_low": row["change_s"] - Z * row["change_error_s"]}
                    row |= {"change_high": row["change_s"] + Z * row["change_error_s"]}
                    rows.append(row | {"published_s": gaps[robots]})
    return pl.DataFrame(rows, infer_schema_length=None)


Z: Final = 1.96


def _published_gaps() -> list[float]:
    none, positive = (published(f"experiments.decision_time_s.{name}") for name in ("none", "positive"))
    return [float(p) - float(n) for n, p in zip(none, positive, strict=True)]


def _gaps(work: Work, column: str, threshold: float, gate: str, robots: int) -> tuple[Any, Any, Any]:
    """Positive less none of each run, with loss, without, and the first less the second."""
    gaps = [
        work.difference(
            TIME,
            (column, packets, threshold, gate, robots, "positive"),
            (column, packets, threshold, gate, robots, "none"),
        )
        for packets in LOSSES
    ]
    return gaps[0], gaps[1], gaps[0] - gaps[1]


def _measured(work: Work, column: str) -> Iterator[Row]:
    for robots in sizes():
        for threshold in THRESHOLDS:
            for gate in GATES:
                yield _soft(work, column, threshold, gate, robots)
    for threshold in THRESHOLDS:
        for gate in GATES:
            *_, change = _gaps(work, column, threshold, gate, max(sizes()))
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
    """Bands beside the published means; what loss changes; how the swarms walked."""
    for strategy in STRATEGIES:
        part = tables["bands"].filter(pl.col("strategy") == strategy)
        yield Picture(
            f"experiments-time-{strategy}", f"Decision time, {strategy}", partial(_draw_bands, part)
        )
    for column in COLUMNS:
        part = tables["loss"].filter(pl.col("column") == column)
        if not part.is_empty():
            name = f"experiments-loss-{column}"
            yield Picture(
                name, f"{column}: does loss make positive feedback overtake?", partial(_draw_loss, part)
            )
    for figure, label, numbers in (
        ("avoid_per_sample_s", "avoidance per sample (s)", "avoidance_s_per_sample_none"),
        ("distance_m", "distance between samples (m)", "distance_between_samples_m_none"),
    ):
        draw = partial(_draw_walk, tables["cells"], figure, label, numbers)
        title = label.rpartition(" (")[0].capitalize()
        yield Picture(f"experiments-{figure.rpartition('_')[0].replace('_', '-')}", title, draw)


def _published(values: list[float], name: str = "published") -> pl.DataFrame:
    numbers = [float(value) for value in values]
    there = {"x": [float(n) for n in sizes()], "estimate": numbers, "low": numbers, "high": numbers}
    return (
        pl.DataFrame(there).with_columns(series=pl.lit(name)).select("x", "series", "estimate", "low", "high")
    )


def _draw_bands(part: pl.DataFrame) -> Drawn:
    ours = part.select(
        pl.col("robots").cast(pl.Float64).alias("x"), pl.col("column").alias("series"),
        pl.col("as the text has it").alias("estimate"), pl.col("least").alias("low"), pl.col("most").alias("high"),
    )  # fmt: skip
    together = pl.concat([_published(part["published"].to_list()[: len(sizes())]), ours])
    interval = f"band over thresholds and gates (mark: theta_E {TEXTS}, the robots' gate)"
    return draw_error_bars(together, x_label="robots", label="decision time (s)", interval=interval)


def _draw_loss(part: pl.DataFrame) -> Drawn:
    """Published, ours with loss, and without where that makes most of a difference."""
    settings = [("with", threshold, gate) for threshold in THRESHOLDS for gate in GATES]
    frames = [_published(_published_gaps())]
    for name, threshold, gate in [*settings, ("without", THRESHOLDS[0], GATES[0])]:
        mine = part.filter((pl.col("gate") == gate) & (pl.col("theta_E") == threshold))
        error = Z * pl.col(f"{name}_error_s")
        frames.append(
            mine.select(
                pl.col("robots").cast(pl.Float64).alias("x"),
                pl.lit(f"{name} loss, {threshold}, {gate}").alias("series"),
                pl.col(f"{name}_s").alias("estimate"),
                (pl.col(f"{name}_s") - error).alias("low"),
                (pl.col(f"{name}_s") + error).alias("high"),
            )
        )
    label = "time of positive less none (s)"
    return draw_error_bars(pl.concat(frames), x_label="robots", label=label)


def _draw_walk(table: pl.DataFrame, figure: str, label: str, numbers: str) -> Drawn:
    chosen = (pl.col("packets") == LOSSES[0]) & (pl.col("strategy") == "none")
    chosen &= (pl.col("theta_E") == TEXTS) & (pl.col("gate") == GATES[1])
    ours = table.filter(chosen).select(
        pl.col("robots").cast(pl.Float64).alias("x"), pl.col("column").alias("series"),
        pl.col(figure).alias("estimate"), pl.col(f"{figure}_low").alias("low"), pl.col(f"{figure}_high").alias("high"),
    )  # fmt: skip
    together = pl.concat([_published(published(f"experiments.{numbers}")), ours])
    return draw_error_bars(together, x_label="robots", label=label)


_BANDS: Final = {
    "column": Column("column"), "strategy": Column("strategy"), "robots": Column("robots"),
    "published": Column("published mean", "s"), "least": Column("ours, least", "s"),
    "most": Column("ours, most", "s"), "as the text has it": Column("ours at 1.55, own gate", "s"),
    "inside": Column("published inside"),
}  # fmt: skip
_LOSS: Final = {
    "column": Column("column"), "theta_E": Column("theta_E"), "gate": Column("gate"), "robots": Column("robots"),
    "packets lost": Column("packets lost", percent=True), "published_s": Column("published", "s"),
    "with_s": Column("with loss", "s"), "without_s": Column("without", "s"),
    "change_s": Column("what loss changes", "s"), "change_low": Column("from", "s"),
    "change_high": Column("to", "s"),
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
        "counted; ours are therefore bands over 1.33 and 1.55, and over O_c counting all observations or a "
        "robot's own.",
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
        Shown("bands", "Published means and the band of ours.", _BANDS),
        Shown("loss", "Decision time of positive less no feedback; 95 % intervals over runs, paired.", _LOSS),
        Shown(
            "cells",
            "All cells, with 95 % intervals over runs.",
            {key: Column(key) for key in KEYS} | PROPER_FORM | WALK_FORM,
        ),
    ),
)
