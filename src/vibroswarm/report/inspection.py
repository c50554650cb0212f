"""The report of an inspection: where it vibrates, how sure that is, what would have been missed, and may one stop?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import count, p_value, size
from vibroswarm.inspection.assessment import Assessment, Refusal
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.samples import Samples
from vibroswarm.plots.heat import draw_certainty
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.run import maps_figure
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.simulation import versions
from vibroswarm.statistics.intervals import Interval
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


def damage_answer(found: Assessment) -> tuple[str, ...]:
    """Return the verdict, and the size that would have been found."""
    question = found.question
    weakest = min(question.contrasts)
    wanted = f"{in_cm(question.least_m)} cm or larger, contrast {weakest:g} or more"
    posterior = found.stopping.risk
    risk = f"risk {f'{posterior:.1%}' if posterior > 1e-3 else 'below 0.1%'}, tolerated {question.risk:.1%}"
    p = p_value(found.scan.p_value)
    verdicts = {
        "refused": f"NOT CERTIFIED: {Refusal.REFUSED.value}",
        "damage": f"DAMAGE: {count(len(found.scan.called_m), 'patch', 'patches')} (p = {p})",
        "clear": f"CLEAR of damage of {wanted}: {risk}",
        "open": f"OPEN: none is called (p = {p}), but damage of {wanted} is not excluded: {risk}",
    }
    verdict = f"{verdicts[found.verdict]}."
    pod = found.pods[weakest]
    if found.verdict == "refused" or not np.isfinite(pod.a90_95_m):
        return (verdict,)
    size = f"Squares of {in_cm(pod.a90_95_m)} cm, contrast {weakest:g}, are found in 90 % of inspections (a90/95)."
    return verdict, size


def damage_parts(found: Assessment, samples: Samples) -> Iterator[tuple[str, Table | Figure]]:
    """Yield the tables and the picture; without those of damage if the law is refused."""
    checks = Table(found.checks, "Does the law of the sensor hold?", "p (Holm) below .05 refuses it.")
    if found.verdict == "refused":
        yield "checks", checks
        return
    if found.scan.called_m:
        yield (
            "patches",
            Table(_patches(found), "Called patches", "Limits: 90 % region of place, size, contrast."),
        )
    places_m = np.stack([samples.column("x_m"), samples.column("y_m")], axis=1)
    draw = partial(draw_certainty, found.scan.raster, samples.size_m, places_m, marked_m=found.scan.called_m)
    yield "damage", Figure(draw, "Damage")
    rows = [
        (contrast, pod.a50_m, pod.a90_m, pod.a90_95_m, pod.false_calls)
        for contrast, pod in found.pods.items()
    ]
    pods = pl.DataFrame(rows, ["contrast", "a50_m", "a90_m", "a90_95_m", "false_calls_share"], orient="row")
    sizes = {"a50_m": "a50", "a90_m": "a90", "a90_95_m": "a90/95"}
    caption = "Sides of squares that are found in 50 and 90 % of inspections; a90/95: upper limit."
    yield "pod", Table(pods.fill_nan(None), "What would have been missed?", caption, sizes)
    yield "risk", Table(_risk(found), "May one stop?", "Shares of surfaces drawn at the same places.")
    yield "checks", checks


def _patches(found: Assessment) -> pl.DataFrame:
    rows = []
    for box, region in zip(found.scan.called_m, found.scan.regions, strict=True):
        middle = (*box.centre_m, max(box.width_m, box.height_m), sum(region.contrast) / 2.0)
        names = ("x_m", "y_m", "side_m", "contrast")
        values: dict[str, float] = dict(zip(names, middle, strict=True))
        for name, (low, high) in zip(names, region, strict=True):
            values |= {f"{name}_low": low, f"{name}_high": high}
        rows.append(values)
    return pl.DataFrame(rows)


def _risk(found: Assessment) -> pl.DataFrame:
    stops = found.stopping
    shares = {
        "damage that would be cleared": stops.missed,
        "intact surfaces that would be cleared": stops.cleared,
    }
    rows: dict[str, Interval | float] = {
        "risk, given the samples": stops.risk, **shares, "cells of 10 cm with a sample": found.visited,
    }  # fmt: skip
    columns = ["what", "value_share", "value_share_low", "value_share_high"]
    cells = [
        (what, *(each[:3] if isinstance(each, Interval) else (each, None, None)))
        for what, each in rows.items()
    ]
    return pl.DataFrame(cells, columns, orient="row", infer_schema_length=None)


def plan_report(
    table: pl.DataFrame, want_m: float | None, setting: str, made_by: Mapping[str, str]
) -> Report:
    """Return what robots and time buy (``pod.plan``), and what is enough for a wanted size."""
    effort = pl.col("robots") * pl.col("until_s")
    if want_m is None:
        best, found = table.drop_nulls("a90_m").sort("a90_m", effort), "the smallest of these plans"
    else:
        best = table.filter(pl.col("a90_95_m") <= want_m).sort(effort, "a90_m")
        found = f"with the fewest robot minutes for {in_cm(want_m)} cm (a90/95)"
    answer = "None of these plans finds the wanted squares in 90 % of inspections."
    if not best.is_empty():
        row = best.row(0, named=True)
        time = f"{row['until_s'] / 60.0:.3g} min"
        answer = (
            f"{row['robots']} robots in {time} find squares of {in_cm(row['a90_m'])} cm in 90 %, {found}."
        )
    titles = {"a50_m": "a50", "a90_m": "a90", "a90_95_m": "a90/95", "until_s": "time"}
    caption = "Squares of contrast 1, drawn by the law of the sensor; empty: does not exist."
    parts = {"plan": Table(table, "What robots and time buy", caption, titles)}
    return Report("Plan of an inspection", (answer,), parts, setting, made_by={**made_by, **versions()})


def in_cm(size_m: float) -> str:
    """Write a length in cm, without its unit."""
    return f"{100.0 * size_m:.3g}"
