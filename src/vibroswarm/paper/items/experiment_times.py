"""The cells of the real experiments, the settings that fit the published times best, and the effect of packet loss.

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

from vibroswarm.paper.columns import STRATEGIES, published, sizes
from vibroswarm.paper.item import Cells, Settings, Work
from vibroswarm.paper.real_data import real_floor

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
