"""The report of an inspection by place: where it vibrates, how sure that is, and what would have been missed."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count, size
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.samples import Samples
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.run import maps_figure
from vibroswarm.report.damage import damage_answer, damage_parts
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.simulation import versions
from vibroswarm.statistics.map_figures import SURE, calibration

ROWS: Final = 12
"""Rows of the table of scores over time."""
NARROW: Final = 3
"""Tiles should be so many times as wide as places are uncertain."""
WIDEST_MAP: Final = 16
"""Most columns of tiles of a map in a terminal."""


@report.register
def of_inspection(found: Inspection) -> Report:
    """Return what an inspection says; if the samples contradict the law, that alone."""
    samples, assessment = found.samples, found.assessment
    is_refused = assessment is not None and assessment.verdict == "refused"
    answer = () if assessment is None else damage_answer(assessment)
    return Report(
        title=f"Inspection of {samples.source}",
        answer=(*answer, *(() if is_refused else _map_answer(found))),
        parts={
            **({} if assessment is None else dict(damage_parts(assessment, samples))),
            **({} if is_refused else dict(_map_parts(found))),
        },
        setting=f"{_setting(samples)}; places {samples.places.value}; law {samples.law.origin}",
        warnings=tuple(_warnings(found)),
        made_by={"law": samples.law.origin, "samples": samples.hash, **versions()},
    )


def _map_answer(found: Inspection) -> Iterator[str]:
    if found.pooled is None:
        return
    p, what = found.pooled[-1], "vibrate" if found.samples.kinds is None else "are not of kind 0"
    sure, still = int((p > SURE).sum()), int((p < 1.0 - SURE).sum())
    truth = ""
    if found.samples.truth_known:
        last = found.scores.row(-1, named=True)
        truth = f" (in truth {last['right']:.0%} right, {last['surely_wrong']:.0f} surely wrong)"
    yield (
        f"{sure} of {count(p.size, 'tile')} {what}, {still} do not, each with more than {SURE:.0%}{truth}; "
        f"{p.size - sure - still} are open."
    )


def _setting(samples: Samples) -> str:
    robots = count(len(samples.robots), "robot")
    return f"{count(samples.frame.height, 'sample')} of {robots} on {size(*samples.size_m)}"


def _warnings(found: Inspection) -> Iterator[str]:
    samples, assessment = found.samples, found.assessment
    refusals = samples.doubts if assessment is None else assessment.refusals
    yield from (f"Not certified: {refusal.value}" for refusal in refusals)
    if assessment is None:
        yield "The law is not checked; add --damage"
    spread_m = np.hypot(samples.column("spread_x_m"), samples.column("spread_y_m")) / np.sqrt(2.0)
    if samples.floor is not None and min(samples.floor.geometry[2:4]) < NARROW * float(spread_m.mean()):
        yield f"Tiles are less than {NARROW} times as wide as places are uncertain: the map is too sure of them"


def _map_parts(found: Inspection) -> Iterator[tuple[str, Table | Figure]]:
    if found.pooled is None or found.by_kind is None:
        return
    maps, grid = found.maps, found.samples.grid
    rows, columns = grid.tiles.shape
    percent = (100.0 * found.pooled[-1]).round().astype(np.int64).reshape(rows, columns)
    tiles = pl.DataFrame(percent, [str(column) for column in range(columns)]).with_row_index("row")
    yield "map", Table(tiles, "Probability of each tile, %, from all samples", folded=columns > WIDEST_MAP)
    yield (
        "maps",
        Figure(partial(_draw_maps, maps, grid.geometry[2:4]), "Map of all samples, and of each robot"),
    )
    if found.samples.kinds is not None:
        kinds = pl.DataFrame(found.by_kind[-1], [f"kind {kind}" for kind in range(found.by_kind.shape[2])])
        likely = pl.Series("likely", found.by_kind[-1].argmax(axis=1))
        truth = pl.Series("true", found.samples.kinds.at(float(found.times_s[-1])).tiles.ravel())
        yield "kinds", Table(kinds.with_row_index("tile").with_columns(likely, truth), "Kind of each tile")
    yield "tiles", Table(maps.drop("run"), "Tile by tile", folded=True)
    if found.vibrates is not None:
        chosen = np.unique(np.linspace(0, len(found.times_s) - 1, ROWS).round().astype(int))
        yield "scores", Table(found.scores[chosen], "Against the true floor, over time")
        bins = calibration(found.pooled.ravel(), found.vibrates.ravel().astype(np.float64))
        yield "calibration", Table(bins, "Tiles by their probability, over time", folded=True)


def _draw_maps(maps: pl.DataFrame, tile_m: tuple[float, float]) -> Picture:
    figure = maps_figure(maps, tile_m=tile_m, label="probability")
    return Picture(figure, maps, "Probability of each tile: all robots, each by itself.")
