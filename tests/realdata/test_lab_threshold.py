"""The thresholds of the study's robots: what the readings say of error rates and edges.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import pytest

from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import at_threshold, find_threshold


def test_error_rates_at_the_simulators_threshold(real: Recording) -> None:
    found = at_threshold(real, 1.33)
    assert found.all_samples.false_positive == pytest.approx(0.163, abs=0.001)
    assert found.all_samples.false_negative == pytest.approx(0.147, abs=0.001)
    assert found.decidable.verdict == "indistinguishable from the boundary"
    assert at_threshold(real, 1.55).share_by_session.high < 0.5


def test_equal_error_is_near_what_the_simulations_used(real: Recording) -> None:
    equal = find_threshold(real)
    assert equal.low < 1.33 < equal.high
    assert 1.30 < equal.value < 1.40
