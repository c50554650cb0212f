"""``vibroswarm check``: code that is good passes, and what is wrong with any other is said in words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from helpers.commands import json_of, refusal_of
from vibroswarm.cli import main
from vibroswarm.scenario.plugins import load_file
from vibroswarm.testing import motion as motion_checks
from vibroswarm.testing import motion_tables
from vibroswarm.testing import network as network_checks
from vibroswarm.testing import runs as run_checks
from vibroswarm.testing.motion_cases import CASES
from vibroswarm.testing.runs import require, run_check

NETWORK = """from vibroswarm.networks import Network


class Sent:
    count: int


def send(n, a, sender, tick, number, bytes_on_air, x_m, y_m, arrival_tick, d, p, w):
    n.count += 1
    for j in range(arrival_tick.size):
        arrival_tick[j] = tick + 1 + n.count % 40


mine = Network(name="mine", state=Sent, send=send)
"""
TASK = """from vibroswarm.tasks import Task


def truth(floor, asked, p):
    return int(floor.tiles[0].sum() > 2)


mine = Task(name="mine", truth=truth)
"""
MOTION = """from dataclasses import dataclass, replace
from typing import Any

import polars as pl

from vibroswarm.motion.source import Motion, Source
from vibroswarm.motion.event.event_run import EVENT


@dataclass
class Mine:
    inner: Any
    start_s: float = 0.0

    @property
    def time_s(self):
        return self.inner.time_s

    def advance(self, until_s):
        self.start_s = self.inner.time_s
        return self.told(self.inner.advance(until_s))

    def told(self, motion):
        return motion

    def copy(self):
        return replace(self, inner=self.inner.copy())


def init(scenario, seed, run, segments=False, moves=False):
    return Mine(EVENT.init(scenario, seed, run, segments=segments, moves=moves))


mine = Source("mine", init)
"""
SENSOR = """import numpy as np

from vibroswarm.sensors import SensorModel

calls = []


def measure(kind, u, p):
    return u + kind


def reading(value, p):
    return (value > 0.8).astype(np.int64)


def likelihood(kind, value, p):
    return np.where((value >= kind) & (value <= kind + 1), 1.0, 0.0)


mine = SensorModel(name="mine", measure=measure, reading=reading, likelihood=likelihood)
"""
TOLD = "        return motion\n"
GOOD = {"network": NETWORK, "task": TASK, "sensor": SENSOR, "motion": MOTION}


def checked(
    text: str, folder: Path, capsys: pytest.CaptureFixture[str], *more: str, name: str = "mine"
) -> tuple[int, str]:
    """The exit code, and what is printed, a line for each check."""
    file = folder / "a file.py"
    file.write_text(text, encoding="utf-8")
    capsys.readouterr()
    code = main(["check", f"{file}:{name}", *more])
    shown = capsys.readouterr()
    return code, shown.err if code == 2 else re.sub(
        r"\n  (?!(ok|FAIL|note) )", " ", shown.out
    )  # broken to fit


@pytest.mark.slow
@pytest.mark.usefixtures("few_cases")
@pytest.mark.parametrize("kind", ["network", "sensor", "motion"])  # a task does below
def test_a_good_file_passes(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, shown = checked(GOOD[kind], tmp_path, capsys)
    assert code == 0, shown
    assert shown.startswith("'mine' passes: ")
    assert "FAIL" not in shown


def spoilt(how: str) -> str:
    assert TOLD in MOTION
    return MOTION.replace(TOLD, f"        return {how}\n")


def of_samples(columns: str) -> str:
    return spoilt(f"replace(motion, samples=motion.samples.with_columns({columns}))")


RENUMBERED = """        here, tables = pl.lit(self.run, pl.UInt32).alias("run"), vars(motion).items()
        return Motion(**{name: None if t is None else t.with_columns(here) for name, t in tables})
"""
AT_ONCE = NETWORK.replace("tick + 1 + n.count % 40", "tick")
SEGMENTS = "segments=None if motion.segments is None else motion.segments.with_columns"
MOVES = "moves=None if motion.moves is None else motion.moves.with_columns"
FEW = CASES[:2]
"""Cases for motion: ``test_motion_contract.py`` holds our sources to all, and finds what is wrong, check by check."""


@pytest.fixture
def few_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (motion_checks, motion_tables):
        monkeypatch.setattr(module, "CASES", FEW)
    monkeypatch.setattr(network_checks, "SIZES", (1, 5))


@pytest.fixture
def no_processes(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread stands for the other process, except in ``ELSEWHERE``."""
    if not any(what in request.node.name for what in ELSEWHERE):
        workers = run_checks.pool_for
        monkeypatch.setattr(run_checks, "pool_for", lambda how, count: workers("threads", count))


def test_a_network_for_some_swarm_sizes_is_checked_with_these() -> None:
    scenarios = network_checks._scenarios("loss_by_size")
    assert {scenario.swarm.robots for _, scenario in scenarios} == {5}


KINDS = """
from vibroswarm.strategies import Strategy

class State:
    seen: int
    decision: int

def begin(s, a, d, p, w):
    s.decision = -1

def on_sample(s, a, x, out, d, p, w):
    s.seen += 1
    if s.seen > 5:
        s.decision = 7 if w.kinds > 2 else 1
    out.bit = 1
    return True

def decision(s, a, p, w):
    return s.decision

mine = Strategy(
    name="mine", state=State, begin=begin, on_sample=on_sample, decision=decision, many_readings=True,
    answers_kinds=True,
)
"""
BAD = {
    "strategy: raises": (
        KINDS.replace("s.seen += 1", "raise ValueError('three')"),
        "in on_sample: ValueError: three",
    ),
    "strategy: wrong with three kinds only": (
        KINDS,
        "FAIL  it compiles, and gives decisions and beliefs: three kinds of tile: strategy 'mine': a decision is none",
    ),
    "strategy: answers a kind, and decides yes or no": (
        KINDS.replace("7 if", "2 if").replace("answers_kinds=True", "answers_kinds=False"),
        "three kinds of tile: a decision is not from -1 to 1",
    ),
    "network: in the past": (
        NETWORK.replace("tick + 1 + n.count % 40", "-5"),
        "FAIL  nothing is heard before it is sent: 5 robots, none: send lets robot 1 read at tick -5",
    ),
    "network: before it is sent": (
        AT_ONCE,
        "FAIL  nothing is heard before it is sent: 5 robots, none: send lets robot 1 read at tick ",
    ),
    "network: numbers beyond 64 bits": (
        NETWORK.replace("n.count % 40", "(sender + 2**40) * 2**40 % 97"),
        "FAIL  compiled as in plain Python: 5 robots, none: compiled and plain Python results differ: ",
    ),
    "network: a probability": (
        "from vibroswarm.networks import Network\n\n\n"
        "mine = Network(name='mine', lost=lambda sender, receiver, d, p, w: 0.3)\n",
        "FAIL  it compiles and runs: network 'mine': lost returned neither True nor False",
    ),
    "network: cannot be compiled": (
        NETWORK.replace("tick + 1 + n.count % 40", "'soon'"),
        "FAIL  it compiles and runs: ",
    ),
    "task: gives 2": (TASK.replace("> 2)", "> 2) + 1"), "returned 2; return 0, 1 or None"),
    "task: asks for a number, and gives text": (
        TASK.replace("int(floor.tiles[0].sum() > 2)", "'much'").replace("truth=t", "estimated='it', truth=t"),
        "returned 'much'; return a finite number",
    ),
    "task: scores against text": (
        TASK.replace("truth=t", "scored=lambda floor, asked, p: 'much', truth=t"),
        "returned 'much'; return a finite number",
    ),
    "task: gives tiles": (
        TASK.replace("int(floor.tiles[0].sum() > 2)", "floor.tiles"),
        "FAIL  it gives one of its answers, None, or a number",
    ),
    "task: draws": (
        "from os import urandom\n\n" + TASK.replace("int(floor.tiles[0].sum() > 2)", "urandom(1)[0] % 2"),
        "FAIL  the same again for the same floor: on the floor ",
    ),
    "task: remembers": (
        "seen = []\n\n\n"
        + TASK.replace(
            "return int(floor.tiles[0].sum() > 2)", "seen.append(0)\n    return len(seen) // 40 % 2"
        ),
        "FAIL  the same again for the same floor: on the floor ",
    ),
    "task: counts its calls": (
        "seen = []\n\n\n"
        + TASK.replace("return int(floor.tiles[0].sum() > 2)", "seen.append(0)\n    return len(seen) % 2"),
        "FAIL  the same again for the same floor: on the floor ",
    ),
    "task: goes by the order in which it met floors": (
        "seen = {}\n\n\n"
        + TASK.replace(
            "int(floor.tiles[0].sum() > 2)", "seen.setdefault(floor.tiles.tobytes(), len(seen) % 2)"
        ),
        "FAIL  the same in another process: diagonal:0.48: another process, which computes in the opposite order",
    ),
    "task: draws when it is loaded": (
        "from os import urandom\n\nDRAWN = urandom(64)\n\n"
        + TASK.replace("int(floor.tiles[0].sum() > 2)", "DRAWN[floor.tiles.sum() % 64] % 2"),
        "FAIL  the same in another process: ",
    ),
    "task: exits": (
        TASK.replace("return int(floor.tiles[0].sum() > 2)", "raise SystemExit(3)"),
        "in truth: SystemExit: 3",
    ),
    "sensor: drifts": (
        SENSOR.replace("return u + kind", "calls.append(0)\n    return u + kind + (len(calls) > 60)"),
        "FAIL  the same again for the same numbers: on kind 0 values depend on what else is measured",
    ),
    "sensor: claims less than nothing of what the other kind measures": (
        SENSOR.replace("0.0)", "-1.0)"),
        "FAIL  likelihoods are densities: sensor 'mine', likelihood: returned ",
    ),
    "task: writes": (
        TASK.replace("    return", "    floor.tiles[0] = 0\n    return"),
        "in truth: ValueError: assignment destination is read-only",
    ),
    "task: writes all the same": (
        TASK.replace(
            "    return", "    floor.tiles.setflags(write=True)\n    floor.tiles[0] = 1\n    return"
        ),
        "FAIL  it leaves floors as they are: it changes the floor ",
    ),
    "motion: others in pieces": (
        of_samples("x_m=pl.col('x_m') + 1e-3 * (self.start_s > 0)"),
        "is equal to the same run of a batch: paper, run 0, in pieces and in one: x_m in row ",
    ),
    "motion: jumps": (
        spoilt(f"replace(motion, {SEGMENTS}(x_m=pl.col('x_m') + 1e-5 * (pl.col('start_s') > 20)))"),
        "FAIL  Each segment ends where the next begins: nobody jumps: paper: run 0, robot 0 jumps, by 1e-05 m or rad",
    ),
    "motion: turned less": (
        spoilt(f"replace(motion, {MOVES}(turned_rad=pl.col('turned_rad') * (1 - 1e-6)))"),
        "rad from what the segments turn",
    ),
    "motion: follows the strategy": (
        MOTION.replace(
            "EVENT.init(scenario, seed,", "EVENT.init(scenario, seed + (scenario.strategy.name == 'soft'),"
        ),
        "sensor, strategy, decision or network: motion depends on strategy.name: ",
    ),
    "motion: draws": (
        MOTION.replace(
            "EVENT.init(scenario, seed, run, s", "EVENT.init(scenario, next(count), run, s"
        ).replace(
            "@dataclass", "from itertools import count as counted\n\ncount = counted()\n\n\n@dataclass"
        ),
        "FAIL  A run is the same again, alone, in a batch, and in whatever order: ",
    ),
    "motion: leaves at the end": (
        spoilt(
            "replace(motion, ends=motion.ends.with_columns(x_m=-3.0 + 0 * pl.col('x_m')), segments=None, moves=None)"
        ),
        "paper: a robot is not in the arena",
    ),
    "motion: stops before it was there": (
        of_samples("stop_start_s=pl.lit(0.0)"),
        "paper: a stop begins before the robot's last sample",
    ),
    "motion: asserts and says nothing": (
        MOTION.replace(TOLD, "        assert False\n"),
        "in told: AssertionError",
    ),
    "motion: gives no table": (spoilt("None"), "gives NoneType, not Motion"),
}
ELSEWHERE = (
    "task: goes by the order in which it met floors",
    "task: draws when it is loaded",
)
"""What only another process shows; and a strategy, which no good file here is."""


@pytest.mark.slow
@pytest.mark.usefixtures("few_cases", "no_processes")
@pytest.mark.parametrize("what", list(BAD))
def test_a_bad_file_fails_in_words(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network_checks, "STRATEGIES", ("none",))  # for each, kernels would be compiled
    text, words = BAD[what]
    assert text not in GOOD.values()
    code, shown = checked(text, tmp_path, capsys)
    assert code == 1, shown
    assert shown.startswith("'mine' fails: ")
    assert " ".join(words.split()) in " ".join(shown.split()), shown
    for line in shown.splitlines()[1:]:
        mark, _, said = line.strip().partition("  ")
        assert mark != "FAIL" or said.partition(": ")[2].strip(), f"it is not said why: {line}"


def test_a_task_that_tells_no_floors_apart_passes_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, shown = checked(TASK.replace("> 2)", "> 99)"), tmp_path, capsys)
    assert code == 0, shown
    assert "note it tells floors apart: it gives 0 on every floor" in " ".join(shown.split())


@pytest.mark.slow
@pytest.mark.usefixtures("few_cases", "no_processes")
def test_motion_that_is_the_same_in_all_runs_passes_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same = MOTION.replace("EVENT.init(scenario, seed, run, s", "EVENT.init(scenario, 1, 0, s")
    same = same.replace(TOLD, RENUMBERED)
    same = same.replace("inner: Any\n", "inner: Any\n    run: int\n").replace(
        "moves=moves))", "moves=moves), run)"
    )
    code, shown = checked(same, tmp_path, capsys)
    assert code == 0, shown
    note = "note Other runs and other seeds are different: runs 7 and 2 of a seed are alike"
    assert note in " ".join(shown.split())


def test_a_name_that_nobody_knows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, words in (
        (
            ["evnt"],
            "unknown strategy, network, task, sensor, motion source or method of search 'evnt', did you mean 'event'?",
        ),
        (["softt", "--kind", "strategy"], "unknown strategy 'softt', did you mean 'soft'?"),
        (
            ["soft", "--kind", "network"],
            "unknown network 'soft' (network: bursts, delay, range, ideal, loss, loss_by_size, tree; or FILE.py:NAME)",
        ),
        ([f"{tmp_path / 'no.py'}:mine"], "no.py"),
    ):
        assert words in refusal_of(capsys, "check", *arguments)
    code, shown = checked(TASK, tmp_path, capsys, name="mien")
    assert code == 2
    assert "'mien' is not there, did you mean 'mine'?" in shown
    code, shown = checked(TASK, tmp_path, capsys, "--kind", "motion")
    assert code == 2
    assert "'mine' is not a motion" in shown
    code, shown = checked(TASK.replace("mine = ", "mine = 3\nother = "), tmp_path, capsys)
    assert code == 2
    assert "'mine' is not a strategy, network, task, sensor, motion, method; the file has other" in shown


def test_a_name_of_several_kinds_is_asked_for_and_another_file_of_a_name_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "task.py").write_text(TASK, encoding="utf-8")
    load_file("task", f"{tmp_path / 'task.py'}:mine")
    code, shown = checked(TASK + "\n", tmp_path, capsys)
    assert code == 2
    assert "another file has been loaded with a task 'mine' already" in shown
    (tmp_path / "network.py").write_text(NETWORK, encoding="utf-8")
    load_file("network", f"{tmp_path / 'network.py'}:mine")
    assert "'mine' is a network and a task; add --kind" in refusal_of(capsys, "check", "mine")
    checks = json_of(capsys, "check", "mine", "--kind", "task", "--json")["tables"]["checks"]
    assert [one["holds"] for one in checks] == [True] * 5


def test_a_finding_is_never_without_words() -> None:
    def fails() -> None:
        require(False, "")

    def breaks() -> None:
        raise KeyError

    assert run_check("a", fails).why == "the check failed without a message"
    assert run_check("a", breaks).why == "it cannot be checked: KeyError: "
    assert not run_check("a", fails).holds
    assert run_check("a", lambda: iter(["one", "two"])).why == "one"
    assert run_check("a", lambda: None).holds
