"""The reports of recordings: what an import read, what strategies would have decided, the best threshold, spectra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.core.numbers import Estimate, count, listed, number, percent, stated, with_limits
from vibroswarm.lab.replay import (
    Replays,
    SessionOutcome,
    logged_outcomes,
    session_outcomes,
    shares_lost,
    with_beliefs,
)
from vibroswarm.lab.spectrum import Spectra, Spectrum, spectra_frame
from vibroswarm.plots.curves import draw_spectrum
from vibroswarm.plots.picture import Picture
from vibroswarm.recordings.assemble_recording import COUNTED
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import Recommendation
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.run_page.write import write_run_page
from vibroswarm.scenario.scenario import Scenario

UNKNOWN_THRESHOLD: Final = (
    "The threshold of these robots is unknown: samples are read by that of the preset, and beliefs and decisions of "
    "replays follow from it; find one with 'vibroswarm lab threshold'."
)


def of_import(recording: Recording, computed: Sequence[str] = ()) -> Report:
    """Return what an import read: the sessions' outcomes, the robots' settings, and what was odd in the logs."""
    logs = [str(one["log"]) for one in recording.sessions]
    sessions = recording.runs.select("consensus", "consensus_time_s").insert_column(0, pl.Series("log", logs))
    counts = [
        {"log": one["log"], "count": float(one["told"][name]), "what": words}
        for one in recording.sessions
        for name, words in COUNTED.items()
        if one["told"].get(name)
    ]
    settings = [
        {
            "setting": one["name"],
            "inferred": str(one["value"]),
            "range": "" if one["low"] is None else f"{stated(one['low'])} to {stated(one['high'])}",
            "stated": str(recording.scenario[one["name"]]) if one["name"] in recording.stated else "",
        }
        for one in recording.inferred
    ]
    return Report(
        title="Recording",
        answer=(f"{count(recording.runs.height, 'session')} read.", recording.floor_words),
        parts={
            "sessions": Table(sessions, "Sessions"),
            "settings": Table(
                pl.DataFrame(settings, infer_schema_length=None), "Settings that the logs show"
            ),
            "counts": Table(pl.DataFrame(counts), "What was read"),
            "acceleration": Table(pl.DataFrame({"words": list(computed)}), "Energies from acceleration"),
        },
        warnings=_threshold_warnings(recording, recording.scenario),
    )


def write_pages(recording: Recording, folder: Path) -> list[str]:
    """Write a page of each session into ``folder``, with replayed beliefs if none are logged; return their names."""
    shown = recording if recording.logs_beliefs else with_beliefs(recording)
    names = [f"run-{run + 1}.html" for run in range(recording.runs.height)]
    for run, name in enumerate(names):
        title = f"{recording.sessions[run]['log']}{'' if shown is recording else ' (beliefs replayed, not logged)'}"
        write_run_page(shown, folder / name, run, title=title)
    return names


@report.register
def of_replays(found: Replays) -> Report:
    """Return what strategies would have decided on a recording's observations."""
    recording = found.recording
    outcomes = {name: session_outcomes(recording, one) for name, one in found.by_strategy.items()}
    logged = logged_outcomes(recording)
    first = next(iter(found.by_strategy.values())).scenario
    lost = [stated(share) if share is not None else "none" for share in shares_lost(recording).values()]
    parts = {
        "sessions": Table(
            pl.DataFrame(
                [_row("as logged", one) for one in logged]
                + [_row(name, one) for name, of_one in outcomes.items() for one in of_one],
                infer_schema_length=None,
            ).sort("session", maintain_order=True),
            "Sessions",
            "Limits: 5 % and 95 % quantiles over draws of the lost messages.",
        )
    }
    return Report(
        title="Replay of a recording",
        answer=(
            f"As logged: {_shares(logged)}.",
            "; ".join(f"{name}: {_shares(of_one)}" for name, of_one in outcomes.items()) + ".",
        ),
        parts=parts,
        setting=f"theta_E {stated(first.sensor.rms_threshold)}, p_c {stated(first.decision.credible_threshold)}, "
        f"O_c {first.decision.min_observations}, gate {first.decision.gate}; shares of lost messages {listed(lost)}",
        warnings=(*found.warnings, *_threshold_warnings(recording, first)),
        made_by={"seed": str(found.seed), "draws": str(found.draws)},
    )


@report.register
def of_threshold(found: Recommendation) -> Report:
    """Return which threshold to use, others by several rules, and whether the floor can be decided with them."""
    chosen, in_use = found.chosen, found.in_use
    rows = [
        {
            "rule": one.rule,
            "theta": one.value,
            "theta_low": one.low,
            "theta_high": one.high,
            "false_positive_share": one.all_samples.false_positive,
            "false_negative_share": one.all_samples.false_negative,
            "ones_share": one.share_by_session.estimate,
            "ones_share_low": one.share_by_session.low,
            "ones_share_high": one.share_by_session.high,
            "floor": one.decidable.verdict if one.tells_kinds_apart else "undecidable",
        }
        for one in (*found.thresholds, in_use)
    ]
    errors = chosen.all_samples
    parts = {
        "thresholds": Table(pl.DataFrame(rows, infer_schema_length=None), "Thresholds", titles={"theta": "theta_E"}),
        "unseen": Table(found.unseen, "Each session at the threshold of the others"),
    }  # fmt: skip
    if found.law is not None:
        parts["law"] = Table(
            found.law.rename({"low": "value_low", "high": "value_high"}), "Law of the sensor"
        )
    return Report(
        title="Threshold of the sensor",
        answer=(
            f"Use theta_E = {with_limits(Estimate(chosen.value, chosen.low, chosen.high), decimals=chosen.decimals)} "
            f"({chosen.rule}): {percent(errors.false_positive)} of the samples on still tiles and "
            f"{percent(errors.false_negative)} of those on vibrating tiles are read wrong.",
            chosen.decidable.says if chosen.tells_kinds_apart else "The floor cannot be decided.",
        ),
        parts=parts,
        warnings=(
            *(() if chosen.tells_kinds_apart else ("Energies do not tell tiles apart: is the floor right?",)),
            *(("The session judges itself.",) if found.unseen.is_empty() else ()),
        ),
    )


def _threshold_warnings(recording: Recording, scenario: Scenario) -> tuple[str, ...]:
    threshold = recording.scenario.sensor.rms_threshold
    if recording.knows("sensor.rms_threshold") or scenario.sensor.rms_threshold != threshold:
        return ()
    read = (recording.rows["energy"] > threshold).cast(pl.Int64)
    return () if (read != recording.observations["observation"]).any() else (UNKNOWN_THRESHOLD,)


def _shares(found: Sequence[SessionOutcome]) -> str:
    """Return how many sessions end with which consensus, mean over draws: ``right in 2.9 of 3 sessions``."""
    totals: dict[str, float] = {}
    for outcome in found:
        for name, share in outcome.consensus.items():
            totals[name] = totals.get(name, 0.0) + share
    if not totals:
        return "not known"
    each = listed(f"{name} in {number(total, digits=3)}" for name, total in totals.items())
    return f"{each} of {count(len(found), 'session')}"


def _row(name: str, found: SessionOutcome) -> dict[str, Any]:
    words = ", ".join(f"{outcome} {percent(share, None)}" for outcome, share in found.consensus.items())
    return {"session": found.session, "strategy": name} | asdict(found) | {"consensus": words}


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
