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
COUNTS_BITS = GOOD.replace(
    "    n: int\n", "    n: int\n\n\ndef on_counts(s, ones, zeros, p, w):\n    s.n += ones\n"
).replace("    return True\n", "    out.bit = p.lead - 4\n    return True\n")
WRONG_VALUES = (
    GOOD.replace("strategy_in, u", "array, strategy_in")
    .replace(
        "    decides: int = -1\n",
        "    decides: float = -1.0\n    bit: int = 0\n    index: int = 0\n",
    )
    .replace("    n: int\n", "    n: int\n\n\nclass Arrays:\n    heard = array('int32', 'robots')\n")
    .replace("    return True\n", "    out.bit = p.bit\n    a.heard[p.index] += 1\n    return True\n")
)
BAD = {
    "a syntax error": (GOOD.replace("class State:", "class State"), 1, r"SyntaxError: .*line 13"),
    "raises as it is loaded": (GOOD + "\nraise ValueError('no')\n", 1, "line 34, in <module>: ValueError: no"),
    "no strategy": (GOOD.replace("mine = ", "other = "), 2, "has no strategy 'mine'; it has other"),
    "other arguments": (
        GOOD.replace("def begin(s, a, d, p, w)", "def begin(s)"), 2,
        r"^vibroswarm: error: \S*[^:]*line 17, in begin: takes s; .* w\s*$",
    ),
    "arguments in another order": (
        GOOD.replace("on_sample(s, a, x,", "on_sample(s, x, a,"), 2, "line 21.*given, in this order, s, a, x, out",
    ),
    "a function that nobody calls": (
        GOOD.replace("    s.n = 0\n", "    s.n = 0\n\n\ndef on_count(s, ones, zeros, p, w):\n    s.n += ones\n"),
        2, "has on_count, which is nearly the name of a hook",
    ),
    "no parameters": (
        GOOD.replace("    lead: int = 4\n    raises_at: int = 0\n    decides: int = -1\n", "    pass\n"),
        2, r"p.raises_at: no such field \(there are none\)",
    ),
    "no such field": (GOOD.replace("s.n += 1", "s.m = 1"), 2, "line 22.*s.m: no such field"),
    "text for a decision": (GOOD.replace("return p.decides", "return 'yes'"), 2, "a file.py: TypingError"),
    "a name that is not there": (GOOD.replace("s.n += 1", "s.n += one"), 2, "name 'one' is not"),
    "no kind of decision": (GOOD, 1, "a decision is none of", "decides=7"),
    "no kind of decision, counting": (COUNTS_BITS, 1, "a decision is none of", "decides=7"),
    "a part of a decision": (WRONG_VALUES, 1, "a decision is none of", "decides=0.5"),
    "two bits": (WRONG_VALUES, 1, "the bit of a message is neither 0 nor 1", "bit=2"),
    "two bits, counting": (COUNTS_BITS, 1, "the bit of a message is neither 0 nor 1", "lead=2"),
    "an index too large": (WRONG_VALUES, 1, "IndexError", "index=5"),
    "a count that is none": (GOOD.replace("    n: int", "    n: int\n    alpha: float"), 2, "alpha and beta are"),
    "raises": (GOOD, 1, "line 24, in on_sample: ValueError: three", "raises_at=3"),
    "two ways to hear": (
        GOOD.replace("    n: int\n", "    n: int\n\n\ndef on_counts(s, ones, zeros, p, w):\n    s.n += ones\n\n\n"
        "def on_message(s, a, m, sender, t_s, d, p, w):\n    s.n += m.bit\n"),
        2, "has on_counts and on_message; define one of them",
    ),
    "draws bits by itself": (
        "from random import getrandbits\n" + GOOD.replace("s.n = 0", "s.n = getrandbits(1)"), 2, "draws random numbers"
    ),
    "draws by itself": (GOOD.replace("s.n = 0", "s.n = int(np.random.random())"), 2, "line 17.*draws random numbers"),
    "draws in a function of Numba": (
        "from numba import njit\n\n@njit\ndef noise():\n    return np.random.random()\n\n\n"
        + GOOD.replace("s.n = 0", "s.n = int(noise())"), 2, "draws random numbers"
    ),
    "a default that is not used": (
        GOOD.replace("    n: int\n", "    n: int\n    choice: int = -1\n"), 2, "choice: defaults have no effect.*begin"
    ),
    "changes a parameter": (GOOD.replace("s.n += 1", "p.decides += 1"), 2, "line 22.*changes p.decides, which others"),
    "changes a message": (
        GOOD.replace("    n: int\n", "    n: int\n\n\ndef on_message(s, a, m, sender, t_s, d, p, w):\n    m.bit = 1\n"),
        2, "in on_message: changes m.bit, which others read too",
    ),
    "registers itself": (
        GOOD.replace("strategy_in, u", "register, strategy_in, u").replace('strategy_in(__name__, "mine")',
        'register(strategy_in(__name__, "mine"))'), 2, "registers 'mine' itself; leave out"
    ),
    "a name that is taken": (GOOD.replace("mine = ", "soft = ").replace('"mine"', '"soft"'), 2, "'soft' already"),
}  # fmt: skip


@pytest.mark.parametrize("what", list(BAD))
def test_a_bad_file_is_said_with_its_line(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, code, words, *values = BAD[what]
    file = tmp_path / "a file.py"
    file.write_text(text, encoding="utf-8")
    name = "soft" if what == "a name that is taken" else "mine"
    out = tmp_path / "out"
    more = [word for value in values for word in ("--set", f"strategy.mine.{value}")]
    found = said(
        capsys, main(["run", "--strategy", f"{file}:{name}", *SHORT, *more, "--out", str(out)]), code
    )
    assert re.search(words, found), found
    last = [line for line in found.splitlines() if line.startswith("vibroswarm: error: ")]
    assert len(last) == 1
    assert "Traceback" not in found
    assert not out.exists(), "nothing half-written is left"


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
    for wrong in ("sized", "sized.py", str(path), 3, None):
        with pytest.raises(InputError, match="code"):
            load_code(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="there is no such file"):
        load_code("another.py:sized", folder=tmp_path)
