"""Item 2: recordings and simulations compared: the six similarities, error rates, battery, and the three figures."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any, Final

import numpy as np
import polars as pl

from vibroswarm.analysis.intervals import mean_interval
from vibroswarm.calibrate.compare import Comparison, compare
from vibroswarm.calibrate.features import FEATURES, WORDS, sessions_of
from vibroswarm.calibrate.figures import FIGURES, figures_of
from vibroswarm.calibrate.similarity import null, similarity
from vibroswarm.page.report import Column
from vibroswarm.paper.columns import EMPIRICAL
from vibroswarm.paper.histograms import draw_maps, draw_shares, histograms_of
from vibroswarm.paper.item import CLAIMS, Drawn, Item, Picture, Settings, Shown, Tables, Work
from vibroswarm.paper.measure import Row, exact, frame, mean
from vibroswarm.paper.published import published
from vibroswarm.paper.real_floor import real_floor
from vibroswarm.paper.recordings import AUTHORS, REAL, hash_of, missing, recorded
from vibroswarm.plots import draw_error_bars
from vibroswarm.result import Result
from vibroswarm.simulation import simulate

NAMES: Final = {
    "avoidance": "state_times",
    "vibrating": "energy_vibrating",
    "still": "energy_non_vibrating",
    "places": "sample_positions",
    "distances": "distance_over_time",
    "steps": "distance_and_angle",
}
"""The features, and what the paper calls them."""
SESSIONS: Final = 3
SETS: Final = 10
"""Sets of three simulated sessions, for an interval."""
LABELS: Final = {
    "avoidance": "avoidance time per sample (s)",
    "vibrating": "energy on vibrating tiles (RMS)",
    "still": "energy on still tiles (RMS)",
}
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
    for place, (name, one) in enumerate(sources.items()):
        found[name] = compare(real, one)
        work.tell(0.2 + 0.6 * (place + 1) / len(sources))
    of_sets = {column: _of_sets(real, one) for column, one in many.items()}
    measured = _of_authors(found[SIMULATOR])
    for column in settings.columns:
        measured += _of_column(settings, column, of_sets[column])
    everything: dict[str, Result] = {ROBOTS: real, **sources}
    return {
        "similarities": _similarities(found, of_sets),
        "distances": _distances(found),
        "figures": _figures(settings, everything),
        "states": pl.concat([_states(name, one) for name, one in everything.items()]),
        "histograms": histograms_of({ROBOTS: real, **sources}),
        CLAIMS: frame(measured),
    }


Sets = dict[str, list[tuple[float, float]]]


def _of_sets(real: Result, simulated: Result) -> Sets:
    """Similarity of each set of three sessions to the recordings, and of even scatter, by feature."""
    there, here = sessions_of(real), sessions_of(simulated)
    found: Sets = {}
    for feature in FEATURES:
        all_real = np.concatenate(there.values(feature))
        values = here.values(feature)
        for first in range(0, len(values), SESSIONS):
            some = np.concatenate(values[first : first + SESSIONS])
            count = min(len(all_real), len(some))
            pair = (similarity(feature, all_real, some), null(feature, all_real, count))
            found.setdefault(feature, []).append(pair)
    return found


def _printed(feature: str) -> float:
    return float(published(f"calibration.cosine_similarity.{NAMES[feature]}"))


def _of_authors(found: Comparison) -> list[Row]:
    return [
        exact("calibration-printed", "paper", WORDS[one.feature], one.as_published - _printed(one.feature))
        for one in found.similarities
    ]


def _of_column(settings: Settings, column: str, of_sets: Sets) -> list[Row]:
    rows = []
    for feature, pairs in of_sets.items():
        alike, even = np.array(pairs).T
        rows.append(mean("calibration-ours", column, WORDS[feature], alike, less=_printed(feature)))
        rows.append(mean("calibration-tells", column, WORDS[feature], alike - even))
    return rows + _errors(settings, column) + _battery(settings, column)


def _errors(settings: Settings, column: str) -> list[Row]:
    """Error rates of each run at the column's own threshold."""
    scenario = settings.scenario(column, real_floor(), with_=EMPIRICAL)
    result = simulate(scenario, settings.seed, min(settings.runs, 100), energies=False)
    kinds = np.array([int(tile) for row in real_floor()["floor.tiles"] for tile in row])
    tile, read = (result.observations[name].to_numpy() for name in ("tile", "observation"))
    run, kind = result.observations["run"].to_numpy(), kinds[tile]
    shares = [np.bincount(run[kind == k], read[kind == k] != k) / np.bincount(run[kind == k]) for k in (0, 1)]
    names = ("false_positive", "false_negative")
    return [
        mean("calibration-errors", column, name, share, less=float(published(f"calibration.{name}_share")))
        for name, share in zip(names, shares, strict=True)
    ]


def _battery(settings: Settings, column: str) -> list[Row]:
    scenario = settings.scenario(column)
    ends = zip((0.0, scenario.run.t_end_s), published("calibration.battery_first_last"), strict=True)
    return [
        exact("battery", column, f"at {t_s:g} s", 1.0 - t_s / scenario.robot.battery_life_s - printed)
        for t_s, printed in ends
    ]


def _similarities(found: dict[str, Comparison], of_sets: dict[str, Sets]) -> pl.DataFrame:
    rows = []
    for source, one in found.items():
        for alike in one.similarities:
            row: dict[str, Any] = {
                "source": source,
                "feature": WORDS[alike.feature],
                "printed": _printed(alike.feature),
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


def pictures(tables: Tables, settings: Settings) -> Iterator[Picture]:
    """The paper's three: states and energies, places, steps; real robots beside each source."""
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
    alike = tables["similarities"]
    yield Picture(
        "calibration-similarities", "Similarities between null and ceiling", partial(_draw_alike, alike)
    )


def _draw_states(states: pl.DataFrame) -> Drawn:
    rows = [
        (state, source[0], *mean_interval(part[state].to_numpy())[:3], part.height)
        for state in ("walking", "sensing", "avoiding")
        for source, part in states.group_by("source", maintain_order=True)
    ]
    made = pl.DataFrame(rows, schema=["x", "series", "estimate", "low", "high", "runs"], orient="row")
    return draw_error_bars(made, label="share of time", percent=True, interval="95 % interval over sessions")


def _draw_alike(alike: pl.DataFrame) -> Drawn:
    """The mark is the similarity, the bar goes from null to ceiling."""
    made = alike.select(
        x="feature", series="source", estimate="at equal counts",
        low=pl.min_horizontal("null", "at equal counts"), high=pl.max_horizontal("ceiling", "at equal counts"),
    )  # fmt: skip
    return draw_error_bars(
        made, label="cosine similarity", interval="span from even scatter to a perfect simulation"
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
