"""Tasks and sources of motion from outside the package, through the whole program."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from helpers.commands import output_of, refusal_of
from vibroswarm import preset, tasks
from vibroswarm.cli import main
from vibroswarm.core.user_code import errors_in
from vibroswarm.errors import CodeError
from vibroswarm.motion import source
from vibroswarm.result import Result
from vibroswarm.scenario import plugins
from vibroswarm.simulation import simulate
from vibroswarm.study.study_result import StudyResult

SHORT = ("--set", "run.t_end_s=200", "--set", "decision.min_observations=10")
HALVES = '''"""Does the left part of the floor vibrate more than the right?"""

from typing import Annotated

from pydantic import Field

from vibroswarm.tasks import Task


class Params:
    columns: Annotated[int, Field(ge=1)] = 2


def truth(floor, asked, p):
    left, right = (half.sum() for half in (floor.tiles[:, : p.columns], floor.tiles[:, -p.columns :]))
    return None if left == right else int(left > right)


halves = Task(name="halves", truth=truth, params=Params, answers=("it is the right", "it is the left"))
'''
STANDING = '''"""Robots that stand in a row, and sample every ten seconds."""

import math

import polars as pl

from vibroswarm.motion.source import ENDS, MOTION, Motion, Source


class Standing:
    def __init__(self, scenario, seed, run, segments=False, moves=False):
        self.scenario, self.run, self.tick = scenario, run, 0

    @property
    def time_s(self):
        return self.tick * self.scenario.tick_s

    def advance(self, until_s):
        since, s = self.tick, self.scenario
        self.tick = max(self.tick, math.ceil(until_s / s.tick_s - 1e-9))
        every, robots = round(10.0 / s.tick_s), range(s.swarm.robots)
        place = [{"run": self.run, "robot": i, "x_m": 0.1 + 0.1 * i, "y_m": 0.5, "heading_rad": 0.0} for i in robots]
        samples = [
            one | {"sample": k, "time_s": (k + 1) * 10.0, "stop_start_s": k * 10.0, "stop_s": 10.0}
            for k in range(max(since - 1, 0) // every, max(self.tick - 1, 0) // every)
            for one in place
        ]
        spent = {"drive_s": 0.0, "turn_s": 0.0, "avoid_s": 0.0}
        table = pl.DataFrame([row | spent for row in samples], schema=MOTION)
        ends = pl.DataFrame([one | {"end_s": self.time_s, "stop_start_s": None} for one in place], schema=ENDS)
        return Motion(table, ends)

    def copy(self):
        other = Standing(self.scenario, 0, self.run)
        other.tick = self.tick
        return other


standing = Source("standing", Standing)
'''


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "halves.py").write_text(HALVES, encoding="utf-8")
    (tmp_path / "standing.py").write_text(STANDING, encoding="utf-8")
    yield tmp_path  # type: ignore[misc]
    as_in_another_process()


def as_in_another_process() -> None:
    """Nothing of these files is known, nor their texts."""
    tasks.base.forget("halves")
    source.forget("standing")
    plugins._texts.clear()


def right_by_hand(result: Result, run: int) -> int | None:
    tiles = np.array(result.floor(run).tiles, dtype=int)
    left, right = int(tiles[:, :2].sum()), int(tiles[:, 3:].sum())
    return None if left == right else int(left > right)


def test_a_task_says_which_decision_is_right(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, task = files / "out", f"{files / 'halves.py'}:halves"
    command = ["run", "--task", task, *SHORT, "--set", "task.halves.columns=2", "--out", str(out)]
    assert "it is the " in output_of(capsys, *command)
    result = Result.read(out)
    assert "it is the left" in (out / "run.html").read_text(encoding="utf-8")
    assert (out / "halves.py").read_text(encoding="utf-8") == HALVES
    usual = simulate(
        preset("paper").with_values({"run.t_end_s": 200.0, "decision.min_observations": 10}), 1, 30
    )
    other = simulate(usual.scenario.with_values({"task.name": "halves"}), 1, 30)
    assert other.robots.drop("belief_in_truth").equals(usual.robots.drop("belief_in_truth")), (
        "nobody acts otherwise"
    )
    assert other.runs["truth"].to_list() == [right_by_hand(other, run) for run in range(30)]
    assert set(other.runs["truth"].to_list()) == {None, 0, 1}
    assert set(usual.runs["truth"].to_list()) == {0}
    assert result.runs["truth"].to_list() == other.runs["truth"].to_list()[:1]
    as_in_another_process()
    assert "is not loaded; add --trust to run the file" in refusal_of(capsys, "show", out)


@pytest.mark.slow
def test_tasks_side_by_side_are_kept_apart(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, task = files / "a study", f"{files / 'halves.py'}:halves"
    study = [
        "evaluate",
        *SHORT,
        "--vary",
        f"task.name=fill_ratio,{task}",
        "--no-confirm",
        "--no-pictures",
        "--out",
        str(out),
    ]
    assert main([*study, "--runs", "20"]) == 0
    table = pl.read_csv(out / "summary.csv")
    assert table["swarm_right"].n_unique() == 2
    as_in_another_process()
    assert main(["show", str(out)]) == 0
    assert "--trust" in refusal_of(capsys, "evaluate", out / "study.toml", "--runs", "24", "--out", out)
    again = [
        "evaluate",
        str(out / "study.toml"),
        "--runs",
        "24",
        "--out",
        str(out),
        "--trust",
        "--no-confirm",
        "--no-pictures",
    ]
    assert main([*again, "--executor", "processes", "--workers", "1"]) == 0
    assert StudyResult.open(out).cells["there"].to_list() == [24, 24]


def test_a_search_with_a_task(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    never_even = HALVES.replace("None if left == right else int(left > right)", "int(left > right)")
    (files / "halves.py").write_text(never_even, encoding="utf-8")
    search = files / "search.toml"
    search.write_text(
        """[scenario]
task = { name = "halves.py:halves" }
decision = { min_observations = 10 }
run = { t_end_s = 100 }
[space]
"sample.sample_interval_ms" = { from = 1000.0, to = 5000.0 }
[search]
method = "random"
budget = 20
evaluations = 4
fresh = 8
""",
        encoding="utf-8",
    )
    command = [
        "optimize",
        str(search),
        "--workers",
        "1",
        "--no-pictures",
        "--trust",
        "--out",
        str(files / "found"),
    ]
    assert "Best: " in output_of(capsys, *command)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "None if left == right else int(left > right)",
            "7",
            "line 14, in truth: returned 7; return 0, 1 or None",
        ),
        ("left, right =", "left, right, more =", "line 15, in truth: ValueError"),
        ("def truth(floor, asked, p):", "def truth(floor, p):", "line 14, in truth: TypeError"),
        ("truth=truth", "truth=lambda floor, asked: 1", "line 19, in <lambda>: TypeError"),
        ("truth=truth", "truth=partial(truth, asked=None)", "task 'halves', truth: TypeError"),
        ("truth=truth", "truth=partial(int)", "task 'halves', truth: TypeError"),
        ("truth=truth", "truth=partial(lambda *_: 7)", "task 'halves', truth: returned 7"),
        ("truth=truth", "truth=truth, check=lambda *_: 1 / 0", "line 19, in <lambda>: ZeroDivisionError"),
        (
            "truth=truth",
            "truth=truth, check=lambda *_: False",
            "halves.check: returned False; raise InputError",
        ),
        ("params=Params", "params=Params()", "is not a class; give the class itself"),
    ],
)
def test_a_task_that_is_wrong(
    old: str, new: str, words: str, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = files / "halves.py", files / "out"
    text = HALVES.replace(old, new).replace(
        "from typing import", "from functools import partial; from typing import"
    )
    file.write_text(text, encoding="utf-8")
    # Declarations that are wrong are bad input; code that fails is a failure.
    code = 2 if words.startswith(("halves.check", "is not a class")) else 1
    assert main(["run", "--task", f"{file}:halves", *SHORT, "--out", str(out)]) == code
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_what_a_file_prints_goes_to_stderr(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "print('loaded')\n" + HALVES.replace("    left, right =", "    print('asked')\n    left, right =")
    (files / "halves.py").write_text(text, encoding="utf-8")
    assert main(["run", "--task", f"{files / 'halves.py'}:halves", *SHORT, "--json"]) == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["answer"]
    assert shown.err.splitlines()[:2] == ["loaded", "asked"]


@pytest.mark.parametrize("draw", ["random()", "chance.random()"])
def test_a_task_that_draws_is_refused(draw: str, files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = "import random as chance\nfrom random import random\n" + HALVES
    text = text.replace("None if left == right else int(left > right)", f"int({draw} > 0.5)")
    (files / "halves.py").write_text(text, encoding="utf-8")
    assert "in truth: draws random numbers of its own" in refusal_of(
        capsys, "run", "--task", f"{files / 'halves.py'}:halves", *SHORT
    )


@pytest.mark.slow
def test_motion_of_a_file(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion, out = f"{files / 'standing.py'}:standing", files / "out"
    assert "No page" in output_of(capsys, "run", "--motion", motion, *SHORT, "--out", out)
    result = Result.read(out)
    assert result.source.startswith("standing.py:standing sha256:")
    assert result.motion["time_s"].unique().to_list() == [10.0 * k for k in range(1, 20)]
    study = files / "a study"
    command = [
        "evaluate",
        "--motion",
        motion,
        *SHORT,
        "--strategy",
        "none,soft",
        "--no-confirm",
        "--no-pictures",
        "--out",
        str(study),
    ]
    assert main([*command, "--runs", "8"]) == 0
    as_in_another_process()
    assert main(["show", str(study)]) == 0
    again = ["evaluate", str(study / "study.toml"), "--out", str(study), "--runs", "12", "--no-pictures"]
    again += ["--no-confirm"]
    assert "is not loaded" in refusal_of(capsys, *again)
    assert main([*again, "--trust", "--executor", "processes", "--workers", "1"]) == 0
    manifest = json.loads((study / "vibroswarm.json").read_text(encoding="utf-8"))
    assert manifest["kind"] == "study"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("0.1 + 0.1 * i", "0.9 + 0.1 * i", "column 'x_m' leaves the arena"),
        ("(k + 1) * 10.0", "(k + 3) * 10.0", "has times of 30 to 110 s"),
        ('"drive_s": 0.0, ', "", "column 'drive_s' lacks a value in row 0"),
        ('"drive_s": 0.0, ', '"drive_s": float("nan"), ', "samples: column 'drive_s' holds nan in row 0"),
        ("return Motion(table, ends)", "return table", "gives DataFrame, not Motion"),
        ("return Motion(table, ends)", 'return Motion(table.drop("x_m"), ends)', "samples': 'x_m' is missing"),
        ("self.tick = max", "self.ticks = max", "its time_s is 0"),
        ("every, robots =", "every, robots, more =", "line 21, in advance: ValueError"),
        ("return Motion(table, ends)", "return Motion(table.reverse(), ends)", "is not sorted"),
        ("return Motion(table, ends)", "return Motion(table, ends[1:])", "exactly one row for each of the 5 robots"),
    ],
)  # fmt: skip
def test_motion_that_is_wrong_is_refused(
    old: str, new: str, words: str, files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = files / "standing.py", files / "out"
    assert old in STANDING
    file.write_text(STANDING.replace(old, new), encoding="utf-8")
    assert main(["run", "--motion", f"{file}:standing", *SHORT, "--out", str(out)]) == 1
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_motion_cannot_be_steered_if_it_says_so(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    avoider = Path(__file__).parents[2] / "examples" / "strategies" / "avoider.py"
    command = ["run", "--motion", f"{files / 'standing.py'}:standing", "--strategy", f"{avoider}:avoider"]
    assert "cannot be steered" in refusal_of(capsys, *command)


@pytest.mark.parametrize("given", ["[0.5, 2]", "[]"])
def test_a_parameter_that_is_a_list_is_set(tmp_path: Path, given: str) -> None:
    """As docs/own-strategy.md declares one: with no further word to Pydantic."""
    path = tmp_path / "slow_list.py"
    path.write_text(
        "from vibroswarm.networks import Network\nclass Params:\n    waits: tuple[float, ...] = (1.0,)\n"
        "def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w):\n"
        "    for j in range(w.robots):\n        if j != sender:\n"
        "            arrival_tick[j] = tick + 1 + int(a.waits.sum())\n"
        'slow_list = Network("slow_list", send=send, params=Params)\n',
        encoding="utf-8",
    )
    network = ["--network", f"{path}:slow_list", "--set", f"network.slow_list.waits={given}"]
    assert main(["run", *network, "--set", "run.t_end_s=20", "--json"]) == 0


@pytest.mark.parametrize("folder", ["elsewhere", "day 2: noon"])
def test_lines_of_another_file_of_the_same_name_are_not_named(folder: str) -> None:
    file = f"/{folder}/{Path(__file__).name}"
    with pytest.raises(CodeError, match=f"^{file}: ValueError: no$"), errors_in(f"{file}:init"):
        raise ValueError("no")
