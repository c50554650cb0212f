"""Preset `calibrated` against the recordings: its headline figures, seen through the camera of the recordings.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vibroswarm.calibrate.compare import compare
from vibroswarm.paper.columns import AUTHORS, EMPIRICAL, read_recordings, real_floor, scenario_of
from vibroswarm.recordings.recording import Recording
from vibroswarm.result import Result
from vibroswarm.simulation import simulate

pytest.importorskip("sklearn", reason="scikit-learn is not installed: pip install 'vibroswarm[lab]'")

pytestmark = pytest.mark.slow
SEEDS = (150, 151)


def simulated(seed: int, column: str = "calibrated", **values: Any) -> Result:
    """Three sessions with the settings and on the floor of the recordings."""
    changes = {name.replace("__", "."): value for name, value in values.items()}
    scenario = scenario_of(column, real_floor(), parameter_set=EMPIRICAL).with_values(changes)
    return simulate(scenario, seed, 3)


def test_each_similarity_is_at_least_the_studys_simulators(real: Recording, recordings: Path) -> None:
    authors = compare(real, read_recordings(recordings, AUTHORS))
    ours = [compare(real, simulated(seed)) for seed in SEEDS]
    theirs = {one.feature: one.at_equal_counts for one in authors.likenesses}
    alike = {
        name: np.mean(
            [one.at_equal_counts for each in ours for one in each.likenesses if one.feature == name]
        )
        for name in theirs
    }
    for feature, share in alike.items():  # energies differ by the tiles that are drawn: 0.004 between sets
        assert share > theirs[feature] - 0.006, feature
    assert alike["avoidance"] > theirs["avoidance"] + 0.02
    assert alike["places"] > theirs["places"] + 0.02
    # Control: the preset that is not fitted is below them in two features and more.
    paper = compare(real, simulated(SEEDS[0], "paper")).likenesses
    assert sum(one.at_equal_counts < theirs[one.feature] - 0.006 for one in paper) >= 2
    told = [found.recognised.estimate for found in ours if found.recognised is not None]
    assert len(told) == len(SEEDS)
    assert np.mean(told) < 0.65
    assert authors.recognised is not None
    assert authors.recognised.estimate > 0.7  # the control
