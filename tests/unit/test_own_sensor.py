"""A user's own sensor, which is one file, and what is said of one that is wrong: one sentence, from any command."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from helpers.commands import output_of, refusal_of, words_of
from vibroswarm import preset, simulate
from vibroswarm.cli import main
from vibroswarm.sensors.base import forget, register

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
BAD = {
    "measure raises": ("return u + kind", "return u[99999]", "mine.py, line 6, in measure: IndexError"),
    "measure draws": (
        "return u + kind",
        "return np.random.random(u.shape)",
        "line 6, in measure: draws random numbers",
    ),
    "measure has one that is no number": (
        "return u + kind",
        "return np.where(u > 0.999, np.nan, u + kind)",
        "measure: returned nan; return",
    ),
    "measure has another shape": ("return u + kind", "return 1.0", "measure: returned"),
    "reading returns nothing": ("return value > 1.0", "pass", "reading: returned None; return a class"),
    "reading raises": ("return value > 1.0", "return 1 / 0", "line 9, in reading: ZeroDivisionError"),
    "reading falls": ("return value > 1.0", "return abs(value - 0.5) > 0.2", "reading falls as u grows"),
    "reading is no class": ("return value > 1.0", "return 7 * (value > 1.0)", "reading: returned 7; return"),
    "kinds are not whole": (
        "likelihood=likelihood",
        "kinds=lambda p: 2.5",
        "kinds: returned 2.5; return a whole",
    ),
    "kinds are too many": ("likelihood=likelihood", "kinds=lambda p: 17", "kinds: returned 17"),
    "kinds raise": ("likelihood=likelihood", "kinds=lambda p: 1 / 0", "ZeroDivisionError"),
    "classes are too few": ("likelihood=likelihood", "readings=lambda p: 1", "readings: returned 1"),
    "likelihood raises": (
        "return np.where",
        "return 1 / 0\n    np.where",
        "in likelihood: ZeroDivisionError",
    ),
    "likelihood is negative": ("1.0, 1e-9)", "1.0, -1.0)", "likelihood: returned"),
    "likelihood is no density": ("1.0, 1e-9)", "0.4, 0.0)", "sums to 0.4 over all values on kind 0"),
    "check raises": ("likelihood=likelihood", "check=lambda p: p.gain", "AttributeError"),
}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run(text: str) -> int:
    """Run a strategy that reads everything that a sensor states: classes, error rates, and likelihoods of values."""
    Path("mine.py").write_text(text, encoding="utf-8")
    values = [
        "sensor.model=mine.py:mine",
        "run.t_end_s=60",
        "strategy.name=places",
        "localisation.method=true",
    ]
    values += [
        "strategy.places.energies=true",
        "network.name=loss",
    ]  # for which other tests compile the kernel
    return main(["run", "--trust", "--out", "run", *(word for value in values for word in ("--set", value))])


def test_a_file_is_a_sensor(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(GOOD) == 0, capsys.readouterr().err


def test_one_that_is_not_loaded_says_how_to_load_it(capsys: pytest.CaptureFixture[str]) -> None:
    """It once said: name its file with --sensor, an option that there is not."""
    assert run(GOOD) == 0
    forget("mine")  # as in another process
    again = ["run", "--scenario", "run/scenario.toml"]
    assert "sensor.model: 'mine.py:mine' is not loaded; add --trust to run the file" in refusal_of(
        capsys, *again
    )
    assert main([*again, "--trust"]) == 0


def test_the_results_of_a_study_say_what_they_need(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.py").write_text(GOOD, encoding="utf-8")
    short = ["--set", "sensor.model=mine.py:mine", "--set", "run.t_end_s=20", "--runs", "2"]
    assert main(["evaluate", "--trust", *short, "--no-pictures", "--no-confirm", "--out", "study"]) == 0
    forget("mine")
    shown = words_of(capsys, "show", "study")
    assert "need code that is not loaded (sensor.model: 'mine.py:mine' is not loaded; add --trust" in shown
    assert "Outcome" in output_of(capsys, "show", "study", "--trust")


@pytest.mark.parametrize("what", list(BAD))
def test_what_is_wrong_is_said_in_a_sentence(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    found, put, told = BAD[what]
    assert GOOD.count(found) == 1
    assert run(GOOD.replace(found, put)) in (1, 2)
    error = capsys.readouterr().err
    assert told in error
    assert "Traceback" not in error
    assert not list(Path().glob("run/*.parquet"))


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_sensor_whose_global_changes_reads_what_it_measures(wrapped: bool) -> None:
    forget("mine")
    session: dict[str, Any] = {"__name__": "session", "WIDTH": 0.1}
    exec(GOOD.replace("return u + kind", "return WIDTH * u + 2 * kind"), session)  # noqa: S102
    mine = session["mine"]
    register(replace(mine, measure=partial(mine.measure)) if wrapped else mine)
    scenario = preset("paper").with_values({"sensor.model": "mine", "run.t_end_s": 60.0})
    for session["WIDTH"] in (0.1, 4.0):
        seen = simulate(scenario, 1, energies=True).observations
        assert (seen["observation"] == (seen["energy"] > 1.0)).all()
