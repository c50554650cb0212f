"""The certificate of an inspection: one sheet of paper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import polars as pl

from vibroswarm.core.atomic_io import write_text
from vibroswarm.core.numbers import count, number, percent, size, span, stated, stated_percent
from vibroswarm.documents.damage import (
    MOST_LISTED,
    UNTESTED,
    checks_table,
    damage_answer,
    in_cm,
    map_figure,
    not_certified,
    pod_table,
    raster_figure,
    scan_words,
    stopping_parts,
    weakest_parts,
)
from vibroswarm.inspection.inspection import Inspection
from vibroswarm.inspection.scan import Scan
from vibroswarm.show.document import Column, Document, Figure, Section, Table, Text
from vibroswarm.simulation import versions

CERTIFICATE: Final = "certificate.html"


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
            Section("Question", (Text(asked), Text(_what(found)))),
            Section("Where", _where(found)),
            Section(
                "What would have been missed",
                (
                    _short(pod_table(assessment)),
                    *map(_short, weakest_parts(assessment)),
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
    left_out = len(scan.called_m) - len(rows)
    if not left_out:
        return (table,)
    more = count(left_out, "more patch is", "more patches are")
    return table, Text(f"{more} called; the report lists all.")


def _short(table: Table) -> Table:
    """Return a table without what a certificate has no room for."""
    return replace(table, frame=table.frame.drop("top", "surfaces", "area_m2", strict=False))


def _what(found: Inspection) -> str:
    samples = found.samples
    return (
        f"{count(samples.frame.height, 'sample')} of {count(len(samples.robots), 'robot')} in "
        f"{number(found.times_s[-1], 0)} s on {size(*samples.size_m)}."
    )


def write_certificate(path: Path, found: Inspection) -> None:
    """Write the certificate of an inspection as one HTML page, which prints on one sheet of A4."""
    from vibroswarm.show.page import certificate_html

    write_text(path, certificate_html(certificate_document(found)), replace=True)
