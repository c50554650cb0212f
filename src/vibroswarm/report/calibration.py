"""The reports of ``calibrate``: comparisons and fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial

import polars as pl

from vibroswarm.calibrate.camera import seen_through
from vibroswarm.calibrate.compare import STRETCH, Comparison
from vibroswarm.calibrate.fit import Fit, Fold
from vibroswarm.calibrate.histograms import draw_histograms, histograms_of
from vibroswarm.calibrate.samples import FEATURES, WORDS
from vibroswarm.core.numbers import count, listed, number, percent
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
        f"{count(len(found.changed), 'field')} fitted to {count(len(found.found.sessions), 'session')}.",
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
        frames = [fold.scores.select(pl.lit(fold.session).alias("session"), pl.all()) for fold in judged]
        parts["scores"] = Table(pl.concat(frames), "Held-out sessions")
    return Report("Fitted scenario", tuple(answer), parts)


def _limits(name: str, interval: Interval | None) -> dict[str, float | None]:
    return columns_of(name, interval if interval is not None else [None] * 3)


def _drawn(sources: Mapping[str, Result], feature: str) -> Picture:
    return draw_histograms(histograms_of(sources), feature)
