"""Spectra of recorded acceleration: lines whose frequency is known, what folds onto them, and bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from vibroswarm.errors import InputError
from vibroswarm.lab.spectrum import spectra_of

RATE_HZ = 350.0


def recorded(
    vertical: list[tuple[float, float]],
    across: list[tuple[float, float]],
    count: int = 40,
    noise: float = 0.2,
) -> pl.DataFrame:
    """A recording of two robots: stops of 0.8 s, with sines (Hz, amplitude) upwards and across, and gravity."""
    rng, readings = np.random.default_rng(5), 280
    t = np.arange(readings) / RATE_HZ
    values = noise * rng.standard_normal((count, 3, readings))
    values[:, 2] += 9.81
    for axis, sines in ((2, vertical), (0, across)):
        for hz, amplitude in sines:
            phases = rng.uniform(0, 2 * np.pi, (count, 1))
            values[:, axis] += amplitude * np.cos(2 * np.pi * hz * t + phases)
    ends_s = 5.0 + 3.0 * np.arange(count)
    time_s = (ends_s[:, None] + np.arange(1 - readings, 1) / RATE_HZ).ravel()
    axes = dict(zip(("ax", "ay", "az"), values.transpose(1, 0, 2).reshape(3, -1), strict=True))
    frame = pl.DataFrame({"robot": np.repeat(np.arange(count) % 2, readings), "time_s": time_s} | axes)
    x_m = np.repeat(np.where(np.arange(count) % 2, 0.1, 0.9), readings)
    return frame.with_columns(x_m=x_m, y_m=np.full(frame.height, 0.9)).sort("robot", "time_s")


def file_of(frame: pl.DataFrame, folder: Path) -> Path:
    path = folder / "acceleration.csv"
    frame.write_csv(path)
    return path


def test_lines_are_where_the_sines_are(tmp_path: Path) -> None:
    path = file_of(recorded([(61.3, 1.0), (120.0, 0.5)], []), tmp_path)
    found = spectra_of(path, axis="z", by=("robot", "tile", "time"))
    assert (found.samples, found.stops) == (40, 40)
    assert found.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)
    lines = found.whole.lines
    assert [round(line.hz) for line in lines] == [61, 120]
    for line, hz, amplitude in zip(lines, (61.3, 120.0), (1.0, 0.5), strict=True):
        assert line.low < hz < line.high
        assert line.high - line.low < 2.0
        assert line.amplitude == pytest.approx(amplitude, rel=0.1)
        assert line.folds_from == pytest.approx((RATE_HZ - line.hz, RATE_HZ + line.hz))
    groups = [(one.group, one.name, one.samples) for one in found.spectra]
    assert groups[:5] == [
        ("all", "", 40), ("robot", "robot 0", 20), ("robot", "robot 1", 20), ("tile", "tile 1, 1", 20),
        ("tile", "tile 1, 5", 20),
    ]  # fmt: skip
    assert sum(one.samples for one in found.spectra if one.group == "time") == 40


def test_a_magnitude_doubles_horizontal_frequencies(tmp_path: Path) -> None:
    path = file_of(recorded([], [(40.0, 6.0)]), tmp_path)
    (line, *_) = spectra_of(path).whole.lines
    assert line.hz == pytest.approx(80.0, abs=0.5)
    assert "twice the horizontal 40.0 Hz" in line.words
    (line, *_) = spectra_of(path, axis="x").whole.lines
    assert line.hz == pytest.approx(40.0, abs=0.5)


def test_a_recording_without_pauses_is_refused(tmp_path: Path) -> None:
    frame = recorded([(61.3, 1.0)], []).drop("x_m", "y_m")
    time_s = pl.int_range(pl.len()) / RATE_HZ
    with pytest.raises(InputError, match="without a pause"):
        spectra_of(file_of(frame.with_columns(robot=0, time_s=time_s), tmp_path))
