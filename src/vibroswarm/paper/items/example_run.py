"""Item 9: an example run of seven robots, and how close the estimates of such swarms come to the fill ratio."""

from __future__ import annotations

from functools import partial

import polars as pl

from vibroswarm.paper.item import Drawn, Made, Work
from vibroswarm.plots import draw_run
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import columns_of, mean_interval


def compute(work: Work, made: Made) -> None:
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
