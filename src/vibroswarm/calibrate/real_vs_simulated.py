"""Compare real with simulated samples: the paper's six similarities, energy distances, and a classifier's accuracies.

The similarities come with their null and ceiling (``similarity``). The distributions of real and simulated samples are
also drawn side by side, feature by feature, as in the paper's calibration figures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import polars as pl

from vibroswarm.calibrate.camera import RIGHT, Camera, seen_through
from vibroswarm.calibrate.classifier import ClassifierAccuracy, classifier_accuracy, scikit_learn
from vibroswarm.calibrate.features import FEATURES, WORDS, Sessions, sessions_of
from vibroswarm.calibrate.histograms import AXES, draw_panel, highest_of, histograms_of
from vibroswarm.calibrate.similarity import (
    EnergyDistance,
    RealCache,
    Similarity,
    compare_distance,
    compare_feature,
)
from vibroswarm.core.atomic_io import make_folder
from vibroswarm.core.numbers import number
from vibroswarm.errors import InputError, check_kind
from vibroswarm.plots.picture import save_figure
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Comparison:
    """Result of ``compare``."""

    similarities: tuple[Similarity, ...]
    """Similarity of each feature, without the missing features."""
    distances: tuple[EnergyDistance, ...]
    """Energy distance of each feature, without the missing features."""
    classifier: ClassifierAccuracy | None
    """How well a classifier distinguishes real from simulated samples; None if it refuses the sessions."""
    missing: tuple[str, ...]
    """Features of which a session has too few values."""
    unclassified: str = ""
    """Why the classifier refuses the sessions; empty if it does not."""
    camera: Camera = RIGHT
    """The camera through which the simulated positions were seen; ``RIGHT`` is an exact camera."""
    without_camera: tuple[Similarity, ...] = ()
    """The similarities of the positions as simulated; empty if the camera is exact."""

    def as_dict(self) -> dict[str, Any]:
        """Return nested plain values for JSON."""
        return {
            "similarities": [row.as_dict() for row in self.similarities],
            "energy_distances": [row.as_dict() for row in self.distances],
            "told_apart": None if self.classifier is None else self.classifier.as_dict(),
            "not_told_apart": self.unclassified,
            "missing": list(self.missing),
            "camera": asdict(self.camera),
            "similarities_without_camera": [row.as_dict() for row in self.without_camera],
        }


def camera_between(real: Result, simulated: Result) -> Camera:
    """Return the camera through which simulated positions are seen for a comparison with recordings.

    It is the camera that was fitted together with the simulation's scenario. It is an exact camera (``RIGHT``) if
    positions need no change: if ``real`` is a simulation, if ``simulated`` is a recording, or if the recording's
    positions are corrected already, as those from the command ``lab track`` are.
    """
    if not isinstance(real, Recording) or isinstance(simulated, Recording) or real.places_corrected:
        return RIGHT
    return Camera.of(simulated.scenario)


def compare_several(
    real: Result,
    simulated: Mapping[str, Result],
    *,
    camera: Camera | None = None,
    name: str = "the recording",
) -> dict[str, Comparison]:
    """Compare several results with the same recording, by name.

    What depends on the recording alone is computed once.

    Args:
        simulated: by name. camera: as for ``compare``. name: of the recording, for messages.
    Raises:
        InputError: one cannot be compared; the error names it.
    """
    known = RealCache()
    found = {}
    for other, result in simulated.items():
        try:
            found[other] = compare(real, result, known, camera=camera)
        except InputError as error:
            raise InputError(f"cannot be compared with '{name}': {error}", field=other) from None
    return found


def compare(
    real: Result,
    simulated: Result,
    known: RealCache | None = None,
    *,
    camera: Camera | None = None,
) -> Comparison:
    """Compare the samples of two results; each run is a session.

    Args:
        real: recordings, or a simulation in their place.
        simulated: a simulation (or recordings) of the same floor and settings.
        known: distances among the sessions of ``real`` from earlier calls with the same ``real``, by feature; this call
            adds those that are missing. None: they are computed.
        camera: the camera through which simulated positions are seen; by default ``camera_between``.
    Raises:
        InputError: no samples, no energies, or too few of them to compare anything; or scikit-learn is not installed.
    """
    scikit_learn("model_selection")  # without it the classifier would fail, at the end
    for words, result in (("the recording", real), ("the simulation", simulated)):
        check_kind(result, Result, words, "a Result or a Recording")
        if result.observations.is_empty():
            raise InputError("has no samples, and nothing can be compared", field=words)
    camera = camera_between(real, simulated) if camera is None else camera
    real_sessions = sessions_of(real)
    simulated_sessions = sessions_of(seen_through(simulated, camera))
    similarities = _similarities(real_sessions, simulated_sessions)
    if not similarities:
        raise InputError(
            "a session has fewer than 10 values of each feature; give longer sessions", field="sessions"
        )
    distances = [
        compare_distance(
            feature, real_sessions.values(feature), simulated_sessions.values(feature), known=known
        )
        for feature in similarities
    ]
    classifier, unclassified = None, ""
    try:
        classifier = classifier_accuracy(real_sessions.samples, simulated_sessions.samples)
    except InputError as error:  # such as one robot, or no times spent avoiding: all else can be compared
        unclassified = error.reason
    return Comparison(
        similarities=tuple(similarities.values()),
        distances=tuple(each for each in distances if each is not None),
        classifier=classifier,
        unclassified=unclassified,
        missing=tuple(feature for feature in FEATURES if feature not in similarities),
        camera=camera,
        without_camera=()
        if camera == RIGHT
        else tuple(_similarities(real_sessions, sessions_of(simulated)).values()),
    )


def _similarities(real: Sessions, simulated: Sessions) -> dict[str, Similarity]:
    """Return the similarities by feature, of all features of which every session has enough values."""
    found = {}
    for feature in FEATURES:
        # The values as the authors computed them, for the similarity that they would have printed.
        published = real.values(feature, as_published=True), simulated.values(feature, as_published=True)
        similarity = compare_feature(feature, real.values(feature), simulated.values(feature), published)
        if similarity is not None:
            found[feature] = similarity
    return found


INK: Final = ("#2b2b2b", "#4c78a8")
"""Colours of the real and of the simulated histogram: one darker than the other, so legible in grey."""


def comparison_figure(
    real: Result, simulated: Result, found: Comparison, features: Sequence[str] = FEATURES
) -> Figure:
    """Draw a row for each feature: the real values left, the simulated ones right, with similarities in the titles.

    Args:
        found: result of ``compare`` for ``real`` and ``simulated``; its missing features are not drawn.
        features: features to draw.
    """
    from matplotlib.figure import Figure

    values = histograms_of({"real": real, "simulated": seen_through(simulated, found.camera)})
    shown = [feature for feature in features if feature not in found.missing]
    rows = max(len(shown), 1)  # matplotlib needs at least one row
    figure = Figure(figsize=(7.0, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, squeeze=False)
    for row, feature in enumerate(shown):
        similarity = next(each for each in found.similarities if each.feature == feature)
        of_feature = values.filter(pl.col("feature") == feature)
        highest = highest_of(of_feature)
        for axis, part, ink in zip(
            axes[row], of_feature.partition_by("source", maintain_order=True), INK, strict=True
        ):
            draw_panel(axis, part, feature, highest, ink)
            axis.set_xlabel(AXES[feature][0], fontsize=7)
            axis.set_ylabel(AXES[feature][1], fontsize=7)
            axis.tick_params(labelsize=6)
        axes[row][0].set_title(f"{WORDS[feature]}, real", fontsize=8)
        axes[row][1].set_title(
            f"simulated: S {number(similarity.at_equal_counts, 3)} "
            f"(null {number(similarity.null, 3)}, ceiling {number(similarity.ceiling, 3)})",
            fontsize=8,
        )
    return figure


def write_comparison_pictures(
    real: Result, simulated: Result, found: Comparison, folder: str | Path
) -> list[Path]:
    """Draw one picture for each feature, ``FEATURE.png``, and one with all features, ``together.png``.

    Features that are missing in the comparison (``found.missing``) have no picture, and no row in ``together.png``.

    Args:
        found: result of ``compare`` for ``real`` and ``simulated``.
        folder: folder of the pictures; it is made if it does not exist.
    Returns:
        Paths of the pictures: the features in the order of ``FEATURES``, then ``together.png``.
    """
    folder = Path(folder)
    make_folder(folder)
    chosen: dict[str, tuple[str, ...]] = {name: (name,) for name in FEATURES if name not in found.missing}
    chosen["together"] = FEATURES  # of which ``comparison_figure`` leaves out the missing ones
    for name, features in chosen.items():
        save_figure(partial(comparison_figure, real, simulated, found, features), folder / f"{name}.png")
    return [folder / f"{name}.png" for name in chosen]


def write_comparison_picture(real: Result, simulated: Result, found: Comparison, path: Path) -> None:
    """Draw all features into a file: PNG, SVG or PDF by its suffix."""
    save_figure(lambda: comparison_figure(real, simulated, found), path)
