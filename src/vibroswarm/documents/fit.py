"""The document of a scenario that was fitted to recordings, and of its validation on held-out sessions."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final

import polars as pl

from vibroswarm.calibrate.classifier import STRETCH
from vibroswarm.calibrate.cross_validation import Fold
from vibroswarm.calibrate.features import WORDS
from vibroswarm.calibrate.fit import LACKS, Fit
from vibroswarm.core.numbers import (
    Estimate,
    count,
    decimals_of,
    listed,
    number,
    percent,
    with_limits,
)
from vibroswarm.show.document import Column, Document, Part, Section, Table, Text

DIGITS: Final = 5
"""Significant digits of estimates, which become fields of a scenario."""


def fit_document(found: Fit, judged: Sequence[Fold] = ()) -> Document:
    """Return what a fit says: its fields, the estimates behind them, checks, and what the model lacks.

    Args:
        judged: the validation on each held-out session; empty: none was made.
    """
    fields = "\n".join(f"{name} = {_as_toml(value)}" for name, value in found.changed.items())
    estimates = [
        {
            "figure": one.name,
            "value": with_limits(
                Estimate(one.value, one.low, one.high),
                decimals=decimals_of((one.value, one.low, one.high), DIGITS),
            ),
            "error": number(one.error, digits=2),
        }
        for one in found.figures
    ]
    columns = {"value": Column("value (95 %)"), "error": Column("standard error")}
    parts: list[Part] = [
        Section("Fields of the scenario", (Text(fields, "code"),)),
        _settings(found),
        Table(pl.DataFrame(estimates), columns, "Estimates behind them.", "figures"),
        _predicted(found),
        Section("What the model lacks", tuple(map(Text, LACKS))),
        *(_held_out(judged) if judged else ()),
    ]
    return Document(
        title="Fitted scenario",
        answer=(
            f"{count(len(found.changed), 'field')} fitted on {count(found.sessions, 'session')}, with "
            f"{count(found.motion_runs, 'run')} of motion.",
            _agreement_of_avoidance(found),
            _validity(judged) if judged else "",
        ),
        parts=tuple(parts),
        made_by={"sessions": str(found.sessions), "motion_runs": str(found.motion_runs)},
        data=_tables_for_json(found, judged),
    )


def _as_toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')


def _settings(found: Fit) -> Table:
    name = "sample.timer"
    frame = pl.DataFrame([{"setting": name, "value": found.scenario[name], "evidence": "assumed"}])
    return Table(frame, caption="Settings of the robots.", name="settings")


def _is_inside(limits: tuple[float, float, float]) -> bool:
    recorded, low, high = limits
    return low <= recorded <= high


def _agreement_of_avoidance(found: Fit) -> str:
    outside = [name for name, limits in found.predicted.items() if not _is_inside(limits)]
    if not outside:
        return "All figures of the recorded avoidance lie in the range of 95 % of the sessions simulated with the fit."
    return f"Outside the range of 95 % of the sessions simulated with the fit: {listed(outside)}."


def _predicted(found: Fit) -> Table:
    """Return recorded figures of avoidance, and 95 % of single sessions simulated with the fit."""
    rows = [
        {
            "figure": name,
            "recorded": number(limits[0], 4),
            "simulated": f"[{number(limits[1], 4)}, {number(limits[2], 4)}]",
            "verdict": "inside" if _is_inside(limits) else "outside",
        }
        for name, limits in found.predicted.items()
    ]
    caption = "Predictive check of avoidance: recorded, and 95 % of single sessions simulated with the fit."
    columns = {"verdict": Column(tones={"outside": "bad"})}
    return Table(pl.DataFrame(rows), columns, caption, "predictive_check")


def _validity(judged: Sequence[Fold]) -> str:
    """Say how well classifiers tell held-out sessions from the fit, and from another simulator if there is one."""
    fitted = statistics.mean(fold.accuracy_fitted for fold in judged)
    other = statistics.mean(fold.accuracy_simulator for fold in judged)
    versus = "" if math.isnan(other) else f"; from those of the other simulator {percent(other)}"
    return (
        f"Held-out sessions: a classifier, trained on other robots, tells {percent(fitted)} of the stretches of "
        f"{STRETCH} samples from simulated ones{versus} (50 %: chance)."
    )


SOURCES: Final = {
    "fitted": "similarity, fitted",
    "other_sessions": "similarity, real",
    "other_simulator": "similarity, against",
    "distance_fitted": "distance, fitted",
    "distance_sessions": "distance, real",
    "distance_simulator": "distance, against",
}
"""Headings of the fields of ``Score``."""


def _held_out(judged: Sequence[Fold]) -> list[Part]:
    """Return how well held-out sessions are predicted by the fits to the other sessions."""
    scores = [
        {"feature": WORDS[judged[0].scores[place].feature]}
        | {name: statistics.mean(getattr(fold.scores[place], name) for fold in judged) for name in SOURCES}
        for place in range(len(judged[0].scores))  # every fold has the same features in the same order
    ]
    columns = {name: Column(title, decimals=4) for name, title in SOURCES.items()}
    caption = (
        f"Fitted on the other sessions, validated on the held-out one: mean over {count(len(judged), 'session')} "
        "(fitted: simulated with the fit; real: the other sessions; against: the other simulator)."
    )
    frame = pl.DataFrame(scores).select(
        "feature", *(name for name in SOURCES if not all(math.isnan(row[name]) for row in scores))
    )
    return [Table(frame, columns, caption, "held_out"), readings_table(judged)]


def readings_table(judged: Sequence[Fold]) -> Table:
    """Return statistics of the bits that robots read, recorded and simulated with the fit, and their deviations.

    A statistic has a row if it is known in some session, and a dash for each session in which it is unknown.
    """
    of_folds = [{reading.name: reading for reading in fold.readings} for fold in judged]
    rows = []
    for name in dict.fromkeys(name for of_fold in of_folds for name in of_fold):
        known = [of_fold[name] for of_fold in of_folds if name in of_fold]
        rows.append(
            {
                "statistic": name,
                "recorded": number(statistics.mean(one.recorded for one in known), 3),
                "fitted": number(statistics.mean(one.simulated for one in known), 3),
                "deviations": ", ".join(
                    number(of_fold[name].deviation, 1, sign=True) if name in of_fold else "-"
                    for of_fold in of_folds
                ),
            }
        )
    columns = {"deviations": Column("deviation of each session, in s.d. of a session")}
    return Table(pl.DataFrame(rows), columns, "What robots read in held-out sessions.", "held_out_readings")


def _tables_for_json(found: Fit, judged: Sequence[Fold]) -> dict[str, pl.DataFrame]:
    folds = [fold.as_dict() for fold in judged]
    return {
        "fields": pl.DataFrame([found.changed]),
        "figures": pl.DataFrame([asdict(figure) for figure in found.figures]),
        "predictive_check": pl.DataFrame(
            [{"figure": name, "recorded": recorded, "low": low, "high": high}
             for name, (recorded, low, high) in found.predicted.items()]
        ),
        "camera": pl.DataFrame([asdict(found.camera)]),
        "lacks": pl.DataFrame({"words": LACKS}),
        "folds": pl.DataFrame(
            [{name: fold[name] for name in ("session", "told_apart", "told_apart_other")} for fold in folds]
        ),
        "fold_fields": pl.DataFrame([{"session": fold["session"], **fold["fields"]} for fold in folds]),
        "fold_scores": pl.DataFrame([{"session": fold["session"], **row} for fold in folds for row in fold["scores"]]),
        "fold_readings": pl.DataFrame(
            [{"session": fold["session"], **row} for fold in folds for row in fold["readings"]]
        ),
    }  # fmt: skip
