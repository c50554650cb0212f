"""The reports of ``calibrate``: comparisons, figures of sessions, and fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import polars as pl

from vibroswarm.core.numbers import count, listed, number, percent, stated
from vibroswarm.lab.calibrate.camera import seen_through
from vibroswarm.lab.calibrate.classifier import STRETCH
from vibroswarm.lab.calibrate.compare import Comparison
from vibroswarm.lab.calibrate.cross_validation import Fold
from vibroswarm.lab.calibrate.features import FEATURES, WORDS
from vibroswarm.lab.calibrate.fit import Fit
from vibroswarm.lab.calibrate.histograms import AXES, draw_maps, draw_shares, histograms_of
from vibroswarm.lab.calibrate.session_statistics import FIGURES
from vibroswarm.lab.calibrate.session_statistics import Figure as SessionFigure
from vibroswarm.plots.picture import Picture
from vibroswarm.report.report import Figure, Report, Table, report
from vibroswarm.result import Result
from vibroswarm.statistics.intervals import Interval, columns_of


@report.register
def of_comparison(found: Comparison, sources: tuple[Result, Result] | None = None) -> Report:
    """Return what the comparison of a recording with a simulation says."""
    rows = [
        {
            "feature": WORDS[one.feature],
            "as_published": one.as_published,
            "null": one.null,
            "at_equal_counts": one.at_equal_counts,
            "ceiling": one.ceiling,
            **_limits("distance", one.distance),
            **_limits("real_distance", one.real_distance),
        }
        for one in found.likenesses
    ]
    most = max(found.likenesses, key=lambda one: one.distance.estimate)
    missing = [WORDS[name] for name in FEATURES if name not in {one.feature for one in found.likenesses}]
    recognised = found.recognised
    told = "" if recognised is None else f"{percent(recognised.estimate)} of stretches of {STRETCH} samples"
    titles = {
        "at_equal_counts": "similarity",
        "distance": "energy distance",
        "real_distance": "between real sessions",
    }
    parts: dict[str, Table | Figure] = {
        "features": Table(pl.DataFrame(rows, infer_schema_length=None), "Features", titles=titles)
    }
    if sources is not None:
        seen = {"real": sources[0], "simulated": seen_through(sources[1], found.camera)}
        for one in found.likenesses:
            parts[one.feature] = Figure(partial(_drawn, seen, one.feature), WORDS[one.feature])
    return Report(
        title="Recordings and simulation",
        answer=(
            f"A classifier recognises {told} as real or simulated (chance: 50 %)."
            if told
            else "Too few robots or samples for a classifier.",
            f"Most different: {WORDS[most.feature]}, energy distance {number(most.distance.estimate, 3)}.",
        ),
        parts=parts,
        setting="Positions as the camera of the recordings sees them." if found.camera.fields() else "",
        warnings=(f"Too few values of {listed(missing)}.",) if missing else (),
    )


def of_figures(figures: Mapping[str, Sequence[SessionFigure]], rms_threshold: float) -> Report:
    """Return figures of several results side by side, with 95 % intervals over sessions."""
    rows: list[dict[str, Any]] = []
    for place, (words, scale) in enumerate(FIGURES.values()):
        row: dict[str, Any] = {"statistic": words}
        for folder, of_folder in figures.items():
            limits = _limits(folder, of_folder[place].interval)
            row |= {name: None if value is None else scale * value for name, value in limits.items()}
        rows.append(row)
    return Report(
        title="Figures of sessions",
        answer=(f"Error rates are at a threshold of {stated(rms_threshold)}.",),
        parts={"figures": Table(pl.DataFrame(rows, infer_schema_length=None))},
    )


@report.register
def of_fit(found: Fit, judged: Sequence[Fold] = ()) -> Report:
    """Return a fitted scenario, the estimates behind it, and how it holds for what it was not fitted to."""
    outside = [name for name, (recorded, low, high) in found.predicted.items() if not low <= recorded <= high]
    fields = [{"field": name, "value": str(value)} for name, value in found.changed.items()]
    predicted = [
        {"statistic": name, "recorded": recorded, "simulated_low": low, "simulated_high": high}
        for name, (recorded, low, high) in found.predicted.items()
    ]
    answer = [
        f"{count(len(found.changed), 'field')} fitted to {count(found.sessions, 'session')}.",
        f"Avoidance outside of what the fit predicts: {listed(outside) if outside else 'nothing'}.",
    ]
    parts: dict[str, Table | Figure] = {
        "fields": Table(pl.DataFrame(fields), "Fitted fields"),
        "estimates": Table(
            pl.DataFrame([asdict(figure) for figure in found.figures]).rename(
                {"low": "value_low", "high": "value_high"}
            ),
            "Estimates",
        ),
        "predicted": Table(pl.DataFrame(predicted), "Avoidance, recorded and simulated", folded=True),
    }
    if judged:
        mean = sum(fold.accuracy for fold in judged) / len(judged)
        answer.append(
            f"A classifier tells {percent(mean)} of the stretches of held-out sessions from simulated ones "
            "(chance: 50 %)."
        )
        for name, title in (("scores", "Held-out sessions"), ("rates", "Bits of held-out sessions")):
            frames = [
                getattr(fold, name).insert_column(0, pl.lit(fold.session).alias("session")) for fold in judged
            ]
            parts[name] = Table(pl.concat(frames), title)
    return Report(
        "Fitted scenario", tuple(answer), parts, setting=f"{count(found.motion_runs, 'run')} of motion"
    )


def _limits(name: str, interval: Interval | None) -> dict[str, float | None]:
    return columns_of(name, interval if interval is not None else [None] * 3)


def _drawn(sources: Mapping[str, Result], feature: str) -> Picture:
    frame = histograms_of(sources).filter(feature=feature)
    if frame["y"].null_count():
        return draw_shares(frame.select("x", "share", series="source"), x_label=AXES[feature][0])
    return draw_maps(frame.select("x", "y", "share", panel="source"), feature)
