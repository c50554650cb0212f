"""The recordings of the study's robots under the strategies: as they decided, and as they would have at 1.4.

They stay where they are; VIBROSWARM_RUGBOT names their folder.
"""

from __future__ import annotations

import os
from pathlib import Path

import polars as pl
import pytest

from vibroswarm.floors.floor import Floor
from vibroswarm.floors.io import read_tiles
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.recordings.recording import Recording
from vibroswarm.recordings.replay import logged_outcomes, replay_recording, session_outcomes
from vibroswarm.scenario.scenario import preset

FOLDER = os.environ.get("VIBROSWARM_RUGBOT", "")
pytestmark = pytest.mark.skipif(
    not FOLDER, reason="VIBROSWARM_RUGBOT does not name the folder of the recordings"
)


@pytest.fixture(scope="module")
def real() -> Recording:
    floor = Floor.filling(read_tiles(Path(FOLDER) / "world.txt", (5, 5)), name="world.txt")
    logs = [read_log(Path(FOLDER) / f"CAL_{k}.csv") for k in (1, 2, 3)]
    return recording_of(logs, floor, preset("paper"))


def test_as_they_ran_they_decide_as_they_did(real: Recording) -> None:
    """Threshold, gate and strategy are those that were inferred, so this is their evidence too."""
    replayed = replay_recording(real, real.scenario, draws=20)
    logged = logged_outcomes(real)
    for mine, theirs in zip(session_outcomes(real, replayed), logged, strict=True):
        assert mine.consensus == {"right": 1.0}
        assert mine.decision_time_s == pytest.approx(theirs.decision_time_s, abs=30.0)
    # Sessions 1 and 3 waited for the gate: to the sample.
    gated = replayed.robots.filter(pl.col("run") != 1).join(
        real.robots, on=["run", "robot"], suffix="_logged"
    )
    assert (gated["decision_time_s"] == gated["decision_time_s_logged"]).all()
    assert replayed.put_back == 4
    assert replayed.unsent == 0


def test_at_a_lower_threshold_session_two_goes_wrong(real: Recording) -> None:
    lower = replay_recording(real, real.scenario.with_values({"sensor.rms_threshold": 1.4}), draws=20)
    assert session_outcomes(real, lower)[1].consensus.get("wrong", 0.0) > 0.9
