"""Item 11: density of samples in the corners, spread of times with each strategy, and swarms on a single floor.

The density is the number of samples on an area, divided by the number if samples were spread uniformly. A column is a
preset of the reproduction. The measured values of the claims are rows of ``claims.MEASURED``; ``Work.change`` makes a
row from the difference of two cells (first - second), paired by run.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.paper.cell_tables import two_forms
from vibroswarm.paper.cells import on_threads
from vibroswarm.paper.claim_values import Row, frame, log_spread, mean
from vibroswarm.paper.columns import EMPIRICAL, REAL_FLOOR, STRATEGIES, fills, published, real_floor
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import draw_density
from vibroswarm.scenario.scenario import Scenario
from vibroswarm.show.document import Column
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import mean_interval

MOST_RUNS: Final = 200
"""Most runs whose samples are analysed."""
BINS: Final = 20
"""Bins of the pictures of density, on each axis."""
TILES: Final = 25
"""Tiles of the floor (5 x 5)."""
TIMERS: Final = ("as it ran", "always", "frozen_in_avoidance")
"""Modes of the sample timer: that of the column's preset; always on; stopped while a robot avoids."""


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, floor, strategy); the floors are random floors, and the floor of the recordings."""
    floors = {f"random:{fill}": {"floor.source": f"random:{fill}"} for fill in fills()}
    floors[REAL_FLOOR] = real_floor()
    return {
        (column, floor, strategy): settings.cell(column, {**values, "strategy.name": strategy})
        for column in settings.columns
        for strategy in STRATEGIES
        for floor, values in floors.items()
    }


def compute(work: Work) -> Tables:
    """Return corner densities, counts of samples on a grid, the table of cells, and the claims' measured values.

    Each column is simulated here with P0 and each timer, because the results of cells hold no positions.
    """
    columns = work.settings.columns
    runs = min(work.settings.runs, MOST_RUNS)
    keys = [(column, timer) for column in columns for timer in TIMERS]
    scenarios = {
        (column, timer): work.settings.scenario(
            column, {} if timer == TIMERS[0] else {"sample.timer": timer}, parameter_set=EMPIRICAL
        )
        for column, timer in keys
    }
    # Each different scenario once: the timer "as it ran", that of the preset, may be one of the other two timers.
    distinct = list(dict.fromkeys(scenarios.values()))
    placed_of = partial(_placed, work.settings.seed, runs)
    results = dict(zip(distinct, on_threads(placed_of, distinct, work.settings.workers), strict=True))
    # By column and timer: run, x and y of each sample.
    placed = {key: results[scenario] for key, scenario in scenarios.items()}
    corners = {key: _corners(x, y, run, runs) for key, (run, x, y) in placed.items()}
    rows = []
    for (column, timer), values in corners.items():
        density = mean_interval(values)
        rows.append(
            {
                "column": column, "timer": timer, "density": density.estimate, "low": density.low,
                "high": density.high, "runs": density.n,
            }
        )  # fmt: skip
    counts = pl.concat([_counts(column, timer, x, y) for (column, timer), (_, x, y) in placed.items()])
    measured = [row for column in columns for row in _measured(work, column, corners)]
    # The keys of the cells are (column, floor, strategy), see ``cells``. The table shows only the floors of which times
    # are compared; the cells on the other floors serve only the claims about the spread. All keys are tuples;
    # ``isinstance`` is for the type checker, which knows only that keys are hashable.
    floors = (f"random:{published('parameters.pso.fill_ratio')}", REAL_FLOOR)
    shown = [key for key in work.cells if isinstance(key, tuple) and key[1] in floors]
    return {
        "corners": pl.DataFrame(rows),
        "places": counts,
        "cells": work.rows(("column", "floor", "strategy"), shown),
        CLAIMS: frame(measured),
    }


def _placed(seed: int, runs: int, scenario: Scenario) -> tuple[Any, Any, Any]:
    """Simulate a scenario; return run, x (m) and y (m) of each sample, (samples,) each."""
    samples = simulate(scenario, seed, runs, energies=False).motion
    return samples["run"].to_numpy(), samples["x_m"].to_numpy(), samples["y_m"].to_numpy()


def _corners(x: Any, y: Any, run: Any, runs: int) -> Any:
    """Return the density of each run's samples on the four corner tiles, relative to a uniform density, (runs,).

    Args:
        x, y, run: position (m) in an arena of 1 m by 1 m, and run, of each sample, (samples,). Runs are numbered from
            0.
        runs: number of runs. The density of a run without samples is nan.
    """
    rim_x, rim_y = ((place < 0.2) | (place >= 0.8) for place in (x, y))  # on the outermost of 5 tiles
    corner = rim_x & rim_y
    # Of each run: samples in the corners / all samples.
    in_corners, samples = np.bincount(run, corner, minlength=runs), np.bincount(run, minlength=runs)
    share = np.divide(in_corners, samples, out=np.full(runs, np.nan), where=samples > 0)
    return share * TILES / 4  # a uniform density has the share 4 / TILES


def _counts(column: str, timer: str, x: Any, y: Any) -> pl.DataFrame:
    """Count samples on a grid over the arena of 1 m by 1 m; return one row per bin, with its centre.

    Args:
        column, timer: values of the first two columns of the table. x, y: positions of the samples, m, (samples,).
    """
    counts, _, _ = np.histogram2d(x, y, BINS, ((0.0, 1.0), (0.0, 1.0)))
    centre = (np.arange(BINS) + 0.5) / BINS
    across, up = np.meshgrid(centre, centre, indexing="ij")
    return pl.DataFrame(
        {"x_m": across.ravel(), "y_m": up.ravel(), "count": counts.ravel().astype(np.int64)}
    ).select(pl.lit(column).alias("column"), pl.lit(timer).alias("timer"), "x_m", "y_m", "count")


def _measured(work: Work, column: str, corners: dict[tuple[str, str], Any]) -> Iterator[Row]:
    """Yield the measured values of the claims about corners, floors and strategies in a column (preset).

    They are:

    - The corner density minus 1, the uniform density.
    - The corner density minus that with the timer frozen in avoidance, run by run.
    - The logarithm of the ratio of standard deviations over runs, with feedback to without; of the decision time and of
      the belief, at each fill ratio.
    - The time on the floor of the recordings minus the time on random floors of the same fill ratio.

    Args:
        corners: densities of ``_corners``, by column and timer.
    """
    time = "decision_time_s"
    ran, frozen = corners[column, TIMERS[0]], corners[column, TIMERS[2]]
    yield mean("corner-density-less-even", column, "P0", ran, less=1.0)
    yield mean("corner-density-less-frozen-timer", column, "P0", ran - frozen)
    for fill in fills():
        # One strategy stands for all: whether decisions can answer the question does not depend on it.
        cannot = work.cannot((column, f"random:{fill}", "none"))
        for value_name, name in (("log-spread-of-time", time), ("log-spread-of-belief", "belief_in_truth")):
            none = work.values((column, f"random:{fill}", "none"), name)
            for strategy in ("positive", "soft"):
                values = work.values((column, f"random:{fill}", strategy), name)
                words = f"{strategy} to none, fill ratio {fill}"
                yield log_spread(value_name, column, words, values, none, cannot=cannot)
    for strategy in STRATEGIES:
        pair = (column, REAL_FLOOR, strategy), (column, "random:0.48", strategy)
        yield work.change("time-on-one-floor-less-random", column, strategy, time, *pair)


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of the density of samples, with the timer as it ran and with the timer frozen in avoidance."""
    for column in settings.columns:
        for timer in (TIMERS[0], TIMERS[2]):
            chosen = (pl.col("column") == column) & (pl.col("timer") == timer)
            part = tables["places"].filter(chosen).select("x_m", "y_m", "count")
            name = f"side-claims-{column}-density-{timer.replace(' ', '-').replace('_', '-')}"
            title = f"{column}: density of samples, timer {timer.replace('_', ' ')}"
            # One scale for all pictures, so that they can be compared: it ends at twice the uniform density.
            yield picture(
                name, title, draw_density, part, bins=BINS, highest=2.0, folded=column != settings.columns[0]
            )


ITEM: Final = Item(
    number=11,
    name="side-claims",
    title="Claims in passing",
    about=(
        "Claims that the paper makes in passing: samples are denser in the corners because the sample "
        "timer counts avoidance; all strategies vary equally, in time and in accuracy; and real swarms differ from "
        "simulated ones because they ran on one floor. Density is relative to uniform sampling, for P0, with which "
        f"the recordings were made, over up to {MOST_RUNS} runs.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        TableView(
            "corners",
            "Density of samples in the corner tiles, 95 % intervals over runs.",
            {
                "column": Column("column"), "timer": Column("timer"),
                "density": Column("density", limits=("low", "high")), "runs": Column("runs"),
            },
        ),
        *two_forms(("column", "floor", "strategy")),
    ),
)  # fmt: skip
