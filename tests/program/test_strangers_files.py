"""A stranger's sensor, task and strategy: three files written from the documentation, and nothing else touched.

A sensor that measures colour with a table of 4 x 4 shares, the task "is kind 2 above 10 %?", and a strategy that
reports an estimate of that share: checked, run, varied in a study, in a league, and exported to C.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
import pytest

from helpers.exported_robots import Swarm, built, measured_at_each_tick, needs_gcc, rows, run_program
from vibroswarm import Result, Scenario, load_code, preset, simulate
from vibroswarm.cli import main

FILES: Final = {
    "hue": """
import numpy as np

from vibroswarm.sensors import SensorModel

TABLE = np.array(
    [[0.90, 0.04, 0.03, 0.03], [0.05, 0.85, 0.05, 0.05], [0.02, 0.08, 0.80, 0.10], [0.05, 0.05, 0.15, 0.75]]
)


def colours(p):
    return 4


def measure(kind, u, p):
    return np.searchsorted(TABLE[kind].cumsum()[:3], u, side="right").astype(float)


def reading(value, p):
    return value.astype(int)


def likelihood(kind, value, p):
    return TABLE[kind, value.astype(int)]


hue = SensorModel(
    name="hue", kinds=colours, readings=colours, measure=measure, reading=reading, likelihood=likelihood
)
""",
    "enough": """
from typing import Annotated

from pydantic import Field

from vibroswarm.tasks import Task


class Params:
    kind: Annotated[int, Field(ge=0, le=15)] = 2
    more_than: Annotated[float, Field(gt=0, lt=1)] = 0.1


def scored(floor, asked, p):
    return floor.share_within(p.kind, asked.width_m, asked.height_m)


def truth(floor, asked, p):
    share = scored(floor, asked, p)
    return None if abs(share - p.more_than) < 1e-9 else int(share > p.more_than)


enough = Task(
    name="enough", truth=truth, scored=scored, params=Params, answers=("not enough is there", "enough is there")
)
""",
    "tally": """
import math
from typing import Annotated

from pydantic import Field

from vibroswarm.strategies import strategy_in


class Params:
    kind: Annotated[int, Field(ge=0, le=15)] = 2
    more_than: Annotated[float, Field(gt=0, lt=1, description="Share of readings above which it says yes.")] = 0.14
    spreads: Annotated[float, Field(gt=0)] = 2.0


class State:
    hits: int
    total: int
    estimate: float
    estimate_spread: float
    decision: int


class Message:
    colour: int


def begin(s, a, d, p, w):
    s.decision, s.estimate, s.estimate_spread = -1, math.nan, math.nan


def count(s, colour, p):
    s.hits += 1 if colour == p.kind else 0
    s.total += 1
    s.estimate = (s.hits + 1) / (s.total + 2)
    s.estimate_spread = math.sqrt(s.estimate * (1 - s.estimate) / (s.total + 3))


def on_message(s, a, m, sender, t_s, d, p, w):
    count(s, m.colour, p)


def on_sample(s, a, x, out, d, p, w):
    count(s, x.reading, p)
    if s.decision == -1 and s.total > w.min_observations:
        if abs(s.estimate - p.more_than) > p.spreads * s.estimate_spread:
            s.decision = 1 if s.estimate > p.more_than else 0
    out.colour = x.reading
    return True


def decision(s, a, p, w):
    return s.decision


tally = strategy_in(__name__, "tally", many_readings=True, reports=("estimate", "estimate_spread"))
""",
}
"""Names are those of the files, and of the objects in them."""
ASKED: Final = [
    *("--set", "sensor.model=hue.py:hue", "--task", "enough.py:enough", "--strategy", "tally.py:tally"),
    *("--set", "decision.min_observations=100"),
]
FLOOR: Final = ["--tiles", "10x10", "--floor", "random:0.4,0.3,0.2,0.1", "--set", "run.t_end_s=400"]


@pytest.fixture(autouse=True)
def _in_a_folder_with_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "files of a stranger"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.chdir(folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_each_file_passes_its_checks(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", f"{name}.py:{name}"]) == 0, capsys.readouterr().err
    assert "FAIL" not in capsys.readouterr().out


def test_they_run_and_the_estimate_is_judged_by_the_task(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", *ASKED, *FLOOR, "--out", "a run"]) == 0, capsys.readouterr().err
    result = Result.read("a run")
    assert result.runs.select("fill_ratio", "truth").row(0) == (0.2, 1)  # what estimates are scored against
    kept = result.robots["estimate"].to_list()
    assert all(0.15 < one < 0.3 for one in kept)
    reports = result.reports
    assert reports is not None
    last = reports.filter(pl.col("name") == "estimate").group_by("robot", maintain_order=True).last()
    assert last["value"].to_list() == pytest.approx(kept, abs=0.01)  # messages may come after the last sample


@pytest.mark.slow
@pytest.mark.usefixtures("empty_pictures")
def test_they_are_in_a_study_file() -> None:
    text = """
        runs = 10
        [scenario]
        preset = "paper"
        sensor = { model = "hue.py:hue" }
        task = { name = "enough.py:enough" }
        strategy = { name = "tally.py:tally" }
        floor = { rows = 10, columns = 10 }
        run = { t_end_s = 400.0 }
        [grid]
        "floor.source" = ["random:0.4,0.3,0.2,0.1", "random:0.5,0.4,0.05,0.05"]
        "strategy.tally.spreads" = [1.0, 3.0]
    """
    Path("study.toml").write_text(text, encoding="utf-8")
    assert main(["evaluate", "study.toml", "--trust", "--no-pictures", "--out", "grid"]) == 0
    summary = pl.read_parquet("grid/summary.parquet")
    assert summary["swarm_wrong"].to_list() == [0.0] * 4
    assert summary["estimate"].to_list() == pytest.approx([0.22, 0.22, 0.09, 0.09], abs=0.04)


def scenario() -> Scenario:
    found = {name: load_code(f"{name}.py:{name}") for name in FILES}
    values = {
        "sensor.model": found["hue"],
        "task.name": found["enough"],
        "strategy.name": found["tally"],
        "floor.source": "random:0.4,0.32,0.2,0.08",
        "decision.min_observations": 30,
        "run.t_end_s": 200.0,
    }
    return preset("paper").with_values(values)


@needs_gcc
@pytest.mark.slow
def test_exported_to_c_they_do_what_was_simulated_bit_by_bit(tmp_path: Path) -> None:
    asked, seed = scenario(), 4
    inspection = simulate(asked, seed, [0])
    readings = [inspection.observations.filter(robot=i)["observation"].to_list() for i in range(5)]
    swarm = Swarm(asked, seed, measured_at_each_tick(asked, seed, 9_999), readings)
    swarm.run()
    reports = inspection.reports
    assert reports is not None
    for i, robot in enumerate(swarm.robots):
        found, expected = rows(swarm.did[i], swarm), inspection.inference.filter(robot=i)
        np.testing.assert_array_equal(found[:, 3], expected["decision"])
        np.testing.assert_array_equal(found[:, 5], expected["messages_received"])
        assert robot.decision == inspection.robots["decision"][i]
    program = built(asked, tmp_path, precision=3)
    for events, walked in zip(swarm.whole, swarm.walked, strict=True):
        assert np.array(run_program(program, events)).tobytes() == np.array(walked).tobytes()
    # Negative control: with the classes of the next kind the robot does something else.
    swarm.readings[0] = [(kind + 1) % 4 for kind in readings[0]]
    other = Swarm(asked, seed, swarm.measured, swarm.readings)
    other.run()
    assert np.array(run_program(program, other.whole[0])).tobytes() != np.array(swarm.walked[0]).tobytes()
