"""The thresholds of the study's robots: what the readings say of error rates and edges.

The recordings stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from vibroswarm.documents.recording import threshold_document
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.threshold import at_threshold, edge_profile, find_thresholds, labelled, recommend


def test_error_rates_at_the_simulators_threshold(real: Recording) -> None:
    found = at_threshold(real, 1.33)
    assert found.all_samples.false_positive == pytest.approx(0.163, abs=0.001)
    assert found.all_samples.false_negative == pytest.approx(0.147, abs=0.001)
    assert found.decidable.verdict == "indistinguishable from the boundary"
    assert at_threshold(real, 1.55).share_by_session.high < 0.5


def test_equal_error_is_near_what_the_simulations_used(real: Recording) -> None:
    equal = find_thresholds(real)[0]
    assert equal.low < 1.33 < equal.high
    assert 1.30 < equal.value < 1.40


def test_the_answer_says_at_what_price_the_threshold_in_use_decides(real: Recording) -> None:
    """1.55 reads 44.6 % of this floor as vibrating, and would read less than half of one with 55 %, too."""
    chosen = find_thresholds(real)[0]

    def answer(value: float) -> tuple[str, ...]:
        found = replace(recommend(real), in_use=at_threshold(real, value), chosen=chosen)
        return tuple(threshold_document(found).answer)

    assert len(answer(1.33)) == 2
    assert "one with 50 % to 56 % vibrating tiles would be taken for below 50 %" in answer(1.55)[2]
    assert "one with 50 % to 100 % vibrating tiles would be taken for below 50 %" in answer(3.0)[2]
    errors = at_threshold(real, 1.55).all_samples
    assert 0.55 * (1 - errors.false_negative) + 0.45 * errors.false_positive < 0.5


def test_false_positives_sit_at_the_edges(real: Recording) -> None:
    profile = edge_profile(labelled(real), 1.33)
    assert profile["false_positive"][0] > 0.44  # within 10 mm of a vibrating tile
    assert profile["false_positive"][-1] < 0.06  # beyond 60 mm
    assert profile["false_positive"].is_sorted(descending=True)
