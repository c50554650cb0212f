"""Item 2: recordings and simulations compared: six similarities, error rates, battery, and three figures.

The similarity of a simulation is that of a set of three simulated sessions to the recordings, over sets of three.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.calibrate.camera import seen_through
from vibroswarm.calibrate.features import FEATURES, WORDS, sessions_of
from vibroswarm.calibrate.real_vs_simulated import Comparison, camera_between, compare
from vibroswarm.calibrate.session_statistics import FIGURES, figures_of
from vibroswarm.calibrate.similarity import RealCache, null_similarity, similarity
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import EMPIRICAL, published
from vibroswarm.paper.item import CLAIMS, Drawn, Item, Picture, Settings, Tables, TableView, Work
from vibroswarm.paper.real_data import (
    AUTHORS,
    REAL,
    draw_maps,
    draw_shares,
    hash_of,
    histograms_of,
    missing,
    read_recordings,
    real_floor,
)
from vibroswarm.plots import draw_error_bars
from vibroswarm.report.html import Column
from vibroswarm.result import Result
from vibroswarm.simulation import simulate

LABELS: Final = {
    "avoidance": "avoidance time per sample (s)",
    "vibrating": "energy on vibrating tiles (RMS)",
    "still": "energy on still tiles (RMS)",
}


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield states and energies, positions, steps: real robots next to each source; then the similarities."""
    yield Picture("calibration-states", "Time in each state", partial(_draw_states, tables["states"]))
    histograms = tables["histograms"]
    for feature in ("avoidance", "vibrating", "still"):
        part = histograms.filter(pl.col("feature") == feature)
        draw = partial(draw_shares, part.select("x", "share", series="source"), x_label=LABELS[feature])
        yield Picture(f"calibration-{feature}", WORDS[feature].capitalize(), draw)
    for feature in ("places", "distances", "steps"):
        part = histograms.filter(pl.col("feature") == feature)
        maps = partial(draw_maps, part.select("x", "y", "share", panel="source"), feature)
        yield Picture(f"calibration-{feature}", WORDS[feature].capitalize(), maps)
    # The mark is the similarity, the bar goes from null to ceiling.
    spans = tables["similarities"].select(
        x="feature", series="source", estimate="at equal counts",
        low=pl.min_horizontal("null", "at equal counts"), high=pl.max_horizontal("ceiling", "at equal counts"),
    )  # fmt: skip
    span = "span from uniform values to a perfect simulation"
    draw = partial(draw_error_bars, spans, label="cosine similarity", interval=span, spans=True)
    yield Picture("calibration-similarities", "Similarities between null and ceiling", draw)


def _draw_states(states: pl.DataFrame) -> Drawn:
    """Draw the share of time in each state, with intervals over sessions."""
    rows = [
        (state, source[0], *mean_interval(part[state].to_numpy())[:3], part.height)
        for state in ("walking", "sensing", "avoiding")
        for source, part in states.group_by("source", maintain_order=True)
    ]
    intervals = pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high", "runs"], orient="row")
    return draw_error_bars(
        intervals, label="share of time", percent=True, interval="95 % interval over sessions"
    )


SESSIONS: Final = 3
"""Number of recorded sessions, and of sessions in a set."""
THEIR_SETS: Final = 1
"""Sets of three sessions behind each printed similarity."""
NAMES: Final = {
    "avoidance": "state_times",
    "vibrating": "energy_vibrating",
    "still": "energy_non_vibrating",
    "places": "sample_positions",
    "distances": "distance_over_time",
    "steps": "distance_and_angle",
}
"""Names of the features in the paper."""
Sets = dict[str, list[tuple[float, float]]]


def similarity_by_set(real: Result, simulated: Result) -> Sets:
    """Return the similarity to the recordings of each set of three sessions, and of uniform values, by feature."""
    real_sessions = sessions_of(real)
    simulated_sessions = sessions_of(seen_through(simulated, camera_between(real, simulated)))
    by_feature: Sets = {}
    for feature in FEATURES:
        all_real = np.concatenate(real_sessions.values(feature))
        even: dict[int, float] = {}
        values = simulated_sessions.values(feature)
        for first in range(0, len(values), SESSIONS):
            some = np.concatenate(values[first : first + SESSIONS])
            count = min(len(all_real), len(some))
            if count not in even:
                even[count] = null_similarity(feature, all_real, count)
            by_feature.setdefault(feature, []).append((similarity(feature, all_real, some), even[count]))
    return by_feature


def printed(feature: str) -> float:
    """Return the printed similarity of a feature."""
    return float(published(f"calibration.cosine_similarity.{NAMES[feature]}"))


def authors_rows(found: Comparison) -> list[Row]:
    """Return the rows for the authors' own simulator against the recordings, minus the printed similarity."""
    return [
        exact(
            "calibration-printed",
            "paper",
            WORDS[row_of.feature],
            row_of.as_published - printed(row_of.feature),
        )
        for row_of in found.similarities
    ]


def column_rows(settings: Settings, column: str, sets: Sets) -> list[Row]:
    """Return the rows of all claims about a preset; ``sets`` are those of its simulation."""
    rows = []
    for feature, pairs in sets.items():
        alike, even = np.array(pairs).T
        published_value = printed(feature)
        rows.append(
            mean(
                "calibration-ours", column, WORDS[feature], alike, published_value, published_runs=THEIR_SETS
            )
        )
        rows.append(mean("calibration-tells", column, WORDS[feature], alike - even))
    return rows + error_rows(settings, column) + battery_rows(settings, column)


def error_rows(settings: Settings, column: str) -> list[Row]:
    """Return the rows of the error rates of each run on the real floor, at the column's own threshold; needs no
    recordings."""
    scenario = settings.scenario(column, real_floor(), parameter_set=EMPIRICAL)
    result = simulate(scenario, settings.seed, min(settings.runs, 100), energies=False)
    kinds = np.array([int(tile) for row in real_floor()["floor.tiles"] for tile in row])
    tile, read = (result.observations[name].to_numpy() for name in ("tile", "observation"))
    run, kind = result.observations["run"].to_numpy(), kinds[tile]
    shares = [np.bincount(run[kind == k], read[kind == k] != k) / np.bincount(run[kind == k]) for k in (0, 1)]
    names = ("false_positive", "false_negative")
    return [
        mean(
            "calibration-errors",
            column,
            name,
            share,
            less=float(published(f"calibration.{name}_share")),
            published_runs=SESSIONS,
        )
        for name, share in zip(names, shares, strict=True)
    ]


def battery_rows(settings: Settings, column: str) -> list[Row]:
    """Return the rows of the battery factor at both ends of a run, minus the printed one."""
    scenario = settings.scenario(column)
    ends = zip((0.0, scenario.run.t_end_s), published("calibration.battery_first_last"), strict=True)
    return [
        exact("battery", column, f"at {t_s:g} s", 1.0 - t_s / scenario.robot.battery_life_s - printed)
        for t_s, printed in ends
    ]


SETS: Final = 10
"""Sets of three simulated sessions behind an interval."""
ROBOTS, SIMULATOR = "real robots", "authors' simulator"
SHOWN_FIGURES: Final = (
    "start_speed_m_s", "drop", "between_m_s", "within_m_s", "spacing_s", "distance_m", "avoid_s", "density_corners",
    "near_walls", "lag_one_bits",
)  # fmt: skip


def _simulated(settings: Settings, column: str) -> Result:
    sets = min(SETS, max(2, settings.runs // SESSIONS))
    scenario = settings.scenario(column, real_floor(), parameter_set=EMPIRICAL)
    return simulate(scenario, settings.seed, sets * SESSIONS, segments=True)


def _first_set(result: Result) -> Result:
    return simulate(result.scenario, int(result.seed or 0), SESSIONS, segments=True)


def compute(work: Work) -> Tables:
    """Compute all comparisons with the recordings, and claims."""
    settings = work.settings
    assert settings.recordings is not None
    real, authors = (read_recordings(settings.recordings, names) for names in (REAL, AUTHORS))
    work.progress(0.2)
    simulated = {column: _simulated(settings, column) for column in settings.columns}
    sources: dict[str, Result] = {SIMULATOR: authors}
    sources |= {column: _first_set(source) for column, source in simulated.items()}
    comparisons: dict[str, Comparison] = {}
    known: RealCache = {}
    for place, (name, source) in enumerate(sources.items()):
        comparisons[name] = compare(real, source, known)
        work.progress(0.2 + 0.6 * (place + 1) / len(sources))
    sets = {column: similarity_by_set(real, source) for column, source in simulated.items()}
    measured = authors_rows(comparisons[SIMULATOR])
    for column in settings.columns:
        measured += column_rows(settings, column, sets[column])
    everything: dict[str, Result] = {ROBOTS: real, **sources}
    return {
        "similarities": _similarities(comparisons, sets),
        "distances": _distances(comparisons),
        "figures": _figures(settings, everything),
        "states": pl.concat([_states(name, source) for name, source in everything.items()]),
        "histograms": histograms_of(
            {name: seen_through(one, camera_between(real, one)) for name, one in everything.items()}
        ),
        CLAIMS: frame(measured),
    }


def _similarities(found: dict[str, Comparison], of_sets: dict[str, Sets]) -> pl.DataFrame:
    """Return the similarities of each source and feature with their references."""
    rows = []
    for source, comparison in found.items():
        for alike in comparison.similarities:
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
    """Return the energy distances and classifier accuracy of each source."""
    rows = []
    for source, comparison in found.items():
        named = [
            (WORDS[distance.feature], distance.effect, distance.real) for distance in comparison.distances
        ]
        named.append(
            (
                "share of stretches told apart",
                comparison.classifier.simulated_by_robot,
                comparison.classifier.real,
            )
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
    """Return the error rates at the threshold of preset ``paper``, and statistics of driving, by source."""
    threshold = settings.scenario("paper").sensor.rms_threshold
    rows = []
    for source, result in sources.items():
        for figure in figures_of(result, threshold):
            if (
                figure.name in (*SHOWN_FIGURES, "false_positive", "false_negative")
                and figure.interval is not None
            ):
                words, times = FIGURES[figure.name]
                ends = [times * value if np.isfinite(value) else None for value in figure.interval[:3]]
                rows.append((source, words, *ends, figure.interval.n))
    names = ["source", "figure", "mean", "low", "high", "sessions"]
    return pl.DataFrame(rows, schema=names, orient="row")


def _states(source: str, result: Result) -> pl.DataFrame:
    """Return the share of time in each state, one row per session."""
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
    TableView(
        "similarities",
        "Cosine similarity to the recordings: printed, for all samples pooled, and over sets of three simulated "
        "sessions, with that of uniform values and of a perfect simulation; by session, and real against real.",
        {
            "source": Column("source"), "feature": Column("feature"), "printed": Column("printed"),
            "as published": Column("pooled"), "sets": Column("over sets"), "sets_low": Column("from"),
            "sets_high": Column("to"), "null": Column("uniform"), "at equal counts": Column("equal counts"),
            "ceiling": Column("perfect"), "session": Column("by session"), "real session": Column("real by session"),
        },
    ),
    TableView(
        "distances",
        "Sharper measures: effect size of the energy distance, and accuracy of a classifier between these and real "
        "stretches of other robots (0.5: chance); the same for real against real. 95 % intervals over sessions.",
        {
            "source": Column("source"), "feature": Column("feature"), "effect": Column("effect"),
            "low": Column("from"), "high": Column("to"), "real": Column("real by real"),
            "real_low": Column("from"), "real_high": Column("to"),
        },
    ),
    TableView(
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
        "and our presets with P0 on that floor. What the text calls state times is avoidance time per sample; the "
        "real state times are drawn too. A cosine similarity alone says little: uniform values may score as high.",
    ),
    compute=compute,
    pictures=pictures,
    shown=_SHOWN,
    skipped=lambda settings: missing(settings.recordings),
    also=lambda settings: "" if settings.recordings is None else hash_of(settings.recordings),
)
