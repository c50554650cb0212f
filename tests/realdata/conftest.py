"""The recordings of the study's robots and the logs of its simulator, which stay where they are.

VIBROSWARM_RUGBOT names their folder; without it, what uses them is skipped.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from vibroswarm.paper.columns import AUTHORS, REAL, read_recordings
from vibroswarm.recordings.recording import Recording


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder."""
    folder = os.environ.get("VIBROSWARM_RUGBOT")
    if not folder:
        pytest.skip("VIBROSWARM_RUGBOT does not name the folder of the recordings")
    return Path(folder)


@pytest.fixture(scope="session")
def real(recordings: Path) -> Recording:
    """The three sessions of the robots."""
    return read_recordings(recordings, REAL)


@pytest.fixture(scope="session")
def simulated(recordings: Path) -> Recording:
    """The three logs of the simulator."""
    return read_recordings(recordings, AUTHORS)
