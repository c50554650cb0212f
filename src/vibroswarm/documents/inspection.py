"""The document of an inspection by place: where it vibrates, how sure that is, on what it is based; its certificate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from numpy.typing import NDArray

from vibroswarm.core.atomic_io import write_file
from vibroswarm.core.numbers import count, number, percent, size, span, stated, stated_percent, verb, whole
from vibroswarm.documents.cell_figures import WIDEST_MAP, tile_lines
from vibroswarm.documents.damage import (
    MOST_LISTED,
    UNTESTED,
    checks_table,
    damage_answer,
    damage_sections,
    in_cm,
    map_figure,
    not_certified,
    pod_table,
    raster_figure,
    scan_words,
    stopping_parts,
    vibrates,
    weakest_tables,
)
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.region import HELD
from vibroswarm.inspection.samples import Samples
from vibroswarm.inspection.scan import Scan
from vibroswarm.show.document import Column, Document, Figure, Part, Section, Table, Text, if_any
from vibroswarm.simulation import versions
from vibroswarm.statistics.map_scores import SURE, calibration

ROWS: Final = 12
"""Rows of the table of scores over time."""
NARROW: Final = 3
"""Tiles should be so many times as wide as places are uncertain."""
UNCHECKED: Final = (
    "Whether the law of the sensor holds, robots agree on places, and the grid is right, is not checked; "
    "add --damage."
)


def inspection_document(found: Inspection) -> Document:
    """Return the document of an inspection."""
    samples = found.samples
    is_refused = found.assessment is not None and bool(found.assessment.refusals)  # the answer says why
    return Document(
        title=f"Inspection of {samples.source}",
        answer=_answer(found),
        knew=(f"Places: {samples.places}. Law of the sensor: {samples.law.origin}.",),
        warnings=("" if is_refused else samples.warning,),
        parts=(
            Text(_what(samples)),
            *map(Text, _presumptions(samples)),
            Text(UNCHECKED if found.assessment is None else ""),
            *if_any(found.by_kind, lambda by_kind: _kinds(by_kind, samples, found.times_s[-1])),
            *([] if found.pooled is None else _map(found)),
            *([] if found.assessment is None else damage_sections(found)),
        ),
        made_by={
            "law of the sensor": " ".join(filter(None, (samples.law.origin, samples.law.hash))),
            "samples": samples.hash,
            **versions(),
        },
    )


def _kinds(by_kind: NDArray[np.float64], samples: Samples, time_s: float) -> list[Part]:
    """Return the most probable kind of each tile, beside the true one; nothing if no tile has a kind."""
    if samples.kinds is None:
        return []
    tiles = samples.kinds.at(time_s).tiles
    likely = by_kind.argmax(axis=1).reshape(tiles.shape)
    lines = [
        "  ".join(f"{one}{' ' if one == true else '!'}" for one, true in zip(row, of_row, strict=True))
        for row, of_row in zip(likely.tolist(), tiles.tolist(), strict=True)
    ]
    right = int((likely == tiles).sum())
    row, column = (index.ravel() for index in np.indices(tiles.shape))
    table = pl.DataFrame(
        {"row": row, "column": column, "kind": tiles.ravel(), "most_probable": likely.ravel()}
        | {f"kind_{kind}": by_kind[:, kind] for kind in range(by_kind.shape[1])}
    )
    columns = {f"kind_{kind}": Column(f"kind {kind}", share=True) for kind in range(by_kind.shape[1])}
    return [
        Text(
            f"Most probable kind of each tile, from all samples: {right} of {tiles.size} right; ! marks a wrong tile:"
        ),
        Text("\n".join(lines), "code"),
        Table(table, columns, "Probability of each kind of each tile.", "kinds", names=2, folded=True),
    ]


def _answer(found: Inspection) -> tuple[str, ...]:
    damage = () if found.assessment is None else damage_answer(found.assessment)
    if found.assessment is not None and found.assessment.refusals:
        damage = (not_certified(found.assessment), *damage)
    if found.pooled is None:
        return damage
    p = found.pooled[-1]
    vibrate, still = int((p > SURE).sum()), int((p < 1.0 - SURE).sum())
    two = found.by_kind is None
    vibrates = verb(vibrate, "vibrate") if two else f"{verb(vibrate, 'are', 'is')} of another kind than 0"
    unsure = p.size - vibrate - still
    words = (
        f"{whole(vibrate)} of {count(p.size, 'tile')} {vibrates} and {whole(still)} {verb(still, 'are', 'is')} "
        f"{'still' if two else 'of kind 0'}, each with more than {percent(SURE, 0)}; {whole(unsure)} "
        f"{verb(unsure, 'are', 'is')} open, after {number(found.times_s[-1], 0)} s. Expected number of tiles "
        f"that {'vibrate' if two else 'are of another kind than 0'}: {number(float(p.sum()), 1)}."
    )
    if still and found.assessment is not None and found.assessment.verdict == "damage":
        words += " A tile is taken as alike all over: damage on a part of one is in the scan, not in these numbers."
    return (*damage, words, _against_truth(found, p.size) if found.samples.truth_known else "")


def _against_truth(found: Inspection, tiles: int) -> str:
    last = found.scores.row(-1, named=True)
    right = round(last["right"] * tiles)
    since = "" if found.right_from_s is None else f", all of them from {number(found.right_from_s, 0)} s on"
    return (
        f"Against the true floor: {right} of {tiles} tiles right{since}, {int(last['surely_wrong'])} surely wrong; "
        f"Brier score {number(last['brier'], 4)} (0.25: knows nothing)."
    )


def _what(samples: Samples) -> str:
    left_out = (
        f" {count(samples.left_out, 'row')} of the file without a value left out." if samples.left_out else ""
    )
    outside = int((samples.beyond > 0.0).any(axis=0).sum())
    beyond = f", {outside} of them outside of it" if outside else ""
    return (
        f"{count(samples.frame.height, 'sample')} of {count(len(samples.robots), 'robot')} on "
        f"{size(*samples.size_m)}{beyond}.{left_out}"
    )


def _presumptions(samples: Samples) -> Iterator[str]:
    errors = samples.place_errors
    if errors is not None:
        shares = ", ".join(percent(share) for share in errors.within)
        lag = (
            ""
            if math.isnan(errors.lag_one)
            else f", correlated by {number(errors.lag_one, 2)} from sample to sample of a robot"
        )
        yield (
            f"Places taken as independent: their errors within 1, 2 and 4 stated standard deviations are {shares} "
            f"(68.3, 95.4 and 100 % expected){lag}."
        )
    elif samples.column("spread_x_m").any():
        yield "Places taken as independent; how wrong they are is not known."
    elif samples.frame["true_x_m"].null_count():
        yield "Places taken as exact and independent; how wrong they are is not known (state it: --spread-mm)."
    else:
        yield "Places are exact."
    if samples.floor is not None:
        before = (
            "vibrating with probability 1/2" if samples.kinds is None else "of each kind equally probable"
        )
        yield f"Tiles taken as independent, each {before} before any sample; the grid is known."
        spreads_m = [samples.column(f"spread_{axis}_m") for axis in "xy"]
        times = min(samples.floor.geometry[2:4]) / max(float(np.sqrt(np.mean(np.square(spreads_m)))), 1e-9)
        if times < NARROW:
            yield (
                f"Tiles are {number(times, 1)} times as wide as places are uncertain (standard deviation): below "
                f"{NARROW} the map is surer of single tiles than it is right."
            )


def _map(found: Inspection) -> list[Part]:
    """Return the map as text, figure and table, and its scores over time where the truth is known."""
    maps, floor = found.last_maps, found.samples.floor
    is_narrow = floor is not None and floor.tiles.shape[1] <= WIDEST_MAP
    wrong = "; ! marks a wrong tile" if found.samples.truth_known else ""
    words = f"Probability that each tile {vibrates(found)}, %, from all samples{wrong}:"
    columns = {"vibrating": Column(share=True), "spread": Column("standard deviation", share=True)}
    each = Table(maps.drop("run"), columns, name="map", names=3)
    return [
        Text(words if is_narrow else ""),
        Text(tile_lines(maps.filter(pl.col("robot").is_null())) if is_narrow else "", "code"),
        map_figure(found),
        Section("Tile by tile", (each,), folded=True),
        Section(
            "Over time", if_any(found.scores, lambda scores: [_score_table(scores), _calibration(found)])
        ),
    ]


def _score_table(scores: pl.DataFrame) -> Table:
    chosen = np.unique(np.linspace(0, scores.height - 1, ROWS).round().astype(int))
    columns = {
        "time_s": Column("time", "s", decimals=0),
        "brier": Column("Brier score", decimals=4),
        "log_score": Column("log score", decimals=4),
        "auc": Column("AUC", decimals=3),
        "right": Column("tiles right", share=True),
        "surely_wrong": Column("surely wrong", decimals=0),
        "location_error_m": Column("location error", "m", decimals=3),
    }
    caption = "The map over time, against the true floor at each time."
    return Table(scores[chosen], columns, caption, "scores")


def _calibration(found: Inspection) -> Table:
    """Return how often tiles of a probability vibrate, over all times: those of one inspection are not independent."""
    assert found.pooled is not None
    assert found.vibrates is not None
    columns = {
        **{name: Column(share=True) for name in ("from", "to", "probability")},
        "vibrating": Column("truly vibrating", share=True),
    }
    frame = calibration(found.pooled.ravel(), found.vibrates.ravel().astype(np.float64)).drop(
        "vibrating_low", "vibrating_high"
    )
    caption = "Calibration: tiles at all times, by their probability."
    return Table(frame, columns, caption=caption, name="calibration", names=2, folded=True)


CERTIFICATE: Final = "certificate.html"
_FOUND: Final = (
    "a50, a90: size that would have been found in 50 and 90 % of inspections; a90/95: upper 95 % limit of a90. "
    "Contrast 1: as strong as in the reference. A dash: not reached."
)


def certificate_document(found: Inspection) -> Document:
    """Return the certificate of an inspection as a document: question, answer, map, what is not covered, origin."""
    samples, assessment = found.samples, found.assessment
    assert assessment is not None
    question = assessment.question
    asked = (
        f"Is there damage of {in_cm(question.least_m)} cm or larger, with a contrast of at least "
        f"{stated(min(question.contrasts))}? Tolerated risk {stated_percent(question.risk)}, prior "
        f"{stated_percent(question.prior)}{', at every place' if question.strict else ', on average over places'}."
    )
    resampled = f"drawn, {count(len(samples.law.draws), 'law')} of resampled references"
    covered = (
        f"Visited: {percent(assessment.visited, 0)} of the cells of 10 cm. Not covered: damage smaller than "
        f"{in_cm(question.least_m)} cm or weaker than contrast {stated(min(question.contrasts))}; places not visited; "
        f"shapes without a row above; damage that does not follow the reference. Places: {samples.places}; errors of "
        f"places taken as independent. Error of the law: {resampled if samples.law.draws else 'not known'}."
    )
    return Document(
        title=f"Inspection of {samples.source}",
        answer=damage_answer(assessment),
        warnings=(not_certified(assessment),) if assessment.refusals else (),
        parts=(
            Section("Question", (Text(asked), Text(_sampled(found)))),
            Section("Where", _where(found)),
            Section(
                "What would have been missed",
                (
                    _for_certificate(pod_table(assessment)),
                    *if_any(
                        assessment.weakest, lambda weakest: map(_for_certificate, weakest_tables(weakest))
                    ),
                    Text(_FOUND),
                    *stopping_parts(assessment),
                ),
            ),
            Section(
                "Law of the sensor",
                (Text(f"Origin: {samples.law.origin}. {UNTESTED}"), checks_table(assessment)),
            ),
            Section("Not covered", (Text(covered),)),
        ),
        made_by={"samples": samples.hash, "law": samples.law.hash, **versions()},
    )


def _where(found: Inspection) -> tuple[Text | Table | Figure, ...]:
    """Return the map of a certificate: of the tiles, if there is a grid, or else the called patches and the raster."""
    assert found.assessment is not None
    scan = found.assessment.scan
    figure = raster_figure(found) if found.pooled is None else map_figure(found, own=False)
    patches = _patches(scan) if found.pooled is None else ()
    return replace(figure, on_page="column"), scan_words(scan), *patches  # it is printed 80 mm wide


def _patches(scan: Scan) -> tuple[Table | Text, ...]:
    """Return the first called patches with their regions, in few columns, and how many there are beyond them."""
    rows = [
        (
            f"x {number(box.centre_m[0], 2)}, y {number(box.centre_m[1], 2)}",
            f"{in_cm(region.size_m[0])} to {in_cm(region.size_m[1])}",
            span(region.contrast or (), 2),
            1e4 * region.centre_m2,
        )
        for box, region in zip(scan.called_m[:MOST_LISTED], scan.regions[:MOST_LISTED], strict=True)
    ]
    if not rows:
        return ()
    columns = {
        "centre": Column("called patch", "m"),
        "size": Column("size", "cm"),
        "contrast": Column(),
        "area": Column("centres", "cm²", decimals=0),
    }
    table = Table(pl.DataFrame(rows, list(columns), orient="row"), columns)
    words = f"Size, contrast and area of the centres: of one joint {percent(HELD, 0)} region of each patch."
    if left_out := len(scan.called_m) - len(rows):
        words += f" {count(left_out, 'more patch is', 'more patches are')} called; the report lists all."
    return table, Text(words)


def _for_certificate(table: Table) -> Table:
    return replace(table, frame=table.frame.drop("top", "surfaces", "area_cm2", strict=False))


def _sampled(found: Inspection) -> str:
    samples = found.samples
    return (
        f"{count(samples.frame.height, 'sample')} of {count(len(samples.robots), 'robot')} in "
        f"{number(found.times_s[-1], 0)} s on {size(*samples.size_m)}."
    )


def write_certificate(path: Path, found: Inspection) -> None:
    """Write the certificate of an inspection as one HTML page, which prints on one sheet of A4."""
    from vibroswarm.show.page import certificate_html

    write_file(path, certificate_html(certificate_document(found)), replace=True)
