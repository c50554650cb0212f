"""The recordings of the study's robots under the strategies: as they decided, and as they would have at 1.4.

They stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import pytest

from vibroswarm.lab.replay import logged_outcomes, replay_recording, session_outcomes
from vibroswarm.recordings.recording import Recording

DECIDED = {"decision.gate": "own", "decision.min_observations": 84, "strategy.name": "positive"}


def test_as_they_ran_they_decide_as_they_did(real: Recording) -> None:
    replayed = replay_recording(real, real.scenario.with_values(DECIDED), draws=20)
    logged = logged_outcomes(real)
    for mine, theirs in zip(session_outcomes(real, replayed), logged, strict=True):
        assert mine.consensus == {"right": 1.0}
        assert mine.decision_time_s == pytest.approx(theirs.decision_time_s, abs=30.0)


def test_at_a_lower_threshold_session_two_goes_wrong(real: Recording) -> None:
    lower = replay_recording(
        real, real.scenario.with_values(DECIDED | {"sensor.rms_threshold": 1.4}), draws=20
    )
    assert session_outcomes(real, lower)[1].consensus.get("wrong", 0.0) > 0.9
