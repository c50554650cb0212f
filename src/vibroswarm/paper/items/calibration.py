"""Item 2: recordings and simulations compared: the six similarities, error rates, battery, and the three figures."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.calibrate.compare import Comparison, compare
from vibroswarm.calibrate.energy_distance import Known
from vibroswarm.calibrate.features import WORDS
from vibroswarm.calibrate.figures import FIGURES, figures_of
from vibroswarm.page.report import Column
from vibroswarm.paper.columns import EMPIRICAL
from vibroswarm.paper.histograms import histograms_of
from vibroswarm.paper.item import CLAIMS, Item, Settings, Shown, Tables, Work
from vibroswarm.paper.items.calibration_claims import (
    SESSIONS,
    Sets,
    alike_by_set,
    authors_rows,
    column_rows,
    printed,
)
from vibroswarm.paper.items.calibration_pictures import pictures
from vibroswarm.paper.measure import frame
from vibroswarm.paper.real_floor import real_floor
from vibroswarm.paper.recordings import AUTHORS, REAL, hash_of, missing, recorded
from vibroswarm.result import Result
from vibroswarm.simulation import simulate

SETS: Final = 10
"""Sets of three simulated sessions, for an interval."""
ROBOTS, SIMULATOR = "real robots", "authors' simulator"
SHOWN_FIGURES: Final = (
    "start_speed_m_s", "drop", "between_m_s", "within_m_s", "spacing_s", "distance_m", "avoid_s", "density_corners",
    "near_walls", "lag_one_bits",
)  # fmt: skip


def _simulated(settings: Settings, column: str) -> Result:
    sets = min(SETS, max(2, settings.runs // SESSIONS))
    scenario = settings.scenario(column, real_floor(), with_=EMPIRICAL)
    return simulate(scenario, settings.seed, sets * SESSIONS, segments=True)


def _first_set(result: Result) -> Result:
    return simulate(result.scenario, int(result.seed or 0), SESSIONS, segments=True)


def compute(work: Work) -> Tables:
    """All comparisons with the recordings, and claims."""
    settings = work.settings
    assert settings.recordings is not None
    real, authors = (recorded(settings.recordings, names) for names in (REAL, AUTHORS))
    work.tell(0.2)
    many = {column: _simulated(settings, column) for column in settings.columns}
    sources: dict[str, Result] = {SIMULATOR: authors} | {c: _first_set(one) for c, one in many.items()}
    found: dict[str, Comparison] = {}
    known: Known = {}
    for place, (name, one) in enumerate(sources.items()):
        found[name] = compare(real, one, known)
        work.tell(0.2 + 0.6 * (place + 1) / len(sources))
    sets = {column: alike_by_set(real, one) for column, one in many.items()}
    measured = authors_rows(found[SIMULATOR])
    for column in settings.columns:
        measured += column_rows(settings, column, sets[column])
    everything: dict[str, Result] = {ROBOTS: real, **sources}
    return {
        "similarities": _similarities(found, sets),
        "distances": _distances(found),
        "figures": _figures(settings, everything),
        "states": pl.concat([_states(name, one) for name, one in everything.items()]),
        "histograms": histograms_of({ROBOTS: real, **sources}),
        CLAIMS: frame(measured),
    }


def _similarities(found: dict[str, Comparison], of_sets: dict[str, Sets]) -> pl.DataFrame:
    rows = []
    for source, one in found.items():
        for alike in one.similarities:
            row: dict[str, Any] = {
                "source": source,
                "feature": WORDS[alike.feature],
                "printed": printed(alike.feature),
            }
            row["as published"] = alike.as_published
            if source in of_sets:
                ends = mean_interval([pair[0] for pair in of_sets[source][alike.feature]])[:3]
                row |= dict(zip(("sets", "sets_low", "sets_high"), ends, strict=True))
            else:
                row |= dict.fromkeys(("sets", "sets_low", "sets_high"))
            row |= {"null": alike.null, "at equal counts": alike.at_equal_counts, "ceiling": alike.ceiling}
            row["session"] = alike.by_session.mean
            row["real session"] = None if alike.real_by_session is None else alike.real_by_session.mean
            rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def _distances(found: dict[str, Comparison]) -> pl.DataFrame:
    rows = []
    for source, one in found.items():
        named = [(WORDS[each.feature], each.effect, each.real) for each in one.distances]
        named.append(
            ("share of stretches told apart", one.told_apart.simulated_by_robot, one.told_apart.real)
        )
        for feature, effect, real in named:
            row: dict[str, Any] = {"source": source, "feature": feature}
            row |= dict(zip(("effect", "low", "high"), effect[:3], strict=True))
            row |= dict(
                zip(("real", "real_low", "real_high"), real[:3] if real else (None,) * 3, strict=True)
            )
            rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def _figures(settings: Settings, sources: dict[str, Result]) -> pl.DataFrame:
    """Error rates at the threshold of preset paper, and how robots drive, source by source."""
    threshold = settings.scenario("paper").sensor.rms_threshold
    rows = []
    for source, result in sources.items():
        for one in figures_of(result, threshold):
            if one.name in (*SHOWN_FIGURES, "false_positive", "false_negative") and one.interval is not None:
                words, times = FIGURES[one.name]
                ends = [times * value if np.isfinite(value) else None for value in one.interval[:3]]
                rows.append((source, words, *ends, one.interval.n))
    names = ["source", "figure", "mean", "low", "high", "sessions"]
    return pl.DataFrame(rows, schema=names, orient="row")


def _states(source: str, result: Result) -> pl.DataFrame:
    """Share of time in each state, a row a session."""
    ends = result.ends.group_by("run", maintain_order=True).agg(pl.col("end_s").sum())
    spent = result.motion.group_by("run", maintain_order=True).agg(
        pl.col("avoid_s", "stop_s").cast(pl.Float64).sum()
    )
    both = ends.join(spent, on="run").sort("run")
    avoiding, sensing = pl.col("avoid_s") / pl.col("end_s"), pl.col("stop_s") / pl.col("end_s")
    return both.select(
        pl.lit(source).alias("source"),
        "run",
        avoiding=avoiding,
        sensing=sensing,
        walking=1.0 - avoiding - sensing,
    )


_SHOWN: Final = (
    Shown(
        "similarities",
        "Cosine similarity to the recordings: printed, all samples together, over sets of three simulated "
        "sessions, and "
        "where it stands between even scatter and a perfect simulation; by session, and real against real.",
        {
            "source": Column("source"), "feature": Column("feature"), "printed": Column("printed"),
            "as published": Column("together"), "sets": Column("over sets"), "sets_low": Column("from"),
            "sets_high": Column("to"), "null": Column("even scatter"), "at equal counts": Column("equal counts"),
            "ceiling": Column("perfect"), "session": Column("by session"), "real session": Column("real by session"),
        },
    ),
    Shown(
        "distances",
        "Measures that discriminate: effect size of the energy distance, and the share of stretches that a "
        "classifier tells "
        "from real ones of other robots (0.5: not at all); beside it real against real. 95 % intervals over "
        "sessions.",
        {
            "source": Column("source"), "feature": Column("feature"), "effect": Column("effect"),
            "low": Column("from"), "high": Column("to"), "real": Column("real by real"),
            "real_low": Column("from"), "real_high": Column("to"),
        },
    ),
    Shown(
        "figures",
        "Error rates at preset `paper`'s threshold, and how robots drive; 95 % intervals over "
        "sessions.",
        {
            "source": Column("source"), "figure": Column("figure"), "mean": Column("mean"), "low": Column("from"),
            "high": Column("to"), "sessions": Column("sessions"),
        },
    ),
)  # fmt: skip
ITEM: Final = Item(
    number=2,
    name="calibration",
    title="Calibration",
    about=(
        "Three recorded sessions of five robots with P0 on one floor, the logs of the authors' simulator, "
        "and our presets with "
        "P0 on that floor. What the text calls state times is avoidance time per sample; the real state "
        "times are drawn "
        "beside it. A cosine similarity says little by itself: even scatter may score as high.",
    ),
    compute=compute,
    pictures=pictures,
    shown=_SHOWN,
    skipped=lambda settings: missing(settings.recordings),
    also=lambda settings: "" if settings.recordings is None else hash_of(settings.recordings),
)
