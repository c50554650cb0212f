"""Whatever a log holds, reading it gives a recording or an ``InputError``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.read import read_log
from vibroswarm.scenario.scenario import preset


def try_to_read(path: Path) -> None:
    with suppress(InputError):
        log = read_log(path)
        found = recording_of([log], Floor.filling([[0, 1], [1, 0]]), preset("paper"), any_floor=True)
        assert found.motion.height == found.observations.height == found.inference.height > 0
        assert np.isfinite(found.poses.select("x_m", "y_m", "heading_rad").to_numpy()).all()


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=400), st.booleans())
def test_any_bytes(
    tmp_path: Path, logs: list[Path], console_logs: list[Path], data: bytes, console: bool
) -> None:
    head = (console_logs if console else logs)[0].read_bytes()[:3000]
    (tmp_path / "log").write_bytes(head + data)
    try_to_read(tmp_path / "log")
