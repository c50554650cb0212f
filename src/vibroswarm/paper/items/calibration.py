"""Item 2: recordings and simulations compared: six similarities, error rates, battery.

The recordings are three sessions, so simulated ones are compared in sets of three: the set is the independent unit.
The null is the similarity of uniform values to the recordings, the ceiling that of a perfect simulation.
"""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.camera import seen_through
from vibroswarm.calibrate.compare import Comparison, camera_between, compare, null_similarity, similarity
from vibroswarm.calibrate.histograms import draw_histograms, histograms_of
from vibroswarm.calibrate.samples import FEATURES, WORDS, by_session, values_of
from vibroswarm.core.numbers import number, stated
from vibroswarm.paper.claims import all_claims, constant, mean, state
from vibroswarm.paper.columns import (
    AUTHORS,
    EMPIRICAL,
    REAL,
    missing_in,
    published,
    read_recordings,
    real_floor,
    scenario_of,
)
from vibroswarm.paper.item import Drawn, Made, Settings, Work
from vibroswarm.plots import draw_error_bars
from vibroswarm.result import Result
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import columns_of, mean_interval

SESSIONS: Final = 3
SETS: Final = 10
"""Most sets of three simulated sessions."""
ROBOTS, SIMULATOR = "real robots", "authors' simulator"
NAMES: Final = {
    "avoidance": "state_times",
    "vibrating": "energy_vibrating",
    "still": "energy_non_vibrating",
    "places": "sample_positions",
    "distances": "distance_over_time",
    "steps": "distance_and_angle",
}
"""Names of the features in the paper."""


def missing(settings: Settings) -> str:
    """Return why the item cannot be computed; empty if it can."""
    return missing_in(settings.recordings) or ("" if find_spec("sklearn") else "needs scikit-learn")


def compute(work: Work, made: Made) -> None:
    """Compare the authors' simulator and our presets with the recordings."""
    settings = work.settings
    assert settings.recordings is not None
    real, authors = (read_recordings(settings.recordings, names) for names in (REAL, AUTHORS))
    sources: dict[str, Result] = {ROBOTS: real, SIMULATOR: authors}
    comparisons = dict[str, Comparison]()
    rows: list[dict[str, Any]] = []
    for column in settings.columns:
        scenario = scenario_of(column, real_floor(), parameter_set=EMPIRICAL)
        sets = min(SETS, max(2, settings.runs // SESSIONS))
        simulated = simulate(scenario, settings.seed, sets * SESSIONS, poses=True)
        rows += _measure(made, column, real, simulated)
        sources[column] = simulate(scenario, settings.seed, SESSIONS, poses=True)  # the first set
        _errors_and_battery(settings, made, column)
    for name in (SIMULATOR, *settings.columns):
        comparisons[name] = compare(real, sources[name])
    for one in comparisons[SIMULATOR].likenesses:
        less = one.as_published - _printed(one.feature)
        made.values.append(constant("calibration-printed", "paper", WORDS[one.feature], less))
    made.tables |= {
        "similarities": _similarities(comparisons),
        "sets": pl.DataFrame(rows),
        "distances": _distances(comparisons),
        "states": pl.concat([_states(name, source) for name, source in sources.items()]),
    }
    _draw(made, {name: seen_through(one, camera_between(real, one)) for name, one in sources.items()})


def _printed(feature: str) -> float:
    return float(published(f"calibration.cosine_similarity.{NAMES[feature]}"))


def _measure(made: Made, column: str, real: Result, simulated: Result) -> list[dict[str, Any]]:
    real_sessions = by_session(real)
    simulated_sessions = by_session(seen_through(simulated, camera_between(real, simulated)))
    (claim,) = (claim for claim in all_claims() if claim.id == "calibration-ours")
    rows = []
    for feature in FEATURES:
        whole = np.concatenate([values_of(session, feature) for session in real_sessions])
        values = [values_of(session, feature) for session in simulated_sessions]
        sets = [np.concatenate(values[k : k + SESSIONS]) for k in range(0, len(values), SESSIONS)]
        counts = [min(len(whole), len(one)) for one in sets]
        null_of = {count: null_similarity(feature, whole, count) for count in set(counts)}
        found = np.array([similarity(feature, whole, one) for one in sets])
        nulls = np.array([null_of[count] for count in counts])
        label, printed = WORDS[feature], _printed(feature)
        even = float(nulls.mean()) - printed
        is_easy = state(even, even, claim.bounds) == "within"
        why = f"evenly scattered points have {number(even, 3, sign=True)}" if is_easy else ""
        error = float(found.std(ddof=1))  # of the one set of the paper
        made.values += [
            mean("calibration-ours", column, label, found, printed, published_error=error, cannot=why),
            mean("calibration-tells", column, label, found - nulls),
        ]
        similarities = columns_of("similarity", mean_interval(found))
        rows.append(
            {"source": column, "feature": label, "printed": printed, **similarities, "sets": len(sets)}
        )
    return rows


def _errors_and_battery(settings: Settings, made: Made, column: str) -> None:
    made.values += error_values(settings, column)
    scenario = scenario_of(column)
    first_last = published("calibration.battery_first_last")
    for t_s, printed in zip((0.0, scenario.run.t_end_s), first_last, strict=True):
        less = 1.0 - t_s / scenario.robot.battery_life_s - printed
        made.values.append(constant("battery", column, f"at {stated(t_s)} s", less))


def error_values(settings: Settings, column: str) -> list[Any]:
    """Return false positives and false negatives on the real floor, less the published ones of three sessions."""
    scenario = scenario_of(column, real_floor(), parameter_set=EMPIRICAL)
    result = simulate(scenario, settings.seed, min(settings.runs, 100), energies=False)
    kinds = np.array([int(tile) for row in real_floor()["floor.tiles"] for tile in row])
    run, tile, read = (result.observations[name].to_numpy() for name in ("run", "tile", "observation"))
    values = []
    for kind, name in enumerate(("false_positive", "false_negative")):
        on_kind = kinds[tile] == kind
        share = np.bincount(run[on_kind], read[on_kind] != kind) / np.bincount(run[on_kind])
        error, printed = (
            float(np.nanstd(share, ddof=1)) / SESSIONS**0.5,
            published(f"calibration.{name}_share"),
        )
        values.append(mean("calibration-errors", column, name, share, printed, published_error=error))
    return values


def _similarities(comparisons: dict[str, Comparison]) -> pl.DataFrame:
    rows = [
        {
            "source": source, "feature": WORDS[one.feature], "printed": _printed(one.feature),
            "pooled": one.as_published, "null": one.null, "at_equal_counts": one.at_equal_counts,
            "ceiling": one.ceiling,
        }
        for source, comparison in comparisons.items()
        for one in comparison.likenesses
    ]  # fmt: skip
    return pl.DataFrame(rows, infer_schema_length=None)


def _distances(comparisons: dict[str, Comparison]) -> pl.DataFrame:
    """Return effect sizes of energy distances and a classifier's accuracy, beside those of real against real."""
    rows = []
    for source, comparison in comparisons.items():
        measures = [(WORDS[one.feature], one.distance, one.real_distance) for one in comparison.likenesses]
        if comparison.recognised is not None:
            measures.append(("stretches told apart", comparison.recognised, None))
        for feature, effect, real in measures:
            row = {"source": source, "feature": feature, **columns_of("effect", effect)}
            rows.append(row | columns_of("real", real or [None] * 3))
    return pl.DataFrame(rows, infer_schema_length=None)


def _states(source: str, result: Result) -> pl.DataFrame:
    """Return the share of time in each state, its mean over sessions with limits; walking is what is left."""
    ends = result.ends.group_by("run").agg(pl.col("end_s").sum())
    spent = result.motion.group_by("run").agg(pl.col("avoid_s", "stop_s").cast(pl.Float64).sum())
    both = ends.join(spent, on="run").sort("run")
    avoiding, sensing = both["avoid_s"] / both["end_s"], both["stop_s"] / both["end_s"]
    shares = {"walking": 1.0 - avoiding - sensing, "sensing": sensing, "avoiding": avoiding}
    rows = [
        {
            "source": source,
            "state": name,
            **columns_of("time_share", mean_interval(values)),
            "runs": both.height,
        }
        for name, values in shares.items()
    ]
    return pl.DataFrame(rows, schema_overrides={"time_share_low": pl.Float64, "time_share_high": pl.Float64})


def _draw(made: Made, sources: dict[str, Result]) -> None:
    ends = {"estimate": "time_share", "low": "time_share_low", "high": "time_share_high"}
    states = made.tables["states"].select("runs", x="state", series="source", **ends)
    draw = partial(draw_error_bars, states, label="share of time", percent=True)
    made.pictures["calibration-states"] = Drawn("Time in each state", draw)
    histograms = histograms_of(sources)
    for feature in NAMES:
        drawn = partial(draw_histograms, histograms, feature)
        made.pictures[f"calibration-{feature}"] = Drawn(WORDS[feature].capitalize(), drawn)
    at = pl.col("at_equal_counts")
    spans = made.tables["similarities"].select(
        x="feature", series="source", estimate=at, low=pl.min_horizontal("null", at),
        high=pl.max_horizontal("ceiling", at),
    )  # fmt: skip
    label = "cosine similarity, from uniform values to a perfect simulation"
    drawn = partial(draw_error_bars, spans, label=label, spans=True)
    made.pictures["calibration-similarities"] = Drawn("Similarities between null and ceiling", drawn)
