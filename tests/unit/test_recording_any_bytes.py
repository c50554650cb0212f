"""Whatever a log holds, reading it gives a recording or an ``InputError``."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vibroswarm.errors import InputError
from vibroswarm.floors.floor import Floor
from vibroswarm.recordings.assemble_recording import recording_of
from vibroswarm.recordings.log_readers import read_log
from vibroswarm.scenario.scenario import preset

SHIPPED = Path(__file__).parents[2] / "examples" / "lab"
TEXTS = ("", "None", "nan", "inf", "-1", "0", "1", "2", "1e300", "-1e-300", "999999999999", "0.5", "x", '"')
CELLS = st.sampled_from([*TEXTS, "\u2028", "65536"])


def try_to_read(path: Path) -> None:
    with suppress(InputError):
        log = read_log(path)
        found = recording_of([log], Floor.filling([[0, 1], [1, 0]]), preset("paper"), any_floor=True)
        assert found.motion.height == found.observations.height == found.inference.height > 0
        assert np.isfinite(found.segments.select("x_m", "y_m", "heading_rad", "speed_m_s").to_numpy()).all()


@pytest.mark.slow
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_cells_changed_at_random(tmp_path: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(["session-1.csv", "console-1.txt"]))
    lines = (SHIPPED / name).read_text().splitlines()[:150]
    for _ in range(data.draw(st.integers(1, 6))):
        k = data.draw(st.integers(0, len(lines) - 1))
        cells = lines[k].split(",")
        cells[data.draw(st.integers(0, len(cells) - 1))] = data.draw(CELLS)
        lines[k] = ",".join(cells)
        if data.draw(st.booleans()):
            lines.insert(data.draw(st.integers(1, len(lines))), lines[k])
    (tmp_path / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    try_to_read(tmp_path / name)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=400), st.sampled_from(["session-1.csv", "console-1.txt"]))
def test_any_bytes(tmp_path: Path, data: bytes, name: str) -> None:
    head = (SHIPPED / name).read_bytes()[:3000]
    (tmp_path / name).write_bytes(head + data)
    try_to_read(tmp_path / name)
