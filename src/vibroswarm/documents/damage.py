"""What an inspection says about damage, as sentences, tables and figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import islice
from typing import Final

import numpy as np
import polars as pl

from vibroswarm.core.numbers import (
    count,
    drawn_of,
    listed,
    number,
    p_value,
    percent,
    stated,
    stated_percent,
    whole,
    with_limits,
)
from vibroswarm.inspection.assessment import WHOLLY, Assessment
from vibroswarm.inspection.damage import CRACK_M
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.missed import EACH
from vibroswarm.inspection.patches import Form
from vibroswarm.inspection.pod import INTACT
from vibroswarm.inspection.region import HELD
from vibroswarm.inspection.scan import MOST_CALLED, Box, Scan
from vibroswarm.inspection.stopping import BLOCKS, LOOKS
from vibroswarm.plots.certainty import draw_certainty, draw_rasters
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.run import MOST_MAPS, maps_figure
from vibroswarm.plots.style import settings
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text, if_any
from vibroswarm.simulation import versions

MOST_LISTED: Final = 4
"""Called patches that are listed in the answer; the map has all."""


def damage_answer(found: Assessment) -> tuple[str, ...]:
    """Return sentences: is there damage, where, how large; may one stop; what would have been missed."""
    question, risk = found.question, float(found.stopping.told[-1])
    told = "below 0.1 %" if risk < 0.001 else percent(risk)
    contrast = min(question.contrasts)
    size = f"{in_cm(question.least_m)} cm or larger, contrast {stated(contrast)}{' or more' if contrast < 1.0 else ''}"
    if found.verdict == "damage":
        each = [_placed(box) for box in found.scan.called_m[:MOST_LISTED]]
        more = len(found.scan.called_m) - len(each)
        each += [f"and {more} more"] if more else []
        at_least = "at least " * (len(found.scan.called_m) == MOST_CALLED)
        where = at_least + count(len(found.scan.called_m), "patch", "patches")
        first = f"DAMAGE: {where}, {'; '.join(each)} (centres; p = {p_value(found.scan.p_value)})."
    elif found.verdict == "clear":
        first = (
            f"CLEAR of damage of {size}: risk {told}{'' if question.strict else ' on average over places'} (tolerated: "
            f"{stated_percent(question.risk)}){_unvisited(found)}."
        )
    else:
        first = (
            f"OPEN: no damage is called (p = {p_value(found.scan.p_value)}), but the risk of damage of {size} is "
            f"{told} (tolerated: {stated_percent(question.risk)}); {_next(found)}."
        )
    return first, _pod_words(found)


def _unvisited(found: Assessment) -> str:
    """Return how much has no sample, where the average over places may be tolerated all the same."""
    return (
        f"; {percent(1.0 - found.visited)} of the cells of 10 cm have no sample"
        if found.visited < 1.0
        else ""
    )


def _next(found: Assessment) -> str:
    """Return what to do about an open question: if damage is as sure as clearing asks, it is too weak to be called."""
    suspected = found.stopping.suspected
    if suspected is None or found.stopping.told[-1] < 1.0 - found.question.risk:
        unvisited = f": {percent(1.0 - found.visited, 0)} of the cells of 10 cm have none"
        return f"more samples are needed{unvisited if found.visited < WHOLLY else ''}"
    box, contrast = suspected
    return (
        f"the samples fit damage of contrast {stated(contrast)} better than none, best {_placed(box)} (centre): "
        "measure there again, or by other means"
    )


def _pod_words(found: Assessment) -> str:
    contrast, pod = max(found.pods.items())
    if pod.b1 <= 0.0:
        return (
            f"Larger damage of contrast {stated(contrast)} would have been found less often than smaller damage: there "
            "is no size from which on it would have been found in 90 % of inspections."
        )
    if not math.isfinite(pod.a90_m):
        return (
            f"Damage of contrast {stated(contrast)} would not have been found in 90 % of inspections at any size that "
            f"was drawn, up to {in_cm(pod.largest_m)} cm."
        )
    limit = (
        f"at most {in_cm(pod.a90_95_m)} cm with 95 % confidence"
        if math.isfinite(pod.a90_95_m)
        else "its upper limit does not exist"
    )
    return (
        f"Damage of {in_cm(pod.a90_m)} cm and contrast {stated(contrast)} would have been found in 90 % of "
        f"inspections (a90; {limit}), at {percent(pod.false_calls)} false calls. Model-assisted: drawn from the law of "
        "the sensor."
    )


def not_certified(found: Assessment) -> str:
    """Return the sentence that says why nothing is certified."""
    return f"Not certified: {'; '.join(found.refusals)}."


def damage_sections(found: Inspection) -> list[Section]:
    """Return what an inspection says about damage, as sections of a report."""
    assessment = found.assessment
    assert assessment is not None
    told = {"time_s": assessment.stopping.times_s, "risk": assessment.stopping.told}
    # Every fourth look, the last one included; samples of one time have one.
    every_fourth = pl.DataFrame(told)[3::4].unique("time_s", keep="last", maintain_order=True)
    return [
        Section(
            "Is there damage, and where?",
            (
                scan_words(assessment.scan),
                *if_any(assessment.scan.called_m, lambda _: _patch_parts(assessment.scan)),
                raster_figure(found),
                _over_time(found),
            ),
        ),
        Section(
            "What would have been missed?",
            (pod_table(assessment), *if_any(assessment.weakest, weakest_tables), Text(_POD)),
        ),
        Section("When may one stop?", (*stopping_parts(assessment), Table(every_fourth, _RISK, name="risk"))),
        Section("Does the law of the sensor hold?", (checks_table(assessment), Text(UNTESTED))),
    ]


_POD: Final = (
    f"At random places of this inspection, {count(INTACT, 'intact surface')}; PoD(a) = p_f + (1 - p_f) F(b0 + b1 "
    "g(a)), F logistic or Weibull, a90/95 by penalised profile likelihood (one-sided 95 %). Size: side of squares, "
    f"diameter of discs, length of cracks of {stated(100 * CRACK_M)} cm. Where less than {percent(WHOLLY, 0)} of the "
    "cells are visited the curve may end below 1 (by AIC). Other places are not covered."
)
UNTESTED: Final = (
    "Holm's correction; at most 5 % of right laws are refused. Places are tested by whether the robots agree on where "
    "it vibrates (power: share of robots with useless places that are found); where nothing vibrates they cannot be "
    "tested. The law of damage cannot be tested where there is none: it is that of the reference. Surfaces are drawn "
    "without effects of time: gains that vary by 10 % within minutes give 8 to 16 % false calls, not 5 %."
)
_RISK: Final = {"time_s": Column("time", "s", decimals=0), "risk": Column(share=True)}


def scan_words(scan: Scan) -> Text:
    """Return how was scanned, and with which p-value."""
    level = stated_percent(scan.level)
    words = (
        f"Scan of {listed(map(_form, scan.forms))} cm: T = {number(scan.statistic, 2)} "
        f"({level} of intact surfaces reach {number(scan.critical, 2)}), p = {p_value(scan.p_value)} from "
        f"{count(scan.replicates, 'intact surface')} drawn at the same places; values exchanged within robots and "
        f"blocks of time, as if all intact places were alike: p = {p_value(scan.permuted_p_value)}. "
        f"{_looks_in_words(scan)}"
    )
    return Text(words)


def _patch_parts(scan: Scan) -> tuple[Text | Table, ...]:
    """Return the called patches with their joint regions."""
    rows = []
    for box, region in zip(scan.called_m, scan.regions, strict=True):
        low, high = region.contrast or (None, None)
        small, large = (100.0 * size for size in region.size_m)
        rows.append((_box(box), *box.centre_m, 1e4 * region.centre_m2, small, large, low, high))
    columns = {
        "patch": Column("called patch"),
        "x_m": Column("x", "m", decimals=2),
        "y_m": Column("y", "m", decimals=2),
        "centre_cm2": Column("centres", "cm²", decimals=0),
        "size_from_cm": Column("size from", "cm", decimals=0),
        "size_to_cm": Column("to", "cm", decimals=0),
        "contrast_from": Column("contrast from", decimals=2),
        "contrast_to": Column("to", decimals=2),
    }
    words = (
        f"Place, size and contrast of a patch are in one joint region with {percent(HELD, 0)}, of which the table has "
        "the area of the centres, the sizes and the contrasts. One patch is presumed; later ones are by the samples "
        "that are not on those before. Damage below the smallest or above the largest declared size is not weighed: "
        "smaller damage comes out larger and weaker than it is, larger as several patches (declare its size). The "
        "region presumes the shapes that were scanned for: other damage is in it less often than stated (a crack, if "
        "only squares were scanned for: its centre in 40 to 80 % of cases, its length seldom)."
    )
    return Table(pl.DataFrame(rows, schema=list(columns), orient="row"), columns, name="patches"), Text(words)


def _placed(box: Box) -> str:
    return f"{_box(box)} at x = {number(box.centre_m[0], 2)} m, y = {number(box.centre_m[1], 2)} m"


def _box(box: Box) -> str:
    if box.is_disc:
        return f"disc of {in_cm(box.width_m)} cm"
    return f"{in_cm(box.width_m)} cm x {in_cm(box.height_m)} cm"


def _form(form: Form) -> str:
    if form.is_disc:
        return f"{in_cm(form.width_m)} (disc)"
    is_square = form.width_m == form.height_m
    return in_cm(form.width_m) if is_square else f"{in_cm(form.width_m)} x {in_cm(form.height_m)}"


def _looks_in_words(scan: Scan) -> str:
    if scan.looks == 1:
        return "One look, at the end."
    called = "" if scan.called_s is None else f"; first called at {number(scan.called_s, 0)} s"
    return f"{scan.looks} looks, T and its p-value are of the largest over them{called}."


def stopping_parts(found: Assessment) -> tuple[Text, ...]:
    """Return when the risk is tolerated, and how much damage is cleared all the same."""
    told, question = found.stopping, found.question
    contrasts = listed(map(stated, question.contrasts))
    heard = f"all but {stated_percent(question.loss)} of" if question.loss else "all of"
    places = listed(
        f"{whole(places)} of {_form(form)}"
        for form, places in zip(told.patches.forms, told.patches.places.tolist(), strict=True)
    )
    if question.strict:
        rule = f"the largest L of all places ({places} cm) and contrasts"
    else:
        rule = f"the mean of L over places, all with the same weight ({places} cm), of the worst size and contrast"
    worst = f"{with_limits(told.worst, '%')} at the worst of {BLOCKS**2} blocks of places"
    missed = f"{with_limits(told.missed, '%')} ({worst})"
    robots = (
        ""
        if told.missed_by_robots is None
        else f", if the robots decide {with_limits(told.missed_by_robots, '%')}"
    )
    return (
        Text(
            f"Risk: pi Lambda / (1 - pi + pi Lambda), with the prior pi = {stated_percent(question.prior)}, L the "
            f"likelihood ratio of damage at a place against none, and Lambda {rule} ({contrasts}). With "
            f"all samples it is {_tolerated(told.cleared_s)}; for the last robot, with its own samples and {heard} "
            f"the others', {_tolerated(told.robots_s)}."
        ),
        Text(
            f"If the inspection ends when the risk is tolerated for the first time ({LOOKS} looks), squares of "
            f"{in_cm(question.least_m)} cm with contrast {stated(min(question.contrasts))} would still be cleared in "
            f"{missed}{robots}; by all samples at the end in {with_limits(told.missed_at_end, '%')}. Drawn at the "
            "places of this inspection, with 95 % limits."
        ),
    )


def _tolerated(time_s: float | None) -> str:
    return "not tolerated at any look" if time_s is None else f"first tolerated at {number(time_s, 0)} s"


def pod_table(found: Assessment) -> Table:
    """Return the sizes that would have been found, by shape and contrast."""
    each = [("square", contrast, pod) for contrast, pod in found.pods.items()]
    each += [(shape, max(found.pods), pod) for shape, pod in found.shaped.items()]
    rows = [
        (
            shape, contrast, 100 * pod.a50_m, 100 * pod.a90_m, 100 * pod.a90_95_m, pod.false_calls, pod.top, pod.trials,
        )
        for shape, contrast, pod in each
    ]  # fmt: skip
    names = ("shape", "contrast", "a50_cm", "a90_cm", "a90_95_cm", "false_calls", "top", "surfaces")
    frame = pl.DataFrame(rows, schema=list(names), orient="row").with_columns(
        pl.col(pl.Float64).fill_nan(None)
    )
    columns = {
        **{
            name: Column(title, "cm", decimals=1)
            for name, title in (("a50_cm", "a50"), ("a90_cm", "a90"), ("a90_95_cm", "a90/95"))
        },
        "false_calls": Column("false calls", share=True),
        "top": Column("PoD of the largest", share=True, wide=True),
        "surfaces": Column("drawn"),
    }
    return Table(
        frame,
        columns,
        caption="Size of damage that would have been found; a dash: none up to the largest that was drawn (of a90/95: "
        "up to 1.5 times that).",
        name="pod",
    )


def weakest_tables(weakest: pl.DataFrame) -> tuple[Table, ...]:
    """Return the weakest contrasts that would have been found, by area; readings of classes have none."""
    shown = weakest.select(
        (pl.col("side_m") * 100.0).alias("side_cm"),
        (pl.col("area_m2") * 1e4).alias("area_cm2"),
        "c90",
        "c90_95",
    )
    columns = {
        "side_cm": Column("square", "cm", decimals=0),
        "area_cm2": Column("area", "cm²", decimals=0),
        "c90": Column("contrast at 90 %", decimals=2),
        "c90_95": Column("95 % limit", decimals=2),
    }
    caption = (
        "Weakest contrast that would have been found in 90 % of inspections, by area, with its upper limit; a dash: "
        f"not shown up to 1 by {whole(EACH)} drawn surfaces of each contrast."
    )
    return (Table(shown, columns, caption=caption, name="weakest"),)


def checks_table(found: Assessment) -> Table:
    """Return the checks of the law and of places."""
    columns = {
        "samples": Column(decimals=0),
        "p_value": Column("p", p_value=True),
        "corrected": Column("corrected p", p_value=True),
        "power": Column("power", share=True, decimals=0),
    }
    return Table(found.checks, columns, name="checks")


def _over_time(found: Inspection) -> Figure:
    """Return the raster over time, and that of the own samples of the ``MOST_MAPS`` robots with the lowest numbers."""
    assert found.assessment is not None
    assessment, size_m = found.assessment, found.samples.size_m
    panels = {
        f"{number(time_s, 0)} s": cells
        for time_s, cells in zip(assessment.raster_times_s, assessment.rasters, strict=True)
    }
    own = assessment.own_rasters
    panels |= {f"robot {robot}": cells for robot, cells in islice(own.items(), MOST_MAPS)}
    title = f"Damage over time, and by robot{drawn_of(min(len(own), MOST_MAPS), len(own), 'robot')}"
    return Figure("raster", lambda style: draw_rasters(panels, size_m, style=style), title)


def map_figure(found: Inspection, *, own: bool = True) -> Figure:
    """Return the figure of the map of tiles, of all samples; with ``own`` also of each robot's."""
    maps = found.last_maps if own else found.last_maps.filter(pl.col("robot").is_null())
    words, floor = vibrates(found), found.samples.floor
    assert floor is not None  # without a grid there is no map
    caption = f"Probability that each tile {words}: all robots{', each by itself' if own else ''}."

    def draw(style: str) -> Picture:
        with settings():
            label = f"probability that a tile {words}"
            return Picture(maps_figure(maps, tile_m=floor.geometry[2:4], label=label), maps, caption)

    return Figure("map", draw, f"Map of all samples{', and of each robot' if own else ''}")


def vibrates(found: Inspection) -> str:
    """Return what the map of tiles is a probability of."""
    return "vibrates" if found.by_kind is None else "is of another kind than 0"


def raster_figure(found: Inspection) -> Figure:
    """Return the figure of the probability of damage, with the called patches."""
    assert found.assessment is not None
    samples, scan = found.samples, found.assessment.scan
    places = np.stack([samples.column("x_m"), samples.column("y_m")], axis=1)
    marked = scan.called_m

    def draw(style: str) -> Picture:
        return draw_certainty(scan.raster, samples.size_m, places, marked_m=marked, style=style)

    return Figure("damage", draw, "Damage")


def plan_document(
    table: pl.DataFrame, want_m: float | None, runs: int, plates: int, source: Mapping[str, str], places: str
) -> Document:
    """Return what robots and time buy (``missed.plan``), and what is enough for a wanted size.

    Args:
        want_m: size that should be found in 90 % of inspections; None: none is asked for. runs: simulated inspections.
        plates: drawn surfaces of all sizes.
        source: scenario and seed of the inspections. places: theirs, in words.
    """
    lengths = ("a50_m", "a90_m", "a90_95_m", "sweep_a90_m")
    shown = table.with_columns(pl.col("until_s") / 60.0, *(pl.col(name) * 100.0 for name in lengths)).rename(
        {"until_s": "until_min", **{name: name.replace("_m", "_cm") for name in lengths}}
    )
    columns = {
        "until_min": Column("time", "min"),
        "samples": Column("samples", decimals=0),
        "false_calls": Column("false calls", share=True),
        "a50_cm": Column("a50", "cm", decimals=1),
        "a90_cm": Column("a90", "cm", decimals=1),
        "a90_95_cm": Column("a90/95", "cm", decimals=1),
        "sweep_a90_cm": Column("a90 of a sweep", "cm", decimals=1),
    }
    words = (
        f"{count(runs, 'simulated inspection')}, half of which give the threshold; {count(plates, 'surface')} with "
        "squares of contrast 1 drawn from the law of the sensor (model-assisted); a90/95 is the upper 95 % limit of "
        "a90 for so many, at the places of these inspections: of few inspections it is often below the a90 of many "
        "(--runs). A sweep: as many samples on a regular grid, of one sensor with exact places. A dash: does not exist."
    )
    return Document(
        title="Plan of an inspection",
        answer=(_planned(table, want_m),),
        knew=(f"Places: {places}.",),
        parts=(Table(shown, columns, name="plan"), Text(words)),
        made_by={**source, **versions()},
    )


def _planned(table: pl.DataFrame, want_m: float | None) -> str:
    """Return the plan with the fewest robot minutes that finds the wanted size, or without one the smallest size."""
    effort = pl.col("robots") * pl.col("until_s")
    if want_m is None:
        # Of good plans several find the least size that is tried.
        best = table.drop_nulls("a90_m").sort("a90_m", effort)
        if best.is_empty():
            return "No plan finds squares of any drawn size in 90 % of inspections."
        row = best.row(0, named=True)
        return (
            f"{count(row['robots'], 'robot')} in {number(row['until_s'] / 60, 1)} min find squares of "
            f"{in_cm(row['a90_m'])} cm in 90 % of inspections, the smallest of these plans."
        )
    enough = table.filter(pl.col("a90_95_m") <= want_m).sort(effort, "a90_m")
    if enough.is_empty():
        return (
            f"None of these plans surely finds squares of {in_cm(want_m)} cm in 90 % of inspections (a90/95)."
        )
    row = enough.row(0, named=True)
    return (
        f"{count(row['robots'], 'robot')} in {number(row['until_s'] / 60, 1)} min are enough for squares of "
        f"{in_cm(want_m)} cm: a90 {in_cm(row['a90_m'])} cm, with 95 % confidence at most {in_cm(row['a90_95_m'])} cm, "
        f"at {percent(row['false_calls'])} false calls (fewest robot minutes)."
    )


def in_cm(size_m: float) -> str:
    """Write a length in cm, without its unit."""
    return number(100 * size_m, digits=3)
