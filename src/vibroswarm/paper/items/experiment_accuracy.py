"""Item 16: accuracy, packet loss by size and sampling distance of the real experiments, with their pool of 16 robots.

The accuracy is the mean belief in the truth; the distance is the mean distance between successive samples of a robot.
Each real experiment used n robots of a pool of 16. With up to 8 robots, all 16 took part in turn; with 9 or 10 robots
only a subset took part. So the distance with 9 or 10 robots may differ from the distance with 8 because other robots,
with other speeds, took part.

| name | symbol | equation |
|---|---|---|
| error of a published mean over 15 experiments | - | s / sqrt(15), because the error is not published |
| sd of the accuracy | s | our sd over runs, the largest with any threshold theta_E and any gate (what O_c counts) |
| variance over runs of the distance, if a robot keeps its speed | V | speeds drawn once per robot |
| variance over runs of the distance, if not | V' | speeds drawn at every sample, as in the other items |
| sd of the distance over subsets of n of 16 robots | S | sqrt((V - V') (16 - n) / 16) |
| rise, with n robots | r | distance with n robots - distance with 8 robots |
| unexplained rise, in standard deviations | z | (r published - r ours) / S |

A column is a preset of the reproduction. The measured values of the claims are rows of ``claims.MEASURED``;
``Work.change`` makes one from the difference of two cells (first - second), paired by run. A comparison with published
means has as many degrees of freedom as the 15 experiments give, because their scatter dominates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.numbers import number
from vibroswarm.paper.cells import Cell
from vibroswarm.paper.claim_values import Row, exact, frame, row
from vibroswarm.paper.columns import STRATEGIES, published, sizes
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
from vibroswarm.paper.items import experiments
from vibroswarm.paper.items.experiments import (
    AS_TEXT,
    FITTED,
    LOSSES,
    REAL_EXPERIMENTS,
    beside_published,
    columns_of,
    points,
    published_by_size,
    published_points,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.show.document import Column

POOL: Final[int] = published("experiments.pool_of_robots")
"""Robots from which the robots of each real experiment were taken."""
WHOLE: Final[int] = published("experiments.whole_pool_takes_part_up_to")
"""With up to this number of robots, all robots of the pool took part, in turn."""
SUBSET_SIZES: Final = [robots for robots in sizes() if robots > WHOLE]
"""Swarm sizes with which only a subset of the pool took part."""
POOL_RUNS: Final = 300
"""Runs with speeds drawn once per robot."""
POOL_COLUMN: Final = "paper"
"""Preset in which the pool is simulated; `calibrated` has the speeds of five real robots, which are no pool of 16."""
PUBLISHED: Final = "experiments.belief_in_truth"
"""Published accuracy, by strategy."""
BELIEF, DISTANCE = "belief_in_truth", "distance_m"
"""Figures of a run: mean belief in the truth, and mean distance between successive samples of a robot (m)."""
GROUPS: Final = 20
"""Groups of runs for the jackknife."""


def cells(settings: Settings) -> Cells:
    """Return the cells of ``experiments`` with message loss, and the cells of the pool.

    The cells of the pool have the key ("pool", robots), with the sizes of ``SUBSET_SIZES``; in them a robot's speed is
    drawn once. There are none if ``POOL_COLUMN`` was not requested.
    """
    of_times = experiments.cells(settings)
    with_loss = LOSSES[0]
    # All keys are tuples; ``isinstance`` is for type checkers.
    cells_of: Cells = {
        key: cell for key, cell in of_times.items() if isinstance(key, tuple) and key[1] == with_loss
    }
    if POOL_COLUMN in settings.columns:
        for robots in SUBSET_SIZES:
            cell: Cell = of_times[_key(POOL_COLUMN, robots)]
            drawn_once = cell.scenario.with_values({"robot.speed_redraw": "robot"})
            cells_of["pool", robots] = replace(cell, scenario=drawn_once, runs=POOL_RUNS)
    return cells_of


def _key(column: str, robots: int, strategy: str = "none") -> tuple[str | float, ...]:
    """Return the key of a cell with message loss and as the text has it, in the order of ``experiments.KEYS``."""
    return column, LOSSES[0], *AS_TEXT, robots, strategy


def compute(work: Work) -> Tables:
    """Return tables of accuracy, loss and distances next to the published values, and the claims' measured values.

    The distances, and the values of the claims about loss and about the pool, exist only if ``POOL_COLUMN`` was
    requested.
    """
    columns = columns_of(work.settings)
    tables: Tables = {"accuracy": _accuracy(work, columns), "loss": _loss()}
    measured = [row for column in columns for row in _measured(work, column)]
    if POOL_COLUMN in columns:
        for robots, off in tables["loss"].select("robots", "off the line").iter_rows():
            measured.append(exact("plotted-loss-less-line", POOL_COLUMN, f"{robots} robots", off))
        unexplained = {robots: _to_explain(work, robots) for robots in SUBSET_SIZES}
        measured += list(unexplained.values())
        tables["distance"] = _distances(work, unexplained)
    return tables | {CLAIMS: frame(measured)}


def _accuracy(work: Work, columns: Sequence[str]) -> pl.DataFrame:
    """Return our accuracy next to the published one, one row for each column, setting, strategy and swarm size.

    A setting is a threshold and a gate: those of the paper's text, and ``FITTED``. ``ours_error`` is the standard error
    of our accuracy. ``less`` is our accuracy minus the published accuracy, ``error`` its standard error, which includes
    that of the published accuracy, and "in errors" their ratio.
    """
    rows = [
        row
        for column in columns
        for setting in (AS_TEXT, FITTED)
        for row in beside_published(work, [column], setting, PUBLISHED, BELIEF, widest=True)
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def _loss() -> pl.DataFrame:
    """Return the published shares of lost packets by swarm size, their least-squares line, and the residuals.

    Columns: robots, plotted, line, and "off the line", which is plotted - line.
    """
    robots = np.array(sizes(), dtype=np.float64)
    plotted = np.array(published("experiments.packet_loss_percent")) / 100
    line = np.polyval(np.polyfit(robots, plotted, 1), robots)
    return pl.DataFrame({"robots": sizes(), "plotted": plotted, "line": line, "off the line": plotted - line})


def _measured(work: Work, column: str) -> Iterator[Row]:
    """Yield the measured values of the claims about accuracy and distance in a column.

    They are, for each strategy: our accuracy minus the published accuracy with each swarm size, and the change of our
    accuracy from the smallest to the largest swarm; and the rise of our distance with each size of a subset.
    """
    for found in beside_published(work, [column], AS_TEXT, PUBLISHED, BELIEF, widest=True):
        label = f"{found['robots']} robots, {found['strategy']}"
        # n is the number of experiments, not of our runs: the scatter of the experiments dominates the error.
        yield row("belief-less-robots", column, label, found["less"], found["error"], REAL_EXPERIMENTS)
    for strategy in STRATEGIES:
        first, second = (_key(column, n, strategy) for n in (max(sizes()), min(sizes())))
        # ``check=False``: with a check, presets that cannot answer the paper's question would have no estimate here,
        # while ``robots-belief`` above has one for all presets.
        yield work.change(
            "belief-on-real-floor-many-less-few", column, strategy, BELIEF, first, second, check=False
        )
    for robots in SUBSET_SIZES:
        first, second = (_key(column, n) for n in (robots, WHOLE))
        label = f"{robots} less {WHOLE} robots"
        yield work.change("distance-less-eight-robots", column, label, DISTANCE, first, second)


def _to_explain(work: Work, robots: int) -> Row:
    """Return the row of the unexplained rise z, with a standard error for our runs and the published means.

    The error of our runs is a jackknife: z is computed again without each of ``GROUPS`` groups of runs in turn. The
    estimate is NaN, so that the claim is inconclusive, if distances do not vary more over runs with speeds drawn once
    per robot than with speeds drawn at every sample: S is undefined then.

    Args:
        robots: swarm size, one of ``SUBSET_SIZES``.
    """
    drawn_once = work.values(("pool", robots), DISTANCE)
    redrawn, with_whole = (work.values(_key(POOL_COLUMN, n), DISTANCE) for n in (robots, WHOLE))
    printed = published_by_size("experiments.distance_between_samples_m_none")
    published_rise = printed[robots] - printed[WHOLE]
    estimate = _z(drawn_once, redrawn, with_whole, robots, published_rise)
    left_out = np.array(
        [
            _z(
                drawn_once=_without(drawn_once, group),
                redrawn=_without(redrawn, group),
                with_whole=_without(with_whole, group),
                robots=robots,
                published_rise=published_rise,
            )
            for group in range(min(GROUPS, drawn_once.size))  # with fewer runs than groups, a run is a group
        ]
    )
    own_error = np.sqrt((left_out.size - 1) * np.mean((left_out - left_out.mean()) ** 2))
    # The published rise is the difference of two means over 15 experiments, hence the 2. Their errors are not
    # published: the variance of one experiment is taken to be V' at both swarm sizes. V would also include the choice
    # of robots, which S stands for.
    rise_error = np.sqrt(2 * float(redrawn.var(ddof=1)) / REAL_EXPERIMENTS)
    published_error = rise_error / _subset_sd(drawn_once, redrawn, robots)  # z is a rise divided by S
    error = float(np.hypot(own_error, published_error))
    return row(
        "published-rise-less-ours",
        POOL_COLUMN,
        f"{robots} of {POOL} robots",
        estimate,
        error,
        REAL_EXPERIMENTS,
    )


def _without(values: NDArray[np.float64], group: int) -> NDArray[np.float64]:
    """Return the values of all runs outside a group: the group has every ``GROUPS``-th run from run ``group`` on."""
    return np.delete(values, np.s_[group::GROUPS])


def _z(
    drawn_once: NDArray[np.float64],
    redrawn: NDArray[np.float64],
    with_whole: NDArray[np.float64],
    robots: int,
    published_rise: float,
) -> float:
    """Return the unexplained rise z: the published rise minus our rise, in standard deviations S over subsets.

    Our rise is that with speeds drawn at every sample: with speeds drawn once, swarms of ``WHOLE`` robots are not
    simulated.

    Args:
        drawn_once, redrawn: mean distance of each run with ``robots`` robots, whose speeds are drawn once or at every
            sample, m, (runs,). with_whole: mean distance of each run with ``WHOLE`` robots, m, (runs,).
    """
    own_rise = float(redrawn.mean() - with_whole.mean())
    return (published_rise - own_rise) / _subset_sd(drawn_once, redrawn, robots)  # z


def _subset_sd(drawn_once: NDArray[np.float64], redrawn: NDArray[np.float64], robots: int) -> float:
    """Return the standard deviation S of the mean distance over subsets of the pool, m.

    V - V' is the variance that robots of different speeds add if each run has other robots. If n robots are chosen of a
    fixed pool of 16, this variance is (16 - n) / 16 times as large (finite population correction).

    The result is NaN if the distance does not vary more with speeds drawn once per robot than with speeds drawn at
    every sample.

    Args:
        drawn_once, redrawn: mean distance of each run with speeds drawn once per robot, and with speeds drawn at every
            sample, m, (runs,). robots: swarm size n.
    """
    variance = float(drawn_once.var(ddof=1) - redrawn.var(ddof=1)) * (POOL - robots) / POOL
    return variance**0.5 if variance > 0 else float("nan")  # S


def _distances(work: Work, unexplained: dict[int, Row]) -> pl.DataFrame:
    """Return the distances between samples, published and ours, one row per swarm size.

    Sizes with which only a subset of the pool took part also have S ("subset_sd_m") and z ("to explain"). Both are null
    for the other sizes.

    Args:
        unexplained: rows of ``_to_explain`` by swarm size.
    """
    rows = []
    for robots, published_m in published_by_size("experiments.distance_between_samples_m_none").items():
        redrawn = work.values(_key(POOL_COLUMN, robots), DISTANCE)
        size_row: dict[str, Any] = {
            "subset_sd_m": None,
            "to explain": None,
            "robots": robots,
            "published_m": published_m,
            "ours_m": float(redrawn.mean()),
        }
        if robots in unexplained:
            size_row["subset_sd_m"] = _subset_sd(work.values(("pool", robots), DISTANCE), redrawn, robots)
            size_row["to explain"] = unexplained[robots]["estimate"]
        rows.append(size_row)
    return pl.DataFrame(rows, infer_schema_length=None)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield one picture per strategy: the published accuracy over the swarm size, and ours with 95 % intervals."""
    for strategy in STRATEGIES:
        part = tables["accuracy"].filter(pl.col("strategy") == strategy)
        if not part.is_empty():
            mean, half = pl.col("ours"), 1.96 * pl.col("ours_error")
            series = pl.format("{}, θ_E {}, gate {}", "column", "theta_E", "gate")
            published_line = published_points(published_by_size(f"{PUBLISHED}.{strategy}"))
            both = pl.concat([published_line, points(part, series, "ours", mean - half, mean + half)])
            yield picture(
                f"experiments-accuracy-{strategy}", f"Accuracy, {strategy}", draw_error_bars, both,
                x_label="robots", label="belief in the truth",
            )  # fmt: skip


ITEM: Final = Item(
    number=16,
    name="experiments-beside",
    title="Real experiments: accuracy, packet loss, distances",
    about=(
        "The published accuracy (mean belief in the truth) and ours, with the text's threshold 1.55 and the robots' "
        f"gate, and with {number(FITTED[0], 2)} and the gate on the total, which fits the published times best. "
        f"Published "
        f"means are over {REAL_EXPERIMENTS} experiments whose variation is unknown, so that of our runs is used, at "
        "the threshold and gate where it is largest: where nearly all of ours are right they hardly vary, but "
        "the published ones, at some 0.7, must have varied.",
        "Packet loss by size compares the paper's own numbers with a straight line: nothing is simulated.",
        f"Real robots sampled farther apart with 9 and 10 robots than with {WHOLE}. The paper's reason: up to {WHOLE} "
        f"robots all {POOL} of the pool ran in batches, above it only some. Which ones ran is unknown, so it cannot be "
        "simulated; the rise is compared with the effect of choosing a subset on the mean distance, with "
        "speeds drawn once a robot as in the text. Below 2 standard deviations the choice can explain it.",
    ),
    cells=cells,
    compute=compute,
    skipped=needs_column(*experiments.COLUMNS),
    pictures=pictures,
    shown=(
        TableView(
            "accuracy",
            "Published accuracy and ours; the error of the difference includes that of the published mean.",
            {
                "column": Column("column"), "theta_E": Column("theta_E"), "gate": Column("gate"),
                "strategy": Column("strategy"), "robots": Column("robots"), "published": Column("published"),
                "ours": Column("ours"), "less": Column("ours - published"), "error": Column("standard error"),
                "in errors": Column("in standard errors"),
            },
        ),
        TableView(
            "loss",
            "Packet loss as plotted, and the least-squares line.",
            {
                "robots": Column("robots"), "plotted": Column("plotted", share=True),
                "line": Column("line", share=True),
                "off the line": Column("off the line", "points", share=True, sign=True),
            },
        ),
        TableView(
            "distance",
            f"Distance between samples, and the effect of choosing a subset of {POOL} robots.",
            {
                "robots": Column("robots"), "published_m": Column("published", "m"), "ours_m": Column("ours", "m"),
                "subset_sd_m": Column("sd over subsets", "m"),
                "to explain": Column("unexplained rise, in these"),
            },
        ),
    ),
)  # fmt: skip
