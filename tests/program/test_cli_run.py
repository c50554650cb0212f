"""``vibroswarm run`` as a user meets it."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from helpers.commands import json_of, output_of, printed_by, refusal_of, remarks_of, words_of
from vibroswarm import sensors
from vibroswarm.cli import main
from vibroswarm.cli.commands import COMMANDS
from vibroswarm.cli.show import LAWFUL
from vibroswarm.cli.show import _needs_kernels as needs_kernels
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


def test_pictures_are_drawn_on_request(tmp_path, capsys):
    out, short = tmp_path / "first", [*SHORT, "--set", "run.t_end_s=20"]
    assert run(*short, "--strategy", "places", "--out", str(out)) == 0
    assert {path.name for path in out.glob("*.png")} == set()
    saved = capsys.readouterr().out.split(f"Saved in {out}: ")[1].splitlines()[0]
    assert saved == "run.html, scenario.toml, tables (CSV, Parquet)"
    assert run(*short, "--strategy", "places", "--out", str(out), "--pictures") == 0
    assert {path.name for path in out.glob("*.png")} == {"run.png", "maps.png"}
    assert (out / "run.png").read_bytes().startswith(b"\x89PNG")
    assert "run.png" in capsys.readouterr().out


def test_one_thing_is_written_in_the_singular(tmp_path, capsys):
    alone = (*SHORT, "--set", "swarm.robots=1")
    assert run(*alone, "--out", str(tmp_path / "run")) == 0
    assert main(["evaluate", *alone, "--strategy", "none,soft", "--runs", "1", "--no-confirm"]) == 0
    printed = capsys.readouterr()
    said = printed.out + printed.err + (tmp_path / "run" / "run.html").read_text(encoding="utf-8")
    assert "1 robot on" in said
    assert "1 run each" in said
    assert not re.findall(r"\b1 (?:robots|runs|cells|samples|tiles|items)\b", said)


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


def test_robots_that_fail_are_named(capsys):
    faults = [
        "--set",
        "faults.stopped=[3]",
        "--set",
        "faults.stopped_from_s=30",
        "--set",
        "faults.stuck_at_1=0.2",
    ]
    said = " ".join(output_of(capsys, "run", *SHORT, *faults).splitlines())
    assert "of 5 robots failed" in said
    assert "robot 3 stopped from 30 s" in said
    assert "stuck at 1" in said
    assert json_of(capsys, "run", *SHORT, *faults[:4], "--json")["tables"]["faults"] == [
        {"run": 0, "robot": 3, "fault": "stopped", "from_s": 30.0}
    ]
    assert run(*SHORT, "--set", "faults.stuck_at_1=0.05") == 0
    said = capsys.readouterr()
    assert "none of 5 robots failed" in said.out, "a share that is less than half a robot"
    assert "0.05 of 5 robots is 0.25; none of them have the fault" in said.err
    assert "faults.biased has no effect" in remarks_of(capsys, "run", *SHORT, "--set", "faults.biased=0.2")
    assert "more than the whole swarm" in refusal_of(capsys, "run", *SHORT, "--set", "faults.stuck_at_1=3")


def test_nothing_is_sampled_before_the_first_stop(capsys):
    said = output_of(capsys, "run", "--set", "run.t_end_s=2", "--robots", "1")
    assert "INCOMPLETE: the robot is undecided" in said
    assert "No robot took a sample." in said


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ([], "more than 381 observations, own and received (decision.min_observations); the most that one had is "),
        (["decision.gate=own", "decision.min_observations=4"], "more than 4 own samples (decision.min_observations)"),
        (["decision.min_observations=0"], None),
        (["strategy.name=places"], None),
        (["task.name=share"], None),
    ],
)  # fmt: skip
def test_a_gate_that_no_robot_reached_is_said(capsys, settings, words):
    said = words_of(
        capsys, "run", "--set", "run.t_end_s=20", *(word for one in settings for word in ("--set", one))
    )
    assert (f"No robot was allowed to decide: that takes {words}" in said) if words else "allowed" not in said


def test_the_swarm_words_of_each_outcome(capsys):
    easy = ["--floor", "stripe:0.48", "--set", "run.t_end_s=300", "--set", "decision.min_observations=5"]
    assert "CONSENSUS, RIGHT: all 3 robots decided 'more than 3 % vibrates' by" in output_of(
        capsys, "run", *easy, "--set", "decision.decision_boundary=0.03", "--robots", "3"
    )
    assert "CONSENSUS, WRONG: all 5 robots decided 'less than 3 % vibrates'" in output_of(
        capsys, "run", *easy, "--set", "decision.decision_boundary=0.03", "--set", "sensor.rms_threshold=50"
    )
    assert "neither is right" in output_of(
        capsys, "run", *easy, "--set", "decision.decision_boundary=0.48", "--set", "sensor.rms_threshold=50"
    )


BAD = {
    "--floor nowhere.txt": ("nowhere.txt", "no such file"),
    "--floor diagnal:0.46": ("--floor", "did you mean 'diagonal:0.46'?"),
    "--floor random:0.47": ("0.47", "0.44"),
    "--floor patch:0.1@7": ("--floor", "a contrast of 'patch:0.1@7' is 7"),
    "--set floor.source=diagnal:0.46": ("floor.source", "did you mean 'diagonal:0.46'?"),
    "--floor diagonal:0.46 --tiles 3x3": ("--tiles", "3x3"),
    "--tiles 5": ("--tiles", "5"),
    "--tiles 5x5 --floor .": (".", "folder"),
    "--preset papr": ("preset", "did you mean 'paper'?"),
    "--strategy sof": ("--strategy", "did you mean 'soft'?"),
    "--strategy none,soft": ("vibroswarm evaluate --strategy none,soft",),
    "--strategy none,sofd": ("unknown strategy",),
    "--robots many": ("--robots", "'many' is not a whole number"),
    f"--seed {'9' * 400}": ("--seed", "is not a whole number"),
    "--robots 0": ("swarm.robots", "0 is wrong"),
    "--robots 901": ("swarm.robots", "at most 900"),
    "--robots -3": ("swarm.robots", "-3"),
    "--seed -1": ("seed", "-1"),
    "--seed 9223372036854775808": ("seed", "2^63"),
    "--seed x": ("--seed", "'x' is not a whole number"),
    "--scenario nowhere.toml": ("nowhere.toml", "cannot be read"),
    "--energies nowhere.csv": ("nowhere.csv", "cannot be read"),
    "--set walk.gamma=3": ("walk.gamma", "no such field"),
    "--set strategy.nam=soft": ("strategy.nam", "did you mean 'strategy.name'?"),
    "--set walk": ("--set", "section.field=value"),
    "--set walk=3": ("walk", "is a section"),
    "--set walk.=3": ("walk.", "there is no such field"),
    "--set rays.side_m=0,0.01": ("rays.side_m", "give a list, such as [0,0.01]"),
    "--set run.t_end_s=nan": ("run.t_end_s", "nan"),
    "--set run.t_end_s=inf": ("run.t_end_s", "inf"),
    "--set run.t_end_s=-5": ("run.t_end_s", "-5"),
    "--set run.t_end_s=0": ("run.t_end_s", "0"),
    "--set run.t_end_s=1e-9": ("run.t_end_s: 1e-09 s has no control period (20 ms)",),
    "--set run.t_end_s=8400": ("robot.battery_life_s", "empty"),
    "--set walk.leg_min_ms=40000": ("walk.leg_min_ms", "40000"),
    "--set strategy.name=7": ("strategy.name", "7"),
    "--set swarm.robots=2.5": ("swarm.robots", "2.5"),
    "--set arena.width_m=0.02": ("arena.width_m", "does not fit"),
    "--set floor.left_m=3": ("floor.left_m: at 3 m", "outside the arena of 1 m"),
    "--set floor.bottom_m=-1": ("floor.bottom_m: at -1 m", "outside the arena of 1 m"),
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


def test_a_file_in_the_way_is_refused(tmp_path, capsys):
    (tmp_path / "out").write_text("mine")
    assert "is a file" in refusal_of(capsys, "run", *SHORT, "--out", tmp_path / "out", "--force")
    assert run(*SHORT, "--out", str(tmp_path / "out" / "deeper")) == 2
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize("out", [".", "..", "../here"])
def test_the_working_folder_is_never_replaced(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A study ended with a traceback, a run was lost, and the page of a third stood in a folder that was gone."""
    place = tmp_path / "here"
    place.mkdir()
    monkeypatch.chdir(place)
    assert "is the working folder or holds it" in refusal_of(capsys, "run", *SHORT, "--out", out)
    Path(out, "vibroswarm.json").write_text("")
    assert "is the working folder or holds it" in refusal_of(
        capsys, "evaluate", "--runs", "1", "--out", out, "--force"
    )
    assert place.samefile(".")


def test_an_empty_path_is_not_the_working_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--out: is empty; give a path" in refusal_of(capsys, "run", *SHORT, "--out", "")


@pytest.mark.parametrize("where", ["frame", "picture"])
def test_a_disk_that_fills_up_leaves_nothing_and_ends_with_1(where, tmp_path, monkeypatch, capsys):
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    if where == "frame":
        monkeypatch.setattr(Path, "write_bytes", full)
    else:
        monkeypatch.setattr("matplotlib.figure.Figure.savefig", full)
    assert run(*SHORT, "--pictures", "--out", str(tmp_path / "out")) == 1
    assert "No space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


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


def test_no_display_and_no_home_are_needed(tmp_path):
    bare = {"PATH": os.environ["PATH"], "HOME": str(tmp_path / "nobody"), "VIBROSWARM_PLAIN": "1"}
    tiny = ["--set", "run.t_end_s=6", "--robots", "2"]
    process = command("run", *tiny, "--pictures", "--out", str(tmp_path / "out"), env=bare)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    assert Path(tmp_path / "out" / "run.png").stat().st_size > 1000


INVALID_PRODUCT = """
import numpy as np
from vibroswarm.motion.event.event_run import EventRun
move_on = EventRun.move_on
def with_a_product(self, until):
    np.float64(np.inf) * np.float64(0.0)
    return move_on(self, until)
EventRun.move_on = with_a_product
"""


def test_plain_python_warns_of_nothing() -> None:
    """What compiled code does without a word, NumPy warns of: "invalid value encountered". The control does so."""
    options = ["run", "--plain", "--robots", "10", "--set", "run.t_end_s=40"]
    program = f"""
import sys
from vibroswarm.cli import main
assert main({options}) == 0
print("CONTROL", file=sys.stderr)
{INVALID_PRODUCT}
sys.exit(main({[*options[:-1], "run.t_end_s=1"]}))
"""
    plain = os.environ | {"VIBROSWARM_PLAIN": "1"}
    process = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, env=plain, timeout=300, check=False
    )
    assert process.returncode == 0, process.stderr
    told, control = process.stderr.split("CONTROL")
    for words, is_control in ((told, False), (control, True)):
        warned = any("Warning" in line or "encountered" in line for line in words.splitlines())
        assert warned == is_control, words


def test_help_and_version(capsys):
    for option in ("--version", "-V"):
        assert output_of(capsys, option).startswith("vibroswarm 0.")
    assert "did you mean 'run'?" in refusal_of(capsys, "rnu")
    assert "run one inspection" in output_of(capsys)


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


RUN = "run --set run.t_end_s=30"
STUDY = "evaluate --runs 2 --no-confirm --no-pictures --set run.t_end_s=30"
LEAGUE = "league --strategy none,soft --patterns random --fills 0.4 --runs 2 --belief-runs 0 --fault-runs 0"
SHOWN = {
    "run": RUN,
    "study": STUDY,
    "run near edges": f"{RUN} --preset calibrated",
    "study near edges": f"{STUDY} --preset calibrated",
    "league near edges": f"{LEAGUE} --preset calibrated --set run.t_end_s=30",
    "run at places": f"{RUN} --set sensor.model=acceleration",
    "study at places": f"{STUDY} --set sensor.model=acceleration",
}


@pytest.mark.usefixtures("empty_pictures")
def test_results_are_shown_without_compiling_but_readings_near_edges_or_at_places(tmp_path, monkeypatch):
    """Error rates of such readings would take minutes without; a league is shown as its tables were saved."""
    monkeypatch.chdir(tmp_path)
    for name, words in SHOWN.items():
        assert main([*words.split(), "--out", name]) == 0
    without = [name for name in SHOWN if not needs_kernels(Path(name))]
    assert without == ["run", "study", "league near edges"]
    seen = {"polars", "numba", "scipy.stats"}
    shown = loaded_by(*(["show", name] for name in without), packages=seen)
    assert list(shown.values()) == [{"polars"}] * 3
    with_kernels = loaded_by(["show", "run near edges"], packages=seen)
    assert list(with_kernels.values()) == [{"polars", "numba"}]


def test_sensors_with_a_formula_are_those_that_measure_no_place():
    assert set(LAWFUL) == {name for name, sensor in sensors.known().items() if sensor.sense is None}


def test_a_second_run_loads_no_more_than_it_needs(tmp_path):
    line = ["run", "--set", "run.t_end_s=30", "--out", str(tmp_path / "out")]
    packages = loaded_by(
        line, packages={"scipy.special", "scipy.stats", "matplotlib", "PIL", "numpy.f2py.crackfortran"}
    )
    assert packages[" ".join(line)] == {"scipy.special"}


def test_a_module_that_was_put_off_is_loaded_when_it_is_used():
    program = """
import sys
from vibroswarm.cli.put_off import put_off
put_off("numpy", "f2py")
put_off("numpy", "f2py")
put_off("numpy", "no_such_module")
import numpy, scipy.special
assert "numpy.f2py.crackfortran" not in sys.modules
assert callable(numpy.f2py.get_include)
assert "numpy.f2py.crackfortran" in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize(("of_user", "threads"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_linear_algebra_has_one_thread_unless_the_user_wants_more(of_user, threads):
    program = """
import os, sys
from vibroswarm.cli import main
sys.argv = ["vibroswarm", "--version"]
assert main() == 0
from threadpoolctl import threadpool_info
import numpy
most = max((library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"), default=1)
print(os.environ["OPENBLAS_NUM_THREADS"], most)
"""
    env = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | of_user
    told = subprocess.run(
        [sys.executable, "-c", program], env=env, capture_output=True, text=True, check=True
    )
    asked, most = told.stdout.splitlines()[-1].split()
    assert asked == threads
    assert int(most) <= int(threads)  # fewer where the machine has fewer cores
