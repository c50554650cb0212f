"""The documents of comparisons of recordings with simulations: of one, of several, and of figures side by side."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.calibrate.classifier import FEWEST, STRETCH, ClassifierAccuracy, least_recognised
from vibroswarm.calibrate.features import FEATURES, WORDS
from vibroswarm.calibrate.interval_classifier import LEAST, IntervalAccuracy
from vibroswarm.calibrate.real_vs_simulated import Comparison
from vibroswarm.calibrate.session_statistics import FIGURES, Figure
from vibroswarm.calibrate.similarity import EnergyDistance, Similarity, Spread
from vibroswarm.core.numbers import count, listed, number, percent, stated, with_limits
from vibroswarm.documents.session_estimates import columns_of, estimate_of
from vibroswarm.show.document import Column, Document, Part, Table, Text

DISTANCES: Final = (
    "Energy distance, effect size (0: same distribution, 1: no overlap; in brackets 95 % over sessions)."
)
RECOGNISED: Final = (
    f"Share of stretches of {STRETCH} samples that a classifier recognises (50 %: chance; in brackets 95 % over "
    "sessions). If there is only one real or simulated session, it is trained on, too."
)
CLASSIFIERS: Final = {
    "simulated": "real or simulated, robots and sessions not trained on",
    "simulated_by_robot": "real or simulated, robots not trained on",
    "real": "which real session, robots not trained on",
}
"""What a classifier tells apart, by field of ``ClassifierAccuracy``."""


def comparison_document(found: Comparison, *, intervals: bool = False) -> Document:
    """Return what the comparison of a recording with a simulation says.

    With a single real session nothing is compared between real sessions.

    Args:
        intervals: whether undisturbed intervals were to be told apart, so that their absence is explained.
    """
    parts: list[Part] = []
    if found.without_camera:
        parts.append(
            Text(
                f"Simulated positions are as the camera of the recordings would see them ({found.camera.words}); "
                "--no-camera takes them as they are."
            )
        )
    parts += [_similarities(found), _distances(found), *_recognised(found), *_intervals(found, intervals)]
    return Document(
        title="Recordings and simulation",
        answer=(*_recognises(found.classifier), _most_different(found), *_below_null(found)),
        warnings=_missing(found),
        parts=tuple(parts),
        data=_data(found),
    )


def comparisons_document(found: Mapping[str, Comparison]) -> Document:
    """Return what the comparisons of one recording with several simulations say.

    Args:
        found: by the folder of the simulation. One that has too few values of a feature gets a dash.
    """
    names = names_of(list(found))
    classifiers = {
        names[folder]: one.classifier for folder, one in found.items() if one.classifier is not None
    }
    return Document(
        title="A recording and several simulations",
        answer=_recognised_least(classifiers),
        warnings=tuple(
            f"{names[folder]}: {words}" for folder, one in found.items() for words in _missing(one)
        ),
        parts=(_several_distances(found, names), *_several_classifiers(found, names)),
        data=_joined({folder: _data(one) for folder, one in found.items()}),
    )


def _recognised_least(classifiers: Mapping[str, ClassifierAccuracy]) -> tuple[str, ...]:
    """Return how well each simulation is recognised, and than which the least recognised is not shown to be less."""
    if not classifiers:
        return ("The classifier compared no simulation.",)
    shares = {name: one.simulated.estimate for name, one in classifiers.items()}
    each = listed(f"{percent(share)} of {name}" for name, share in shares.items())
    recognised = f"Recognised as real or simulated: {each} (50 %: chance)."
    if len(shares) == 1:
        return (recognised,)
    names, of_all = list(classifiers), list(classifiers.values())
    least, alike = least_recognised(of_all)
    sessions = min(min(len(one.by_session), one.simulations) for one in of_all)
    needed = "" if sessions >= FEWEST else f"; it takes {FEWEST} real and {FEWEST} simulated ones"
    paired = f"(paired by {count(sessions, 'session')}{needed})"
    if alike:
        others = listed(names[k] for k in alike)
        return recognised, f"Least: {names[least]}, not significantly less than {others} {paired}."
    return recognised, f"Least: {names[least]}, significantly less than each of the others {paired}."


def figures_document(figures: Mapping[str, Sequence[Figure]], rms_threshold: float) -> Document:
    """Return figures of several results side by side.

    Args:
        figures: by folder, each with all of ``FIGURES``. rms_threshold: at which error rates are.
    """
    names = names_of(list(figures))
    rows: list[dict[str, str]] = []
    for place, (words, scale) in enumerate(FIGURES.values()):
        row = {"figure": words}
        for folder, of_folder in figures.items():
            row[names[folder]] = with_limits(estimate_of(of_folder[place].interval, scale))
        rows.append(row)
    values = [
        {"result": folder} | figure.as_dict() for folder, of_folder in figures.items() for figure in of_folder
    ]
    return Document(
        title="Figures of sessions",
        answer=(
            f"{len(FIGURES)} figures of {listed(names.values())}; errors at a threshold of {stated(rms_threshold)}.",
        ),
        parts=(
            Table(pl.DataFrame(rows), name="figures"),
            Text("In brackets: 95 % over sessions. '-': not measurable.", "aside"),
        ),
        made_by={"rms_threshold": stated(rms_threshold)},
        data={"figures": pl.DataFrame(values, infer_schema_length=None)},
    )


def names_of(folders: Sequence[str]) -> dict[str, str]:
    """Return the names of folders; their whole paths if two have the same name in different places."""
    names = [Path(folder).name for folder in folders]
    return dict(zip(folders, names if len(set(names)) == len(names) else folders, strict=True))


def _recognises(found: ClassifierAccuracy | None) -> tuple[str, ...]:
    if found is None:
        return ()
    share = with_limits(estimate_of(found.simulated), "%")
    return (
        f"A classifier recognises {share} of the stretches of {STRETCH} samples as real or simulated (50 %: chance).",
    )


def _most_different(found: Comparison) -> str:
    most = max(found.distances, key=lambda one: one.effect.estimate)
    among = "" if most.real is None else f"; among real sessions {number(most.real.estimate, 4)}"
    distance = with_limits(estimate_of(most.effect), decimals=4)
    return f"Most different: {WORDS[most.feature]}, energy distance {distance}{among}."


def _below_null(found: Comparison) -> list[str]:
    """Return the features in which evenly spread values are at least as similar to the recordings."""
    below = [WORDS[one.feature] for one in found.similarities if one.at_equal_counts <= one.null]
    return [f"No more similar than evenly spread values: {listed(below)}."] if below else []


def _missing(found: Comparison) -> tuple[str, ...]:
    """Return what was not compared, and why."""
    features = [WORDS[name] for name in found.missing]
    too_few = (f"Too few values to compare: {listed(features)}.",) if features else ()
    unclassified = (f"Without the classifier: {found.unclassified}.",) if found.unclassified else ()
    return too_few + unclassified


def _similarities(found: Comparison) -> Table:
    """Return the table of cosine similarities.

    The column "published" is computed as in the paper: of all samples, with the authors' avoidance times. All others
    use equal numbers of real and simulated values: "here" is the result; "null" and "ceiling" are its scale.
    """
    without = {one.feature: one.at_equal_counts for one in found.without_camera}
    rows = [
        {
            "feature": WORDS[one.feature],
            "published": one.as_published,
            "null": one.null,
            "here": one.at_equal_counts,
            "without_camera": without.get(one.feature),
            "ceiling": one.ceiling,
            **_range("session", one.by_session),
            **_range("real_session", one.real_by_session),
            "note": "" if one.at_equal_counts > one.null else "below its null",
        }
        for one in found.similarities
    ]
    columns = {name: Column(decimals=3) for name in ("published", "null", "here", "ceiling")} | {
        "session": Column("sessions, real-sim", decimals=3, wide=True),
        "real_session": Column("sessions, real-real", decimals=3, wide=True),
        "without_camera": Column("without camera", decimals=3),
        "note": Column("note", tones={"below": "bad"}),
    }
    frame = pl.DataFrame(rows, infer_schema_length=None)
    unused = [name for name in ("without_camera", "note") if not any(row[name] for row in rows)]
    caption = (
        "Cosine similarity (published: of all samples; here: at equal counts; null: of evenly spread values; ceiling: "
        "expected of equal distributions; sessions: mean and range over pairs)."
    )
    return Table(frame.drop(unused), columns, caption, "similarities")


def _range(name: str, spread: Spread | None) -> dict[str, float | None]:
    """Return mean and range over pairs of sessions as the columns NAME, NAME_low and NAME_high."""
    values = (None, None, None) if spread is None else (spread.mean, spread.least, spread.most)
    return dict(zip((name, f"{name}_low", f"{name}_high"), values, strict=True))


def _distances(found: Comparison) -> Table:
    rows = [
        {"feature": WORDS[one.feature], **columns_of("simulated", one.effect), **columns_of("real", one.real)}
        for one in found.distances
    ]
    columns = {
        "simulated": Column("real - simulated", decimals=4),
        "real": Column("real - real", decimals=4),
    }
    return Table(pl.DataFrame(rows), columns, DISTANCES, "energy_distances")


def _told_apart(found: Comparison) -> pl.DataFrame:
    shares = {name: getattr(found.classifier, name, None) for name in CLASSIFIERS}
    return pl.DataFrame(
        [
            {"recognised": name} | columns_of("share", share)
            for name, share in shares.items()
            if share is not None
        ]
    )


def _recognised(found: Comparison) -> list[Part]:
    if found.classifier is None:
        return []
    frame = _told_apart(found).with_columns(pl.col("recognised").replace(CLASSIFIERS))
    return [Table(frame, {"share": Column(share=True)}, RECOGNISED, "told_apart")]


def _intervals(found: Comparison, requested: bool) -> list[Part]:
    """Return the shares of undisturbed intervals that boosted trees recognise by turn and distance.

    In an undisturbed interval a robot drives from one sample to the next without avoidance or turn.
    """
    if found.intervals is None:
        few = f"A session has fewer than {LEAST} undisturbed intervals: too few to tell them apart (--intervals)."
        return [Text(few)] if requested else []
    rows = [
        {
            "recognised": name,
            **_range_of("same_robots", accuracy.same_robots),
            **_range_of("other_robots", accuracy.other_robots),
        }
        for name, accuracy in (
            ("real or simulated", found.intervals.simulated),
            ("which real session", found.intervals.real),
        )
        if accuracy.same_robots  # empty if there is no pair of sessions: a single real session
    ]
    columns = {
        "same_robots": Column("same robots", share=True),
        "other_robots": Column("other robots", share=True),
    }
    caption = (
        "Undisturbed intervals that boosted trees recognise by turn and distance (with range over pairs)."
    )
    # turn of turn_rad, distance of distance_m
    alone = (
        f"{percent(share)} by {name.partition('_')[0]}" for name, share in found.intervals.by_feature.items()
    )
    words = f"Real or simulated, same robots, by one feature alone: {listed(alone)}."
    return [Table(pl.DataFrame(rows), columns, caption, "intervals_told_apart"), Text(words)]


def _range_of(name: str, shares: tuple[float, ...]) -> dict[str, float]:
    return {name: statistics.mean(shares), f"{name}_low": min(shares), f"{name}_high": max(shares)}


def _several_distances(found: Mapping[str, Comparison], names: Mapping[str, str]) -> Table:
    """Return energy distances with a column for each simulation; those among real sessions are the same in all."""
    by_feature = {folder: {one.feature: one for one in each.distances} for folder, each in found.items()}
    columns, rows = {"real": Column("real - real", decimals=4)}, []
    for feature in FEATURES:
        of_feature = {folder: each.get(feature) for folder, each in by_feature.items()}
        real = next((one.real for one in of_feature.values() if one is not None), None)
        row: dict[str, Any] = {"feature": WORDS[feature], **columns_of("real", real)}
        for folder, one in of_feature.items():
            row |= columns_of(folder, None if one is None else one.effect)
            columns[folder] = Column(f"real - {names[folder]}", decimals=4)
        rows.append(row)
    return Table(pl.DataFrame(rows), columns, DISTANCES, "distances")


def _several_classifiers(found: Mapping[str, Comparison], names: Mapping[str, str]) -> list[Table]:
    if all(one.classifier is None for one in found.values()):
        return []
    columns: dict[str, Column] = {}
    rows = []
    for field in ("simulated", "simulated_by_robot"):
        row: dict[str, Any] = {"recognised": CLASSIFIERS[field]}
        for folder, one in found.items():
            row |= columns_of(folder, getattr(one.classifier, field, None))
            columns[folder] = Column(names[folder], share=True)
        rows.append(row)
    return [Table(pl.DataFrame(rows), columns, RECOGNISED, "classifiers")]


def _data(found: Comparison) -> dict[str, pl.DataFrame]:
    """Return all numbers of a comparison as tables for JSON."""
    return {
        "similarities": pl.DataFrame(
            [_similarity(one) for one in found.similarities], infer_schema_length=None
        ),
        "similarities_without_camera": pl.DataFrame([_similarity(one) for one in found.without_camera]),
        "energy_distances": pl.DataFrame([_distance(one) for one in found.distances]),
        "told_apart": _told_apart(found),
        "intervals_told_apart": _pairs(found.intervals),
        "camera": pl.DataFrame([asdict(found.camera)]),
        "missing": pl.DataFrame({"feature": found.missing}, schema={"feature": pl.String}),
    }


def _similarity(one: Similarity) -> dict[str, Any]:
    values = one.as_dict()
    spreads = {name: values.pop(name) or {} for name in ("by_session", "real_by_session")}
    named = {f"{name}_{end}": value for name, spread in spreads.items() for end, value in spread.items()}
    return values | named


def _distance(one: EnergyDistance) -> dict[str, Any]:
    return {"feature": one.feature, **columns_of("effect", one.effect), **columns_of("real", one.real)}


def _pairs(found: IntervalAccuracy | None) -> pl.DataFrame:
    """Return a row for each pair of sessions; empty if undisturbed intervals were not told apart."""
    rows = [] if found is None else [
        {"recognised": name, "robots": split, "share": share}
        for name, told in (("simulated", found.simulated), ("real", found.real))
        for split, shares in asdict(told).items()
        for share in shares
    ]  # fmt: skip
    return pl.DataFrame(rows)


def _joined(tables: Mapping[str, Mapping[str, pl.DataFrame]]) -> dict[str, pl.DataFrame]:
    """Return tables of the same names as one table each, whose first column names the simulation."""
    joined = {}
    for name in next(iter(tables.values())):
        parts = [
            of_one[name].select(pl.lit(folder).alias("simulated"), pl.all())
            for folder, of_one in tables.items()
            if of_one[name].height
        ]
        joined[name] = pl.concat(parts, how="diagonal_relaxed") if parts else pl.DataFrame()
    return joined
