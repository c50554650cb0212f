"""The document of spectra of recorded acceleration: lines, what may be behind them, and a picture."""

from __future__ import annotations

from functools import partial

import numpy as np
import polars as pl

from vibroswarm.core.numbers import Estimate, count, first_of, number, with_limits
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.spectrum import draw_spectrum
from vibroswarm.recordings.spectrum import Spectra, Spectrum
from vibroswarm.show.document import Column, Document, Figure, Part, Section, Table, Text

WORDS = {"robot": "By robot", "tile": "By tile", "place": "By place", "time": "Over time"}
MOST_DRAWN = 4
"""Spectra of one group in one picture; the others are in the tables."""


def spectrum_document(found: Spectra) -> Document:
    """Return what vibrates at which frequency, and how sure that is."""
    groups = {name: [one for one in found.spectra if one.group == name] for name in WORDS}
    parts: tuple[Part, ...] = (
        Text(
            f"{count(found.samples, 'sample')} of {count(found.stops, 'stop')}: the last "
            f"{number(1000 * found.signal_s, 0)} ms of each, at {number(found.rate_hz, 1)} Hz; {found.axis}. Lines "
            f"nearer than {number(2.0 / found.signal_s, 1)} Hz are one."
        ),
        lines_table([found.whole], "lines", found.unit),
        Figure("spectrum", partial(_drawn, found, [found.whole]), "Spectrum of all samples"),
        *(_group(found, name, spectra) for name, spectra in groups.items() if spectra),
    )
    return Document(
        title="Spectrum of vibration",
        answer=(_answer(found),),
        warnings=tuple(f"{words[0].upper()}{words[1:]}." for words in found.warnings),
        parts=parts,
        data={"spectra": spectra_frame(found)},
    )


def _group(found: Spectra, name: str, spectra: list[Spectrum]) -> Section:
    drawn = Figure(
        f"spectrum_by_{name}",
        partial(_drawn, found, spectra[:MOST_DRAWN]),
        first_of(MOST_DRAWN, len(spectra), "group"),
    )
    return Section(WORDS[name], (lines_table(spectra, f"lines_by_{name}", found.unit), drawn))


def _answer(found: Spectra) -> str:
    lines = found.whole.lines
    if not lines:
        return f"No line stands out of the noise up to {number(0.5 * found.rate_hz, 0)} Hz."
    first = lines[0]
    more = f", and {count(len(lines) - 1, 'weaker line')}" if len(lines) > 1 else ""
    return (
        f"The strongest line is at {with_limits(Estimate(first.hz, first.low, first.high), 'Hz', 2)}{more}. "
        f"At this rate it may also be {' or '.join(f'{number(hz, 1)} Hz' for hz in first.folds_from)}."
    )


def lines_table(spectra: list[Spectrum], name: str, unit: str) -> Table:
    """Return the lines of some spectra, with 95 % intervals."""
    rows = [
        {
            "where": spectrum.name or "all samples",
            "samples": spectrum.samples,
            "hz": line.hz,
            "low": line.low,
            "high": line.high,
            "amplitude": line.amplitude,
            "or": ", ".join(number(hz, 1) for hz in line.folds_from),
            "words": line.words,
        }
        for spectrum in spectra
        for line in spectrum.lines
    ]
    schema = {
        "where": pl.String, "samples": pl.Int64, "hz": pl.Float64, "low": pl.Float64, "high": pl.Float64,
        "amplitude": pl.Float64, "or": pl.String, "words": pl.String,
    }  # fmt: skip
    columns = {
        "hz": Column("line (95 %)", "Hz", decimals=2, limits=("low", "high")),
        "amplitude": Column("amplitude", unit, decimals=3),
        "or": Column("or, folded", "Hz"),
        "words": Column("may be", prose=True),
    }
    return Table(pl.DataFrame(rows, schema=schema), columns, "Lines, the strongest first.", name)


def spectra_frame(found: Spectra) -> pl.DataFrame:
    """Return all spectra as a table: group, where, hz, amplitude."""
    return pl.concat(
        pl.DataFrame(
            {
                "group": [spectrum.group] * found.hz.size,
                "where": [spectrum.name] * found.hz.size,
                "hz": found.hz,
                "amplitude": np.sqrt(2.0 * spectrum.power),
            }
        )
        for spectrum in found.spectra
    )


def _drawn(found: Spectra, spectra: list[Spectrum], style: str) -> Picture:
    """Draw some spectra, with the lines of the first if it is alone."""
    inside = found.hz > 0.0
    frame = pl.concat(
        pl.DataFrame(
            {
                "series": [spectrum.name] * int(inside.sum()),
                "hz": found.hz[inside],
                "amplitude": np.sqrt(2.0 * np.maximum(spectrum.power[inside], 1e-24)),
            }
        )
        for spectrum in spectra
    )
    lines = spectra[0].lines if len(spectra) == 1 else ()
    marks = pl.DataFrame(
        [(line.hz, line.low, line.high, line.amplitude) for line in lines],
        schema=["hz", "low", "high", "amplitude"],
        orient="row",
        schema_overrides=dict.fromkeys(("hz", "low", "high", "amplitude"), pl.Float64),
    )
    label = f"amplitude ({found.unit or 'as in the file'})"
    return draw_spectrum(frame, marks, label=label, style=style)
