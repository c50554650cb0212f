"""Energies computed from recorded acceleration: against scipy, through the command, in C, and what is refused."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import signal

from helpers.exported_robots import ACCELERATE, OBSERVED, START, STEP, built, run_program
from helpers.plain_program import plain_program
from vibroswarm import preset
from vibroswarm.cli import main
from vibroswarm.export.assembly import parts_of
from vibroswarm.recordings.recording import Recording
from vibroswarm.robot.walk import DRIVE, STOP

SHIPPED = Path(__file__).parents[2] / "examples" / "lab"
RATE_HZ, COUNT = 350.0, 175
STOP_COUNT = COUNT + 5
"""Readings of a stop, of which a sample takes the last."""


def shaken(energy: float, rng: np.random.Generator, count: int = COUNT) -> np.ndarray[Any, Any]:
    """Acceleration of a robot that stands on a tile: gravity and vibration, (count, 3)."""
    t = np.arange(count) / RATE_HZ
    moved = np.stack([np.zeros(count), np.zeros(count), energy * np.sin(2 * np.pi * 97.0 * t)], axis=1)
    return np.array([0.0, 0.0, 9.81]) + moved + rng.normal(0.0, 0.05, (count, 3))


def energy_of(acceleration: np.ndarray[Any, Any]) -> float:
    """Algorithm 2 by scipy's filter."""
    magnitude = np.sqrt((acceleration**2).sum(axis=1))
    start = signal.lfilter_zi([0.6, -0.6], [1.0, -0.2]) * magnitude[0]
    filtered, _ = signal.lfilter([0.6, -0.6], [1.0, -0.2], magnitude, zi=start)
    return float(np.sqrt((filtered**2).mean()))


def recorded(log: Path, path: Path, rate_hz: float = RATE_HZ, leave_out: Collection[int] = ()) -> list[float]:
    """Write a file of acceleration for the samples of a log; return their energies."""
    rng, energies = np.random.default_rng(3), []
    samples = pl.read_csv(log)
    with path.open("w", newline="") as stream:
        out = csv.writer(stream)
        out.writerow(("robot", "time_s", "ax", "ay", "az"))
        for k, row in enumerate(samples.iter_rows(named=True)):
            acceleration = shaken(float(row["rms"]), rng, STOP_COUNT)
            energies.append(energy_of(acceleration[-COUNT:]))
            # Written to a millisecond, the time of the last reading is one later than that of the sample.
            times = (float(row["t_ms"]) + 0.7) / 1000.0 - (STOP_COUNT - 1 - np.arange(STOP_COUNT)) / rate_hz
            for j, (time_s, values) in enumerate(zip(times, acceleration, strict=True)):
                if k != 7 or j not in leave_out:
                    out.writerow((row["id"], f"{time_s:.3f}", *(repr(float(v)) for v in values)))
    return energies


def arguments(path: Path, out: Path) -> list[str]:
    logs = [str(SHIPPED / "camera.csv"), "--columns", str(SHIPPED / "columns.toml")]
    floor = ["--floor", str(SHIPPED / "floor.txt"), "--any-floor"]
    return ["lab", "import", *logs, *floor, "--acceleration", str(path), "--out", str(out)]


@pytest.fixture(scope="module")
def acceleration(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[float]]:
    """A file of acceleration for the samples of the shipped log, and their energies."""
    path = tmp_path_factory.mktemp("recorded") / "acceleration.csv"
    return path, recorded(SHIPPED / "camera.csv", path)


def test_import_computes_the_energies_that_scipy_computes(
    acceleration: tuple[Path, list[float]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, expected = acceleration
    assert main([*arguments(path, tmp_path / "lab"), "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["tables"]["acceleration"]
    assert f"{len(expected)} energies computed from" in row["words"]
    assert f"{len(expected)} energies computed from" in (tmp_path / "lab" / "report.json").read_text()
    found = Recording.read(tmp_path / "lab").rows["energy"].to_numpy()
    logged = pl.read_csv(SHIPPED / "camera.csv")["rms"].to_numpy()
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=1e-12)
    assert np.abs(np.sort(found) - np.sort(logged)).max() > 0.05  # not those of the log


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_an_exported_robot_observes_the_recorded_acceleration(tmp_path: Path) -> None:
    scenario, rng = preset("paper").with_values({"strategy.name": "none"}), np.random.default_rng(5)
    module, events, expected, found = plain_program(parts_of(scenario)), [START, 1.0, 0.0, 0.0], [], []
    robot = module.Robot()
    module.start(robot, 1, 0, 0)

    def step() -> bool:
        turned_deg = 0.04 * module.right_percent(robot) if robot.walk.mode != DRIVE else 0.0
        events.extend((STEP, turned_deg, 5000.0))
        return bool(module.step(robot, turned_deg, 5000.0))

    def accelerate(readings: np.ndarray[Any, Any]) -> None:
        for reading in readings.tolist():
            events.extend((ACCELERATE, *reading))
            module.accelerate(robot, *reading)

    for energy in rng.uniform(0.5, 5.0, 12):
        while robot.walk.mode != STOP:
            step()
        while robot.walk.stopped_ms < 500:
            accelerate(shaken(50.0, rng, 3))  # while it settles, which is not to count
            step()
        acceleration = shaken(float(energy), rng)
        accelerate(
            np.concatenate([acceleration, shaken(50.0, rng, 9)])
        )  # those after the signal do not count
        expected.append(float(energy_of(acceleration) > scenario.sensor.rms_threshold))
        found.append(float(module.observed(robot)))
        events.append(OBSERVED)
        while not step():
            pass
        step()
    assert found == expected
    assert 3 < sum(expected) < 12  # of both kinds
    program = built(scenario, tmp_path, precision=1)
    ran = run_program(program, events)
    assert observations_in(ran) == expected


def observations_in(numbers: list[float]) -> list[float]:
    """Observations among the rows of the walk, which have six numbers and begin with a tick."""
    found, k = [], 0
    while k < len(numbers):
        if numbers[k] < 0.0:
            found.append(-1.0 - numbers[k])
        k += 1 if numbers[k] < 0.0 else 6
    return found
