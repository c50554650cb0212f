"""``vibroswarm run`` as a user meets it."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from helpers.commands import json_of, output_of, printed_by, refusal_of
from vibroswarm.cli import main
from vibroswarm.cli.commands import COMMANDS
from vibroswarm.result import TABLES, Result
from vibroswarm.scenario.scenario import Scenario, preset

SHORT = ["--set", "run.t_end_s=60", "--set", "decision.min_observations=5"]


def run(*arguments: str) -> int:
    return main(["run", *arguments])


def test_a_folder_with_scenario_tables_and_page(tmp_path, capsys):
    out = tmp_path / "a folder" / "first"
    said = output_of(capsys, "run", *SHORT, "--strategy", "soft", "--seed", "7", "--out", out)
    files = {path.name for path in out.iterdir()}
    assert files == {"scenario.toml", "vibroswarm.json", "run.html"} | {
        f"{name}.parquet"
        for name in TABLES
        if name not in ("moves", "changes", "faults", "places", "reports", "failures")
    }
    assert str(out / "run.html") in said
    assert "5 robots, soft feedback" in said
    assert list(tmp_path.glob("**/.*")) == [], "nothing half-written is left"
    kept = Result.read(out)
    assert kept.scenario.strategy.name == "soft"
    assert kept.seed == 7


def test_the_same_seed_gives_equal_tables_and_another_does_not(tmp_path):
    """Also from the scenario that is saved with the first."""
    kept = ["--scenario", str(tmp_path / "a" / "scenario.toml")]
    asked = [*SHORT, "--floor", "diagonal:0.46"]
    for name, words, seed in (("a", asked, "7"), ("b", kept, "7"), ("c", kept, "8")):
        assert run(*words, "--seed", seed, "--out", str(tmp_path / name)) == 0
    first, second, other = (Result.read(tmp_path / name) for name in "abc")
    assert first == second
    assert not first.same_tables(other)
    for name in set(TABLES) - {
        "moves",
        "changes",
        "faults",
        "places",
        "reports",
        "failures",
    }:  # the files too, byte by byte
        mine, theirs = (tmp_path / folder / f"{name}.parquet" for folder in "ab")
        assert mine.read_bytes() == theirs.read_bytes()


def test_a_floor_file_is_taken_into_the_scenario(tmp_path):
    floor = tmp_path / "my floor.txt"
    floor.write_text("010\n111\n")
    assert run(*SHORT, "--floor", str(floor), "--out", str(tmp_path / "out")) == 0
    floor.unlink()
    kept = Result.read(tmp_path / "out")
    assert kept.scenario.floor.tiles == ("010", "111")
    assert kept.floor().name == "my floor.txt"
    assert run("--scenario", str(tmp_path / "out" / "scenario.toml"), "--set", "run.t_end_s=1") == 0


def test_a_scenario_file_names_a_floor_beside_it(tmp_path, monkeypatch, capsys):
    (tmp_path / "world.txt").write_text("1,0\n0,1\n# -1\n")
    (tmp_path / "s.toml").write_text(
        'preset = "paper-empirical"\n[floor]\nsource = "world.txt"\nrows = 2\ncolumns = 2\n[run]\nt_end_s = 5\n'
    )
    monkeypatch.chdir("/")
    (verdict,) = json_of(capsys, "run", "--scenario", tmp_path / "s.toml", "--json")["tables"]["verdict"]
    assert verdict["fill_ratio"] == 0.5


def test_a_scenario_is_written_down_and_runs(tmp_path, capsys):
    text = output_of(capsys, "scenario", "--preset", "text", "--robots", "8")
    wanted = preset("text").with_values({"swarm.robots": 8})
    assert Scenario.from_toml(text) == wanted
    # What a preset is, and its sources.
    assert text.startswith(
        "# Made from this preset, with other values:\n# The paper's printed text taken literally"
    )
    assert output_of(capsys, "scenario", "--preset", "text").startswith("# The paper's printed text")
    file = tmp_path / "my scenario.toml"
    assert main(["scenario", "--preset", "text", "--robots", "8", "--out", str(file)]) == 0
    assert Scenario.read(file) == wanted
    assert "exists already" in refusal_of(capsys, "scenario", "--out", file)
    assert Scenario.read(file) == wanted
    assert main(["scenario", "--out", str(file), "--force"]) == 0
    assert Scenario.read(file) == preset("paper")
    assert run("--scenario", str(file), "--set", "run.t_end_s=1") == 0
    assert main(["scenario", "--robots", "0"]) == 2


def test_json_is_one_document_with_the_verdict(capsys):
    told = json_of(capsys, "run", *SHORT, "--json")
    (verdict,) = told["tables"]["verdict"]
    assert verdict["consensus"] in ("right", "wrong", "split", "incomplete")
    assert len(told["tables"]["robots"]) == 5
    assert verdict["right"] + verdict["wrong"] + verdict["undecided"] == 5
    assert told["made_by"]["vibroswarm"]


BAD = {
    "--floor nowhere.txt": ("nowhere.txt", "neither a floor nor a file"),
    "--floor diagnal:0.46": ("--floor", "did you mean 'diagonal:0.46'?"),
    "--floor patch:0.1@7": ("--floor", "patch:0.1@7"),
    "--set floor.source=diagnal:0.46": ("floor.source", "did you mean 'diagonal:0.46'?"),
    "--floor diagonal:0.46 --tiles 3x3": ("--tiles", "10x10"),
    "--tiles 5": ("--tiles", "5"),
    "--preset papr": ("preset", "did you mean 'paper'?"),
    "--strategy sof": ("--strategy", "did you mean 'soft'?"),
    "--strategy none,sofd": ("unknown strategy",),
    "--robots many": ("--robots", "'many' is not a whole number"),
    f"--seed {'9' * 400}": ("--seed", "is not a whole number"),
    "--robots 0": ("swarm.robots", "0 is wrong"),
    "--robots 901": ("swarm.robots", "at most 900"),
    "--robots -3": ("swarm.robots", "-3"),
    "--seed -1": ("seed", "-1"),
    "--seed 9223372036854775808": ("seed", "9223372036854775807"),
    "--seed x": ("--seed", "'x' is not a whole number"),
    "--scenario nowhere.toml": ("nowhere.toml", "cannot be read"),
    "--energies nowhere.csv": ("nowhere.csv", "No such file"),
    "--set walk.gamma=3": ("walk.gamma", "no such field"),
    "--set strategy.nam=soft": ("strategy.nam", "did you mean 'strategy.name'?"),
    "--set walk": ("--set", "section.field=value"),
    "--set walk.=3": ("walk.", "there is no such field"),
    "--set rays.side_m=0,0.01": ("rays.side_m", "0,0.01"),
    "--set run.t_end_s=nan": ("run.t_end_s", "nan"),
    "--set run.t_end_s=inf": ("run.t_end_s", "inf"),
    "--set run.t_end_s=-5": ("run.t_end_s", "-5"),
    "--set run.t_end_s=0": ("run.t_end_s", "0"),
    "--set run.t_end_s=1e-9": ("run.t_end_s: 1e-09 s", "control periods of 20 ms"),
    "--set run.t_end_s=8400": ("robot.battery_life_s", "is not longer than the run"),
    "--set walk.leg_min_ms=40000": ("walk.leg_min_ms", "40000"),
    "--set strategy.name=7": ("strategy.name", "7"),
    "--set swarm.robots=2.5": ("swarm.robots", "2.5"),
    "--set arena.width_m=0.02": ("swarm.robots", "do not fit into an arena of 0.02 m"),
    "--set floor.left_m=3": ("floor.left_m", "outside the arena"),
    "--force": ("--force", "has no effect without --out"),
    "--pictures": ("--pictures: needs --out DIR",),
    "--stratgy soft": ("did you mean '--strategy'?",),
    "--preset paper --scenario x": ("--preset", "--scenario"),
    "--out": ("--out",),
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_named_and_ends_with_2(line, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(*line.split()) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("vibroswarm: error: ")
    assert told.err.count("\n") == 1
    for words in BAD[line]:
        assert words in told.err
    assert list(tmp_path.iterdir()) == []


def test_an_output_folder_that_exists_is_refused_unless_told(tmp_path, capsys):
    out = tmp_path / "out"
    assert run(*SHORT, "--seed", "1", "--out", str(out)) == 0
    before = (out / "vibroswarm.json").read_bytes()
    assert "exists already" in refusal_of(capsys, "run", *SHORT, "--seed", "2", "--out", out)
    assert (out / "vibroswarm.json").read_bytes() == before
    link = tmp_path / "link"
    link.symlink_to(out)
    assert "give another --out (--force replaces no symbolic link)" in refusal_of(
        capsys, "run", *SHORT, "--seed", "2", "--out", link, "--force"
    )
    assert (out / "vibroswarm.json").read_bytes() == before
    assert run(*SHORT, "--seed", "2", "--out", str(out), "--force") == 0
    assert Result.read(out).seed == 2


def command(*arguments: str, **more: object) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", "vibroswarm", *arguments]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **more)  # type: ignore[call-overload,no-any-return]


INTERRUPTED = """
import os, signal, sys, threading
from vibroswarm import simulation
from vibroswarm.cli import main
simulate = simulation.simulate
def interrupted(*given, **more):
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    return simulate(*given, **more)
simulation.simulate = interrupted
sys.exit(main(sys.argv[1:]))
"""
"""The command, interrupted half a second after it began to simulate."""


def test_ctrl_c_ends_with_130_and_leaves_nothing_half_written(tmp_path):
    long = ["--set", "run.t_end_s=1000000", "--set", "robot.battery_life_s=1e9", "--robots", "30"]
    line = [sys.executable, "-c", INTERRUPTED, "run", *long, "--out", tmp_path / "out"]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 130
    assert done.stdout == ""
    assert done.stderr.splitlines()[-1] == "vibroswarm: interrupted; nothing is saved"
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_has_had_enough_is_no_error():
    process = command("run", *SHORT)
    assert process.stdout is not None
    process.stdout.close()
    process.wait(timeout=60)
    assert process.stderr is not None
    told = process.stderr.read()
    process.stderr.close()
    assert "Traceback" not in told
    assert process.returncode == 1


HEAVY = {"numba", "llvmlite", "numpy", "scipy", "polars", "pydantic", "matplotlib", "PIL", "rich"}
"""Packages that take longer to import than help takes in all."""


def loaded_by(*lines: list[str], packages: set[str] = HEAVY) -> dict[str, set[str]]:
    """The heavy packages that a new process has loaded after each of these command lines, one after the other."""
    program = f"""
import contextlib, io, json, sys
from vibroswarm.cli import main
loaded = {{}}
for line in {lines!r}:
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.suppress(SystemExit):
        sys.argv = ["vibroswarm", *line]
        assert main() == 0
    assert said.getvalue().count("\\n") > (5 if "show" in line else 0)
    loaded[" ".join(line)] = sorted({packages!r} & set(sys.modules))
print(json.dumps(loaded))
"""
    return {line: set(packages) for line, packages in json.loads(printed_by(program)).items()}


def test_help_loads_nothing_heavy():
    lines = [["--help"], ["--version"], [], *([*words.split(), "--help"] for words in COMMANDS)]
    assert ["lab", "import", "--help"] in lines
    loaded = loaded_by(*lines, ["scenario"])
    assert len(loaded) == len(lines) + 1
    assert "pydantic" in loaded.pop("scenario"), "what is loaded is seen"
    assert {line: packages for line, packages in loaded.items() if packages} == {}
