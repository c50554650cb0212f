"""Items 9 and 11: an example run with its paths, and the density of samples in the corners, for P0, by sample timer."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.paper.claims import mean
from vibroswarm.paper.columns import EMPIRICAL, scenario_of
from vibroswarm.paper.item import Drawn, Made, Work
from vibroswarm.plots import draw_density, draw_run
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import columns_of, mean_interval


def example_run(work: Work, made: Made) -> None:
    """Simulate run 0 with its paths, and average the estimates of all runs."""
    rows = []
    for column in work.settings.columns:
        cells = work.cells["example-run", column]
        for place, cell in enumerate(cells.cells):
            estimate = cells.by_run(place, "estimate")
            row = {"column": column, **cell.texts, "runs": estimate.size}
            rows.append(row | columns_of("estimate", mean_interval(estimate)) | {"sd": estimate.std()})
    made.tables["estimates"] = pl.DataFrame(rows, infer_schema_length=None)
    scenario = work.cells["example-run", work.settings.columns[0]].cells[-1].scenario
    result = simulate(scenario, work.settings.seed, 1, poses=True)
    made.pictures["example-run"] = Drawn("Paths and samples of seven robots", partial(draw_run, result))


CORNER_RUNS: Final = 200
BINS: Final = 20
TIMERS: Final = {
    "as it ran": {},
    "always": {"sample.timer": "always"},
    "frozen": {"sample.timer": "frozen_in_avoidance"},
}


def corners(work: Work, made: Made) -> None:
    """Simulate where robots sample, with each timer."""
    runs, rows = min(work.settings.runs, CORNER_RUNS), []
    for place, column in enumerate(work.settings.columns):
        corners = {}
        for timer, values in TIMERS.items():
            scenario = scenario_of(column, values, parameter_set=EMPIRICAL)
            samples = simulate(scenario, work.settings.seed, runs, energies=False).motion
            corners[timer] = _corners(samples, runs)
            density = columns_of("density", mean_interval(corners[timer]))
            rows.append({"column": column, "timer": timer, **density, "runs": runs})
            if timer != "always":
                name = f"side-claims-{column}-density-{timer.replace(' ', '-')}"
                draw = partial(draw_density, _counts(samples), bins=BINS, highest=2.0)
                title = f"{column}: density of samples, timer {timer}"
                made.pictures[name] = Drawn(title, draw, folded=place > 0)
        ran, frozen = corners["as it ran"], corners["frozen"]
        made.values.append(mean("corners", column, "P0", ran, 1.0))
        made.values.append(mean("corners-timer", column, "P0", ran - frozen))
    made.tables["corners"] = pl.DataFrame(rows)


def _corners(samples: pl.DataFrame, runs: int) -> Any:
    """Return the density of each run's samples on the four corner tiles of 5 x 5, (runs,)."""
    rim = ((pl.col(axis) < 0.2) | (pl.col(axis) >= 0.8) for axis in ("x_m", "y_m"))
    corner = samples.select(pl.all_horizontal(*rim)).to_series().to_numpy()
    run = samples["run"].to_numpy()
    count, in_corners = np.bincount(run, minlength=runs), np.bincount(run, corner, minlength=runs)
    return np.divide(in_corners, count, out=np.full(runs, np.nan), where=count > 0) * 25 / 4


def _counts(samples: pl.DataFrame) -> pl.DataFrame:
    x, y = samples["x_m"].to_numpy(), samples["y_m"].to_numpy()
    counts, _, _ = np.histogram2d(x, y, BINS, ((0.0, 1.0), (0.0, 1.0)))
    across, up = np.meshgrid(*[(np.arange(BINS) + 0.5) / BINS] * 2, indexing="ij")
    columns = {"x_m": across.ravel(), "y_m": up.ravel(), "count": counts.ravel().astype(np.int64)}
    return pl.DataFrame(columns)
