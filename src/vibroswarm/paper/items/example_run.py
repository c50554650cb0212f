"""Item 9: an example run of seven robots, and how close the estimates of such swarms come to the fill ratio."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Final

import polars as pl

from vibroswarm.core.numbers import whole
from vibroswarm.paper.cells import options_of
from vibroswarm.paper.claim_values import frame, mean
from vibroswarm.paper.columns import STRATEGIES, published
from vibroswarm.paper.item import CLAIMS, Cells, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import Picture as Drawn
from vibroswarm.plots import draw_run
from vibroswarm.result import Result
from vibroswarm.show.document import Column
from vibroswarm.simulation import simulate

ROBOTS: Final[int] = published("simulation.example_run.robots")
"""Robots of the example run, and of the swarms of all cells."""
FILL: Final[float] = published("simulation.example_run.fill_ratio")
"""Fill ratio of the floors."""
TILE: Final = 1 / 25
"""Share of the floor that one tile covers."""


def cells(settings: Settings) -> Cells:
    """Return the cells by (column, strategy), with seven robots on random floors of fill ratio 0.48."""
    return {
        (column, strategy): settings.cell(
            column, {"floor.source": f"random:{FILL}", "swarm.robots": ROBOTS, "strategy.name": strategy}
        )
        for column in settings.columns
        for strategy in STRATEGIES
    }


@cache
def example(settings: Settings) -> Result:
    """Return run 0 of seven robots in the first column (preset), with the preset's strategy, and with its paths.

    It is cached, because the tables and the picture both need it.
    """
    values = {"floor.source": f"random:{FILL}", "swarm.robots": ROBOTS}
    return simulate(settings.scenario(settings.columns[0], values), settings.seed, 1, poses=True)


def compute(work: Work) -> Tables:
    """Return the samples and paths of the example run, estimates over many runs, and the measured values of the claim.

    A swarm's estimate is the mean of its robots' estimates of the fill ratio at the end of a run. A value of the claim
    is the mean absolute error of the estimate over runs, minus the share of one tile.
    """
    result = example(work.settings)
    assert result.poses is not None  # ``example`` requests them
    # ``motion`` and ``observations`` have the same samples in the same order.
    samples = result.motion.select("robot", "sample", "time_s", "x_m", "y_m").hstack(
        result.observations.select("tile", "energy", "observation")
    )
    rows, measured = [], []
    for column in work.settings.columns:
        for strategy in STRATEGIES:
            cell = work.cells[column, strategy]
            estimate = work.values((column, strategy), "estimate")
            error = abs(estimate - FILL)
            measured.append(mean("error-of-estimate-less-tile", column, strategy, error, less=TILE))
            figures = (float(estimate.mean()), float(error.mean()), float(estimate.std()))  # over runs
            command = cell.command(work.results.runs, work.results.seed)
            rows.append((column, strategy, error.size, *figures, command))
    names = ["column", "strategy", "runs", "estimate", "error", "spread", "command"]
    return {
        "samples": samples,
        "paths": result.poses,
        "estimates": pl.DataFrame(rows, schema=names, orient="row"),
        CLAIMS: frame(measured),
    }


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield the picture of the example run's paths and samples."""
    yield picture("example-run", "Paths and samples of seven robots", _draw, tables, settings)


def _draw(tables: Tables, settings: Settings, *, style: str) -> Drawn:
    """Draw the example run, which ``example`` simulates: saved tables do not hold the whole result."""
    result = example(settings)
    options = " ".join(options_of(settings.columns[0], result.scenario))
    caption = (
        f"Seven robots, run 0 of seed {settings.seed}: paths, {whole(tables['samples'].height)} samples, and the "
        f"tiles that vibrate. "
        f"Alone: `vibroswarm run {options} --seed {settings.seed}`"
    )
    return replace(draw_run(result, caption=caption, style=style), numbers=tables["samples"])


ITEM: Final = Item(
    number=9,
    name="example-run",
    title="An example run of seven robots",
    about=(
        "The paths of seven robots and where they sampled, as the paper shows for a real experiment; and, over many "
        "such runs, how close the swarm's mean estimate comes to the fill ratio.",
    ),
    cells=cells,
    compute=compute,
    pictures=pictures,
    shown=(
        TableView(
            "estimates",
            "The mean over robots of alpha / (alpha + beta) at the end of a run; the fill ratio is 0.48, a "
            "tile is 0.04.",
            {
                "column": Column("column"), "strategy": Column("strategy"), "runs": Column("runs"),
                "estimate": Column("mean estimate"), "error": Column("mean error (absolute)"),
                "spread": Column("standard deviation over runs"),
            },
        ),
    ),
)  # fmt: skip
