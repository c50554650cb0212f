"""Strategies from outside the package, through the whole program: the examples, and files that are wrong."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from helpers.commands import refusal_of
from vibroswarm import preset, simulate
from vibroswarm.cli import main
from vibroswarm.errors import InputError
from vibroswarm.result import Result
from vibroswarm.scenario.plugins import load_code
from vibroswarm.strategies.base import forget
from vibroswarm.study.spec import Study

EXAMPLES = Path(__file__).parents[2] / "examples" / "strategies"
VOTER, AVOIDER = (f"{EXAMPLES / name}.py:{name}" for name in ("voter", "avoider"))
SHORT = ("--set", "run.t_end_s=120", "--set", "decision.min_observations=20", "--set", "decision.hold_s=5")


def said(capsys: pytest.CaptureFixture[str], code: int, wanted: int) -> str:
    text = capsys.readouterr()
    assert code == wanted, text.err
    return text.err if wanted else text.out


def test_a_run_keeps_a_copy_and_can_be_made_again_only_if_trusted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a run"
    assert main(["run", "--strategy", VOTER, *SHORT, "--out", str(out)]) == 0
    copy = out / "voter.py"
    assert copy.read_bytes() == (EXAMPLES / "voter.py").read_bytes()
    kept = Result.read(out)
    assert kept.scenario.strategy.name == "voter"
    assert "sha256:" in str(kept.scenario.strategy.code)
    forget("voter")
    again = ["run", "--scenario", str(out / "scenario.toml"), "--out", str(tmp_path / "again")]
    assert "--trust" in refusal_of(capsys, *again)
    assert main([*again, "--trust"]) == 0
    assert Result.read(tmp_path / "again").same_tables(kept)
    forget("voter")
    copy.write_text(copy.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert "is not the file that was used" in refusal_of(capsys, *again[:-1], str(tmp_path / "b"), "--trust")


GOOD = """from vibroswarm.strategies import strategy_in, u
import numpy as np

count = 0


class Params:
    lead: int = 4
    raises_at: int = 0
    decides: int = -1


class State:
    n: int


def begin(s, a, d, p, w):
    s.n = 0


def on_sample(s, a, x, out, d, p, w):
    s.n += 1
    if s.n == p.raises_at:
        raise ValueError('three')
    return True


def decision(s, a, p, w):
    return p.decides


mine = strategy_in(__name__, "mine")
"""
"""What it does wrong as it runs is a parameter: a kernel is compiled for each text."""
BAD = {
    "a syntax error": (GOOD.replace("class State:", "class State"), 1, r"SyntaxError: .*line 13"),
    "no strategy": (GOOD.replace("mine = ", "other = "), 2, "has no strategy 'mine'; it has other"),
    "other arguments": (
        GOOD.replace("def begin(s, a, d, p, w)", "def begin(s)"),
        2,
        "line 17, in begin: takes s",
    ),
    "no such field": (GOOD.replace("s.n += 1", "s.m = 1"), 2, "line 22.*s.m: no such field"),
    "no kind of decision": (GOOD, 1, "a decision is none of", "decides=7"),
    "raises": (GOOD, 1, "line 24, in on_sample: ValueError: three", "raises_at=3"),
    "draws by itself": (
        GOOD.replace("s.n = 0", "s.n = int(np.random.random())"),
        2,
        "line 17.*draws random numbers",
    ),
    "a name that is taken": (
        GOOD.replace("mine = ", "soft = ").replace('"mine"', '"soft"'),
        2,
        "'soft' already",
    ),
}


@pytest.mark.parametrize("what", list(BAD))
def test_a_bad_file_is_said_with_its_line(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, code, words, *values = BAD[what]
    file = tmp_path / "a file.py"
    file.write_text(text, encoding="utf-8")
    name = "soft" if what == "a name that is taken" else "mine"
    more = [word for value in values for word in ("--set", f"strategy.mine.{value}")]
    found = said(capsys, main(["run", "--strategy", f"{file}:{name}", *SHORT, *more]), code)
    assert re.search(words, found), found
    assert "Traceback" not in found


ARRAYS = """
from vibroswarm.strategies import array, strategy_in
class State:
    ones: int
class Arrays:
    heard = array("int32", {size})
def begin(s, a, d, p, w):
    a.heard[0] = 1
def on_sample(s, a, x, out, d, p, w):
    a.heard[2] += x.reading
    out.bit = x.reading
    return True
def decision(s, a, p, w):
    return -1
sized = strategy_in(__name__, "sized")
"""


def test_code_is_loaded_in_python(tmp_path: Path) -> None:
    path = tmp_path / "sized.py"
    path.write_text(ARRAYS.format(size="400"), encoding="utf-8")
    code = load_code("sized.py:sized", folder=tmp_path)
    short = preset("text").with_values({"strategy.name": code, "run.t_end_s": 20.0})
    assert short.strategy.code == code
    assert simulate(short, seed=1).runs.height == 1
    both = Study.of(short, runs=1, strategy__name=["none", code]).run()
    assert both.where(strategy__name="sized").frame["strategy.name"].to_list() == ["sized"]
    with pytest.raises(InputError, match="there is no such file"):
        load_code("another.py:sized", folder=tmp_path)
