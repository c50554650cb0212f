"""``vibroswarm check``: what is wrong with a strategy, network, task, sensor or source is said in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from vibroswarm.cli import main
from vibroswarm.testing import motion as motion_checks
from vibroswarm.testing.motion_cases import CASES

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
MOTION = """from vibroswarm.motion.motion_tables import Sink
from vibroswarm.motion.source import Source
from vibroswarm.motion.event.event_run import EVENT


class Mine:
    def __init__(self, scenario, moves):
        self.inner = EVENT.start(scenario, moves)

    def __getattr__(self, name):
        return getattr(self.inner, name)

    def begin(self, seed, run):
        self.begun_at = 0
        self.inner.begin(seed, run)

    def advance(self, until, sink):
        self.begun_at = self.inner.tick
        self.inner.advance(until, self.through(sink))

    def finish(self, sink):
        return self.ends(self.inner.finish(self.through(sink)))

    def through(self, sink):
        return Sink(lambda rows: sink.samples(self.samples(rows)), lambda rows: sink.moves(self.moves(rows)))

    def samples(self, rows):
        return rows

    def moves(self, rows):
        return rows

    def ends(self, rows):
        return rows


mine = Source("mine", Mine)
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
BROKEN = {
    "strategy": (
        KINDS,
        "strategy 'mine': a decision is none of -1",
    ),
    "network": (
        NETWORK.replace("arrival_tick[j]", "arrival_tick[j + 1]"),
        "the same in another process, in plain Python: file.py, line 11, in send",
    ),
    "task": (
        TASK.replace("int(floor.tiles[0].sum() > 2)", "int(id(floor) % 3 > 0)"),
        "and the same again: on the floor ",
    ),
    "sensor": (
        SENSOR.replace("return u + kind", "calls.append(0)\n    return u + kind + (len(calls) > 60)"),
        "the same again for the same numbers: on kind 0 values or readings depend on what else is measured",
    ),
    "motion": (
        MOTION.replace(
            "    def moves(self, rows):\n",
            "    def moves(self, rows):\n        rows['x_m'] += 1e-5 * (rows['tick'] > 1000)\n",
        ),
        "The arc of a move ends where the next begins, the last one where the table of ends puts the robot",
    ),
}
"""A file of each kind that is wrong, and what is said of it."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", BROKEN)
def test_what_is_wrong_is_said(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(motion_checks, "CASES", CASES[:2])
    text, words = BROKEN[kind]
    (tmp_path / "file.py").write_text(text, encoding="utf-8")
    assert main(["check", f"{tmp_path / 'file.py'}:mine"]) == 1
    assert " ".join(words.split()) in " ".join(capsys.readouterr().out.split())
