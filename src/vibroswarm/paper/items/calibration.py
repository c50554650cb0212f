"""Item 2: recordings and simulations compared: six similarities, error rates, battery, and three figures.

A session is one run. The recordings are three sessions, so simulated sessions are compared in sets of three: each set
has a similarity to the recordings, and the similarity of a simulation is the mean over its sets. A source is the real
robots, the authors' simulator, or a column, which is a preset of the reproduction. The "null" is the similarity of
uniformly spread values to the recordings; the "ceiling" is the similarity that a perfect simulation would have. The
measured values of the claims are rows of ``claims.MEASURED``.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.calibrate.camera import seen_through
from vibroswarm.calibrate.compare import Comparison, camera_between, compare, null_similarity, similarity
from vibroswarm.calibrate.features import FEATURES, WORDS, values_of
from vibroswarm.calibrate.histograms import draw_maps, draw_shares, histograms_of
from vibroswarm.calibrate.samples import by_session
from vibroswarm.calibrate.session_statistics import FIGURES, figures_of
from vibroswarm.core.numbers import stated
from vibroswarm.paper.claim_values import Row, exact, frame, mean
from vibroswarm.paper.columns import (
    AUTHORS,
    EMPIRICAL,
    REAL,
    hash_of,
    missing,
    published,
    read_recordings,
    real_floor,
)
from vibroswarm.paper.item import CLAIMS, Item, Picture, Settings, Tables, TableView, Work, picture
from vibroswarm.plots import draw_error_bars
from vibroswarm.result import Result
from vibroswarm.show.document import Column
from vibroswarm.simulation import simulate
from vibroswarm.statistics.intervals import columns_of, mean_interval, plain

LABELS: Final = {
    "avoidance": "avoidance time per sample (s)",
    "vibrating": "energy on vibrating tiles (RMS)",
    "still": "energy on still tiles (RMS)",
}
"""Labels of the x axis, by feature."""


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """Yield pictures of states, energies, positions and steps of all sources, then of the similarities."""
    yield picture(
        "calibration-states", "Time in each state", draw_error_bars, _state_shares(tables["states"]),
        label="share of time", percent=True, interval="95 % interval over sessions",
    )  # fmt: skip
    histograms = tables["histograms"]
    # A value of these features is one number, drawn as a step line; a value of the others is a pair, drawn as a map.
    for feature in ("avoidance", "vibrating", "still"):
        shares = histograms.filter(pl.col("feature") == feature).select("x", "share", series="source")
        yield picture(
            f"calibration-{feature}",
            WORDS[feature].capitalize(),
            draw_shares,
            shares,
            x_label=LABELS[feature],
        )
    for feature in ("places", "distances", "steps"):
        shares = histograms.filter(pl.col("feature") == feature).select("x", "y", "share", panel="source")
        yield picture(f"calibration-{feature}", WORDS[feature].capitalize(), draw_maps, shares, feature)
    # The mark is the similarity "at equal counts": with as many values of each source as null and ceiling are computed
    # for. The bar goes from null to ceiling, and at least to the mark, which may lie beyond them.
    spans = tables["similarities"].select(
        x="feature", series="source", estimate="at equal counts",
        low=pl.min_horizontal("null", "at equal counts"), high=pl.max_horizontal("ceiling", "at equal counts"),
    )  # fmt: skip
    yield picture(
        "calibration-similarities", "Similarities between null and ceiling", draw_error_bars, spans,
        label="cosine similarity", interval="span from uniform values to a perfect simulation", spans=True,
    )  # fmt: skip


def _state_shares(states: pl.DataFrame) -> pl.DataFrame:
    """Return the mean share of time in each state and source with its limits, and the number of sessions.

    Args:
        states: table of ``_states`` for all sources.
    """
    rows = [
        (state, source, *mean_interval(part[state].to_numpy())[:3], part.height)
        for state in ("walking", "sensing", "avoiding")
        for (source,), part in states.group_by("source", maintain_order=True)
    ]
    return pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high", "runs"], orient="row")


SESSIONS: Final = 3
"""Number of recorded sessions, and number of simulated sessions in a set."""
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
"""By feature, for each set: its similarity to the recordings, and the similarity of uniform values (the null)."""


def similarity_by_set(real: Result, simulated: Result) -> Sets:
    """Return the similarity of each set of three simulated sessions to the recordings, and its null, by feature.

    The null depends on the number of values. It is computed with as many uniform values as the set has (or the
    recordings, if they have fewer), once for all sets with the same number of values.

    Args:
        real: the recordings. simulated: simulated sessions; each three successive ones are a set, none is left over.
    """
    sessions = by_session(real), by_session(seen_through(simulated, camera_between(real, simulated)))
    by_feature: Sets = {}
    for feature in FEATURES:
        all_real = np.concatenate([values_of(one, feature) for one in sessions[0]])
        nulls: dict[int, float] = {}  # by number of values
        values = [values_of(one, feature) for one in sessions[1]]
        for first in range(0, len(values), SESSIONS):
            set_values = np.concatenate(values[first : first + SESSIONS])
            count = min(len(all_real), len(set_values))
            if count not in nulls:
                nulls[count] = null_similarity(feature, all_real, count)
            pair = (similarity(feature, all_real, set_values), nulls[count])
            by_feature.setdefault(feature, []).append(pair)
    return by_feature


def printed(feature: str) -> float:
    """Return the similarity of a feature that the paper prints."""
    return float(published(f"calibration.cosine_similarity.{NAMES[feature]}"))


def column_rows(settings: Settings, column: str, sets: Sets) -> list[Row]:
    """Return the measured values of all claims about a column (preset).

    For each feature there are two values: the similarity minus the printed similarity, and the similarity minus the
    null. Both are means over sets of three simulated sessions, which are the independent units here. The values of the
    claims about error rates and about the battery follow.

    Args:
        sets: from ``similarity_by_set``, for the simulation of this column.
    """
    rows = []
    for feature, pairs in sets.items():
        similarities, nulls = np.array(pairs).T
        published_value = printed(feature)
        rows.append(
            mean(
                value_name="simulated-similarity-less-printed",
                column=column,
                cell=WORDS[feature],
                values=similarities,
                less=published_value,
                published_runs=published("calibration.sets_of_sessions"),
            )
            | {"scattered": float(nulls.mean()) - published_value}
        )
        rows.append(mean("similarity-less-scattered", column, WORDS[feature], similarities - nulls))
    return rows + error_rows(settings, column) + battery_rows(settings, column)


def error_rows(settings: Settings, column: str) -> list[Row]:
    """Return the measured values of the claim about error rates: false positives and false negatives.

    A value is the mean rate over simulated runs on the real floor, at the threshold of the column's preset, minus the
    published rate. The error of the published rate is included, as that of a mean over the recorded sessions.
    """
    scenario = settings.scenario(column, real_floor(), parameter_set=EMPIRICAL)
    runs = min(settings.runs, 100)  # a run has many readings, so 100 runs at most are enough
    result = simulate(scenario, settings.seed, runs, energies=False)
    kinds = np.array([int(tile) for row in real_floor()["floor.tiles"] for tile in row])  # by tile index
    run, tile, read = (result.observations[name].to_numpy() for name in ("run", "tile", "observation"))
    kind = kinds[tile]  # 0: still, 1: vibrating
    wrong = read != kind
    # Share of wrong readings of each run, on still and on vibrating tiles. It is NaN (0 / 0) in a run without readings
    # on such tiles; ``mean`` leaves such a run out.
    shares = [
        np.bincount(run[on_kind], wrong[on_kind]) / np.bincount(run[on_kind])
        for on_kind in (kind == 0, kind == 1)
    ]
    names = ("false_positive", "false_negative")
    return [
        mean(
            "error-rate-less-printed",
            column,
            name,
            share,
            less=float(published(f"calibration.{name}_share")),
            published_runs=SESSIONS,
        )
        for name, share in zip(names, shares, strict=True)
    ]


def battery_rows(settings: Settings, column: str) -> list[Row]:
    """Return the measured values of the claim about the battery.

    They are the battery factors at the beginning and at the end of a run, minus the printed factors. The battery factor
    at time t is 1 - t / ``robot.battery_life_s``.
    """
    scenario = settings.scenario(column)
    ends = zip((0.0, scenario.run.t_end_s), published("calibration.battery_first_last"), strict=True)
    return [
        exact(
            "battery-factor-less-printed",
            column,
            f"at {stated(t_s)} s",
            1.0 - t_s / scenario.robot.battery_life_s - printed_factor,
        )
        for t_s, printed_factor in ends
    ]


SETS: Final = 10
"""Sets of three simulated sessions behind an interval."""
ROBOTS, SIMULATOR = "real robots", "authors' simulator"
"""Names of the sources that are no presets."""
SHOWN_FIGURES: Final = (
    "start_speed_m_s", "drop", "between_m_s", "within_m_s", "spacing_s", "distance_m", "avoid_s", "density_corners",
    "near_walls", "lag_one_bits",
)  # fmt: skip
"""Names of the statistics of ``session_statistics`` that are shown, besides the error rates."""


def _simulated(settings: Settings, column: str) -> Result:
    """Simulate all sets of sessions with P0 on the real floor: at least two sets, and at most ``SETS``.

    Between these bounds, there are as many sets as the runs of the reproduction allow. Two are needed for an interval
    over sets.
    """
    sets = min(SETS, max(2, settings.runs // SESSIONS))
    scenario = settings.scenario(column, real_floor(), parameter_set=EMPIRICAL)
    return simulate(scenario, settings.seed, sets * SESSIONS, poses=True)


def _first_set(result: Result) -> Result:
    """Return the first set of sessions of a simulation, as a result of its own.

    A ``Result`` has no method that selects runs, so the sessions are simulated again. They are the same sessions,
    because a run does not depend on how many runs are simulated.

    Args:
        result: simulation with at least one set of sessions.
    """
    seed = int(result.seed or 0)  # None only for recordings, so 0 is never used
    return simulate(result.scenario, seed, SESSIONS, poses=True)


def compute(work: Work) -> Tables:
    """Compare the authors' simulator and our presets with the recordings, and measure the values for the claims.

    Return tables of similarities, energy distances, error rates and driving, time in each state, and histograms, for
    each source; and the claims' measured values.
    """
    settings = work.settings
    assert settings.recordings is not None  # otherwise the item is skipped
    real, authors = (read_recordings(settings.recordings, names) for names in (REAL, AUTHORS))
    work.progress(0.2)
    simulated = {column: _simulated(settings, column) for column in settings.columns}
    # One set of sessions of each preset is compared in detail, because the authors' simulator has one set too.
    sources: dict[str, Result] = {SIMULATOR: authors}
    sources |= {column: _first_set(source) for column, source in simulated.items()}
    comparisons: dict[str, Comparison] = {}
    for place, (name, source) in enumerate(sources.items()):
        comparisons[name] = compare(real, source)
        work.progress(0.2 + 0.6 * (place + 1) / len(sources))
    sets = {column: similarity_by_set(real, source) for column, source in simulated.items()}
    # The authors' own simulator, less what they print of it.
    measured = [
        exact(
            value_name="recomputed-similarity-less-printed",
            column="paper",
            cell=WORDS[similarities.feature],
            value=similarities.as_published - printed(similarities.feature),
        )
        for similarities in comparisons[SIMULATOR].likenesses
    ]
    for column in settings.columns:
        measured += column_rows(settings, column, sets[column])
    everything: dict[str, Result] = {ROBOTS: real, **sources}
    return {
        "similarities": _similarities(comparisons, sets),
        "distances": _distances(comparisons),
        "figures": _figures(settings, everything),
        "states": pl.concat([_states(name, source) for name, source in everything.items()]),
        # Simulated positions are drawn as the camera would have seen them; recordings stay as they are.
        "histograms": histograms_of(
            {name: seen_through(one, camera_between(real, one)) for name, one in everything.items()}
        ),
        CLAIMS: frame(measured),
    }


def _similarities(found: dict[str, Comparison], of_sets: dict[str, Sets]) -> pl.DataFrame:
    """Return one row for each source and feature: its similarities to the recordings, null and ceiling.

    The similarities are the printed one; "as published", with all values of the compared sessions and with the
    avoidance times that the authors computed; "sets", the mean over sets, with its limits; "at equal counts", with as
    many values of each source as null and ceiling are computed for; and "session", the mean over pairs of a real and a
    simulated session. "real session" is the mean over pairs of real sessions.

    Args:
        found: comparison of each source with the recordings.
        of_sets: ``similarity_by_set`` of the sources that are presets; other sources have only one set.
    """
    rows = []
    for source, comparison in found.items():
        for similarities in comparison.likenesses:
            feature = similarities.feature
            row: dict[str, Any] = {
                "source": source,
                "feature": WORDS[feature],
                "printed": printed(feature),
                "as published": similarities.as_published,
            }
            # Mean over sets of three sessions, with its limits.
            sets = [similarity for similarity, _ in of_sets[source][feature]] if source in of_sets else []
            row |= columns_of("sets", mean_interval(sets) if sets else [None] * 3)
            row |= {
                "null": similarities.null,
                "at equal counts": similarities.at_equal_counts,
                "ceiling": similarities.ceiling,
            }
            rows.append(row)
    return pl.DataFrame(rows, infer_schema_length=None)


def _distances(found: dict[str, Comparison]) -> pl.DataFrame:
    """Return the energy distance of each source and feature, then the classifier's accuracy, one row each.

    Each row has two measures with their intervals: the source against the recordings (effect), and the recordings
    against each other (real).

    Args:
        found: comparison of each source with the recordings.
    """
    rows = []
    for source, comparison in found.items():
        measures = [(WORDS[one.feature], one.distance, one.real_distance) for one in comparison.likenesses]
        if comparison.recognised is not None:
            measures.append(("share of stretches told apart", comparison.recognised, None))
        for feature, effect, real in measures:
            row = {"source": source, "feature": feature}
            rows.append(row | columns_of("effect", effect) | columns_of("real", real or [None] * 3))
    return pl.DataFrame(rows, infer_schema_length=None)


def _figures(settings: Settings, sources: dict[str, Result]) -> pl.DataFrame:
    """Return error rates and statistics of driving, one row for each source and statistic.

    The energies of all sources are compared with the threshold of preset ``paper``, so that error rates are comparable.
    The positions of simulations are the true ones, not those that the camera would have seen. A statistic without a
    value in any session has no row; limits that are not finite, as with one session, are null.

    Args:
        settings: options of the reproduction. sources: results by name.
    """
    threshold = settings.scenario("paper").sensor.rms_threshold
    rows = []
    for source, result in sources.items():
        for figure in figures_of(result, threshold):
            if (
                figure.name in (*SHOWN_FIGURES, "false_positive", "false_negative")
                and figure.interval is not None
            ):
                words, factor = FIGURES[figure.name]  # factor: from SI units to the unit in the label
                # Mean, lower and upper limit.
                ends = [plain(factor * value) for value in figure.interval[:3]]
                rows.append((source, words, *ends, figure.interval.n))
    names = ["source", "figure", "mean", "low", "high", "sessions"]
    return pl.DataFrame(rows, schema=names, orient="row")


def _states(source: str, result: Result) -> pl.DataFrame:
    """Return the shares of time that the robots spend avoiding, sensing and walking, one row per session.

    Walking is all time that is neither avoidance nor a stop to sense. Both are known for the intervals that end with a
    sample (``motion`` has a row for each), so a robot's time after its last sample counts as walking.

    Args:
        source: name of the source, for the first column. result: its sessions.
    """
    # All times are summed over the robots of a run.
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


def _without_library() -> str | None:
    return None if find_spec("sklearn") else "It needs scikit-learn: pip install 'vibroswarm[lab]'."


_SHOWN: Final = (
    TableView(
        "similarities",
        "Cosine similarity to the recordings: printed, for all samples pooled, and over sets of three simulated "
        "sessions, with that of uniform values and of a perfect simulation; by session, and real against real.",
        {
            "source": Column("source"), "feature": Column("feature"), "printed": Column("printed"),
            "as published": Column("pooled"), "sets": Column("over sets", limits=("sets_low", "sets_high")),
            "null": Column("uniform"), "at equal counts": Column("equal counts"), "ceiling": Column("perfect"),
            "session": Column("by session"), "real session": Column("real by session"),
        },
    ),
    TableView(
        "distances",
        "Sharper measures: effect size of the energy distance, and accuracy of a classifier between these and real "
        "stretches of other robots (0.5: chance); the same for real against real. 95 % intervals over sessions.",
        {
            "source": Column("source"), "feature": Column("feature"),
            "effect": Column("effect", limits=("effect_low", "effect_high")),
            "real": Column("real by real", limits=("real_low", "real_high")),
        },
    ),
    TableView(
        "figures",
        "Error rates at preset `paper`'s threshold, and how robots drive; 95 % intervals over "
        "sessions.",
        {
            "source": Column("source"), "figure": Column("figure"),
            "mean": Column("mean", limits=("low", "high")), "sessions": Column("sessions"),
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
    skipped=lambda settings: missing(settings.recordings) or _without_library(),
    also=lambda settings: "" if settings.recordings is None else hash_of(settings.recordings),
)
