"""Real against simulated: the paper's six similarities in their place, and two measures that discriminate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vibroswarm.calibrate.classifier import ToldApart, tell_apart
from vibroswarm.calibrate.energy_distance import EnergyDistance, Known, compare_distance
from vibroswarm.calibrate.features import FEATURES, sessions_of
from vibroswarm.calibrate.similarity import Similarity, compare_feature
from vibroswarm.result import Result


@dataclass(frozen=True)
class Comparison:
    """What ``compare`` finds; features that one of the two cannot give are missing."""

    similarities: tuple[Similarity, ...]
    distances: tuple[EnergyDistance, ...]
    told_apart: ToldApart
    missing: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "similarities": [one.as_dict() for one in self.similarities],
            "energy_distances": [one.as_dict() for one in self.distances],
            "told_apart": self.told_apart.as_dict(),
            "missing": list(self.missing),
        }


def compare(real: Result, simulated: Result, known: Known | None = None) -> Comparison:
    """Compare the samples of two results, each run being a session.

    Args:
        real: recordings, or what takes their place. simulated: of the same floor and settings.
        known: what was found of the same ``real`` before; added to.
    Raises:
        InputError: no energies, or fewer than two robots.
    """
    one, other = sessions_of(real), sessions_of(simulated)
    similarities, distances, missing = [], [], []
    for feature in FEATURES:
        values = one.values(feature), other.values(feature)
        published = one.values(feature, as_published=True), other.values(feature, as_published=True)
        alike = compare_feature(feature, *values, published)
        apart = compare_distance(feature, *values, known=known)
        if alike is None or apart is None:
            missing.append(feature)
            continue
        similarities.append(alike)
        distances.append(apart)
    return Comparison(
        tuple(similarities), tuple(distances), tell_apart(one.samples, other.samples), tuple(missing)
    )
