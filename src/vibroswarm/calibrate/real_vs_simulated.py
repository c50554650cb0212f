"""Compare real with simulated samples: the paper's six similarities with null and ceiling, and two sharper measures.

Also draw both side by side, feature by feature, as in the paper's calibration figures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from vibroswarm.calibrate.camera import RIGHT, Camera, seen_through
from vibroswarm.calibrate.classifier import ClassifierAccuracy, classifier_accuracy
from vibroswarm.calibrate.features import FEATURES, WORDS, Sessions, sessions_of
from vibroswarm.calibrate.interval_classifier import IntervalAccuracy, interval_accuracy
from vibroswarm.calibrate.similarity import (
    EnergyDistance,
    RealCache,
    Similarity,
    compare_distance,
    compare_feature,
)
from vibroswarm.core.atomic_io import whole_file
from vibroswarm.core.notebook_view import NotebookView
from vibroswarm.plots.style import MATPLOTLIB_LOCK
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Comparison(NotebookView):
    """Result of ``compare``; features that one of the two lacks are missing."""

    similarities: tuple[Similarity, ...]
    distances: tuple[EnergyDistance, ...]
    classifier: ClassifierAccuracy
    missing: tuple[str, ...]
    camera: Camera = RIGHT
    """Through which the simulated positions were seen."""
    without_camera: tuple[Similarity, ...] = ()
    """The similarities of the positions as simulated; none if the camera is exact."""
    intervals: IntervalAccuracy | None = None
    """How well undisturbed intervals are told apart; None if not asked for, or if there are too few."""

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "similarities": [row.as_dict() for row in self.similarities],
            "energy_distances": [row.as_dict() for row in self.distances],
            "told_apart": self.classifier.as_dict(),
            "missing": list(self.missing),
            "camera": asdict(self.camera),
            "similarities_without_camera": [row.as_dict() for row in self.without_camera],
            "intervals_told_apart": None if self.intervals is None else self.intervals.as_dict(),
        }


def camera_between(real: Result, simulated: Result) -> Camera:
    """Return the camera through which a simulation is compared with recordings: the one kept with its scenario.

    Recordings of ``lab track`` have places that are corrected for their own camera.
    """
    if not isinstance(real, Recording) or isinstance(simulated, Recording) or real.places_corrected:
        return RIGHT
    return Camera.of(simulated.scenario)


def compare(
    real: Result,
    simulated: Result,
    known: RealCache | None = None,
    *,
    camera: Camera | None = None,
    intervals: bool = False,
) -> Comparison:
    """Compare the samples of two results; each run is a session.

    Args:
        real: recordings, or what stands for them. simulated: of the same floor and settings.
        known: earlier results for the same ``real``; extended.
        intervals: whether to tell undisturbed intervals apart too, which takes half a minute.
        camera: how the recordings saw robots; by default ``camera_between``. Simulated positions are seen through it.
    Raises:
        InputError: no energies, or fewer than two robots.
    """
    camera = camera_between(real, simulated) if camera is None else camera
    real_sessions = sessions_of(real)
    simulated_sessions = sessions_of(seen_through(simulated, camera))
    similarities, distances, missing = [], [], []
    for feature in FEATURES:
        values = real_sessions.values(feature), simulated_sessions.values(feature)
        published = (
            real_sessions.values(feature, as_published=True),
            simulated_sessions.values(feature, as_published=True),
        )
        alike = compare_feature(feature, *values, published)
        apart = compare_distance(feature, *values, known=known)
        if alike is None or apart is None:
            missing.append(feature)
            continue
        similarities.append(alike)
        distances.append(apart)
    return Comparison(
        tuple(similarities),
        tuple(distances),
        classifier_accuracy(real_sessions.samples, simulated_sessions.samples),
        tuple(missing),
        camera,
        () if camera == RIGHT else _similarities(real_sessions, sessions_of(simulated)),
        interval_accuracy(real_sessions.samples, simulated_sessions.samples) if intervals else None,
    )


def _similarities(real: Sessions, simulated: Sessions) -> tuple[Similarity, ...]:
    """Return the similarity of each feature that both have."""
    found = []
    for feature in FEATURES:
        published = (
            real.values(feature, as_published=True),
            simulated.values(feature, as_published=True),
        )
        alike = compare_feature(feature, real.values(feature), simulated.values(feature), published)
        found += [] if alike is None else [alike]
    return tuple(found)


INK: Final = ("#2b2b2b", "#4c78a8")
AXES: Final = {
    "avoidance": ("avoidance time (s)", "share of samples"),
    "vibrating": ("energy (RMS)", "share of samples"),
    "still": ("energy (RMS)", "share of samples"),
    "places": ("x (m)", "y (m)"),
    "distances": ("time (s)", "distance (m)"),
    "steps": ("dx (m)", "dy (m)"),
}
SPANS: Final = {
    "avoidance": ((0.0, 8.0),),
    "vibrating": ((0.0, 6.0),),
    "still": ((0.0, 3.0),),
    "places": ((0.0, 1.0), (0.0, 1.0)),
    "distances": ((0.0, 1200.0), (0.0, 0.2)),
    "steps": ((-0.2, 0.2), (-0.2, 0.2)),
}
"""Ranges of the histograms that are drawn, as in the paper's figures."""
_BINS: Final = {"avoidance": 40, "vibrating": 50, "still": 50, "places": 15, "distances": 24, "steps": 39}

Floats = NDArray[np.float64]


def comparison_figure(
    real: Result, simulated: Result, found: Comparison, features: Sequence[str] = FEATURES
) -> Figure:
    """Draw a row for each feature, real and simulated, with similarities in the titles; legible in grey."""
    from matplotlib.figure import Figure

    real_sessions, simulated_sessions = sessions_of(real), sessions_of(seen_through(simulated, found.camera))
    shown = [feature for feature in features if feature not in found.missing]
    figure = Figure(figsize=(7.0, 2.6 * max(len(shown), 1)), layout="constrained")
    axes = figure.subplots(max(len(shown), 1), 2, squeeze=False)
    for row, feature in enumerate(shown):
        alike = next(similarity for similarity in found.similarities if similarity.feature == feature)
        values = [
            np.concatenate(sessions.values(feature)) for sessions in (real_sessions, simulated_sessions)
        ]
        _draw(axes[row], values, feature)
        axes[row][0].set_title(f"{WORDS[feature]}, real", fontsize=8)
        axes[row][1].set_title(
            f"simulated: S {alike.at_equal_counts:.3f} (null {alike.null:.3f}, ceiling {alike.ceiling:.3f})",
            fontsize=8,
        )
    return figure


def _draw(pair: NDArray[np.object_], values: list[Floats], feature: str) -> None:
    """Draw the histograms of one feature into two axes with a common scale."""
    spans, bins = SPANS[feature], _BINS[feature]
    if len(spans) == 1:
        heights = [np.histogram(each[:, 0], bins, spans[0])[0] / max(len(each), 1) for each in values]
        for axis, height, ink in zip(pair, heights, INK, strict=True):
            axis.stairs(height, np.linspace(*spans[0], bins + 1), fill=True, color=ink)
            axis.set_ylim(0.0, 1.05 * max(float(counts.max()) for counts in heights))
    else:
        grids = [np.histogram2d(each[:, 0], each[:, 1], bins, spans)[0] / len(each) for each in values]
        most = max(float(grid.max()) for grid in grids)
        for axis, grid in zip(pair, grids, strict=True):
            extent = (*spans[0], *spans[1])
            axis.imshow(
                grid.T, origin="lower", extent=extent, aspect="auto", cmap="Greys", vmin=0.0, vmax=most
            )
    for axis in pair:
        axis.set_xlabel(AXES[feature][0], fontsize=7)
        axis.set_ylabel(AXES[feature][1], fontsize=7)
        axis.tick_params(labelsize=6)


def write_comparison_pictures(real: Result, simulated: Result, found: Comparison, folder: Path) -> list[Path]:
    """Draw each feature into a file, and all into ``together.png``; returns the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for name in [feature for feature in FEATURES if feature not in found.missing] + ["together"]:
        chosen = FEATURES if name == "together" else (name,)
        with whole_file(folder / f"{name}.png") as part, MATPLOTLIB_LOCK:
            comparison_figure(real, simulated, found, chosen).savefig(part, dpi=150)
        written.append(folder / f"{name}.png")
    return written


def write_comparison_picture(real: Result, simulated: Result, found: Comparison, path: Path) -> None:
    """Draw all features into a file: PNG, SVG or PDF by its suffix."""
    with whole_file(path) as part, MATPLOTLIB_LOCK:
        comparison_figure(real, simulated, found).savefig(part, dpi=150)
