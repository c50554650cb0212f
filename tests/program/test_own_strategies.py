"""Strategies from outside the package, through the whole program: the examples, and files that are wrong."""

from __future__ import annotations

import re
from dataclasses import asdict
from pathlib import Path
from shutil import rmtree

import polars as pl
import pytest

from helpers.commands import output_of, refusal_of, remarks_of
from vibroswarm import preset, replay, simulate
from vibroswarm.cli import main
from vibroswarm.core.atomic_io import MANIFEST
from vibroswarm.errors import CodeError, InputError
from vibroswarm.optimize.sensitivity import sobol_indices
from vibroswarm.optimize.spec import Search
from vibroswarm.optimize.steps import SEARCH, SearchFolder, step_table
from vibroswarm.result import Result, write_code
from vibroswarm.scenario.plugins import load_code, trust_code
from vibroswarm.strategies.base import forget
from vibroswarm.study.spec import Study
from vibroswarm.study.study_result import StudyResult

EXAMPLES = Path(__file__).parents[2] / "examples" / "strategies"
VOTER, AVOIDER = (f"{EXAMPLES / name}.py:{name}" for name in ("voter", "avoider"))
SHORT = ("--set", "run.t_end_s=120", "--set", "decision.min_observations=20", "--set", "decision.hold_s=5")


def said(capsys: pytest.CaptureFixture[str], code: int, wanted: int) -> str:
    text = capsys.readouterr()
    assert code == wanted, text.err
    return text.err if wanted else text.out


@pytest.mark.parametrize("example", ["voter", "avoider"])
def test_the_examples_are_short(example: str) -> None:
    assert len((EXAMPLES / f"{example}.py").read_text(encoding="utf-8").splitlines()) < 60


@pytest.mark.filterwarnings("ignore::ImportWarning")  # of a relative import
@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("import helper_beside", "No module named 'helper_beside'"),
        ("from . import helper_beside", "relative import.*"),
    ],
)
def test_a_file_that_imports_another_says_what_to_do(line: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "helper_beside.py").write_text("")
    (tmp_path / "mine.py").write_text(f"import math\n{line}\n")
    with pytest.raises(InputError, match=rf"{why}; a file imports installed packages only, .* \(line 2\)"):
        load_code(f"{tmp_path / 'mine.py'}:mine")


def test_a_run_keeps_a_copy_and_can_be_made_again_only_if_trusted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a run"
    assert main(["run", "--strategy", VOTER, *SHORT, "--out", str(out)]) == 0
    copy = out / "voter.py"
    assert copy.read_bytes() == (EXAMPLES / "voter.py").read_bytes()
    forget("voter")
    kept = Result.read(out)  # by a program that does not know it
    assert kept.scenario.strategy.name == "voter"
    assert "sha256:" in str(kept.scenario.strategy.code)
    again = ["run", "--scenario", str(out / "scenario.toml"), "--out", str(tmp_path / "again")]
    assert "--trust" in refusal_of(capsys, *again)
    assert main([*again, "--trust"]) == 0
    assert Result.read(tmp_path / "again").same_tables(kept)
    forget("voter")
    copy.write_text(copy.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert "is not the file that was used" in refusal_of(capsys, *again[:-1], str(tmp_path / "b"), "--trust")


def test_a_study_keeps_cells_apart_and_is_shown_without_the_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "voter.py"
    mine.write_text((EXAMPLES / "voter.py").read_text(encoding="utf-8"), encoding="utf-8")
    out = tmp_path / "a study"
    study = ["evaluate", "--strategy", f"none,{mine}:voter", "--vary", "strategy.voter.phase_s=20,60", *SHORT]
    study += ["--no-confirm", "--no-pictures", "--workers", "2", "--out", str(out)]
    forget("voter")  # its parameters are fields as soon as the command has loaded it
    assert main([*study, "--runs", "12"]) == 0
    table = pl.read_csv(out / "summary.csv")
    voters = table.filter(pl.col("strategy.name").str.contains("voter"))
    assert voters.height == 2
    assert voters["decision_time_s"].n_unique() == 2, "cells that differ in a parameter were merged"
    forget("voter")
    shown = output_of(capsys, "show", out)
    assert "4 cells" in shown
    assert "Differences run by run" in shown
    assert "Outcome" in shown
    assert main([*study, "--runs", "14"]) == 0  # goes on
    forget("voter")
    mine.write_text(mine.read_text(encoding="utf-8").replace("0.05", "0.06"), encoding="utf-8")
    assert "has changed: its SHA-256 began with" in refusal_of(capsys, *study, "--runs", "16")


@pytest.mark.parametrize(("spec", "field"), [(VOTER, "voter.phase_s"), (AVOIDER, "avoider.leg_s")])
def test_a_search_over_a_parameter(
    spec: str, field: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    search = tmp_path / "search.toml"
    search.write_text(
        f"""[scenario]
strategy = {{ name = "{spec}" }}
decision = {{ min_observations = 20, hold_s = 5.0 }}
run = {{ t_end_s = 120 }}

[space]
"strategy.{field}" = {{ from = 5.0, to = 60.0 }}

[objective]
cost = "decision_time"

[search]
method = "random"
budget = 40
evaluations = 4
fresh = 8
""",
        encoding="utf-8",
    )
    command = ["optimize", str(search), "--workers", "1", "--no-pictures", "--out", str(tmp_path / "found")]
    assert "--trust" in refusal_of(capsys, *command)
    assert f"Best: {field.rpartition('.')[2].rpartition('_')[0]} " in output_of(capsys, *command, "--trust")


PHASES = f"""[scenario]
strategy = {{ name = "{VOTER}" }}
decision = {{ min_observations = 20, hold_s = 5.0 }}
run = {{ t_end_s = 120 }}

[space]
"strategy.voter.phase_s" = {{ from = 5.0, to = 60.0 }}

[objective]
cost = "decision_time"
"""


def test_a_search_that_was_killed_after_it_copied_the_code_begins_again(tmp_path: Path) -> None:
    with trust_code(tmp_path):
        search = Search.from_toml(PHASES)
    scenarios = [cell.scenario for cell in search.cases]
    write_code(tmp_path, scenarios, search.study.motion)
    copy = tmp_path / "voter.py"
    assert [path.name for path in tmp_path.iterdir()] == [copy.name]
    (tmp_path / ".voter.py.3f.tmp").write_text("half a co", encoding="utf-8")
    folder = SearchFolder(tmp_path, search)
    with folder.alone():
        folder.add(1, step_table(search, {0: "start"}, [(0, "it failed", 1)]))
        assert {path.name for path in tmp_path.iterdir()} >= {copy.name, MANIFEST, SEARCH}
    for name in (MANIFEST, SEARCH):
        (tmp_path / name).unlink()
    rmtree(tmp_path / "steps")
    copy.write_text(copy.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="is not a search"):
        SearchFolder(tmp_path, search)


@pytest.mark.slow
def test_sobol_indices_of_a_parameter_in_processes(tmp_path: Path) -> None:
    pytest.importorskip("SALib")
    with trust_code(tmp_path):
        search = Search.from_toml(PHASES)
    found = [
        sobol_indices(search, 48, replicates=2, executor=executor, workers=workers)
        for executor, workers in (("threads", 2), ("processes", 1))
    ]
    assert found[0].runs == 48
    assert str(asdict(found[0])) == str(asdict(found[1]))  # as texts, in which nan equals nan


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
        "    decides: float = -1.0\n    bit: int = 0\n    index: int = 0\n    sends: float = 1.0\n",
    )
    .replace("    n: int\n", "    n: int\n\n\nclass Arrays:\n    heard = array('int32', 'robots')\n")
    .replace("    return True\n", "    out.bit = p.bit\n    a.heard[p.index] += 1\n    return p.sends\n")
    .replace("    return p.decides\n", "    if p.decides != 3.0:\n        return p.decides\n")
)
BAD = {
    "a syntax error": (GOOD.replace("class State:", "class State"), 2, r"SyntaxError: [^(]* \(line 13\)\s*$"),
    "raises as it is loaded": (GOOD + "\nraise ValueError('no')\n", 2, r"ValueError: no \(line 34\)"),
    "no strategy": (GOOD.replace("mine = ", "other = "), 2, "'mine' is not there.*the file has other"),
    "other arguments": (
        GOOD.replace("def begin(s, a, d, p, w)", "def begin(s)"), 2,
        r"^vibroswarm: error: \S*[^:]*line 17, in begin: takes 1 arguments \(s\); .* w\s*$",
    ),
    "arguments in another order": (
        GOOD.replace("on_sample(s, a, x,", "on_sample(s, x, a,"), 2, "line 21.*given, in this order, s, a, x, out",
    ),
    "a function that nobody calls": (
        GOOD.replace("    s.n = 0\n", "    s.n = 0\n\n\ndef on_count(s, ones, zeros, p, w):\n    s.n += ones\n"),
        2, "has on_count; did you mean 'on_counts'",
    ),
    "a parameter without a type": (
        GOOD.replace("lead: int = 4", "lead = 4"), 2, "Params.lead: has no type; declare it as lead: int",
    ),
    "no parameters": (
        GOOD.replace("    lead: int = 4\n    raises_at: int = 0\n    decides: int = -1\n", "    pass\n"),
        2, r"p.raises_at: no such field \(there are none\)",
    ),
    "no such field": (GOOD.replace("s.n += 1", "s.m = 1"), 2, "line 22.*s.m: no such field"),
    "text for a decision": (GOOD.replace("return p.decides", "return 'yes'"), 2, "cannot be compiled"),
    "a name that is not there": (GOOD.replace("s.n += 1", "s.n += one"), 2, "line 22: NameError: name 'one' is not"),
    "a share to send": (WRONG_VALUES, 1, "on_sample returned neither True nor False", "sends=0.5"),
    "no kind of decision": (GOOD, 1, "a decision is none of", "decides=7"),
    "no kind of decision, counting": (COUNTS_BITS, 1, "a decision is none of", "decides=7"),
    "a part of a decision": (WRONG_VALUES, 1, "a decision is none of", "decides=0.5"),
    "no decision in one case": (WRONG_VALUES, 1, r"a function returned None \(on_sample", "decides=3"),
    "two bits": (WRONG_VALUES, 1, "the bit of a message is neither 0 nor 1", "bit=2"),
    "two bits, counting": (COUNTS_BITS, 1, "the bit of a message is neither 0 nor 1", "lead=2"),
    "an index too large": (WRONG_VALUES, 1, "an index is beyond the end of an array", "index=5"),
    "no decision": (GOOD.replace("return p.decides", "p.decides"), 2, "line 28, in decision: returns nothing"),
    "a count that is none": (GOOD.replace("    n: int", "    n: int\n    alpha: float"), 2, "alpha is a count of bits"),
    "raises": (GOOD, 1, "line 24, in on_sample: ValueError: three", "raises_at=3"),
    "two ways to hear": (
        GOOD.replace("    n: int\n", "    n: int\n\n\ndef on_counts(s, ones, zeros, p, w):\n    s.n += ones\n\n\n"
        "def on_message(s, a, m, sender, t_s, d, p, w):\n    s.n += m.bit\n"),
        2, "has on_counts and on_message; define one of them",
    ),
    "draws bits by itself": (
        "from random import getrandbits\n" + GOOD.replace("s.n = 0", "s.n = getrandbits(1)"), 2, "draws random numbers"
    ),
    "draws by itself": (GOOD.replace("s.n = 0", "s.n = int(np.random.random())"), 2, "line 18.*draws random numbers"),
    "draws in a function of Numba": (
        "from numba import njit\n\n@njit\ndef noise():\n    return np.random.random()\n\n\n"
        + GOOD.replace("s.n = 0", "s.n = int(noise())"), 2, "line 5.*draws random numbers"
    ),
    "a default that is not used": (
        GOOD.replace("    n: int\n", "    n: int\n    choice: int = -1\n"), 2, "choice = -1 has no effect.*begin"
    ),
    "changes a global": (GOOD.replace("s.n += 1", "global count\n    count += 1"), 2, "line 22.*the global count"),
    "changes a parameter": (GOOD.replace("s.n += 1", "p.decides += 1"), 2, "line 22.*changes p.decides, which others"),
    "changes a message": (
        GOOD.replace("    n: int\n", "    n: int\n\n\ndef on_message(s, a, m, sender, t_s, d, p, w):\n    m.bit = 1\n"),
        2, "in on_message: changes m.bit, which others read too",
    ),
    "makes an array": (GOOD.replace("s.n += 1", "s.n = int(np.zeros(3).sum())"), 2, "line 22.*creates an array"),
    "registers itself": (
        GOOD.replace("strategy_in, u", "register, strategy_in, u").replace('strategy_in(__name__, "mine")',
        'register(strategy_in(__name__, "mine"))'), 2, "registers 'mine' itself; leave out"
    ),
    "a name that is taken": (GOOD.replace("mine = ", "soft = ").replace('"mine"', '"soft"'), 2, "vibroswarm has"),
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


def test_files_of_one_name_are_refused_before_anything_is_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A copy of each is saved with the run."""
    network = tmp_path / "voter.py"
    network.write_text((EXAMPLES.parent / "networks" / "near.py").read_text(encoding="utf-8"))
    command = ["run", "--strategy", VOTER, "--network", f"{network}:near", *SHORT]
    with monkeypatch.context() as patch:
        patch.setattr("vibroswarm.simulation.simulate", lambda *_, **__: pytest.fail("simulated"))
        found = refusal_of(capsys, *command, "--out", str(tmp_path / "out"))
    assert "voter.py: two different files have this name" in found
    assert main(command) == 0  # control: nothing is saved


RARELY = GOOD.replace("s.n == p.raises_at", "u(d, 0) < 0.002").replace("'three'", "'rare'")
RAISES = GOOD.replace("raises_at: int = 0", "raises_at: int = 3")


@pytest.mark.slow
@pytest.mark.usefixtures("one_picture")
def test_runs_that_fail_in_a_study_are_told_and_nothing_else_is_lost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / "mine.py", tmp_path / "out"
    file.write_text(RARELY, encoding="utf-8")
    command = ["evaluate", "--strategy", f"none,{file}:mine", *SHORT, "--runs", "20", "--out", str(out)]
    found = said(capsys, main(command), 1)
    failing = [run for run in range(20) if fails(f"{file}:mine", run)]  # each by itself
    assert 2 < len(failing) < 18
    assert f"{len(failing)} runs failed" in found
    assert "line 24, in on_sample: ValueError: rare" in found
    kept = StudyResult.open(out)
    assert {one["first"] for one in kept.store.failures} == set(failing)
    assert kept.runs(1)["run"].to_list() == [run for run in range(20) if run not in failing]
    assert kept.cells["there"].to_list() == [20, 20 - len(failing)]
    assert f"{len(failing)} runs of mine failed and are in no figure" in (out / "report.html").read_text(
        encoding="utf-8"
    )
    file.write_text(RAISES, encoding="utf-8")
    forget("mine")
    alone = [*command[:-1], str(tmp_path / "b"), "--no-pictures"]
    assert "20 runs failed" in said(capsys, main(alone), 1)
    assert pl.read_csv(tmp_path / "b" / "summary.csv")["name"].to_list() == ["none"]


def fails(spec: str, run: int) -> bool:
    scenario = preset("paper").with_values({"strategy.name": spec, "run.t_end_s": 120.0})
    try:
        simulate(scenario, 1, [run])
    except CodeError:
        return True
    return False


def test_check_passes_of_a_strategy_that_steers(capsys: pytest.CaptureFixture[str]) -> None:
    assert "passes: 8 of 8 checks hold." in output_of(capsys, "check", AVOIDER)


def test_a_range_of_whole_numbers_is_one_also_without_the_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.py").write_text(GOOD, encoding="utf-8")
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(
        'runs = 3\nscenario = { strategy = { name = "mine.py:mine" }, run = { t_end_s = 60 } }\n'
        '[grid]\n"strategy.mine.lead" = { from = 2, to = 8, steps = 3 }\n',
        encoding="utf-8",
    )
    command = ["evaluate", str(study), "--no-pictures", "--no-confirm", "--out", str(out)]
    assert "--trust" in refusal_of(capsys, *command)
    assert main([*command, "--trust"]) == 0
    summary = pl.read_csv(out / "summary.csv")
    assert summary["strategy.mine.lead"].to_list() == [2, 5, 8]
    assert summary["robots_undecided"].to_list() == [1.0] * 3, "it never decides"
    forget("mine")
    assert "Done: 9 of 9 runs" in output_of(capsys, "show", out)


def test_a_result_whose_strategy_is_not_loaded_is_not_replayed(tmp_path: Path) -> None:
    """Whether it steered is known only to its code."""
    out = tmp_path / "a run"
    assert main(["run", "--strategy", VOTER, *SHORT, "--out", str(out)]) == 0
    kept = Result.read(out)
    other = kept.scenario.with_values({"strategy.name": "none"})
    assert replay(kept, other).runs.height == kept.runs.height
    forget("voter")
    with pytest.raises(InputError, match=r"'voter' is not loaded, .* import 'voter\.py' first"):
        replay(kept, other)


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


@pytest.mark.parametrize(
    ("size", "words"),
    [("2.5", "give a whole number"), ("-1", "-1 is wrong"), ("None", "give a whole number"),
     ("10**12", "is wrong; give a whole number from 0 to 100000000"), ("'²'", "is not a size"), ("''", "is not a size"),
     ("'9' * 5000", "is not a size"), ("'10000*10000*10000'", "elements; a robot has at most 100,000,000")],
)  # fmt: skip
@pytest.mark.parametrize("command", ["run --strategy", "check"])
def test_sizes_of_arrays_that_are_wrong(
    size: str, words: str, command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "sized.py"
    path.write_text(ARRAYS.format(size=size), encoding="utf-8")
    assert main([*command.split(), f"{path}:sized"]) in (1, 2)
    out, err = capsys.readouterr()
    assert words in " ".join((out + err).split())
    assert "Error" not in out + err


def test_an_array_that_is_declared_like_a_field_is_refused(tmp_path: Path) -> None:
    """It was left out without a word, and ``a.heard`` was "no such field"."""
    path = tmp_path / "sized.py"
    path.write_text(ARRAYS.format(size="4").replace("heard = array", "heard: array"), encoding="utf-8")
    with pytest.raises(InputError, match=r"Arrays\.heard: is declared with ':'; write heard = array"):
        load_code(f"{path}:sized")


def test_code_is_loaded_in_python(tmp_path: Path) -> None:
    path = tmp_path / "sized.py"
    path.write_text(ARRAYS.format(size="400"), encoding="utf-8")
    code = load_code("sized.py:sized", folder=tmp_path)
    short = preset("text").with_values({"strategy.name": code, "run.t_end_s": 20.0})
    assert short.strategy.code == code
    assert simulate(short, seed=1).runs.height == 1
    both = Study.of(short, runs=1, strategy__name=["none", code]).run()
    assert both.where(name="sized").runs()["strategy.name"].to_list() == ["sized"]
    for wrong in ("sized", "sized.py", str(path), 3, None):
        with pytest.raises(InputError, match="code"):
            load_code(wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="there is no such file"):
        load_code("another.py:sized", folder=tmp_path)


def strategy_with_helper(folder: Path, name: str, helper: str, call: str) -> str:
    """Write a strategy called ``name`` that calls a function of the module NAME_helpers; return its FILE:NAME."""
    (folder / f"{name}_helpers.py").write_text(helper, encoding="utf-8")
    text = ARRAYS.format(size="3").replace("sized", name)
    text = text.replace("a.heard[2] += x.reading", f"a.heard[2] += int({call})")
    function = call.partition("(")[0]
    path = folder / f"{name}.py"
    path.write_text(f"from {name}_helpers import {function}\n{text}", encoding="utf-8")
    return f"{path}:{name}"


@pytest.mark.parametrize("plain", [[], ["--plain"]])
def test_plain_functions_of_another_module_of_the_users_are_called(
    plain: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As docs/own-strategy.md says: they need no decorator, and may call each other."""
    monkeypatch.syspath_prepend(tmp_path)
    helper = "def half(x):\n    return x / 2\n\n\ndef doubled(x):\n    return 4 * half(x)\n"
    strategy = strategy_with_helper(tmp_path, "helped", helper, "doubled(x.reading)")
    assert "Numba" not in remarks_of(
        capsys, "run", "--strategy", strategy, "--set", "run.t_end_s=20", "--json", *plain
    )


def test_chance_in_another_module_of_the_users_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    helper = "import random\n\n\ndef tossed(x):\n    return random.random() < x\n"
    strategy = strategy_with_helper(tmp_path, "chancy", helper, "tossed(0.5)")
    assert "draws random numbers of its own" in refusal_of(
        capsys, "run", "--strategy", strategy, "--set", "run.t_end_s=20"
    )
