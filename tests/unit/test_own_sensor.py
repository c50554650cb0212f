"""A user's own sensor, which is one file, and what is said of one that is wrong: one sentence, from any command."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm.cli import main

GOOD = """
import numpy as np
from vibroswarm.sensors import SensorModel

def measure(kind, u, p):
    return u + kind

def reading(value, p):
    return value > 1.0

def likelihood(kind, value, p):
    return np.where((value > kind) & (value < kind + 1.0), 1.0, 1e-9)

mine = SensorModel(name="mine", measure=measure, reading=reading, likelihood=likelihood)
"""


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(text: str) -> int:
    """Run a strategy that reads classes and error rates."""
    Path("mine.py").write_text(text, encoding="utf-8")
    values = [
        "sensor.model=mine.py:mine",
        "run.t_end_s=60",
        "strategy.name=places",
        "localisation.method=true",
    ]
    values += ["network.name=loss"]  # for which other tests compile the kernel
    return main(["run", "--trust", "--out", "run", *(word for value in values for word in ("--set", value))])


def test_a_file_is_a_sensor(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(GOOD) == 0, capsys.readouterr().err
