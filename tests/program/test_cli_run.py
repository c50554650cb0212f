"""``vibroswarm run``, help, and what is wrong on a command line."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from helpers.commands import json_of, output_of, printed_by
from vibroswarm.cli import main
from vibroswarm.cli.commands import COMMANDS
from vibroswarm.result import Result
from vibroswarm.scenario.scenario import Scenario, preset

SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]


def test_the_same_seed_gives_the_same_files_and_another_does_not(tmp_path):
    """Also from the scenario that is saved with the first."""
    saved = ["--scenario", str(tmp_path / "a" / "scenario.toml")]
    options = [*SHORT, "--floor", "diagonal:0.46"]
    for name, words, seed in (("a", options, "7"), ("b", saved, "7"), ("c", saved, "8")):
        assert main(["run", *words, "--seed", seed, "--out", str(tmp_path / name)]) == 0
        assert (tmp_path / name / "run.html").is_file()
    first, second, other = (Result.read(tmp_path / name) for name in "abc")
    assert first == second
    assert not first.same_tables(other)
    for file in (tmp_path / "a").glob("*.parquet"):
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()


def test_a_floor_file_is_copied_into_the_scenario(tmp_path):
    floor = tmp_path / "my floor.txt"
    floor.write_text("010\n111\n")
    assert main(["run", *SHORT, "--floor", str(floor), "--out", str(tmp_path / "out")]) == 0
    assert Result.read(tmp_path / "out").scenario.floor.tiles == ("010", "111")


def test_a_scenario_is_written_and_runs(tmp_path, capsys):
    wanted = preset("text").with_values({"swarm.robots": 8})
    file = tmp_path / "mine.toml"
    assert main(["scenario", "--preset", "text", "--robots", "8", "--out", str(file)]) == 0
    assert Scenario.read(file) == wanted
    assert main(["scenario", "--out", str(file)]) == 2
    assert Scenario.read(file) == wanted
    assert json_of(capsys, "run", "--scenario", file, "--set", "run.t_end_s=1", "--json")["answer"]


BAD = {
    "run --stratgy soft": "did you mean '--strategy'?",
    "rn": "did you mean 'run'?",
    "lab imprt": "did you mean 'import'?",
    "run --strategy sof": "did you mean 'soft'?",
    "run --strategy none,soft": "give one value here",
    "run --set strategy.nam=soft": "did you mean 'strategy.name'?",
    "run --set swarm.robots=2.5": "swarm.robots",
    "run --robots many": "--robots: 'many' is not a whole number",
    "run --robots 0": "swarm.robots: 0 is wrong",
    "run --scenario nowhere.toml": "nowhere.toml",
    "run --energies nowhere.csv": "nowhere.csv",
    "run --preset paper --scenario x": "conflicts with --preset",
    "run --out": "--out",
    "league --floor diagonal": "--floor: unknown option",
    "list strategy": "did you mean 'strategies'?",
    "check softt": "did you mean 'soft'?",
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_named_and_ends_with_2(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(line.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("vibroswarm: error: ")
    assert printed.err.count("\n") == 1
    assert BAD[line] in printed.err
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_has_enough_is_no_error():
    line = [sys.executable, "-m", "vibroswarm", "list", "strategies"]
    process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    process.stdout.close()
    process.wait(timeout=60)
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()


HEAVY = {"numba", "llvmlite", "numpy", "scipy", "polars", "pydantic", "matplotlib", "PIL", "rich"}
"""Packages that take longer to import than help takes in all."""
HELP = """
import contextlib, io, json, sys
from vibroswarm.cli import main
lengths = {}
for line in %r:
    with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.suppress(SystemExit):
        assert main(line) == 0
    lengths[" ".join(line)] = printed.getvalue().count("\\n")
print(json.dumps([lengths, sorted(sys.modules)]))
"""


def test_help_is_short_and_loads_nothing_heavy():
    lines = [["--help"], ["--version"], [], *([*words.split(), "--help"] for words in COMMANDS)]
    lengths, loaded = json.loads(printed_by(HELP % lines, COLUMNS="80"))
    assert {line: length for line, length in lengths.items() if length > 60} == {}
    assert lengths["run --help"] > 30
    assert HEAVY & set(loaded) == set()


def test_names_are_listed(capsys):
    assert "soft" in output_of(capsys, "list", "strategies")
    floors = json_of(capsys, "list", "floors", "--json")["tables"]["floors"]
    assert "diagonal:0.48" in [floor["floor"] for floor in floors]
