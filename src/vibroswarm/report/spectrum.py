"""The report of spectra of recorded acceleration: lines, what may be behind them, and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import polars as pl

from vibroswarm.core.numbers import Estimate, count, number, with_limits
from vibroswarm.lab.recordings.spectrum import Spectra, Spectrum, spectra_frame
from vibroswarm.plots.picture import Picture
from vibroswarm.plots.spectrum import draw_spectrum
from vibroswarm.report.report import Figure, Report, Table, report

MOST_DRAWN = 4
"""Spectra of one group in one picture; the others are in the tables."""


@report.register
def of_spectra(found: Spectra) -> Report:
    """Return what vibrates at which frequency, and how sure that is."""
    groups = {"all samples": [found.whole]}
    for one in found.spectra:
        if one is not found.whole:
            groups.setdefault(f"by {one.group}", []).append(one)
    parts: dict[str, Table | Figure] = {}
    for title, spectra in groups.items():
        name = title.replace(" ", "_")
        parts[f"lines_{name}"] = _lines(spectra, title, found.unit)
        parts[f"spectrum_{name}"] = Figure(partial(_drawn, found, spectra[:MOST_DRAWN]), f"Spectrum {title}")
    lines = found.whole.lines
    answer = f"No line stands out of the noise up to {number(0.5 * found.rate_hz, 0)} Hz."
    if lines:
        first = with_limits(Estimate(lines[0].hz, lines[0].low, lines[0].high), "Hz", 2)
        folded = " or ".join(f"{number(hz, 1)} Hz" for hz in lines[0].folds_from)
        answer = f"The strongest of {count(len(lines), 'line')} is at {first}; at this rate it may also be {folded}."
    return Report(
        title="Spectrum of vibration",
        answer=(answer,),
        parts=parts,
        setting=f"{count(found.samples, 'sample')} of {number(1000 * found.signal_s, 0)} ms at "
        f"{number(found.rate_hz, 1)} Hz; {found.axis}",
        warnings=found.warnings,
    )


def _lines(spectra: Sequence[Spectrum], title: str, unit: str) -> Table:
    rows = [
        {
            "where": spectrum.name or "all samples",
            "samples": spectrum.samples,
            "line_hz": line.hz,
            "line_hz_low": line.low,
            "line_hz_high": line.high,
            "amplitude": line.amplitude,
            "folded": ", ".join(number(hz, 1) for hz in line.folds_from),
            "may be": line.words,
        }
        for spectrum in spectra
        for line in spectrum.lines
    ]
    titles = {"folded": "or, folded, Hz", "amplitude": f"amplitude, {unit or 'as in the file'}"}
    return Table(pl.DataFrame(rows), f"Lines, {title}", titles=titles)


def _drawn(found: Spectra, spectra: Sequence[Spectrum]) -> Picture:
    names = [spectrum.name for spectrum in spectra]
    frame = spectra_frame(found).filter(
        pl.col("where").is_in(names), pl.col("hz") > 0.0, group=spectra[0].group
    )
    lines = spectra[0].lines if len(spectra) == 1 else ()
    marks = pl.DataFrame(
        [(line.hz, line.low, line.high, line.amplitude) for line in lines],
        schema=dict.fromkeys(("hz", "low", "high", "amplitude"), pl.Float64),
        orient="row",
    )
    label = f"amplitude ({found.unit or 'as in the file'})"
    return draw_spectrum(frame.rename({"where": "series"}), marks, label=label)
