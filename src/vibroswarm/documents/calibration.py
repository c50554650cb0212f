"""The documents of ``calibrate``, but that of a fit.

They are of comparisons of recordings with simulations (of one, of several, and of figures side by side), and of the
loss of messages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import polars as pl

from vibroswarm.calibrate.classifier import FEWEST, STRETCH, ClassifierAccuracy, least_recognised
from vibroswarm.calibrate.features import BELOW, FEATURES, WORDS
from vibroswarm.calibrate.message_loss import LEAST_GAIN, STEPS, LossFits
from vibroswarm.calibrate.real_vs_simulated import Comparison
from vibroswarm.calibrate.session_statistics import FIGURES, Figure
from vibroswarm.calibrate.similarity import EnergyDistance, Spread
from vibroswarm.core.numbers import count, listed, number, percent, stated, with_limits
from vibroswarm.documents.cell_figures import columns_of, estimate_of, flat_row
from vibroswarm.show.document import Column, Document, Part, Table, Text
from vibroswarm.statistics.intervals import Interval

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


def comparison_document(found: Comparison) -> Document:
    """Return what the comparison of a recording with a simulation says.

    With a single real session nothing is compared between real sessions.
    """
    seen = (
        f"Simulated positions are as the camera of the recordings would see them ({found.camera.words}); --no-camera "
        "takes them as they are."
    )
    return Document(
        title="Recordings and simulation",
        answer=(_recognises(found.classifier), _most_different(found), _no_more_similar_than_even(found)),
        warnings=_missing(found),
        parts=(
            Text(seen if found.without_camera else ""),
            _similarities(found),
            _distances(found),
            *_recognised(found),
        ),
        data=_tables_for_json(found),
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
        data=_joined({folder: _tables_for_json(one) for folder, one in found.items()}),
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


def _recognises(found: ClassifierAccuracy | None) -> str:
    if found is None:
        return ""
    share = with_limits(estimate_of(found.simulated), "%")
    return f"A classifier recognises {share} of the stretches of {STRETCH} samples as real or simulated (50 %: chance)."


def _most_different(found: Comparison) -> str:
    most = max(found.distances, key=lambda one: one.effect.estimate)
    among = "" if most.real is None else f"; among real sessions {number(most.real.estimate, 4)}"
    distance = with_limits(estimate_of(most.effect), decimals=4)
    return f"Most different: {WORDS[most.feature]}, energy distance {distance}{among}."


def _no_more_similar_than_even(found: Comparison) -> str:
    below = [WORDS[one.feature] for one in found.similarities if one.at_equal_counts <= one.null]
    return f"No more similar than evenly spread values: {listed(below)}." if below else ""


def _missing(found: Comparison) -> tuple[str, ...]:
    """Return what was not compared, and why."""
    features = [WORDS[name] for name in found.missing]
    limits = [stated(BELOW[name]) for name in found.missing if name in BELOW]
    why = (
        f" (only energies below {listed(limits)} count: if their unit is another, convert it in the column map)"
        if limits
        else ""
    )
    too_few = (f"Too few values to compare: {listed(features)}{why}.",) if features else ()
    unclassified = (f"Without the classifier: {found.unclassified}.",) if found.unclassified else ()
    return too_few + unclassified


def _similarities(found: Comparison) -> Table:
    """Return the table of cosine similarities.

    The column "published" (as in the paper) is of all samples, with the authors' avoidance times. All others use equal
    numbers of real and simulated values: "here" (at equal counts) is the result; "null" and "ceiling" are its scale.
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
            **_mean_and_range("session", one.by_session),
            **_mean_and_range("real_session", one.real_by_session),
            "note": "" if one.at_equal_counts > one.null else "below its null",
        }
        for one in found.similarities
    ]
    columns = {
        "published": Column("as in the paper", decimals=3),
        "null": Column(decimals=3),
        "here": Column("at equal counts", decimals=3),
        "ceiling": Column(decimals=3),
        "session": Column("sessions, real-sim", decimals=3, wide=True),
        "real_session": Column("sessions, real-real", decimals=3, wide=True),
        "without_camera": Column("without camera", decimals=3),
        "note": Column("note", tones={"below": "bad"}),
    }
    frame = pl.DataFrame(rows, infer_schema_length=None)
    unused = [name for name in ("without_camera", "note") if not any(row[name] for row in rows)]
    caption = (
        "Cosine similarity (as in the paper: of all samples; all others at equal counts: null, of evenly spread "
        "values; ceiling, expected of equal distributions; sessions, mean and range over pairs)."
    )
    return Table(frame.drop(unused), columns, caption, "similarities")


def _mean_and_range(name: str, spread: Spread | None) -> dict[str, float | None]:
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


def _several_distances(found: Mapping[str, Comparison], names: Mapping[str, str]) -> Table:
    """Return energy distances with a column for each simulation; those among real sessions are the same in all."""
    by_feature = {folder: {one.feature: one for one in each.distances} for folder, each in found.items()}
    rows = {}
    for feature in FEATURES:
        of_feature = {folder: each.get(feature) for folder, each in by_feature.items()}
        real = next((one.real for one in of_feature.values() if one is not None), None)
        effects = {f"{folder}/": None if one is None else one.effect for folder, one in of_feature.items()}
        rows[WORDS[feature]] = {"real": real, **effects}
    titles = {"real": "real - real"} | {f"{folder}/": f"real - {names[folder]}" for folder in found}
    columns = {name: Column(title, decimals=4) for name, title in titles.items()}
    return Table(_side_by_side("feature", rows), columns, DISTANCES, "distances")


def _several_classifiers(found: Mapping[str, Comparison], names: Mapping[str, str]) -> list[Table]:
    if all(one.classifier is None for one in found.values()):
        return []
    rows = {
        CLASSIFIERS[field]: {
            f"{folder}/": getattr(one.classifier, field, None) for folder, one in found.items()
        }
        for field in ("simulated", "simulated_by_robot")
    }
    columns = {f"{folder}/": Column(names[folder], share=True) for folder in found}
    return [Table(_side_by_side("recognised", rows), columns, RECOGNISED, "classifiers")]


def _side_by_side(name: str, rows: Mapping[str, Mapping[str, Interval | None]]) -> pl.DataFrame:
    """Return a row for each name, with an estimate and its limits in columns of each simulation.

    A simulation's column is its folder with a slash, which no folder ``sim_low`` beside ``sim`` or ``real`` can equal.
    """
    frame = pl.DataFrame({name: list(rows)})
    for key in next(iter(rows.values())):
        frame = frame.hstack(pl.DataFrame([columns_of(key, each[key]) for each in rows.values()]))
    return frame


def _tables_for_json(found: Comparison) -> dict[str, pl.DataFrame]:
    return {
        "similarities": pl.DataFrame(
            [flat_row(one.as_dict(), *_SPREADS) for one in found.similarities], infer_schema_length=None
        ),
        "similarities_without_camera": pl.DataFrame(
            [flat_row(one.as_dict(), *_SPREADS) for one in found.without_camera]
        ),
        "energy_distances": pl.DataFrame([_distance(one) for one in found.distances]),
        "told_apart": _told_apart(found),
        "camera": pl.DataFrame([asdict(found.camera)]),
        "missing": pl.DataFrame({"feature": found.missing}, schema={"feature": pl.String}),
    }


_SPREADS: Final = ("by_session", "real_by_session")
"""Figures of a similarity that are several numbers."""


def _distance(one: EnergyDistance) -> dict[str, Any]:
    return {"feature": one.feature, **columns_of("effect", one.effect), **columns_of("real", one.real)}


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


def message_loss_document(found: LossFits) -> Document:
    """Return whether robots lose messages in bursts: two models, and the gaps that they expect."""
    return Document(
        title="Losses of messages",
        answer=(_loss_answer(found),),
        parts=(
            Text(
                f"{count(len(found.windows), 'receiver')}, {count(found.messages, 'message')} addressed to them. "
                "Intervals of more than twice the median between a robot's own samples hold "
                f"{percent(found.sent_in_long)} of the messages and {percent(found.lost_in_long)} of the lost ones."
            ),
            _models(found),
            _gaps(found),
        ),
        data=_loss_data(found),
    )


def _loss_answer(found: LossFits) -> str:
    """Say which model predicts better: the one with the smaller AIC, bursts only from ``LEAST_GAIN`` on."""
    gain, least = found.gain, stated(LEAST_GAIN)
    if gain <= 0:
        alike = found.models["independent"].aic <= found.aic_by_receiver
        how = "" if alike else ", with a share of its own for each receiver,"
        return f"No bursts found: independent losses{how} fit as well (AIC lower by {number(-gain, 1)})."
    if gain < LEAST_GAIN:
        return (
            f"Inconclusive: bursts fit better than independent losses, but by too little (AIC lower by "
            f"{number(gain, 1)}; {least} are needed)."
        )
    bursts = found.models["bursts"]
    return (
        f"Messages are lost in bursts (AIC lower by {number(gain, 1)} than with independent losses; {least} are "
        f"needed): bad periods of "
        f"{number(bursts.bad_s, 1)} s on average, {percent(bursts.bad_share)} of the time, in which "
        f"{percent(bursts.lost_in_bad)} of the messages are lost."
    )


def _models(found: LossFits) -> Table:
    """Return the fitted models, and the standard errors of the one with bursts if they were computed."""
    figures = ("lost", "bad_share", "bad_s", "lost_in_bad", "lost_in_good")
    rows = [
        {"model": name} | {figure: getattr(model, figure) for figure in (*figures, "log_likelihood", "aic")}
        for name, model in found.models.items()
    ]
    rows.insert(1, {"model": "independent, each receiver by itself", "aic": found.aic_by_receiver})
    if found.errors:
        rows.append({"model": "standard error of bursts", **found.errors})
    columns = {
        "lost": Column(share=True, decimals=2),
        "bad_share": Column(decimals=4),
        "bad_s": Column(decimals=1),
        "lost_in_bad": Column(decimals=3),
        "lost_in_good": Column(decimals=4),
        "log_likelihood": Column("log likelihood", decimals=1),
        "aic": Column("AIC", decimals=1),
    }
    caption = "Models, with the fields of the network `bursts`."
    return Table(pl.DataFrame(rows, infer_schema_length=None), columns, caption, "models")


def _gaps(found: LossFits) -> Table:
    """Return the recorded number of gaps of each size beside those that the models expect."""
    ends = [*(str(size - 1) for size in STEPS[1:]), "more"]
    rows = [
        {
            "messages": f"{size} or more"
            if end == "more"
            else str(size)
            if str(size) == end
            else f"{size} to {end}",
            "found": int(found.gaps[place]),
            **{
                name: f"{number(mean[place], 1)} ± {number(deviation[place], 1)}"
                for name, (mean, deviation) in found.expected.items()
            },
        }
        for place, (size, end) in enumerate(zip(STEPS, ends, strict=True))
    ]
    caption = "Gaps (messages lost in a row) by size, all receivers; expected ± standard deviation."
    return Table(pl.DataFrame(rows), {}, caption, "gaps")


def _loss_data(found: LossFits) -> dict[str, pl.DataFrame]:
    fits = [{"model": name, **asdict(model), "aic": model.aic} for name, model in found.models.items()]
    expected = {f"expected_{name}": mean.tolist() for name, (mean, _) in found.expected.items()}
    return {
        "fits": pl.DataFrame(fits),
        "fits_by_receiver": pl.DataFrame(
            [
                {"run": one.run, "robot": one.robot, "lost": model.lost, "aic": model.aic}
                for one, model in zip(found.windows, found.by_receiver, strict=True)
            ]
        ),
        "standard_errors": pl.DataFrame([found.errors] if found.errors else []),
        "gaps": pl.DataFrame({"from": list(STEPS), "found": found.gaps.tolist(), **expected}),
        "long_intervals": pl.DataFrame({"lost": [found.lost_in_long], "sent": [found.sent_in_long]}),
    }
